//! Range filter: a first-order Butterworth low-pass over the points of a sweep, forwards and then
//! backwards, so it does not shift pulses. It passes structures as wide as the pulse. One pulse
//! width at either end, where the filter has not settled, is removed.

use num_complex::{Complex, Complex64};

use super::Sampling;
use radar_sar::RangeAxis;
use radar_sar::math;

/// The filter for one range axis.
#[derive(Debug, Clone)]
pub(super) struct RangeFilter {
    points: usize,
    /// Points removed at either end.
    margin: usize,
    axis: RangeAxis,
    /// Gain of the current and the previous input.
    gain: f64,
    /// Weight of the previous output.
    feedback: f64,
}

impl RangeFilter {
    pub fn new(sampling: &Sampling) -> Self {
        let Sampling { axis, profile, .. } = *sampling;
        // Cut-off as a fraction of half the sampling rate: one step per pulse width.
        let cut_off = (axis.step_m / profile.envelope_fwhm_m()).clamp(1e-6, 0.99);
        // Bilinear transform of the analogue low-pass.
        let k = math::tan(std::f64::consts::FRAC_PI_2 * cut_off);
        let margin = (profile.envelope_fwhm_m() / axis.step_m).round() as usize;
        let left = axis.points.saturating_sub(2 * margin);
        let cropped = RangeAxis { first_m: axis.range_m(margin), points: left, ..axis };
        Self { points: axis.points, margin, axis: cropped, gain: k / (1.0 + k), feedback: (1.0 - k) / (1.0 + k) }
    }

    /// Range axis of the output.
    pub fn axis(&self) -> &RangeAxis {
        &self.axis
    }

    /// Filters a sweep and removes its ends; `None` if its length differs from the axis.
    pub fn filtered(&self, sweep: &[Complex<i16>]) -> Option<Vec<Complex64>> {
        if sweep.len() != self.points || sweep.is_empty() {
            return None;
        }
        let mut values: Vec<Complex64> =
            sweep.iter().map(|s| Complex64::new(f64::from(s.re), f64::from(s.im))).collect();
        for _ in 0..2 {
            self.pass(&mut values);
            values.reverse();
        }
        Some(values.split_off(self.margin.min(values.len())).into_iter().take(self.axis.points).collect())
    }

    /// Filters forwards, with the first value as the initial state.
    fn pass(&self, values: &mut [Complex64]) {
        let Some(&first) = values.first() else { return };
        let (mut input, mut output) = (first, first);
        for value in values {
            let next = (*value + input) * self.gain + output * self.feedback;
            (input, output) = (*value, next);
            *value = next;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baselines::DetectorConfig;
    use radar_sar::envelope;

    #[test]
    fn filter_passes_constants_and_does_not_shift_pulses() {
        let sampling = DetectorConfig::default().sampling();
        let filter = RangeFilter::new(&sampling);
        let ones = vec![Complex::new(1000, -500); sampling.axis.points];
        assert!(filter.filtered(&ones).unwrap().iter().all(|z| (z - Complex64::new(1000.0, -500.0)).norm() < 1e-6));
        let at_m = 0.4;
        let pulse = |n: usize| 2000.0 * envelope(sampling.profile.envelope_fwhm_m(), sampling.axis.range_m(n) - at_m);
        let sweep: Vec<_> = (0..sampling.axis.points).map(|n| Complex::new(pulse(n) as i16, 0)).collect();
        let filtered = filter.filtered(&sweep).unwrap();
        let greatest = (0..filtered.len()).max_by(|&a, &b| filtered[a].re.total_cmp(&filtered[b].re)).unwrap();
        assert!((filter.axis().range_m(greatest) - at_m).abs() <= filter.axis().step_m);
        assert!(filter.filtered(&sweep[1..]).is_none());
    }

    #[test]
    fn filter_removes_fast_ripples() {
        let sampling = DetectorConfig::default().sampling();
        let filter = RangeFilter::new(&sampling);
        let ripple: Vec<_> = (0..sampling.axis.points).map(|n| Complex::new([100, 0, -100, 0][n % 4], 0)).collect();
        // Except for the transients from the edges, one pulse width away.
        assert!(filter.filtered(&ripple).unwrap().iter().all(|z| z.norm() < 6.0));
    }
}

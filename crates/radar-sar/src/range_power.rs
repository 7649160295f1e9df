//! Power over range, sweep by sweep: the terms of `ls`, with ranges of known reflectors masked.
//!
//! For a reflector of unknown amplitude and phase in every sweep, Σ |z|²/σ² is the log-likelihood
//! of its position.

use glam::DVec3;
use num_complex::{Complex32, Complex64};
use rayon::prelude::*;

use super::compression::compress_all;
use super::{CompressedSweep, sweep_noise_rms};
use crate::geometry::Plane;
use crate::math;
use crate::{Beam, Observation, PHASE_RAD_PER_M};

/// An interval of one sweep's range that a known reflector accounts for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaskedRange {
    /// Middle of the interval, metres.
    pub middle_m: f64,
    /// Half of its length, metres.
    pub half_m: f64,
}

/// Noise-normalised, range-compressed sweeps.
#[derive(Debug)]
pub struct RangePower<'a> {
    observations: &'a [Observation],
    compressed: Vec<CompressedSweep>,
    beam: &'a Beam,
    min_range_m: f64,
    /// `[sweep]`: masked intervals.
    masks: Vec<Vec<MaskedRange>>,
}

/// One sweep's measurement at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Index of the sweep.
    pub sweep: usize,
    /// Distance from the sensor when the point at that range was sampled, metres.
    pub distance_m: f64,
    /// |z|²/σ².
    pub power: f64,
    /// Derivative of the power with respect to distance, per metre.
    pub slope_per_m: f64,
    /// Curvature of the log-likelihood due to the pulse, per m²: 8 ln2 · power / FWHM².
    pub curvature_per_m2: f64,
    /// Length from the phase minus the distance, metres, within ±λ/4 and up to an offset shared by
    /// all sweeps.
    pub phase_off_m: f64,
}

impl<'a> RangePower<'a> {
    /// Compresses sweeps; points nearer than `min_range_m` do not count.
    pub fn new(observations: &'a [Observation], beam: &'a Beam, min_range_m: f64) -> Self {
        let compressed = compress_all(observations, |o| (1.0 / echo_free_noise_rms(o)) as f32);
        let masks = vec![Vec::new(); observations.len()];
        Self { observations, compressed, beam, min_range_m, masks }
    }

    /// The same sweeps with motion within a sweep compensated for an echo from `place`: removes the
    /// phase that the sensor's motion between points of a sweep adds (at 1 m/s a radian over a 14
    /// cm pulse). Echoes from near there then have a flat phase.
    pub(super) fn motion_compensated(&self, place: DVec3) -> Self {
        let motion_compensated = self.observations.iter().map(|observation| {
            let from_mid = place - observation.tracking_from_sensor.translation;
            let seen_m = observation.distance_m(place);
            let turned = |(n, sample): (usize, &Complex32)| {
                let moved_m = (from_mid - observation.velocity_m_per_s * observation.point_time_s(n as f64)).length();
                let turn = math::from_polar(1.0, -PHASE_RAD_PER_M * (moved_m - seen_m));
                sample * Complex32::new(turn.re as f32, turn.im as f32)
            };
            Observation { samples: observation.samples.iter().enumerate().map(turned).collect(), ..observation.clone() }
        });
        let motion_compensated: Vec<Observation> = motion_compensated.collect();
        // Turning a sample keeps its power, so the noise is that of the original sweep.
        let compressed = compress_all(&motion_compensated, |o| (1.0 / echo_free_noise_rms(o)) as f32);
        Self { compressed, masks: self.masks.clone(), ..*self }
    }

    /// The underlying sweeps.
    pub fn observations(&self) -> &'a [Observation] {
        self.observations
    }

    /// Distance from a sweep to a point, if the sweep counts for it and the range is not masked.
    fn distance_m(&self, sweep: usize, place: DVec3) -> Option<f64> {
        let observation = &self.observations[sweep];
        let distance_m = observation.distance_m(place);
        let counts = distance_m >= self.min_range_m
            && distance_m > 0.0
            && observation.geometry.axis.contains(distance_m)
            && self.beam.amplitude(observation.cos_off_boresight(place)) > 0.0;
        let claimed = |c: &MaskedRange| (distance_m - c.middle_m).abs() < c.half_m;
        (counts && !self.masks[sweep].iter().any(claimed)).then_some(distance_m)
    }

    /// Sum over sweeps of (|z|²/σ² − 1), and the number of sweeps. For noise the sum has mean 0 and
    /// the count as variance.
    pub fn excess(&self, place: DVec3) -> (f64, usize) {
        let each = (0..self.observations.len())
            .filter_map(|sweep| self.distance_m(sweep, place).map(|d| self.compressed[sweep].at(d).norm_sqr() - 1.0));
        each.fold((0.0, 0), |(sum, count), excess| (sum + excess, count + 1))
    }

    /// A sweep's distance to a point, z/σ there and its derivative with respect to distance, if the
    /// sweep counts for it.
    pub(super) fn echo(&self, sweep: usize, place: DVec3) -> Option<(f64, Complex64, Complex64)> {
        let distance_m = self.distance_m(sweep, place)?;
        let (z, slope) = self.compressed[sweep].value_and_slope(distance_m);
        Some((distance_m, z, slope))
    }

    /// Every sweep's measurement at a point.
    pub fn readings(&self, place: DVec3) -> Vec<Reading> {
        let reading = |sweep: usize| {
            let (distance_m, z, slope) = self.echo(sweep, place)?;
            let width_m = self.observations[sweep].geometry.pulse_fwhm_m;
            let power = z.norm_sqr();
            Some(Reading {
                sweep,
                distance_m,
                power,
                slope_per_m: 2.0 * (z.conj() * slope).re,
                curvature_per_m2: 8.0 * std::f64::consts::LN_2 * power / (width_m * width_m),
                phase_off_m: math::arg(z * math::from_polar(1.0, -PHASE_RAD_PER_M * distance_m)) / PHASE_RAD_PER_M,
            })
        };
        (0..self.observations.len()).filter_map(reading).collect()
    }

    /// The excess at many points, in parallel.
    pub fn excess_at(&self, places: &[DVec3]) -> Vec<(f64, usize)> {
        places.par_iter().map(|&place| self.excess(place)).collect()
    }

    /// Masks the ranges of a reflector at a point: as far as its pulse exceeds the noise, plus 2
    /// cm.
    pub fn mask_point(&mut self, place: DVec3) {
        self.mask_at(|observation| observation.distance_m(place));
    }

    /// Masks the ranges of a specular plane.
    pub fn mask_plane(&mut self, plane: &Plane) {
        self.mask_at(|observation| plane.distance(observation.tracking_from_sensor.translation));
    }

    fn mask_at(&mut self, distance_m: impl Fn(&Observation) -> f64) {
        for (sweep, observation) in self.observations.iter().enumerate() {
            let middle_m = distance_m(observation);
            let axis = &observation.geometry.axis;
            let clamped = middle_m.clamp(axis.first_m, axis.last_m());
            let power = self.compressed[sweep].at(clamped).norm_sqr();
            let half_width_m = observation.geometry.pulse_fwhm_m * 0.5;
            let half_m = half_width_m * math::log2(1.0 + 20.0 * power).sqrt() + 0.02;
            self.masks[sweep].push(MaskedRange { middle_m, half_m });
        }
    }
}

/// Complex noise rms of a sweep with its echoes excluded: the median over points at least a pulse
/// away from any point louder than [`ECHO_POWER`] times the plain estimate. The plain estimate when
/// fewer than half of the points remain.
fn echo_free_noise_rms(observation: &Observation) -> f64 {
    let samples = &observation.samples;
    let plain = sweep_noise_rms(samples);
    // Noise alone exceeds this in one sweep of thirty.
    let loud = ECHO_POWER * plain * plain;
    let geometry = &observation.geometry;
    let near = (geometry.pulse_fwhm_m / geometry.axis.step_m).ceil() as usize;
    let mut last_loud: Option<usize> = None;
    let mut lit = vec![false; samples.len()];
    for (n, sample) in samples.iter().enumerate() {
        if f64::from(sample.norm_sqr()) > loud {
            lit[n.saturating_sub(near)..n].fill(true);
            last_loud = Some(n);
        }
        lit[n] |= last_loud.is_some_and(|last| n - last <= near);
    }
    let quiet: Vec<Complex32> = samples.iter().zip(&lit).filter(|(_, lit)| !**lit).map(|(x, _)| *x).collect();
    if 2 * quiet.len() >= samples.len() { sweep_noise_rms(&quiet) } else { plain }
}

/// Power over noise that noise exceeds in one of 10 000 points. Physics: the power of complex
/// Gaussian noise is exponential, and e⁻⁹·² = 10⁻⁴.
const ECHO_POWER: f64 = 9.2;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_data::{Echo, sweeps};

    const AT: DVec3 = DVec3::new(0.1, 0.0, -1.3);

    #[test]
    fn an_echo_does_not_raise_the_noise() {
        // With points every 6 cm, a strong pulse covers a tenth of them. The data's noise is 20
        // LSB.
        let lit = sweeps(0.2, |_| DVec3::ZERO, &[(Echo::Point(AT), 200.0)], 5);
        let mean = |rms: fn(&Observation) -> f64| lit.iter().map(|o| rms(o).powi(2)).sum::<f64>() / lit.len() as f64;
        let (plain, quiet) = (mean(|o| sweep_noise_rms(&o.samples)).sqrt(), mean(echo_free_noise_rms).sqrt());
        assert!(plain > 21.0 && (quiet / 20.0 - 1.0).abs() < 0.04, "{plain} {quiet}");
    }

    #[test]
    fn motion_compensated_echo_has_a_flat_phase() {
        // 2 m/s towards the point: between two points 6 cm apart the sensor moves by 36 µm.
        let fast = sweeps(0.02, |t| DVec3::NEG_Z * 2.0 * t, &[(Echo::Point(AT), 1000.0)], 5);
        let power = RangePower::new(&fast, &Beam::Lensless, 0.15);
        let turning = |power: &RangePower| {
            let (_, z, slope) = power.echo(10, AT).unwrap();
            (slope / z).im
        };
        // Half of k·v·(time per metre): the matched filter sees half of the ramp.
        let expected = 0.5 * PHASE_RAD_PER_M * 2.0 * 1.8e-5 / 0.06;
        assert!((turning(&power).abs() / expected - 1.0).abs() < 0.1, "{} {expected}", turning(&power));
        assert!(turning(&power.motion_compensated(AT)).abs() < 0.1 * expected);
    }
}

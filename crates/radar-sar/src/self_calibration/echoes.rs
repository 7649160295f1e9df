//! Echoes of a few consecutive sweeps: peaks of their mean power over range with the shape of one
//! pulse.

use std::sync::Arc;

use num_complex::Complex32;

use crate::compression::CompressionScratch;
use crate::math;
use crate::{CompressedSweep, RangeCompressor, subaperture_noise_rms, sweep_noise_rms};
use crate::{Observation, SweepGeometry};

/// Sweeps within this time are evaluated together, nanoseconds. Choice: at 1 m/s an object moves by
/// a twentieth of the pulse.
const GROUP_NS: i64 = 8_000_000;
/// Least number of sweeps for estimating the noise point by point. Choice: a median over fewer is
/// no better than each sweep's own estimate.
const MANY_SWEEPS: usize = 4;
/// Least |z|²/σ² of an echo, summed over the sweeps. Choice: the range's error is then about 1 cm
/// for profile 3; weaker echoes cost work and say little.
const MIN_POWER_SUM: f64 = 40.0;
/// Least mean |z|²/σ² of an echo. Choice: noise reaches it in three of 10 000 points.
const MIN_POWER: f64 = 8.0;
/// Permitted curvature of the peak relative to that of one pulse, 8 ln2 / FWHM² (of ln |z|²);
/// overlapping pulses differ from it. Choice: at the least power noise changes the curvature by
/// about a fifth.
const CURVATURE_SHARE: [f64; 2] = [0.6, 1.6];

/// One echo of a group of sweeps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Echo {
    /// When its point was sampled, host nanoseconds of the sweep stream.
    pub time_ns: i64,
    /// Its range, metres.
    pub range_m: f64,
    /// Variance of the range due to noise, m².
    pub variance_m2: f64,
    /// Phase at that range in the group's middle sweep, rad, and the time its point was sampled.
    pub phase_rad: f64,
    pub phase_time_ns: i64,
    /// Logarithm of its amplitude without the noise's share, in units common to the subsweep.
    pub ln_amplitude: f64,
}

/// Extracts the echoes of one subsweep.
#[derive(Debug)]
pub(super) struct EchoReader {
    geometry: Arc<SweepGeometry>,
    compressor: RangeCompressor,
    group: Vec<(i64, Vec<Complex32>)>,
    room: CompressionScratch,
    min_range_m: f64,
}

impl EchoReader {
    pub fn new(geometry: &Arc<SweepGeometry>, min_range_m: f64) -> Self {
        Self {
            geometry: Arc::clone(geometry),
            compressor: RangeCompressor::new(geometry),
            group: Vec::new(),
            room: CompressionScratch::default(),
            min_range_m,
        }
    }

    /// Adds a sweep; returns the echoes of the group that it closes.
    pub fn push(&mut self, observation: &Observation) -> Option<Vec<Echo>> {
        let closes = self.group.first().is_some_and(|first| observation.mid_time_ns - first.0 >= GROUP_NS);
        let echoes = closes.then(|| self.echoes());
        if closes {
            self.group.clear();
        }
        self.group.push((observation.mid_time_ns, observation.samples.clone()));
        echoes
    }

    fn echoes(&mut self) -> Vec<Echo> {
        let sweeps = self.group.len() as f64;
        let first_ns = self.group[0].0;
        let mean_ns = first_ns + self.group.iter().map(|(t, _)| t - first_ns).sum::<i64>() / self.group.len() as i64;
        let noise_rms = match self.group.len() >= MANY_SWEEPS {
            true => subaperture_noise_rms(self.group.iter().map(|(_, samples)| samples.as_slice())),
            false => self.group.iter().map(|(_, samples)| sweep_noise_rms(samples)).sum::<f64>() / sweeps,
        };
        let middle = self.group.len() / 2;
        let (power, middle_sweep) = self.mean_power((1.0 / noise_rms) as f32, middle);
        let CompressedSweep { first_m, step_m, .. } = middle_sweep;
        let geometry = &self.geometry;
        let pulse_curvature = 8.0 * std::f64::consts::LN_2 / geometry.pulse_fwhm_m.powi(2);
        let echo = |around: usize| {
            let (entry, peak, curvature) = peak(&power[around - 1..=around + 1])?;
            let range_m = first_m + (around as f64 + entry) * step_m;
            let share = curvature / (step_m * step_m) / pulse_curvature;
            let sound = peak >= MIN_POWER.max(MIN_POWER_SUM / sweeps)
                && (CURVATURE_SHARE[0]..=CURVATURE_SHARE[1]).contains(&share)
                && range_m >= self.min_range_m
                && geometry.axis.contains(range_m);
            let point = geometry.axis.point_at(range_m) - (geometry.axis.points as f64 - 1.0) / 2.0;
            let point_ns = (point * geometry.point_period_s * 1e9).round() as i64;
            sound.then(|| Echo {
                time_ns: mean_ns + point_ns,
                range_m,
                variance_m2: 1.0 / (pulse_curvature * peak * sweeps),
                phase_rad: math::arg(middle_sweep.at(range_m)),
                phase_time_ns: self.group[middle].0 + point_ns,
                ln_amplitude: 0.5 * math::ln(peak - 1.0) + math::ln(noise_rms),
            })
        };
        (1..power.len().saturating_sub(1)).filter_map(echo).collect()
    }

    /// Mean |z|² of the group over range, and its middle sweep, each scaled by `scale` first.
    fn mean_power(&mut self, scale: f32, middle: usize) -> (Vec<f64>, CompressedSweep) {
        let Self { compressor, group, room, .. } = self;
        let (mut power, mut middle_z) = (vec![0.0; compressor.entries()], Vec::new());
        for (n, (_, samples)) in group.iter().enumerate() {
            compressor.compress_in(samples, scale, room);
            for (sum, (re, im)) in power.iter_mut().zip(room.re.iter().zip(&room.im)) {
                *sum += f64::from(re * re + im * im);
            }
            if n == middle {
                middle_z = room.re.iter().zip(&room.im).map(|(re, im)| Complex32::new(*re, *im)).collect();
            }
        }
        power.iter_mut().for_each(|sum| *sum /= group.len() as f64);
        (power, CompressedSweep { first_m: compressor.first_m(), step_m: compressor.step_m(), z: middle_z })
    }
}

/// Peak of the parabola through three logarithms: its position (−1 to 1, relative to the middle
/// one), value and curvature; `None` when the middle one is not a maximum.
fn peak(three: &[f64]) -> Option<(f64, f64, f64)> {
    if !(three[1] > three[0] && three[1] >= three[2] && three[0] > 0.0 && three[2] > 0.0) {
        return None;
    }
    let [a, b, c] = [math::ln(three[0]), math::ln(three[1]), math::ln(three[2])];
    let curvature = 2.0 * b - a - c;
    let at = 0.5 * (c - a) / curvature;
    Some((at, math::exp(b + 0.25 * (c - a) * at), curvature))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_data::{Echo as Source, sweeps, winding};
    use glam::DVec3;

    /// Range errors of the echoes of a point, in their own standard deviations.
    fn errors(sources: &[(Source, f64)], at: DVec3) -> Vec<f64> {
        let observations = sweeps(0.5, winding, sources, 3);
        let mut reader = EchoReader::new(&observations[0].geometry, 0.2);
        let echoes = observations.iter().filter_map(|o| reader.push(o)).flatten();
        let error = |e: Echo| {
            let time_s = (e.time_ns - 1_000_000_000) as f64 * 1e-9;
            (e.range_m - at.distance(winding(time_s))) / e.variance_m2.sqrt()
        };
        echoes.map(error).collect()
    }

    #[test]
    fn range_errors_match_their_stated_variance() {
        let at = DVec3::new(0.2, 0.1, -1.2);
        let errors = errors(&[(Source::Point(at), 8.0)], at);
        assert!((55..=63).contains(&errors.len()), "{}", errors.len());
        let mean_square = errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64;
        assert!((0.6..1.5).contains(&mean_square), "{mean_square}");
    }

    #[test]
    fn noise_has_no_echoes() {
        assert!(errors(&[], DVec3::ZERO).is_empty());
    }
}

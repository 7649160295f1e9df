//! Jitter of a sweep's phase and amplitude, which multiplies every echo.
//!
//! Three parts, all measured on static scenes of the vendor's recordings: a white one that differs
//! from sweep to sweep and, beyond 5 cm, from point to point; one with a memory of a millisecond and
//! a slow one with a memory of some hundredths of a second, both common to all points and subsweeps.
//! So the second and third are what a loopback sees too.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use a121::Subsweep;
use radar_sar::math;

/// Phase jitter with HWAAS 8, radians rms, and the power of HWAAS by which it falls. Measured:
/// 0.088 to 0.10 rad with HWAAS 8, 0.071 with 32, 0.055 with 60 (profile 3), 0.12 to 0.135 with 2
/// (profile 1).
const PHASE_AT_HWAAS_8_RAD: f64 = 0.094;
const HWAAS_POWER: f64 = -0.266;
/// Amplitude jitter, relative rms. Measured: 3 %.
const AMPLITUDE_RMS: f64 = 0.03;
/// Share of the power without memory, and the memory of the rest, seconds. Measured: correlation of
/// 0.33, 0.23, 0.12 at lags of 0.4, 0.8, 1.6 ms; of 0.4 between a loopback and an echo in a sweep,
/// 0.80 to 0.87 in the mean of ten.
const WHITE_SHARE: f64 = 0.54;
const MEMORY_S: f64 = 1.2e-3;
/// Distance over which the part without memory is correlated along a sweep, metres. Measured:
/// correlation of 0.6 to 0.8 at 30 to 60 mm, 0.5 at 0.25 m.
const MEMORY_M: f64 = 0.05;
/// Slow part, radians rms, and the distance of its knots, seconds. Measured: means of frames differ by
/// 0.04 to 0.055 rad rms; at 50 Hz neighbours are correlated by 0.2, the next ones by 0.05.
const SLOW_RMS_RAD: f64 = 0.046;
const SLOW_KNOT_S: f64 = 0.018;

/// Phase jitter of a subsweep, radians rms, without the slow part.
pub fn phase_rms_rad(hwaas: u32) -> f64 {
    PHASE_AT_HWAAS_8_RAD * math::powf(f64::from(hwaas) / 8.0, HWAAS_POWER)
}

/// The slow part at a time, radians; the same on every call.
pub fn slow_phase_rad(seed: u64, time_s: f64) -> f64 {
    let at = time_s / SLOW_KNOT_S;
    let (knot, share) = (at.floor(), at - at.floor());
    let value = |n: f64| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x510_0117);
        rng.set_stream(n as i64 as u64);
        normal(&mut rng)
    };
    // Interpolated so that the power is the same between knots.
    let power = (1.0 - share) * (1.0 - share) + share * share;
    SLOW_RMS_RAD * ((1.0 - share) * value(knot) + share * value(knot + 1.0)) / power.sqrt()
}

/// Jitter of the sweeps of one frame.
#[derive(Debug, Clone)]
pub struct FrameJitter {
    rng: ChaCha8Rng,
    /// What has a memory, standard normal, and its time, seconds.
    common: f64,
    time_s: f64,
}

impl FrameJitter {
    /// At the start of a frame.
    pub fn new(rng: ChaCha8Rng) -> Self {
        Self { rng, common: 0.0, time_s: f64::NEG_INFINITY }
    }

    /// Amplitude and phase, radians, of the factor of each point of a subsweep's next sweep; times
    /// increase.
    pub fn next(&mut self, subsweep: &Subsweep, time_s: f64) -> Vec<(f64, f64)> {
        let memory = memory(time_s - self.time_s);
        self.common = memory * self.common + (1.0 - memory * memory).sqrt() * normal(&mut self.rng);
        self.time_s = time_s;
        let points = subsweep.num_points as usize;
        let along = math::exp(-subsweep.step_m() / MEMORY_M);
        let white = correlated(&mut self.rng, points, along);
        let amplitude = correlated(&mut self.rng, points, along);
        let rms_rad = phase_rms_rad(subsweep.hwaas);
        let (white_rad, common_rad) = (rms_rad * WHITE_SHARE.sqrt(), rms_rad * (1.0 - WHITE_SHARE).sqrt());
        let phase_rad = |white: f64| white_rad * white + common_rad * self.common;
        white.iter().zip(&amplitude).map(|(w, a)| (1.0 + AMPLITUDE_RMS * a, phase_rad(*w))).collect()
    }
}

fn memory(pause_s: f64) -> f64 {
    math::exp(-pause_s.max(0.0) / MEMORY_S)
}

/// Standard normal numbers, neighbours correlated by `along`.
fn correlated(rng: &mut ChaCha8Rng, count: usize, along: f64) -> Vec<f64> {
    let fresh = (1.0 - along * along).sqrt();
    let mut value = normal(rng);
    let next = |_| {
        let this = value;
        value = along * this + fresh * normal(rng);
        this
    };
    (0..count).map(next).collect()
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

#[cfg(test)]
mod tests {
    use super::*;
    use a121::Profile;

    /// Phases of a point and of one that is `apart` points further, over frames of 32 sweeps.
    fn phases(subsweep: &Subsweep, apart: usize, sweep_s: f64) -> Vec<Vec<[f64; 2]>> {
        let frame = |n: u64| {
            let mut jitter = FrameJitter::new(ChaCha8Rng::seed_from_u64(n));
            let sweep = |k: usize| {
                let points = jitter.next(subsweep, k as f64 * sweep_s);
                [points[0].1, points[apart].1]
            };
            (0..32).map(sweep).collect()
        };
        (0..400).map(frame).collect()
    }

    fn mean(values: impl Iterator<Item = f64>) -> f64 {
        let values: Vec<f64> = values.collect();
        values.iter().sum::<f64>() / values.len() as f64
    }

    #[test]
    fn jitter_has_the_measured_size_and_correlations() {
        // The configuration of the recordings that it was measured on: 2445 sweeps a second,
        // profile 3, HWAAS 8, points 30 mm apart.
        let subsweep =
            Subsweep { profile: Profile::P3, hwaas: 8, num_points: 23, step_length: 12, ..Default::default() };
        let frames = phases(&subsweep, 1, 0.409e-3);
        let power = mean(frames.iter().flatten().map(|p| p[0] * p[0]));
        assert!((0.088..0.10).contains(&power.sqrt()), "{}", power.sqrt());
        let lag = |k: usize| mean(frames.iter().flat_map(|f| (k..32).map(|n| f[n][0] * f[n - k][0]))) / power;
        for (k, measured) in [(1, 0.33), (2, 0.23), (4, 0.12)] {
            assert!((lag(k) - measured).abs() < 0.04, "lag {k}: {}", lag(k));
        }
        let range =
            |apart: usize| mean(phases(&subsweep, apart, 0.409e-3).iter().flatten().map(|p| p[0] * p[1])) / power;
        assert!((0.6..0.85).contains(&range(1)) && (0.6..0.85).contains(&range(2)), "{} {}", range(1), range(2));
        assert!((0.45..0.55).contains(&range(8)), "{}", range(8));
    }

    #[test]
    fn more_averages_give_less_jitter_as_measured() {
        for (hwaas, measured) in [(2, 0.12..0.14), (8, 0.088..0.10), (32, 0.06..0.072), (60, 0.05..0.058)] {
            assert!(measured.contains(&phase_rms_rad(hwaas)), "{hwaas}: {}", phase_rms_rad(hwaas));
        }
    }

    #[test]
    fn slow_part_is_continuous_and_forgets() {
        let at = |t: f64| slow_phase_rad(7, t);
        assert_eq!(at(1.234), at(1.234));
        assert!((0..1000).all(|n| (at(f64::from(n) * 1e-3) - at(f64::from(n + 1) * 1e-3)).abs() < 0.02));
        let power = mean((0..20_000).map(|n| at(f64::from(n) * 0.013).powi(2)));
        assert!((power.sqrt() / SLOW_RMS_RAD - 1.0).abs() < 0.05);
        let lag = |s: f64| mean((0..20_000).map(|n| at(f64::from(n) * 0.013) * at(f64::from(n) * 0.013 + s))) / power;
        assert!((0.1..0.4).contains(&lag(0.02)) && lag(0.06).abs() < 0.05, "{} {}", lag(0.02), lag(0.06));
        assert!(at(-5.0).is_finite());
    }
}

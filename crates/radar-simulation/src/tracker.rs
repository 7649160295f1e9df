//! Errors of a headset's tracking: jitter, slow drift, rotation error, dropouts.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use radar_sar::PoseSample;
use radar_sar::geometry::Pose;
use radar_sar::math;

/// Sizes of the tracking errors. The default is typical of good lighthouse tracking.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackingErrors {
    /// Poses per second.
    pub rate_hz: f64,
    /// Standard deviation of each pose in each axis, metres.
    pub jitter_m: f64,
    /// Rms of a slow drift (0.05–0.5 Hz) in each axis, metres.
    pub wander_m: f64,
    /// Length of the error of the mount's translation, in a random direction, metres.
    pub mount_m: f64,
    /// Rms of a slow rotation error about each axis, degrees.
    pub rotation_deg: f64,
    /// Tracking losses per minute, of 50 to 300 ms each.
    pub dropouts_per_minute: f64,
}

impl Default for TrackingErrors {
    fn default() -> Self {
        Self {
            rate_hz: 120.0,
            jitter_m: 0.3e-3,
            wander_m: 1e-3,
            mount_m: 2e-3,
            rotation_deg: 0.1,
            dropouts_per_minute: 0.0,
        }
    }
}

impl TrackingErrors {
    /// Poses without any error.
    pub fn none() -> Self {
        let zero = 0.0;
        Self { jitter_m: zero, wander_m: zero, mount_m: zero, rotation_deg: zero, ..Self::default() }
    }

    /// True mount of the sensor, given the assumed one.
    pub(super) fn true_mount(&self, head_from_sensor: &Pose, seed: u64) -> Pose {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x3007);
        let direction = normal_vector(&mut rng).normalize_or(DVec3::X);
        Pose { translation: head_from_sensor.translation + direction * self.mount_m, ..*head_from_sensor }
    }

    /// Tracked poses along a path, from `first_s` to `last_s`; `time_ns` converts path time to host
    /// time.
    pub(super) fn track(
        &self,
        path: impl Fn(f64) -> Pose,
        (first_s, last_s): (f64, f64),
        time_ns: impl Fn(f64) -> i64,
        seed: u64,
    ) -> Vec<PoseSample> {
        let mut tracker = Tracker::new(*self, seed);
        let steps = ((last_s - first_s) * self.rate_hz).floor() as usize;
        let sample = |i: usize| {
            let time_s = first_s + i as f64 / self.rate_hz;
            let (measured, valid) = tracker.measure(time_s, &path(time_s));
            PoseSample { valid, ..PoseSample::valid(time_ns(time_s), &measured) }
        };
        (0..=steps).map(sample).collect()
    }
}

/// Tracking in progress; measures one pose after the other.
#[derive(Debug, Clone)]
pub(super) struct Tracker {
    errors: TrackingErrors,
    rng: ChaCha8Rng,
    drift: Drift,
    turn: Drift,
    lost_until_s: f64,
}

impl Tracker {
    pub fn new(errors: TrackingErrors, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x7124_C4E2);
        let drift = Drift::new(errors.wander_m, &mut rng);
        let turn = Drift::new(errors.rotation_deg.to_radians(), &mut rng);
        Self { errors, rng, drift, turn, lost_until_s: f64::NEG_INFINITY }
    }

    /// The tracked pose for a true one, and whether it is valid.
    pub fn measure(&mut self, time_s: f64, pose: &Pose) -> (Pose, bool) {
        let TrackingErrors { rate_hz, jitter_m, dropouts_per_minute, .. } = self.errors;
        let jitter = normal_vector(&mut self.rng) * jitter_m;
        let measured = Pose::new(
            pose.translation + self.drift.at(time_s) + jitter,
            DQuat::from_scaled_axis(self.turn.at(time_s)) * pose.rotation,
        );
        let starts = self.rng.random_range(0.0..1.0) < dropouts_per_minute / 60.0 / rate_hz;
        let lasts_s = self.rng.random_range(0.05..0.3);
        if starts {
            self.lost_until_s = time_s + lasts_s;
        }
        (measured, time_s >= self.lost_until_s)
    }
}

/// Three independent standard normal numbers.
pub fn normal_vector(rng: &mut ChaCha8Rng) -> DVec3 {
    DVec3::from_array([(); 3].map(|()| StandardNormal.sample(rng)))
}

/// Slow drift with a given rms: five sines per axis.
#[derive(Debug, Clone)]
struct Drift([[DVec3; 3]; 5]);

impl Drift {
    fn new(rms: f64, rng: &mut ChaCha8Rng) -> Self {
        let amplitude = rms * (2.0f64 / 5.0).sqrt();
        Self([0.05, 0.09, 0.16, 0.28, 0.5].map(|hz: f64| {
            let mut each = |low: f64, high: f64| DVec3::from_array([(); 3].map(|()| rng.random_range(low..high)));
            [DVec3::splat(amplitude), each(0.8, 1.25) * hz * TAU, each(0.0, TAU)]
        }))
    }

    fn at(&self, time_s: f64) -> DVec3 {
        self.0.iter().map(|[a, omega, phase]| *a * (*omega * time_s + *phase).map(math::sin)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tracking_errors_have_the_stated_size_and_dropouts_occur() {
        let errors =
            TrackingErrors { wander_m: 0.0, rotation_deg: 0.0, dropouts_per_minute: 20.0, ..Default::default() };
        let still = |_| Pose::IDENTITY;
        let track = errors.track(still, (0.0, 60.0), |t| (t * 1e9) as i64, 5);
        let n = track.len() as f64;
        let rms = (track.iter().map(|p| p.position_m[0].powi(2)).sum::<f64>() / n).sqrt();
        assert!((rms / 0.3e-3 - 1.0).abs() < 0.05, "{rms}");
        let lost = track.iter().filter(|p| !p.valid).count() as f64 / n;
        assert!((0.01..0.15).contains(&lost), "{lost}");
        assert!(track.windows(2).all(|w| w[0].time_ns < w[1].time_ns));
    }

    #[test]
    fn drift_has_the_stated_rms() {
        let errors = TrackingErrors { jitter_m: 0.0, ..Default::default() };
        let mean_square = |seed| {
            let track = errors.track(|_| Pose::IDENTITY, (0.0, 60.0), |t| (t * 1e9) as i64, seed);
            track.iter().map(|p| p.position_m[1].powi(2)).sum::<f64>() / track.len() as f64
        };
        let rms = ((0..20).map(mean_square).sum::<f64>() / 20.0).sqrt();
        assert!((rms / 1e-3 - 1.0).abs() < 0.15, "{rms}");
    }
}

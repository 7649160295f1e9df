//! Errors of a headset's tracking: jitter, slow drift, rotation error, a bent frame, jumps, wrong
//! stamps, dropouts.

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
    /// Tracking losses per minute, of 50 to 300 ms each. A jump ends each.
    pub dropouts_per_minute: f64,
    /// Rms of an error that depends on the position alone, as of a bent frame, in each axis, metres.
    pub distortion_m: f64,
    /// Jumps of the tracking frame per minute, beside those after losses.
    pub jumps_per_minute: f64,
    /// Length of a jump, in a random direction, metres.
    pub jump_m: f64,
    /// Angle of a jump, about a random axis, degrees.
    pub jump_deg: f64,
    /// Rms error of the poses' stamps, seconds; at most 45 % of their distance, so that they rise.
    pub stamp_s: f64,
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
            distortion_m: 0.0,
            jumps_per_minute: 0.0,
            jump_m: 0.0,
            jump_deg: 0.0,
            stamp_s: 0.0,
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
            tracker.measure(time_s, &path(time_s)).sample(&time_ns)
        };
        (0..=steps).map(sample).collect()
    }
}

/// Greatest error of a stamp, as a share of the poses' distance in time. Choice: below a half, so
/// that stamps rise, as those of any driver do.
const MAX_STAMP_ERROR: f64 = 0.45;
/// Share of the offset that remains at the next jump. Choice: a tracker finds back to its map again
/// and again, so that offsets stay as large as jumps are.
const JUMP_MEMORY: f64 = 0.7;
/// Wavelengths of the frame's distortion, metres. Choice: a few over a play area.
const DISTORTION_WAVES_M: (f64, f64) = (2.0, 4.0);

/// A tracked pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TrackedPose {
    /// Time of the true pose, seconds.
    pub time_s: f64,
    /// Stamped time minus true time, seconds.
    pub stamp_error_s: f64,
    /// `tracking_from_head` as measured.
    pub tracking_from_head: Pose,
    /// Whether tracking has not lost the headset.
    pub is_valid: bool,
}

impl TrackedPose {
    /// The sample that a driver gives; `time_ns` converts path time to host time.
    pub fn sample(&self, time_ns: impl Fn(f64) -> i64) -> PoseSample {
        let stamp_ns = time_ns(self.time_s + self.stamp_error_s);
        PoseSample { valid: self.is_valid, ..PoseSample::valid(stamp_ns, &self.tracking_from_head) }
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
    /// What the frame's jumps and the stamps are drawn from.
    jump_rng: ChaCha8Rng,
    distortion: Distortion,
    /// `None` before the first jump.
    frame: Option<Frame>,
}

/// The tracking frame since the last jump: turned about where the head was then, and moved.
#[derive(Debug, Clone, Copy)]
struct Frame {
    pivot_m: DVec3,
    offset_m: DVec3,
    /// Rotation vector.
    offset_rad: DVec3,
}

impl Frame {
    /// `tracked_from_true`.
    fn pose(&self) -> Pose {
        let rotation = DQuat::from_scaled_axis(self.offset_rad);
        Pose::new(self.pivot_m + self.offset_m - rotation * self.pivot_m, rotation)
    }
}

impl Tracker {
    pub fn new(errors: TrackingErrors, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x7124_C4E2);
        let drift = Drift::new(errors.wander_m, &mut rng);
        let turn = Drift::new(errors.rotation_deg.to_radians(), &mut rng);
        let mut jump_rng = ChaCha8Rng::seed_from_u64(seed ^ 0x0A11_0F5E);
        let distortion = Distortion::new(errors.distortion_m, &mut jump_rng);
        let frame = None;
        Self { errors, rng, drift, turn, lost_until_s: f64::NEG_INFINITY, jump_rng, distortion, frame }
    }

    /// `tracked_from_true` since the last jump.
    pub fn frame(&self) -> Pose {
        self.frame.map_or(Pose::IDENTITY, |frame| frame.pose())
    }

    /// The tracked pose for a true one; times increase.
    pub fn measure(&mut self, time_s: f64, pose: &Pose) -> TrackedPose {
        let TrackingErrors { rate_hz, jitter_m, dropouts_per_minute, .. } = self.errors;
        let jitter = normal_vector(&mut self.rng) * jitter_m;
        let starts = self.rng.random_range(0.0..1.0) < dropouts_per_minute / 60.0 / rate_hz;
        let lasts_s = self.rng.random_range(0.05..0.3);
        if starts {
            self.lost_until_s = time_s + lasts_s;
        }
        if starts || self.jump_rng.random_range(0.0..1.0) < self.errors.jumps_per_minute / 60.0 / rate_hz {
            self.jump(pose.translation);
        }
        let error_m = self.drift.at(time_s) + jitter + self.distortion.at(pose.translation);
        let rotation = DQuat::from_scaled_axis(self.turn.at(time_s)) * pose.rotation;
        let in_frame = Pose::new(pose.translation + error_m, rotation);
        let tracking_from_head = self.frame.map_or(in_frame, |frame| frame.pose() * in_frame);
        let stamp_error_s = self.errors.stamp_s * Distribution::<f64>::sample(&StandardNormal, &mut self.jump_rng);
        let most_s = MAX_STAMP_ERROR / rate_hz;
        TrackedPose {
            time_s,
            stamp_error_s: stamp_error_s.clamp(-most_s, most_s),
            tracking_from_head,
            is_valid: time_s >= self.lost_until_s,
        }
    }

    /// The frame jumps while the head is at this place.
    fn jump(&mut self, head_m: DVec3) {
        let mut direction = || normal_vector(&mut self.jump_rng).normalize_or(DVec3::X);
        let (toward, axis) = (direction(), direction());
        let at_head_m = self.frame().transform_point(head_m) - head_m;
        let before_rad = self.frame.map_or(DVec3::ZERO, |frame| frame.offset_rad);
        self.frame = Some(Frame {
            pivot_m: head_m,
            offset_m: at_head_m * JUMP_MEMORY + toward * self.errors.jump_m,
            offset_rad: before_rad * JUMP_MEMORY + axis * self.errors.jump_deg.to_radians(),
        });
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

/// An error that depends on the position: three waves per axis.
#[derive(Debug, Clone)]
struct Distortion([[(DVec3, f64); 3]; 3], f64);

impl Distortion {
    fn new(rms: f64, rng: &mut ChaCha8Rng) -> Self {
        let mut wave = || {
            let direction = normal_vector(rng).normalize_or(DVec3::X);
            let wave_m = rng.random_range(DISTORTION_WAVES_M.0..DISTORTION_WAVES_M.1);
            (direction * (TAU / wave_m), rng.random_range(0.0..TAU))
        };
        Self([(); 3].map(|()| [(); 3].map(|()| wave())), rms * (2.0f64 / 3.0).sqrt())
    }

    fn at(&self, position_m: DVec3) -> DVec3 {
        let along = |waves: &[(DVec3, f64); 3]| -> f64 {
            waves.iter().map(|(per_m, phase)| math::sin(per_m.dot(position_m) + phase)).sum()
        };
        DVec3::from_array(self.0.each_ref().map(along)) * self.1
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
    fn jumps_have_the_stated_length_and_stay_bounded() {
        let errors = TrackingErrors { jumps_per_minute: 7.5, jump_m: 0.02, jump_deg: 0.5, ..TrackingErrors::none() };
        let track = errors.track(|_| Pose::IDENTITY, (0.0, 600.0), |t| (t * 1e9) as i64, 5);
        let at = |p: &PoseSample| DVec3::from_array(p.position_m);
        let steps: Vec<f64> = track.windows(2).map(|w| at(&w[1]).distance(at(&w[0]))).filter(|m| *m > 0.0).collect();
        assert!((50..100).contains(&steps.len()), "{}", steps.len());
        // From the offset that remains to the one after it.
        assert!(steps.iter().all(|m| (0.005..0.045).contains(m)), "{steps:?}");
        assert!(track.iter().all(|p| at(p).length() < 0.07));
    }

    #[test]
    fn stamps_err_but_rise_and_distortion_depends_on_position_alone() {
        let errors = TrackingErrors { stamp_s: 1e-3, distortion_m: 5e-3, ..TrackingErrors::none() };
        let path = |t: f64| Pose::from_translation(DVec3::X * (t * TAU / 5.0).sin());
        let track = errors.track(path, (0.0, 20.0), |t| (t * 1e9).round() as i64, 5);
        assert!(track.windows(2).all(|w| w[0].time_ns < w[1].time_ns));
        let late_s = |n: usize| track[n].time_ns as f64 * 1e-9 - n as f64 / errors.rate_hz;
        let rms_s = ((0..track.len()).map(|n| late_s(n).powi(2)).sum::<f64>() / track.len() as f64).sqrt();
        assert!((rms_s / 1e-3 - 1.0).abs() < 0.05, "{rms_s}");
        let error = |n: usize| DVec3::from_array(track[n].position_m) - path(n as f64 / errors.rate_hz).translation;
        // 600 poses later the sensor is at the same place.
        assert!((0..600).all(|n| error(n).distance(error(n + 600)) < 1e-6));
        assert!((0..600).any(|n| error(n).distance(error(0)) > 3e-3));
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

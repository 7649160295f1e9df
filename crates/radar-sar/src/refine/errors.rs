//! How well the sensor's poses are known: sizes of what makes a measured range differ from the one that the pose tells.

use serde::{Deserialize, Serialize};

/// How well the poses are known; what good lighthouse tracking shows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PositionErrors {
    /// Slow drift in each axis, rms, metres.
    pub wander_m: f64,
    /// Time over which the drift stays alike, seconds: half a period of its fastest part. 1 s: drift up to 0.5 Hz.
    pub wander_s: f64,
    /// Length of the error of the mount's offset, rms, metres. It turns with the head.
    pub mount_m: f64,
    /// Fast error of a smoothed pose in each axis, rms, metres.
    pub jitter_m: f64,
    /// Slow error of the rotation about each axis, rms, degrees. It moves the sensor by the mount's arm.
    pub rotation_deg: f64,
}

/// From the tracked point to the sensor, metres: where a sensor in a headset's front sits.
const ARM_M: f64 = 0.1;

impl Default for PositionErrors {
    /// 0.3 mm of jitter a pose fall to 0.14 mm in the local cubic fit over eleven poses.
    fn default() -> Self {
        Self { wander_m: 1e-3, wander_s: 1.0, mount_m: 2e-3, jitter_m: 0.14e-3, rotation_deg: 0.1 }
    }
}

impl PositionErrors {
    /// Poses that are exact.
    pub fn none() -> Self {
        Self { wander_m: 0.0, mount_m: 0.0, jitter_m: 0.0, rotation_deg: 0.0, ..Self::default() }
    }

    /// Variance in each axis of all that drifts slowly: wander, and rotation at the end of the arm, which moves two of three
    /// axes.
    pub(crate) fn slow_variance_m2(&self) -> f64 {
        let swing_m = self.rotation_deg.to_radians() * ARM_M;
        self.wander_m * self.wander_m + swing_m * swing_m * (2.0 / 3.0)
    }

    /// Variance of the mount's error in each axis.
    pub(crate) fn mount_variance_m2(&self) -> f64 {
        self.mount_m * self.mount_m / 3.0
    }
}

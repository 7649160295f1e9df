//! Model of the sensor's pose errors: what makes a measured range differ from the one computed from
//! the pose.

use serde::{Deserialize, Serialize};

use crate::{BoundedSettings, SettingBound, bounds};

/// Sizes of the pose errors. The defaults are those of good Lighthouse tracking.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PositionErrors {
    /// Slow drift in each axis, rms, metres.
    pub wander_m: f64,
    /// Correlation time of the drift, seconds: half a period of its fastest component. 1 s means
    /// drift up to 0.5 Hz.
    pub wander_s: f64,
    /// Length of the error of the mount's offset, rms, metres. It rotates with the head.
    pub mount_m: f64,
    /// Fast error of a smoothed pose in each axis, rms, metres.
    pub jitter_m: f64,
    /// Slow error of the rotation about each axis, rms, degrees. It displaces the sensor by its
    /// lever arm.
    pub rotation_deg: f64,
}

/// Lever arm from the tracked point to the sensor, metres: for a sensor at a headset's front.
/// Choice: trackers report a point between the eyes.
const ARM_M: f64 = 0.1;

impl BoundedSettings for PositionErrors {
    const BOUNDS: &'static [SettingBound<Self>] = bounds![
        wander_m: 0.0, 1.0;
        wander_s: 0.01, 1e4;
        mount_m: 0.0, 1.0;
        jitter_m: 0.0, 1.0;
        rotation_deg: 0.0, 90.0;
    ];
}

impl Default for PositionErrors {
    /// A jitter of 0.3 mm per pose is reduced to 0.14 mm by the local cubic fit over eleven poses.
    fn default() -> Self {
        Self { wander_m: 1e-3, wander_s: 1.0, mount_m: 2e-3, jitter_m: 0.14e-3, rotation_deg: 0.1 }
    }
}

impl PositionErrors {
    /// Exact poses.
    pub fn none() -> Self {
        Self { wander_m: 0.0, mount_m: 0.0, jitter_m: 0.0, rotation_deg: 0.0, ..Self::default() }
    }

    /// The same with all slow errors together of this rms in each axis, metres, if that is more.
    #[must_use]
    pub fn with_slow_error_m(&self, slow_m: f64) -> Self {
        let more_m2 = (slow_m * slow_m - self.slow_variance_m2()).max(0.0);
        Self { wander_m: (self.wander_m * self.wander_m + more_m2).sqrt(), ..*self }
    }

    /// Variance per axis of all slow errors: drift, and rotation at the end of the lever arm, which
    /// moves two of three axes.
    pub(crate) fn slow_variance_m2(&self) -> f64 {
        let swing_m = self.rotation_deg.to_radians() * ARM_M;
        self.wander_m * self.wander_m + swing_m * swing_m * (2.0 / 3.0)
    }

    /// Variance of the mount's error per axis.
    pub(crate) fn mount_variance_m2(&self) -> f64 {
        self.mount_m * self.mount_m / 3.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_errors_only_grow() {
        let errors = PositionErrors::default();
        assert_eq!(errors.with_slow_error_m(0.5e-3), errors);
        let grown = errors.with_slow_error_m(4e-3);
        assert!((grown.slow_variance_m2().sqrt() - 4e-3).abs() < 1e-12);
        assert_eq!(PositionErrors { wander_m: errors.wander_m, ..grown }, errors);
    }
}

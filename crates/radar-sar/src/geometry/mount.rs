//! The mount: pose of the sensor on what is tracked.

use super::{Pose, PoseError};

/// Farthest that a sensor may be from what is tracked, in each axis, metres. Choice: a vehicle's length; a head is smaller.
const MAX_MOUNT_M: f64 = 10.0;

/// Why numbers are no mount.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum MountError {
    /// No pose.
    #[error(transparent)]
    Pose(#[from] PoseError),
    /// On nothing that a head carries.
    #[error("the sensor is {0:?} m from the head: give at most {MAX_MOUNT_M} m in each axis")]
    TooFar([f64; 3]),
}

/// `head_from_sensor` from external data; the quaternion (x, y, z, w) is normalised.
///
/// # Errors
/// As [`Pose::try_new`]; a coordinate beyond 10 m.
pub fn mount(position_m: [f64; 3], quaternion_xyzw: [f64; 4]) -> Result<Pose, MountError> {
    if position_m.iter().any(|m| m.is_finite() && m.abs() > MAX_MOUNT_M) {
        return Err(MountError::TooFar(position_m));
    }
    Ok(Pose::try_new(position_m, quaternion_xyzw)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mount_is_a_pose_at_most_ten_metres_away() {
        let upright = [0.0, 0.0, 0.0, 1.0];
        assert!(mount([0.0, 10.0, -10.0], upright).is_ok());
        assert_eq!(mount([0.0, 0.0, -10.1], upright), Err(MountError::TooFar([0.0, 0.0, -10.1])));
        assert!(matches!(mount([1e308, 0.0, 0.0], upright), Err(MountError::TooFar(_))));
        assert!(matches!(mount([f64::NAN, 0.0, 0.0], upright), Err(MountError::Pose(_))));
    }
}

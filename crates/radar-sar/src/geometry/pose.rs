//! A rigid transform: rotation, then translation. Right-handed, +y up, −z forward, as OpenVR.

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// Farthest position in each axis, metres. Choice: beyond any tracking volume, and a double still resolves picometres there.
const MAX_POSITION_M: f64 = 1e4;

/// Why numbers do not form a pose.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PoseError {
    /// A component of the position is not finite.
    #[error("position {0:?} m is not finite")]
    PositionNotFinite([f64; 3]),
    /// A position beyond 10 km in an axis.
    #[error("position {0:?} m is farther than 10 km")]
    PositionTooFar([f64; 3]),
    /// A component of the rotation is not finite.
    #[error("quaternion (x y z w) {0:?} is not finite")]
    RotationNotFinite([f64; 4]),
    /// A quaternion too short to define a rotation.
    #[error("quaternion (x y z w) {0:?} has length zero: it defines no rotation")]
    RotationZero([f64; 4]),
}

/// `a_from_b`: maps points of frame `b` to frame `a`; also the position and attitude of `b` in `a`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Origin of `b` in `a`, metres.
    pub translation: DVec3,
    /// Axes of `b` in `a`, unit length.
    pub rotation: DQuat,
}

impl Pose {
    /// The identity.
    pub const IDENTITY: Self = Self { translation: DVec3::ZERO, rotation: DQuat::IDENTITY };

    /// From valid parts. For external data use [`Pose::try_new`].
    #[inline]
    pub fn new(translation: DVec3, rotation: DQuat) -> Self {
        Self { translation, rotation: rotation.normalize() }
    }

    /// From external data; the quaternion (x, y, z, w) is normalised.
    ///
    /// # Errors
    /// A component that is not finite, a position beyond 10 km, or a quaternion whose components are all below 1e-6.
    #[inline]
    pub fn try_new(position_m: [f64; 3], quaternion_xyzw: [f64; 4]) -> Result<Self, PoseError> {
        if !position_m.iter().all(|v| v.is_finite()) {
            return Err(PoseError::PositionNotFinite(position_m));
        }
        if position_m.iter().any(|v| v.abs() > MAX_POSITION_M) {
            return Err(PoseError::PositionTooFar(position_m));
        }
        if !quaternion_xyzw.iter().all(|v| v.is_finite()) {
            return Err(PoseError::RotationNotFinite(quaternion_xyzw));
        }
        let largest = quaternion_xyzw.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        if largest < 1e-6 {
            return Err(PoseError::RotationZero(quaternion_xyzw));
        }
        // Scaled first, so that neither tiny nor huge components lose the direction.
        let scaled = DQuat::from_array(quaternion_xyzw.map(|v| v / largest));
        Ok(Self { translation: DVec3::from_array(position_m), rotation: scaled.normalize() })
    }

    /// A pose without rotation.
    #[inline]
    pub fn from_translation(translation: DVec3) -> Self {
        Self { translation, rotation: DQuat::IDENTITY }
    }

    /// At `eye`, looking along −z towards `target`, with +y as close to `up` as possible. `target`
    /// must differ from `eye`.
    #[inline]
    pub fn looking_at(eye: DVec3, target: DVec3, up: DVec3) -> Self {
        let back = (eye - target).normalize_or(DVec3::Z);
        let right = up.cross(back);
        let right = if right.length_squared() < 1e-12 { back.any_orthonormal_vector() } else { right.normalize() };
        let rotation = DQuat::from_mat3(&glam::DMat3::from_cols(right, back.cross(right), back));
        Self { translation: eye, rotation: rotation.normalize() }
    }

    /// `b_from_a` of this `a_from_b`.
    #[inline]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { translation: rotation * -self.translation, rotation }
    }

    /// A point of frame `b`, in frame `a`.
    #[inline]
    pub fn transform_point(&self, point_in_b: DVec3) -> DVec3 {
        self.rotation * point_in_b + self.translation
    }

    /// A direction of frame `b`, in frame `a`.
    #[inline]
    pub fn transform_vector(&self, vector_in_b: DVec3) -> DVec3 {
        self.rotation * vector_in_b
    }

    /// The −z axis of `b`, in `a`: for a sensor, its boresight.
    #[inline]
    pub fn forward(&self) -> DVec3 {
        self.rotation * DVec3::NEG_Z
    }

    /// Interpolates between two poses: linear in position, along the shortest arc in rotation.
    /// `share` 0 gives `self`, 1 gives `other`.
    #[inline]
    pub fn interpolate(&self, other: &Self, share: f64) -> Self {
        Self {
            translation: self.translation.lerp(other.translation, share),
            rotation: self.rotation.slerp(other.rotation, share).normalize(),
        }
    }
}

/// Axis times angle, of the shorter rotation.
pub(crate) fn rotation_vector(rotation: DQuat) -> DVec3 {
    if rotation.w < 0.0 { (-rotation).to_scaled_axis() } else { rotation.to_scaled_axis() }
}

impl std::ops::Mul for Pose {
    type Output = Pose;
    /// `a_from_b * b_from_c = a_from_c`.
    fn mul(self, b_from_c: Pose) -> Pose {
        Pose {
            translation: self.transform_point(b_from_c.translation),
            rotation: (self.rotation * b_from_c.rotation).normalize(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn bad_numbers_are_refused_with_their_value() {
        assert!(matches!(
            Pose::try_new([f64::NAN, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]),
            Err(PoseError::PositionNotFinite(_))
        ));
        assert!(matches!(Pose::try_new([0.0, 1e16, 0.0], [0.0, 0.0, 0.0, 1.0]), Err(PoseError::PositionTooFar(_))));
        assert!(matches!(
            Pose::try_new([0.0; 3], [0.0, f64::INFINITY, 0.0, 1.0]),
            Err(PoseError::RotationNotFinite(_))
        ));
        assert_eq!(Pose::try_new([0.0; 3], [0.0; 4]), Err(PoseError::RotationZero([0.0; 4])));
    }

    #[test]
    fn a_huge_quaternion_still_names_its_rotation() {
        let pose = Pose::try_new([0.0; 3], [0.0, 1e300, 0.0, 1e300]).unwrap();
        assert!((pose.forward() - DVec3::NEG_X).length() < 1e-12);
    }

    #[test]
    fn looking_at_points_forward_there() {
        let pose = Pose::looking_at(DVec3::new(1.0, 2.0, 3.0), DVec3::new(-1.0, 0.5, 3.0), DVec3::Y);
        assert!((pose.forward() - DVec3::new(-2.0, -1.5, 0.0).normalize()).length() < 1e-12);
        let straight_down = Pose::looking_at(DVec3::Y, DVec3::ZERO, DVec3::Y);
        assert!((straight_down.forward() - DVec3::NEG_Y).length() < 1e-12);
    }

    proptest! {
        #[test]
        fn inverse_undoes(t in prop::array::uniform3(-5.0..5.0f64), q in prop::array::uniform4(0.1..1.0f64), p in prop::array::uniform3(-5.0..5.0f64)) {
            let pose = Pose::try_new(t, q).unwrap();
            let point = DVec3::from_array(p);
            prop_assert!(((pose.inverse() * pose).transform_point(point) - point).length() < 1e-12);
        }
    }
}

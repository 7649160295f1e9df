//! Conversion between OpenVR's matrices (three rows of four floats) and poses.

use glam::{DMat3, DQuat, DVec3};

use super::sys::HmdMatrix34_t;
use radar_sar::geometry::Pose;

/// Tolerance of each entry of a rotation matrix times its transpose against the identity. Choice:
/// f32 rounds at 1e-7 and runtimes' matrices drift a little; at more than 1e-3 it is no pose.
const ORTHONORMALITY_TOLERANCE: f64 = 1e-3;

/// The pose of a matrix `a_from_b`; `None` if the matrix is not rigid.
pub(super) fn pose(matrix: &HmdMatrix34_t) -> Option<Pose> {
    let entry = |row: usize, column: usize| f64::from(matrix.m[row][column]);
    let column = |c: usize| DVec3::new(entry(0, c), entry(1, c), entry(2, c));
    let turn = DMat3::from_cols(column(0), column(1), column(2));
    let away = turn.transpose() * turn - DMat3::IDENTITY;
    let is_turn = away.to_cols_array().iter().all(|v| v.abs() <= ORTHONORMALITY_TOLERANCE) && turn.determinant() > 0.0;
    let translation = column(3);
    (is_turn && translation.is_finite()).then(|| Pose::new(translation, DQuat::from_mat3(&turn)))
}

/// The matrix of a pose.
pub(super) fn matrix(pose: &Pose) -> HmdMatrix34_t {
    let turn = DMat3::from_quat(pose.rotation);
    let row = |r: usize| [turn.x_axis[r], turn.y_axis[r], turn.z_axis[r], pose.translation[r]].map(|v| v as f32);
    HmdMatrix34_t { m: [row(0), row(1), row(2)] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn pose_matrix_roundtrip(axis in prop::array::uniform3(-1.0..1.0f64), angle in -3.0..3.0f64, at in prop::array::uniform3(-9.0..9.0f64)) {
            let turn = DQuat::from_scaled_axis(DVec3::from_array(axis).normalize_or(DVec3::Y) * angle);
            let there = Pose::new(DVec3::from_array(at), turn);
            let back = pose(&matrix(&there)).unwrap();
            prop_assert!((back.translation - there.translation).length() < 1e-5);
            prop_assert!(back.rotation.dot(there.rotation).abs() > 1.0 - 1e-9);
        }
    }

    #[test]
    fn quarter_turn_matches_openvr_matrix_layout() {
        // Row-major, m[row][column]: the columns are b's axes in a. +y is up: after a turn to the
        // left, forward (−z) is at −x.
        let left = Pose::new(DVec3::new(1.0, 2.0, 3.0), DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2));
        let m = matrix(&left).m;
        let expected = [[0.0, 0.0, 1.0, 1.0], [0.0, 1.0, 0.0, 2.0], [-1.0, 0.0, 0.0, 3.0]];
        let away = m.iter().flatten().zip(expected.iter().flatten()).map(|(a, b): (&f32, &f32)| (a - b).abs());
        assert!(away.fold(0.0, f32::max) < 1e-6, "{m:?}");
    }

    #[test]
    fn invalid_matrices_give_none() {
        let sound = matrix(&Pose::IDENTITY);
        assert!(pose(&sound).is_some());
        for (row, column, value) in [(0, 0, 2.0), (1, 3, f32::NAN), (2, 2, -1.0), (0, 1, f32::INFINITY), (0, 0, 0.0)] {
            let mut bad = sound;
            bad.m[row][column] = value;
            assert_eq!(pose(&bad), None, "{row} {column} {value}");
        }
    }
}

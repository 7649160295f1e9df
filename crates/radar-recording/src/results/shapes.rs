//! Shapes of obstacles, walls and moving targets in space, shared by entities and dots.

use glam::{DMat3, DQuat, DVec3};

use radar_mapping::{MovingTarget, Obstacle, Wall};
use radar_sar::eigen;
use radar_sar::geometry::{Aabb, Pose};

/// Uncertainties are drawn at this many standard deviations, within these radii, metres. Choice: 2σ
/// holds 95 % in each direction; the radii stay visible, and in the room where a direction is
/// unobserved.
const DRAWN_SIGMAS: f64 = 2.0;
const RADII_M: [f64; 2] = [0.008, 0.7];
/// Margin of a drawn wall around the reflections on it, metres. Choice: the patch that was seen, a
/// point for a head at rest, becomes visible as a surface.
const WALL_MARGIN_M: f64 = 0.5;

/// The uncertainty ellipsoid at two standard deviations: its pose, and its radii along its axes,
/// metres.
pub fn uncertainty(obstacle: &Obstacle) -> (Pose, DVec3) {
    if !obstacle.covariance_m2.is_finite() {
        return (Pose::from_translation(obstacle.position_m), DVec3::splat(RADII_M[1]));
    }
    let (variances, axes) = eigen(&obstacle.covariance_m2);
    let radius = |variance: f64| match variance.is_finite() {
        true => (DRAWN_SIGMAS * variance.max(0.0).sqrt()).clamp(RADII_M[0], RADII_M[1]),
        false => RADII_M[1],
    };
    // The third axis is chosen so that the matrix is a proper rotation.
    let turn = DMat3::from_cols(axes.x_axis, axes.y_axis, axes.x_axis.cross(axes.y_axis));
    let rotation = DQuat::from_mat3(&turn).normalize();
    let rotation = if rotation.is_finite() { rotation } else { DQuat::IDENTITY };
    (Pose::new(obstacle.position_m, rotation), DVec3::from_array(variances.map(radius)))
}

/// The corners of a wall around its reflections, in order.
pub fn wall_patch(wall: &Wall) -> [DVec3; 4] {
    let outward = wall.plane.outward;
    let is_level = wall.plane.is_level();
    let across = if is_level { DVec3::X } else { DVec3::Y.cross(outward).normalize_or(DVec3::X) };
    let along = outward.cross(across).normalize_or(DVec3::Y);
    let middle = wall.plane.foot(wall.seen_at.center());
    let reach = |axis: DVec3| axis * ((axis.abs() * (wall.seen_at.size() * 0.5)).element_sum() + WALL_MARGIN_M);
    let (u, v) = (reach(across), reach(along));
    [middle - u - v, middle + u - v, middle + u + v, middle - u + v]
}

/// The twelve edges of a box.
pub fn edges(around: &Aabb) -> [[DVec3; 2]; 12] {
    let corner = |n: usize| {
        let pick = |bit: usize, axis: usize| if n >> bit & 1 == 0 { around.min[axis] } else { around.max[axis] };
        DVec3::new(pick(0, 0), pick(1, 1), pick(2, 2))
    };
    let pairs = [0, 2, 4, 6, 0, 1, 4, 5, 0, 1, 2, 3].into_iter().zip([1, 1, 1, 1, 2, 2, 2, 2, 4, 4, 4, 4]);
    let mut found = [[DVec3::ZERO; 2]; 12];
    for (edge, (from, step)) in found.iter_mut().zip(pairs) {
        *edge = [corner(from), corner(from + step)];
    }
    found
}

/// Lines of a moving target: a wedge from the sensor at the last detection to the arc of possible
/// positions at its level, and the vertical extent.
pub fn moving_lines(moving: &MovingTarget) -> Vec<Vec<DVec3>> {
    let from = moving.seen_from.translation;
    let half_rad = moving.half_width_rad();
    let arc = moving.arc_m();
    let upright = (-8..=8).map(|n| moving.place_m(0.0, half_rad * f64::from(n) / 8.0));
    let wedge = [from].into_iter().chain(arc).chain([from]);
    [wedge.collect(), upright.collect()]
        .into_iter()
        .filter(|line: &Vec<DVec3>| line.iter().all(|at| at.is_finite()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use radar_mapping::Observed;
    use radar_sar::geometry::Plane;

    fn obstacle(covariance_m2: DMat3) -> Obstacle {
        Obstacle {
            provisional: false,
            id: 1,
            position_m: DVec3::new(1.0, 0.5, -2.0),
            covariance_m2,
            observed: Observed::Position,
            extent_m: DVec3::splat(0.2),
            evidence: 9.0,
            shape: vec![(DVec3::new(1.0, 0.5, -2.0), 9.0), (DVec3::new(1.1, 0.5, -2.0), 8.0)],
            first_seen_ns: 0,
            last_seen_ns: 0,
        }
    }

    #[test]
    fn ellipsoid_matches_the_covariance() {
        let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(0.3, -1.1, 0.7)));
        let covariance = turn * DMat3::from_diagonal(DVec3::new(1e-4, 9e-4, 4e-4)) * turn.transpose();
        let (pose, radii_m) = uncertainty(&obstacle(covariance));
        assert!((pose.rotation.length() - 1.0).abs() < 1e-12);
        let axes = DMat3::from_quat(pose.rotation);
        let again = axes * DMat3::from_diagonal(radii_m * radii_m / 4.0) * axes.transpose();
        assert!((again - covariance).to_cols_array().iter().all(|v| v.abs() < 1e-12), "{again} {covariance}");
        for bad in [DMat3::NAN, DMat3::from_diagonal(DVec3::INFINITY), DMat3::ZERO] {
            let (pose, radii_m) = uncertainty(&obstacle(bad));
            assert!((pose.rotation.length() - 1.0).abs() < 1e-12 && radii_m.min_element() >= RADII_M[0]);
            assert!(radii_m.max_element() <= RADII_M[1]);
        }
    }

    #[test]
    fn wall_patch_lies_on_its_plane() {
        let seen_at = Aabb::from_corners(DVec3::new(-0.4, 1.0, -1.9), DVec3::new(0.6, 1.8, -2.1));
        for outward in [DVec3::NEG_Z, DVec3::new(0.6, 0.0, -0.8), DVec3::NEG_Y] {
            let plane = Plane { outward, offset_m: 2.0 };
            let wall =
                Wall { id: 1, plane, evidence: 9.0, seen_at, provisional: false, first_seen_ns: 0, last_seen_ns: 0 };
            let patch = wall_patch(&wall);
            assert!(patch.iter().all(|corner| plane.distance(*corner).abs() < 1e-9));
            let sides = [patch[1] - patch[0], patch[2] - patch[1]];
            assert!(sides[0].dot(sides[1]).abs() < 1e-9 && sides.iter().all(|side| side.length() >= 1.0));
        }
    }

    #[test]
    fn box_has_twelve_axis_aligned_edges() {
        let around = Aabb { min: DVec3::ZERO, max: DVec3::new(1.0, 2.0, 3.0) };
        let lengths = edges(&around).map(|[a, b]| (b - a).length());
        let count = |length: f64| lengths.iter().filter(|l| (*l - length).abs() < 1e-12).count();
        assert_eq!([count(1.0), count(2.0), count(3.0)], [4, 4, 4]);
    }
}

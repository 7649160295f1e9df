//! A plane as a specular reflector: the sensor measures its distance along the normal.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{Aabb, Pose};

/// Points `x` with `outward · x = offset_m`; `outward` points away from the room's inside.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Plane {
    /// Unit normal, from the inside of the room towards the plane.
    pub outward: DVec3,
    /// Distance of the plane from the origin along the normal, metres.
    pub offset_m: f64,
}

/// Least absolute vertical component of the normal of a level plane. Choice: within 45°; floors and
/// ceilings are searched level, so that only refinement tilts them.
const MIN_LEVEL_NORMAL_Y: f64 = 0.7;
/// Greatest absolute vertical component of the normal of an upright plane. Choice: within 30°; what
/// lies between, such as a roof's slope, is neither.
const MAX_UPRIGHT_NORMAL_Y: f64 = 0.5;

impl Plane {
    /// Distance from a point inside to the plane, metres; negative beyond it.
    #[inline]
    pub fn distance(&self, point: DVec3) -> f64 {
        self.offset_m - self.outward.dot(point)
    }

    /// Foot of the perpendicular from the point.
    #[inline]
    pub fn foot(&self, point: DVec3) -> DVec3 {
        point + self.outward * self.distance(point)
    }

    /// Whether it is level, as floors and ceilings are.
    #[inline]
    pub fn is_level(&self) -> bool {
        self.outward.y.abs() >= MIN_LEVEL_NORMAL_Y
    }

    /// Whether it is upright, as walls are. A sloping roof is neither upright nor level.
    #[inline]
    pub fn is_upright(&self) -> bool {
        self.outward.y.abs() < MAX_UPRIGHT_NORMAL_Y
    }

    /// The same plane in another frame: `to_from` takes coordinates of this frame to the other.
    #[inline]
    pub fn moved(&self, to_from: &Pose) -> Self {
        let outward = to_from.transform_vector(self.outward);
        Self { outward, offset_m: self.offset_m + outward.dot(to_from.translation) }
    }

    /// The bounding box, in another frame, of a patch of the plane given by its bounding box in
    /// this frame.
    ///
    /// Rotating a bounding box makes it grow each time. This patch keeps its extent along the
    /// plane: of an upright plane the segment between two ends is moved, of a level one the box
    /// keeps its size.
    #[inline]
    pub fn patch_moved(&self, patch: &Aabb, to_from: &Pose) -> Aabb {
        let half = patch.size() * 0.5;
        let Some(along) = self.outward.cross(DVec3::Y).try_normalize().filter(|_| !self.is_level()) else {
            let middle = to_from.transform_point(patch.center());
            return Aabb { min: middle - half, max: middle + half };
        };
        let to_end = along * along.abs().dot(half) + DVec3::Y * half.y;
        let middle = self.foot(patch.center());
        Aabb::from_corners(to_from.transform_point(middle - to_end), to_from.transform_point(middle + to_end))
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    #[test]
    fn the_foot_lies_on_the_plane() {
        let wall = Plane { outward: DVec3::new(0.6, 0.0, -0.8), offset_m: 2.0 };
        let head = DVec3::new(0.3, 1.6, 0.1);
        assert!(wall.distance(wall.foot(head)).abs() < 1e-12);
        assert!((wall.distance(head) - (2.0 - 0.18 + 0.08)).abs() < 1e-12);
    }

    #[test]
    fn a_moved_plane_has_the_moved_points() {
        let wall = Plane { outward: DVec3::new(0.6, 0.0, -0.8), offset_m: 2.0 };
        let to_from = Pose::new(DVec3::new(1.0, -0.5, 0.3), DQuat::from_rotation_y(0.7));
        let moved = wall.moved(&to_from);
        for place in [DVec3::new(0.3, 1.6, 0.1), DVec3::new(-2.0, 0.0, 1.0)] {
            assert!((moved.distance(to_from.transform_point(place)) - wall.distance(place)).abs() < 1e-12);
        }
    }

    #[test]
    fn patch_keeps_its_length_over_repeated_moves() {
        for outward in [DVec3::new(0.6, 0.0, -0.8), DVec3::X, DVec3::new(-0.3, 0.0, -0.95).normalize(), DVec3::NEG_Y] {
            let along = outward.cross(DVec3::Y).try_normalize().unwrap_or(DVec3::X);
            let mut plane = Plane { outward, offset_m: 2.0 };
            let ends = [-1.0, 2.0].map(|at| plane.foot(DVec3::ZERO) + along * at + DVec3::Y * (0.1 * at));
            let mut patch = Aabb::from_corners(ends[0], ends[1]);
            let (first, turn_rad) = (patch, 0.5);
            for n in 0..20 {
                let there = Pose::new(DVec3::new(1.0, 0.0, -2.0), DQuat::from_rotation_y(turn_rad));
                let to_from = if n % 2 == 0 { there } else { there.inverse() };
                (plane, patch) = (plane.moved(&to_from), plane.patch_moved(&patch, &to_from));
            }
            assert!((patch.min - first.min).length() < 1e-9 && (patch.max - first.max).length() < 1e-9, "{outward}");
        }
    }
}

//! A plane, as a mirror seen by a radar: the sensor measures its distance along the normal.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::Pose;

/// Points `x` with `outward · x = offset_m`; `outward` points away from the room's inside.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Plane {
    /// Unit normal, from the inside of the room towards the plane.
    pub outward: DVec3,
    /// Distance of the plane from the origin along the normal, metres.
    pub offset_m: f64,
}

impl Plane {
    /// Distance from a point inside to the plane, metres; negative beyond it.
    pub fn distance(&self, point: DVec3) -> f64 {
        self.offset_m - self.outward.dot(point)
    }

    /// Foot of the perpendicular from the point.
    pub fn foot(&self, point: DVec3) -> DVec3 {
        point + self.outward * self.distance(point)
    }

    /// The same in another frame: `to_from` takes coordinates of this one's.
    pub fn moved(&self, to_from: &Pose) -> Self {
        let outward = to_from.transform_vector(self.outward);
        Self { outward, offset_m: self.offset_m + outward.dot(to_from.translation) }
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
}

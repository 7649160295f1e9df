//! The scene: everything the engine reports of the room at one time.

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use super::MovingTarget;
use radar_sar::geometry::{Aabb, Plane, Pose};

/// How much of an obstacle's position the data determine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Observed {
    /// All three coordinates.
    Position,
    /// The distance, and the direction along one line of the cross-range plane only.
    RangeAndOneDirection,
    /// The distance from the sensor only; the direction is anywhere in the beam.
    RangeOnly,
}

/// An object in the room.
#[derive(Debug, Clone, PartialEq)]
pub struct Obstacle {
    /// Stays the same while the obstacle is known.
    pub id: u64,
    /// Most likely position of its strongest reflection, tracking frame, metres.
    pub position_m: DVec3,
    /// Covariance of the position, m²; large in directions that were not observed. Where only the
    /// range is known it is that of the tangent plane: the point lies on the sphere of that range,
    /// within the width that the covariance gives.
    pub covariance_m2: DMat3,
    /// What the data determine.
    pub observed: Observed,
    /// Full size of the box around what was seen of it, metres.
    pub extent_m: DVec3,
    /// Strength of the evidence: the score of the statistic that found it.
    pub evidence: f64,
    /// Points with evidence that belong to it (voxel centres), tracking frame, and their scores:
    /// its shape as far as seen.
    pub shape: Vec<(DVec3, f32)>,
    /// Restored from a saved map and not yet seen again.
    pub provisional: bool,
    /// First and last sweep that gave evidence, host nanoseconds.
    pub first_seen_ns: i64,
    /// See `first_seen_ns`.
    pub last_seen_ns: i64,
}

/// A wall, floor or ceiling: a smooth plane, seen where the sensor faced it squarely.
#[derive(Debug, Clone, PartialEq)]
pub struct Wall {
    /// Stays the same while the wall is known.
    pub id: u64,
    /// The plane, tracking frame.
    pub plane: Plane,
    /// Score of the plane statistic.
    pub evidence: f64,
    /// Box around the feet of the perpendiculars that it was seen at: least and greatest corner,
    /// metres.
    pub seen_at: Aabb,
    /// Restored from a saved map and not yet seen again.
    pub provisional: bool,
    /// First and last sweep that gave evidence, host nanoseconds.
    pub first_seen_ns: i64,
    /// See `first_seen_ns`.
    pub last_seen_ns: i64,
}

/// The whole scene, at one time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scene {
    /// Time of the newest sweep in it, host nanoseconds.
    pub time_ns: i64,
    /// Obstacles, by falling evidence.
    pub obstacles: Vec<Obstacle>,
    /// Walls, by falling evidence.
    pub walls: Vec<Wall>,
    /// Moving targets, the longest tracked first; never one of the obstacles.
    pub moving: Vec<MovingTarget>,
}

impl Scene {
    /// The same in another frame: `to_from` transforms from this frame's coordinates. Boxes around
    /// obstacles are those around the rotated boxes, so they grow when rotated. Walls stay as long
    /// as they are.
    pub fn moved(&self, to_from: &Pose) -> Self {
        let obstacles = self.obstacles.iter().map(|obstacle| obstacle.moved(to_from)).collect();
        let walls = self.walls.iter().map(|wall| wall.moved(to_from)).collect();
        let moving = self.moving.iter().map(|moving| moving.moved(to_from)).collect();
        Self { time_ns: self.time_ns, obstacles, walls, moving }
    }
}

impl Obstacle {
    /// The box around what was seen of it; `None` without any extent.
    pub fn around(&self) -> Option<Aabb> {
        let around = Aabb::around(self.shape.iter().map(|voxel| voxel.0))?;
        let half = (self.extent_m - around.size()).max(DVec3::ZERO) * 0.5;
        let around = Aabb { min: around.min - half, max: around.max + half };
        (self.extent_m.max_element() > 0.0 && around.min.is_finite() && around.max.is_finite()).then_some(around)
    }

    /// Edge of the cells of its shape, metres: its box is greater than the one around their centres
    /// by this.
    pub fn cell_m(&self) -> f64 {
        let around = Aabb::around(self.shape.iter().map(|cell| cell.0));
        around.map_or(0.0, |around| (self.extent_m - around.size()).max_element().max(0.0))
    }

    /// From a point to the nearest point that belongs to it, metres.
    pub fn distance_m(&self, from: DVec3) -> f64 {
        let points = self.shape.iter().map(|voxel| voxel.0).chain([self.position_m]);
        points.map(|point| point.distance(from)).fold(f64::INFINITY, f64::min)
    }

    fn moved(&self, to_from: &Pose) -> Self {
        let turn = DMat3::from_quat(to_from.rotation);
        Self {
            position_m: to_from.transform_point(self.position_m),
            covariance_m2: turn * self.covariance_m2 * turn.transpose(),
            extent_m: turn.abs() * self.extent_m,
            shape: self.shape.iter().map(|(point, score)| (to_from.transform_point(*point), *score)).collect(),
            ..self.clone()
        }
    }
}

impl Wall {
    fn moved(&self, to_from: &Pose) -> Self {
        let seen_at = self.plane.patch_moved(&self.seen_at, to_from);
        Self { plane: self.plane.moved(to_from), seen_at, ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    fn scene() -> Scene {
        let obstacle = Obstacle {
            id: 3,
            position_m: DVec3::new(0.5, 0.4, -1.0),
            covariance_m2: DMat3::from_diagonal(DVec3::new(1e-4, 4e-4, 9e-4)),
            observed: Observed::Position,
            extent_m: DVec3::new(0.3, 0.9, 0.2),
            evidence: 8.0,
            shape: vec![(DVec3::new(0.5, 0.1, -1.0), 4.0), (DVec3::new(0.5, 0.8, -1.1), 5.0)],
            provisional: false,
            first_seen_ns: 1,
            last_seen_ns: 2,
        };
        let plane = Plane { outward: DVec3::NEG_Z, offset_m: 2.0 };
        let seen_at = Aabb::from_corners(DVec3::new(-1.0, 1.5, -2.0), DVec3::new(1.0, 1.7, -2.0));
        let wall =
            Wall { id: 4, plane, evidence: 20.0, seen_at, provisional: false, first_seen_ns: 1, last_seen_ns: 2 };
        Scene { time_ns: 9, obstacles: vec![obstacle], walls: vec![wall], moving: vec![] }
    }

    #[test]
    fn moved_by_pose_and_inverse_is_identity() {
        // A quarter of a turn keeps boxes along the axes.
        let to_from = Pose::new(DVec3::new(0.3, -0.1, 2.0), DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2));
        let (before, moved) = (scene(), scene().moved(&to_from));
        let back = moved.moved(&to_from.inverse());
        let (obstacle, wall) = (&back.obstacles[0], &back.walls[0]);
        assert!((obstacle.position_m - before.obstacles[0].position_m).length() < 1e-12);
        assert!(
            (obstacle.covariance_m2 - before.obstacles[0].covariance_m2)
                .to_cols_array()
                .iter()
                .all(|v| v.abs() < 1e-15)
        );
        assert!((obstacle.extent_m - before.obstacles[0].extent_m).length() < 1e-12);
        assert!((obstacle.shape[1].0 - before.obstacles[0].shape[1].0).length() < 1e-12);
        assert!((wall.plane.outward - DVec3::NEG_Z).length() < 1e-12 && (wall.plane.offset_m - 2.0).abs() < 1e-12);
        assert!((wall.seen_at.min - before.walls[0].seen_at.min).length() < 1e-12);
        assert_eq!((obstacle.id, wall.id, back.time_ns), (3, 4, 9));
    }

    #[test]
    fn box_encloses_voxels_and_distance_is_to_nearest() {
        let found = Obstacle {
            shape: vec![(DVec3::ONE, 4.0), (DVec3::new(1.1, 1.0, 1.0), 5.0)],
            ..scene().obstacles.remove(0)
        };
        let found = Obstacle { extent_m: DVec3::new(0.15, 0.05, 0.05), position_m: DVec3::ONE, ..found };
        let around = found.around().unwrap();
        assert!(
            (around.min - DVec3::splat(0.975)).length() < 1e-12 && (around.size() - found.extent_m).length() < 1e-12
        );
        assert!((found.distance_m(DVec3::new(1.4, 1.0, 1.0)) - 0.3).abs() < 1e-12);
        assert!((found.cell_m() - 0.05).abs() < 1e-12);
        assert_eq!(Obstacle { extent_m: DVec3::ZERO, ..found.clone() }.around(), None);
        assert_eq!(Obstacle { shape: vec![], ..found }.around(), None);
    }

    #[test]
    fn moved_scene_keeps_distances_and_variances() {
        let to_from = Pose::new(DVec3::new(0.3, -0.1, 2.0), DQuat::from_scaled_axis(DVec3::new(0.2, 1.1, -0.3)));
        let (before, moved) = (scene(), scene().moved(&to_from));
        let head = DVec3::new(0.1, 1.6, 0.2);
        let (wall, there) = (&before.walls[0], &moved.walls[0]);
        assert!((there.plane.distance(to_from.transform_point(head)) - wall.plane.distance(head)).abs() < 1e-12);
        assert!(there.seen_at.contains(to_from.transform_point(wall.seen_at.center())));
        let along = DVec3::new(0.6, 0.0, 0.8);
        let variance = |obstacle: &Obstacle, v: DVec3| v.dot(obstacle.covariance_m2 * v);
        let turned = to_from.transform_vector(along);
        let error = variance(&moved.obstacles[0], turned) - variance(&before.obstacles[0], along);
        assert!(error.abs() < 1e-15);
    }
}

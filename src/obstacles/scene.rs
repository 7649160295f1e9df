//! The scene: everything the engine says of the room at one time.

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::geometry::Plane;

/// How much of an obstacle's place the data determine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Observed {
    /// All three coordinates.
    Position,
    /// The distance, and the direction along one line of the cross-range plane alone.
    RangeAndOneDirection,
    /// The distance from the sensor alone; the direction is anywhere in the beam.
    RangeOnly,
}

/// Something that stands in the room.
#[derive(Debug, Clone, PartialEq)]
pub struct Obstacle {
    /// Stays the same while the obstacle is known.
    pub id: u64,
    /// Most likely place of its strongest reflection, tracking frame, metres.
    pub position_m: DVec3,
    /// Covariance of the position, m²; honest about directions that were not observed. Where only the range is known it is
    /// that of the tangent plane: the place lies on the sphere of that range, within the width that the covariance gives.
    pub covariance_m2: DMat3,
    /// What the data determine.
    pub observed: Observed,
    /// Full size of the box around what was seen of it, metres.
    pub extent_m: DVec3,
    /// Strength of the evidence: the score of the statistic that found it.
    pub evidence: f64,
    /// Places with evidence that belong to it (voxel centres), tracking frame, and their scores: its shape as far as seen.
    pub shape: Vec<(DVec3, f32)>,
    /// First and last sweep that gave evidence, host nanoseconds.
    pub first_seen_ns: i64,
    /// See `first_seen_ns`.
    pub last_seen_ns: i64,
}

/// A wall, floor or ceiling: a smooth plane, seen where the sensor looked at it squarely.
#[derive(Debug, Clone, PartialEq)]
pub struct Wall {
    /// Stays the same while the wall is known.
    pub id: u64,
    /// Where it is, tracking frame.
    pub plane: Plane,
    /// Score of the plane statistic.
    pub evidence: f64,
    /// The feet of the perpendiculars it was seen at: least and greatest corner, metres.
    pub seen_at: crate::geometry::Aabb,
    /// First and last sweep that gave evidence, host nanoseconds.
    pub first_seen_ns: i64,
    /// See `first_seen_ns`.
    pub last_seen_ns: i64,
}

/// All of it, at one time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scene {
    /// Time of the newest sweep in it, host nanoseconds.
    pub time_ns: i64,
    /// Obstacles, by falling evidence.
    pub obstacles: Vec<Obstacle>,
    /// Walls, by falling evidence.
    pub walls: Vec<Wall>,
}

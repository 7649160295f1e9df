//! Poses and fields of view of the headset's eyes.

use glam::DVec3;
use radar_sar::geometry::Pose;

use crate::world::World;

/// Tangents at the edges of an eye's image, signed: right and up are positive.
#[derive(Debug, Clone, Copy)]
pub struct Edges {
    pub left: f64,
    pub right: f64,
    pub up: f64,
    pub down: f64,
}

impl World {
    /// Edges of an eye's image.
    pub fn eye_edges(&self, is_left: bool) -> Edges {
        let tangents = self.config.display.tangents;
        let (left, right) = if is_left { (tangents.outer, tangents.inner) } else { (tangents.inner, tangents.outer) };
        Edges { left: -left, right, up: tangents.up, down: -tangents.down }
    }

    /// Pose of an eye in the head: offset to the side, looking straight ahead.
    pub fn head_from_eye(&self, is_left: bool) -> Pose {
        let half = self.config.display.ipd_m / 2.0;
        Pose::from_translation(DVec3::new(if is_left { -half } else { half }, 0.0, 0.0))
    }
}

//! Where the walls of a session's room are, for those who walk in it.

use glam::DVec3;

use super::super::Room;
use super::super::world::FloorPlan;

/// Outline of a room; heights are ignored.
#[derive(Debug, Clone, Copy)]
pub(super) enum Outline<'w> {
    /// A box about the origin: half its size, metres.
    Box(DVec3),
    /// A floor plan with the origin inside.
    Plan(&'w FloorPlan),
}

/// Step of the search for a wall, metres. Choice: a hundredth of a room.
const STEP_M: f64 = 0.04;

impl Outline<'_> {
    /// The box that a room's walls form.
    pub fn of_walls(room: &Room) -> Self {
        Self::Box(room.walls.iter().map(|wall| wall.extent.max).fold(DVec3::ZERO, DVec3::max))
    }

    /// Distance from a point to the nearest wall, metres; negative outside.
    pub fn clearance_m(&self, point: DVec3) -> f64 {
        match self {
            Self::Box(half) => (half.x - point.x.abs()).min(half.z - point.z.abs()),
            Self::Plan(plan) => plan.clearance_m(point),
        }
    }

    /// Distance from the origin to the wall in a direction, metres.
    pub fn reach_m(&self, toward: DVec3) -> f64 {
        match self {
            Self::Box(half) => (half.x / toward.x.abs().max(1e-6)).min(half.z / toward.z.abs().max(1e-6)),
            Self::Plan(plan) => {
                let level = DVec3::new(toward.x, 0.0, toward.z);
                let inside = |n: &i32| plan.clearance_m(level * (f64::from(*n) * STEP_M)) > 0.0;
                f64::from((1..1000).take_while(inside).last().unwrap_or(0)) * STEP_M
            }
        }
    }

    /// Half the size of a box about the origin within the room, metres.
    pub fn inner_half_m(&self) -> DVec3 {
        match self {
            Self::Box(half) => *half,
            Self::Plan(plan) => {
                let half = (-plan.rectangles[0].min).min(plan.rectangles[0].max);
                DVec3::new(half.x, 0.0, half.y)
            }
        }
    }
}

//! Objects for the truth: a name, what it is, its parts and the points on its surface.

use glam::{DQuat, DVec3};

use radar_sar::geometry::{Aabb, Pose};

use super::assembly::Assembly;
use super::parts::Parts;

/// What an object is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum ObjectKind {
    HardChair,
    SoftChair,
    Table,
    Shelf,
    Sofa,
    Lamp,
    Hanging,
    Cabinet,
    Stool,
    Plant,
    Cable,
    Step,
    Bin,
    Screen,
    /// On a wall: door, window, picture, radiator, curtain.
    Fixture,
}

/// An object in its own frame: its front towards −z, the floor at y = 0.
#[derive(Debug, Clone)]
pub(crate) struct Furniture {
    pub name: &'static str,
    pub kind: ObjectKind,
    pub parts: Parts,
}

impl Furniture {
    pub fn new(name: &'static str, kind: ObjectKind, assembly: Assembly) -> Self {
        Self { name, kind, parts: assembly.parts }
    }

    pub fn named(self, name: &'static str) -> Self {
        Self { name, ..self }
    }

    /// Its extent in its own frame.
    pub fn extent(&self) -> Aabb {
        Aabb::around(self.parts.surface_points()).unwrap_or(Aabb { min: DVec3::ZERO, max: DVec3::ZERO })
    }

    /// Stands it in the room, turned about the vertical.
    pub fn placed(&self, at_m: DVec3, yaw_rad: f64) -> WorldObject {
        let parts = self.parts.moved(&Pose::new(at_m, DQuat::from_rotation_y(yaw_rad)));
        WorldObject { name: self.name.into(), kind: self.kind, points_m: parts.surface_points(), parts }
    }
}

/// An object in the room.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct WorldObject {
    /// Its name, not necessarily unique.
    pub name: String,
    pub kind: ObjectKind,
    /// Its parts, room frame.
    pub parts: Parts,
    /// Points on its surface, at most [`super::SURFACE_SPACING_M`] apart along it, room frame, metres.
    pub points_m: Vec<DVec3>,
}

//! Rooms for play sessions: a play area with furniture around it, near enough for the player to
//! approach; −25 to +10 dBsm.

use std::f64::consts::TAU;

use glam::DVec3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::super::furniture::{
    Draw, METAL_CHAIR, PLASTIC_CHAIR, cabinet, chair, clothes_hanger, door_frame, lamp, shelf, sofa, stool, table,
};
use super::super::scenes::room_walls;
use super::super::{Room, SceneObject};
use super::REMOVED_CHAIR;

use radar_sar::math;

/// Pieces of furniture in addition to the chairs that every room has. Choice: with the chairs a
/// furnished room, in which objects mask each other.
const EXTRA_FURNITURE: usize = 5;
/// Distance from the room's centre to the near side of the furniture, metres. Choice: around the
/// play area of 0.9 m, so that objects can be reached and do not stand in it.
const RING_M: (f64, f64) = (0.95, 1.35);
/// Distance from the centre of a chair to the wall behind it, metres. Choice: a chair before a
/// strong wall is the case that wall cancellation is for.
const CHAIR_TO_WALL_M: f64 = 0.5;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    MetalChair,
    SoftChair,
    ChairAtWall,
    RemovedChair,
    Table,
    Shelf,
    Sofa,
    Lamp,
    Hanger,
    Stool,
    Cabinet,
    DoorFrame,
}

impl Kind {
    /// Distance from its centre to the side that faces the player, metres.
    fn half_depth_m(self) -> f64 {
        match self {
            Self::Table => 0.3,
            Self::Sofa => 0.4,
            Self::Lamp | Self::DoorFrame => 0.05,
            _ => 0.2,
        }
    }
}

/// A room of 3.8 to 4.6 m by 4.4 to 5.2 m, centred at the origin, with furniture at equal angles in
/// random order.
pub(super) fn play_room(rng: &mut ChaCha8Rng) -> Room {
    let (width_m, depth_m) = (rng.random_range(3.8..4.6), rng.random_range(4.4..5.2));
    let mut kinds = vec![Kind::MetalChair, Kind::SoftChair, Kind::ChairAtWall, Kind::RemovedChair];
    let mut others =
        [Kind::Table, Kind::Shelf, Kind::Sofa, Kind::Lamp, Kind::Hanger, Kind::Stool, Kind::Cabinet, Kind::DoorFrame];
    shuffle(&mut others, rng);
    kinds.extend(&others[..EXTRA_FURNITURE]);
    shuffle(&mut kinds, rng);
    let first_rad = rng.random_range(0.0..TAU);
    let mut draw = Draw(ChaCha8Rng::clone(rng));
    let count = kinds.len() as f64;
    let objects = kinds.iter().enumerate().map(|(n, &kind)| {
        let angle_rad = first_rad + TAU * (n as f64 + draw.uniform(-0.15, 0.15)) / count;
        furniture(&mut draw, kind, angle_rad, [width_m, depth_m])
    });
    Room { things: objects.collect(), walls: room_walls(width_m, depth_m, 2.5) }
}

fn shuffle<T>(items: &mut [T], rng: &mut ChaCha8Rng) {
    for n in (1..items.len()).rev() {
        items.swap(n, rng.random_range(0..=n));
    }
}

/// An object in a direction from the centre, with its front towards the centre.
fn furniture(draw: &mut Draw, kind: Kind, angle_rad: f64, [width_m, depth_m]: [f64; 2]) -> SceneObject {
    let ahead = DVec3::new(math::sin(angle_rad), 0.0, -math::cos(angle_rad));
    // With this yaw the front (−z) of an object faces the centre.
    let yaw = std::f64::consts::PI - angle_rad;
    let to_wall_m = (width_m / 2.0 / ahead.x.abs().max(1e-9)).min(depth_m / 2.0 / ahead.z.abs().max(1e-9));
    let ring_m = draw.uniform(RING_M.0, RING_M.1) + kind.half_depth_m();
    let at_ring = ahead * ring_m.min(to_wall_m - kind.half_depth_m() - 0.1);
    let turned = yaw + draw.uniform(-0.4, 0.4);
    // The wall in this direction, and the shortest way to it.
    let along_x = width_m / 2.0 / ahead.x.abs().max(1e-9) < depth_m / 2.0 / ahead.z.abs().max(1e-9);
    let outward = if along_x { DVec3::X * ahead.x.signum() } else { DVec3::Z * ahead.z.signum() };
    let before_wall = |m: f64| {
        let on_wall = ahead * to_wall_m;
        on_wall - outward * m
    };
    let from_wall_yaw = math::atan2(outward.x, outward.z);
    let named = |name: &str, furniture: SceneObject| SceneObject { name: name.into(), ..furniture };
    match kind {
        Kind::MetalChair => chair(draw, "chair", at_ring, turned, METAL_CHAIR),
        Kind::SoftChair => chair(draw, "soft chair", at_ring, turned, PLASTIC_CHAIR),
        Kind::RemovedChair => chair(draw, REMOVED_CHAIR, at_ring, turned, METAL_CHAIR),
        Kind::ChairAtWall => chair(draw, "chair at the wall", before_wall(CHAIR_TO_WALL_M), turned, METAL_CHAIR),
        Kind::Table => table(draw, at_ring, turned),
        Kind::Shelf => shelf(draw, before_wall(0.2), from_wall_yaw),
        Kind::Sofa => sofa(draw, before_wall(0.5), from_wall_yaw),
        Kind::Lamp => lamp(draw, at_ring),
        Kind::Hanger => clothes_hanger(draw, at_ring + DVec3::Y * 1.6, turned),
        Kind::Stool => stool(draw, at_ring, turned),
        Kind::Cabinet => named("cabinet", cabinet(draw, before_wall(0.25), from_wall_yaw)),
        Kind::DoorFrame => door_frame(draw, before_wall(0.02), from_wall_yaw),
    }
}

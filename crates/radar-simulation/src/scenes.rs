//! The thesis' scenes and furnished rooms, floor at y = 0. Thesis scenes lie ahead (−z) of where the sensor starts; rooms
//! have their middle at the origin.

use glam::DVec3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::furniture::{
    Draw, METAL_CHAIR, PLASTIC_CHAIR, chair, clothes_hanger, corner_reflector, lamp, shelf, sofa, table,
};
use super::{Room, SceneObject, WallPanel};
use radar_sar::geometry::{Aabb, Plane};

/// Scenes by name.
pub const SCENES: [&str; 9] = [
    "corner-reflector",
    "raised-reflector",
    "pair",
    "clothes-hanger",
    "chair",
    "two-chairs",
    "furnished-room",
    "empty-room",
    "nothing",
];

/// No such scene.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("scene \"{0}\" is not known: use {list}", list = SCENES.join(", "))]
pub struct SceneError(pub String);

/// A room and where the thesis' motions start in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// What stands in it.
    pub room: Room,
    /// Where the sensor starts, metres.
    pub start_m: DVec3,
    /// What it is turned to, metres.
    pub look_at_m: DVec3,
}

/// The scene of that name; the seed places furniture and draws phases and lobes.
///
/// # Errors
/// No such scene.
pub fn scene(name: &str, seed: u64) -> Result<Scene, SceneError> {
    let mut draw = Draw(ChaCha8Rng::seed_from_u64(seed ^ 0x5CE7_E5ED));
    let standing = DVec3::new(0.0, 1.5, 0.0);
    let ahead = |things| Scene {
        room: Room { things, walls: Vec::new() },
        start_m: standing,
        look_at_m: standing + DVec3::NEG_Z,
    };
    match name {
        "corner-reflector" => Ok(ahead(vec![corner_reflector(&mut draw, DVec3::new(-0.3, 1.5, -1.0))])),
        // Where a sensor that moves level, or not at all, cannot tell its height.
        "raised-reflector" => Ok(ahead(vec![corner_reflector(&mut draw, DVec3::new(-0.3, 1.7, -1.0))])),
        "pair" => Ok(ahead(pair(&mut draw, DVec3::new(-0.3, 1.5, -1.0), standing).into())),
        "clothes-hanger" => Ok(ahead(vec![clothes_hanger(&mut draw, DVec3::new(0.1, 1.55, -1.1), 0.3)])),
        "chair" => Ok(looking_at_things(vec![chair(&mut draw, "chair", DVec3::new(0.0, 0.0, -1.3), 0.4, METAL_CHAIR)])),
        "two-chairs" => Ok(looking_at_things(vec![
            chair(&mut draw, "metal chair", DVec3::new(-0.45, 0.0, -1.2), 0.4, METAL_CHAIR),
            chair(&mut draw, "plastic chair", DVec3::new(0.5, 0.0, -1.45), -0.5, PLASTIC_CHAIR),
        ])),
        "furnished-room" => Ok(Scene { room: furnished_room(&mut draw), ..ahead(Vec::new()) }),
        "empty-room" => {
            let room = Room { things: Vec::new(), walls: room_walls(4.0, 5.0, 2.5) };
            Ok(Scene { room, ..ahead(Vec::new()) })
        }
        "nothing" => Ok(ahead(Vec::new())),
        other => Err(SceneError(other.into())),
    }
}

/// Things on the floor, seen from a metre up, the sensor turned to their middle.
fn looking_at_things(things: Vec<SceneObject>) -> Scene {
    let room = Room { things, walls: Vec::new() };
    let middle = Aabb::around(room.scatterers().map(|s| s.position_m)).map_or(DVec3::NEG_Z, |b| b.center());
    Scene { room, start_m: DVec3::new(0.0, 1.0, 0.0), look_at_m: middle }
}

/// Two equal corner reflectors 20 cm apart, level, across the line of sight from `seen_from` to their middle.
fn pair(draw: &mut Draw, middle: DVec3, seen_from: DVec3) -> [SceneObject; 2] {
    let across = (middle - seen_from).cross(DVec3::Y).normalize() * 0.1;
    let named = |name: &str, thing: SceneObject| SceneObject { name: name.into(), ..thing };
    [
        named("left corner reflector", corner_reflector(draw, middle - across)),
        named("right corner reflector", corner_reflector(draw, middle + across)),
    ]
}

pub(super) fn room_walls(width_m: f64, depth_m: f64, height_m: f64) -> Vec<WallPanel> {
    let (x, y, z) = (width_m / 2.0, height_m, depth_m / 2.0);
    let all = Aabb { min: DVec3::new(-x, 0.0, -z), max: DVec3::new(x, y, z) };
    let wall = |name: &str, outward: DVec3, offset_m: f64, reflection_db: f64| {
        let on_plane = |corner: DVec3| corner + outward * (offset_m - outward.dot(corner));
        let extent = Aabb::from_corners(on_plane(all.min), on_plane(all.max));
        WallPanel { name: name.into(), plane: Plane { outward, offset_m }, extent, reflection_db }
    };
    vec![
        wall("wall −z", DVec3::NEG_Z, z, -10.0),
        wall("wall +z", DVec3::Z, z, -10.0),
        wall("wall −x", DVec3::NEG_X, x, -10.0),
        wall("wall +x", DVec3::X, x, -10.0),
        wall("floor", DVec3::NEG_Y, 0.0, -8.0),
        wall("ceiling", DVec3::Y, y, -10.0),
    ]
}

/// 4 × 5 m: furniture along the walls and into the room, each jittered by the seed.
fn furnished_room(draw: &mut Draw) -> Room {
    let jitter =
        |draw: &mut Draw, x: f64, z: f64| DVec3::new(x + draw.uniform(-0.12, 0.12), 0.0, z + draw.uniform(-0.12, 0.12));
    let turn = |draw: &mut Draw, yaw: f64| yaw + draw.uniform(-0.3, 0.3);
    let (at, yaw) = (jitter(draw, -0.9, -1.1), turn(draw, 0.5));
    let near_chair = chair(draw, "chair", at, yaw, METAL_CHAIR);
    let (at, yaw) = (jitter(draw, 1.15, -0.4), turn(draw, -1.4));
    let side_chair = chair(draw, "side chair", at, yaw, METAL_CHAIR);
    let (at, yaw) = (jitter(draw, 0.7, -1.75), turn(draw, 0.0));
    let table = table(draw, at, yaw);
    let (at, yaw) = (DVec3::new(-1.75, 0.0, 0.3), -std::f64::consts::FRAC_PI_2);
    let shelf = shelf(draw, at, yaw);
    let (at, yaw) = (DVec3::new(0.3 + draw.uniform(-0.2, 0.2), 0.0, 1.85), std::f64::consts::PI);
    let sofa = sofa(draw, at, yaw);
    let at = jitter(draw, 1.25, 0.95);
    let lamp = lamp(draw, at);
    let at = DVec3::new(-1.15 + draw.uniform(-0.1, 0.1), 1.75, 1.1 + draw.uniform(-0.1, 0.1));
    let hanger = clothes_hanger(draw, at, 0.8);
    Room { things: vec![near_chair, side_chair, table, shelf, sofa, lamp, hanger], walls: room_walls(4.0, 5.0, 2.5) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scene_exists_and_depends_on_the_seed() {
        for name in SCENES {
            assert_eq!(scene(name, 7).unwrap(), scene(name, 7).unwrap());
        }
        assert_ne!(scene("furnished-room", 1).unwrap(), scene("furnished-room", 2).unwrap());
        assert!(scene("moon", 1).unwrap_err().to_string().contains("furnished-room"));
    }

    #[test]
    fn pair_is_two_equal_reflectors_20_cm_apart_across_range() {
        let scene = scene("pair", 3).unwrap();
        let both: Vec<_> = scene.room.scatterers().collect();
        assert_eq!((both.len(), both[0].rcs_dbsm), (2, both[1].rcs_dbsm));
        assert!((both[0].position_m.distance(both[1].position_m) - 0.2).abs() < 1e-9);
        assert!((both[0].position_m.distance(scene.start_m) - both[1].position_m.distance(scene.start_m)).abs() < 1e-9);
        // Left of the boresight's left: the first named.
        assert!(both[0].position_m.x < both[1].position_m.x);
    }

    #[test]
    fn furniture_stands_inside_the_walls() {
        for seed in 0..20 {
            let room = scene("furnished-room", seed).unwrap().room;
            assert!(room.scatterers().count() > 40);
            for wall in &room.walls {
                assert!(room.scatterers().all(|s| wall.plane.distance(s.position_m) > 0.0), "{}", wall.name);
            }
        }
    }
}

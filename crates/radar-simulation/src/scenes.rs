//! Scenes of the thesis and furnished rooms, with the floor at y = 0. Scenes of the thesis lie
//! ahead (−z) of the sensor's start; rooms are centred at the origin.

use glam::DVec3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::furniture::{
    Draw, METAL_CHAIR, PLASTIC_CHAIR, chair, clothes_hanger, corner_reflector, lamp, shelf, sofa, table,
};
use super::{Room, SceneObject, WallPanel};
use radar_sar::geometry::{Aabb, Plane};

/// Names of all scenes.
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

/// Unknown scene.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("scene \"{0}\" is not known: use {list}", list = SCENES.join(", "))]
pub struct SceneError(pub String);

/// A room, and the start of the thesis' motions in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The room.
    pub room: Room,
    /// Start of the sensor, metres.
    pub start_m: DVec3,
    /// Point that the sensor faces, metres.
    pub look_at_m: DVec3,
}

/// The scene with this name; the seed varies furniture positions, phases and lobes.
///
/// # Errors
/// Unknown scene.
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
        // A sensor that moves only horizontally, or not at all, cannot determine the height of this
        // one.
        "raised-reflector" => Ok(ahead(vec![corner_reflector(&mut draw, DVec3::new(-0.3, 1.7, -1.0))])),
        "pair" => Ok(ahead(pair(&mut draw, DVec3::new(-0.3, 1.5, -1.0), standing).into())),
        "clothes-hanger" => Ok(ahead(vec![clothes_hanger(&mut draw, DVec3::new(0.1, 1.55, -1.1), 0.3)])),
        "chair" => {
            Ok(looking_at_objects(vec![chair(&mut draw, "chair", DVec3::new(0.0, 0.0, -1.3), 0.4, METAL_CHAIR)]))
        }
        "two-chairs" => Ok(looking_at_objects(vec![
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

/// Objects on the floor, with the sensor 1 m above the floor and facing their centre.
fn looking_at_objects(things: Vec<SceneObject>) -> Scene {
    let room = Room { things, walls: Vec::new() };
    let middle = Aabb::around(room.scatterers().map(|s| s.position_m)).map_or(DVec3::NEG_Z, |b| b.center());
    Scene { room, start_m: DVec3::new(0.0, 1.0, 0.0), look_at_m: middle }
}

/// Two equal corner reflectors 20 cm apart, horizontally across the line of sight from `seen_from`
/// to their centre.
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

/// A room of 4 × 5 m with furniture along the walls and inside, at seeded offsets.
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
        // The first one is on the left.
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

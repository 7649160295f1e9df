//! What stands in a room: objects of panels, tubes and fittings, and the room's shell, in three families of worlds.

// The session calls this once it is wired.
#![allow(dead_code, unused_imports)]

mod assembly;
mod evaluation;
mod family;
mod fixtures;
mod floor_plan;
pub(crate) mod material;
mod object;
mod parts;
mod placement;
mod shell;
mod training;
mod tuning;
#[cfg(test)]
mod world_tests;

use glam::DVec3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use radar_sar::math;

use crate::echoes::{EchoScene, Sampling};
use crate::furniture::Draw;

pub(crate) use assembly::{Assembly, four_corners};
pub(crate) use family::{CHAIR_AT_WALL, Family, Item, REMOVABLE_CHAIR};
pub(crate) use floor_plan::{Ceiling, FloorPlan, Rectangle, RoomShape, WallLine};
pub(crate) use material::Material;
pub(crate) use object::{Furniture, ObjectKind, WorldObject};
pub(crate) use parts::{Corner, Edge, FloorEdge, InnerEdge, Panel, Parts, SURFACE_SPACING_M, Tube};
pub(crate) use shell::{Finish, Opening, OpeningKind, Shell, WorldWall};

use family::Style;
use placement::{Footprint, Furnisher};

/// Spacing of the diffuse points of objects, metres. Choice: half the envelope of profile 3, at which a surface's
/// echo is as random as with denser points.
const OBJECT_SPACING_M: f64 = 0.07;
/// Spacing of the diffuse points of walls, floor and ceiling, metres. Choice: about two envelopes of profile 3; nearer
/// ones cost more than all furniture.
const SHELL_SPACING_M: f64 = 0.25;
/// Width and height of a door, and width of a window, metres. Source: DIN 18101; a usual window.
const DOOR_M: [f64; 2] = [0.86, 2.0];
const WINDOW_M: f64 = 1.3;

/// A furnished room, its floor at y = 0, the play area's centre at the origin.
#[derive(Debug, Clone)]
pub(crate) struct World {
    pub family: Family,
    pub shape: RoomShape,
    /// What the player keeps clear of, besides the objects.
    pub plan: FloorPlan,
    pub objects: Vec<WorldObject>,
    pub shell: Shell,
    /// Index of the object that may be removed.
    pub removable: usize,
    finish: Finish,
    seed: u64,
}

impl World {
    /// The world of a family with this seed; the shape follows from the seed.
    pub fn new(family: Family, seed: u64) -> Self {
        let shape = RoomShape::ALL[(seed % RoomShape::ALL.len() as u64) as usize];
        Self::with_shape(family, shape, seed)
    }

    /// A world of this shape.
    pub fn with_shape(family: Family, shape: RoomShape, seed: u64) -> Self {
        // A room in which a chair finds no place is drawn again.
        let mut attempt = 0;
        loop {
            if let Some(world) = Self::attempt(family, shape, seed, attempt) {
                return world;
            }
            attempt += 1;
        }
    }

    fn attempt(family: Family, shape: RoomShape, seed: u64, attempt: u64) -> Option<Self> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x3007_1D5E);
        rng.set_stream(family as u64 * 1000 + attempt);
        let mut draw = Draw(rng);
        let style = family.style();
        let size_m = [style.width_m, style.depth_m].map(|(low, high)| draw.uniform(low, high));
        let height_m = draw.uniform(style.height_m.0, style.height_m.1);
        let plan = FloorPlan::new(shape, size_m, height_m, &mut draw.0);
        let (openings, mut objects, taken) = fixtures(family, &style, &plan, &mut draw);
        let shell = Shell::new(&plan, &style.finish, &openings);
        let mut furnisher = Furnisher { plan: &plan, taken };
        let mut removable = None;
        for (n, Item { furniture, place, removable: is_removable }) in family.items(&mut draw).into_iter().enumerate() {
            match furnisher.place(&furniture, place, &mut draw) {
                Some(object) => objects.push(object),
                None if n < 4 => return None,
                None => continue,
            }
            if is_removable {
                removable = Some(objects.len() - 1);
            }
        }
        let (removable, finish) = (removable?, style.finish);
        Some(Self { family, shape, plan, objects, shell, removable, finish, seed })
    }

    /// What returns echoes, with all objects or without the removed one; the others' echoes are the same in both.
    pub fn echoes(&self, removed: bool) -> EchoScene {
        let there = |n: &usize| !(removed && *n == self.removable);
        let objects = (0..self.objects.len()).filter(there).map(|n| (n as u64, &self.objects[n].parts));
        let sampling = Sampling { spacing_m: OBJECT_SPACING_M, shell_spacing_m: SHELL_SPACING_M, seed: self.seed };
        EchoScene::new(&self.shell.parts, objects, self.finish.floor.specular(), &sampling)
    }
}

/// Doors, windows and what hangs on walls: openings, objects, and the floor that they need.
fn fixtures(
    family: Family,
    style: &Style,
    plan: &FloorPlan,
    draw: &mut Draw,
) -> (Vec<Opening>, Vec<WorldObject>, Vec<Footprint>) {
    let walls = plan.walls();
    // Walls that are long and high enough, in random order.
    let mut free: Vec<usize> = (0..walls.len())
        .filter(|&n| {
            let middle = 0.5 * (walls[n].from + walls[n].to);
            walls[n].length_m() >= 2.2
                && (plan.ceiling == Ceiling::Flat || walls[n].inward().x > -0.5 || middle.x < 0.0)
        })
        .collect();
    for n in (1..free.len()).rev() {
        free.swap(n, (draw.uniform(0.0, (n + 1) as f64) as usize).min(n));
    }
    let (mut openings, mut objects, mut taken) = (Vec::new(), Vec::new(), Vec::new());
    let mut hang = |furniture: &Furniture, wall: &WallLine, along_m: f64, room_m: f64| {
        let at = wall.from + wall.along() * along_m;
        let (at_m, yaw_rad) = (DVec3::new(at.x, 0.0, at.y), math::atan2(-wall.inward().x, -wall.inward().y));
        let extent = furniture.extent();
        taken.push(Footprint::new(extent.min - DVec3::Z * room_m, extent.max, at_m, yaw_rad));
        objects.push(furniture.placed(at_m, yaw_rad));
    };
    let [door, window] = family.frames(DOOR_M, WINDOW_M);
    for (n, kind) in [OpeningKind::Door, OpeningKind::Window].into_iter().enumerate() {
        let Some(&index) = free.get(n) else { continue };
        let wall = &walls[index];
        let (width_m, heights_m) = match kind {
            OpeningKind::Door => (DOOR_M[0], [0.0, DOOR_M[1]]),
            OpeningKind::Window => (WINDOW_M, style.window_heights_m),
        };
        let along_m = draw.uniform(0.5 * width_m + 0.4, wall.length_m() - 0.5 * width_m - 0.4);
        let span_m = [along_m - 0.5 * width_m, along_m + 0.5 * width_m];
        openings.push(Opening { kind, wall: index, along_m: span_m, heights_m });
        match kind {
            OpeningKind::Door => hang(&door, wall, along_m, 0.4),
            OpeningKind::Window => {
                hang(&window, wall, along_m, 0.0);
                let cover = (style.cover)(style.cover_width_m, [0.05f64.max(heights_m[0] - 0.4), heights_m[1]]);
                hang(&cover, wall, span_m[0], 0.05);
                if heights_m[0] > 0.7 {
                    hang(&(style.radiator)(draw.uniform(0.7, 1.1), 0.5), wall, along_m, 0.1);
                }
            }
        }
    }
    let hanging_wall = free.get(2).or(free.first());
    if let Some(&index) = hanging_wall {
        let (wall, furniture) = (&walls[index], family.wall_hanging(draw));
        if free.len() > 2 {
            let along_m = draw.uniform(0.8, wall.length_m() - 0.8);
            hang(&furniture, wall, along_m, 0.0);
            if style.window_heights_m[0] <= 0.7 {
                hang(&(style.radiator)(draw.uniform(0.6, 1.0), 0.6), wall, along_m, 0.1);
            }
        }
    }
    (openings, objects, taken)
}

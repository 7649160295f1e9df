//! What stands in a room: objects of panels, tubes and fittings, and the room's shell, in families of worlds.

mod assembly;
mod dining;
mod family;
mod fixtures;
mod floor_plan;
mod living;
pub(crate) mod material;
mod object;
mod office;
mod parts;
mod placement;
mod shell;
mod wall_fittings;
#[cfg(test)]
mod world_tests;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::furniture::Draw;

#[cfg(test)]
pub(crate) use assembly::Assembly;
#[cfg(test)]
pub(crate) use family::{CHAIR_AT_WALL, REMOVABLE_CHAIR};
pub(crate) use family::{Family, Item};
pub(crate) use floor_plan::{FloorPlan, RoomShape};
#[cfg(test)]
pub(crate) use material::Material;
pub(crate) use object::{ObjectKind, WorldObject};
pub(crate) use parts::{Corner, Edge, InnerEdge, Panel, Parts, Tube};
pub(crate) use shell::{Finish, Shell, WorldWall};

use placement::Furnisher;
use wall_fittings::WallFittings;

/// A furnished room, its floor at y = 0, the play area's centre at the origin.
#[derive(Debug, Clone)]
pub(crate) struct World {
    /// What the player keeps clear of, besides the objects.
    pub plan: FloorPlan,
    pub objects: Vec<WorldObject>,
    pub shell: Shell,
    /// Index of the object that may be removed; `None` in a bare room.
    pub removable: Option<usize>,
    finish: Finish,
    /// What its random numbers come from.
    pub seed: u64,
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
        let WallFittings { openings, mut objects, taken } = WallFittings::new(family, &plan, &mut draw);
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
        Some(Self { plan, objects, shell, removable, finish: style.finish, seed })
    }

    /// Specularly reflected power of the floor.
    pub fn floor_reflectivity(&self) -> f64 {
        self.finish.floor.specular()
    }
}

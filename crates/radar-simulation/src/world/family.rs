//! Families of worlds: each has builders, materials and proportions of its own, so that what was tuned on one is not
//! tested on its like.

use crate::furniture::Draw;

use super::fixtures::{blind, column_radiator, curtain, door_frame, picture, plate_radiator, whiteboard, window_frame};
use super::material::{CARPET, CONCRETE, METAL, MINERAL_FIBRE, Material, PLASTER, PLASTERBOARD, PLASTIC, TILE, WOOD};
use super::object::Furniture;
use super::placement::Place;
use super::shell::Finish;
use super::{dining, living, office};

/// A family of worlds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Family {
    /// Offices: to train on.
    Office,
    /// Dining rooms: to choose settings on.
    Dining,
    /// Living rooms: for figures only.
    Living,
    /// Walls, floor and ceiling alone.
    Bare,
}

/// A piece of furniture and where it is to stand.
#[derive(Debug, Clone)]
pub(crate) struct Item {
    pub furniture: Furniture,
    pub place: Place,
    /// Whether it is the object that may be removed.
    pub removable: bool,
}

/// What a family's rooms are made of.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Style {
    pub finish: Finish,
    pub width_m: (f64, f64),
    pub depth_m: (f64, f64),
    pub height_m: (f64, f64),
    pub frame: Material,
    pub frame_board_m: f64,
    pub window_heights_m: [f64; 2],
    pub radiator: fn(f64, f64) -> Furniture,
    /// Before the window.
    pub cover: fn(f64, [f64; 2]) -> Furniture,
    pub cover_width_m: f64,
}

/// Distance of a chair's centre from the wall behind it, metres. Choice: a chair before a strong wall is the case that
/// wall cancellation is for.
const CHAIR_TO_WALL_M: f64 = 0.5;

/// Name of the chair half a metre before a wall, and of the one that may be removed.
pub(crate) const CHAIR_AT_WALL: &str = "chair at the wall";
pub(crate) const REMOVABLE_CHAIR: &str = "chair to be removed";

fn item(furniture: Furniture, place: Place) -> Item {
    Item { furniture, place, removable: false }
}

/// The four chairs that every room has: hard, soft, before a wall, to be removed.
fn chairs(hard: Furniture, soft: Furniture, at_wall: Furniture, removable: Furniture) -> Vec<Item> {
    vec![
        Item { furniture: removable.named(REMOVABLE_CHAIR), place: Place::Ring, removable: true },
        item(at_wall.named(CHAIR_AT_WALL), Place::BeforeWall(CHAIR_TO_WALL_M)),
        item(hard, Place::Ring),
        item(soft, Place::Ring),
    ]
}

impl Family {
    #[cfg(test)]
    pub const ALL: [Self; 3] = [Self::Office, Self::Dining, Self::Living];

    /// Furniture of a room, the most important first.
    pub fn items(self, draw: &mut Draw) -> Vec<Item> {
        match self {
            Self::Office => office_items(draw),
            Self::Dining => dining_items(draw),
            Self::Living => living_items(draw),
            Self::Bare => Vec::new(),
        }
    }

    /// What hangs on a free wall.
    pub fn wall_hanging(self, draw: &mut Draw) -> Furniture {
        match self {
            Self::Office => whiteboard(draw.uniform(0.9, 1.4), 0.9),
            Self::Dining | Self::Bare => picture(draw.uniform(0.4, 0.7), draw.uniform(0.4, 0.6), 1.5, WOOD),
            Self::Living => picture(draw.uniform(0.7, 1.1), draw.uniform(0.5, 0.8), 1.55, METAL),
        }
    }

    pub fn style(self) -> Style {
        match self {
            Self::Office => Style {
                finish: Finish { wall: PLASTERBOARD, floor: CARPET, ceiling: MINERAL_FIBRE, door: WOOD },
                width_m: (4.2, 5.2),
                depth_m: (4.6, 5.6),
                height_m: (2.5, 2.8),
                frame: METAL,
                frame_board_m: 0.06,
                window_heights_m: [0.85, 2.2],
                radiator: plate_radiator,
                cover: blind,
                cover_width_m: 1.0,
            },
            Self::Dining | Self::Bare => Style {
                finish: Finish { wall: PLASTER, floor: WOOD, ceiling: PLASTER, door: WOOD },
                width_m: (4.0, 4.8),
                depth_m: (4.4, 5.2),
                height_m: (2.4, 2.6),
                frame: WOOD,
                frame_board_m: 0.09,
                window_heights_m: [0.8, 2.05],
                radiator: plate_radiator,
                cover: curtain,
                cover_width_m: 0.35,
            },
            Self::Living => Style {
                finish: Finish { wall: CONCRETE, floor: TILE, ceiling: PLASTER, door: PLASTIC },
                width_m: (4.1, 5.0),
                depth_m: (4.5, 5.6),
                height_m: (2.4, 2.7),
                frame: PLASTIC,
                frame_board_m: 0.07,
                window_heights_m: [0.35, 2.15],
                radiator: column_radiator,
                cover: curtain,
                cover_width_m: 0.7,
            },
        }
    }

    /// Frames of the family's doors and windows.
    pub fn frames(self, door_m: [f64; 2], window_m: f64) -> [Furniture; 2] {
        let style = self.style();
        [
            door_frame(door_m[0], door_m[1], style.frame_board_m, style.frame),
            window_frame(window_m, style.window_heights_m, style.frame_board_m, style.frame),
        ]
    }
}

fn office_items(draw: &mut Draw) -> Vec<Item> {
    use office::*;
    let mut items = chairs(visitor_chair(draw), swivel_chair(draw), visitor_chair(draw), folding_chair(draw));
    items.extend([
        item(desk(draw), Place::AtWall(0.03)),
        item(metal_shelf(draw), Place::AtWall(0.03)),
        item(office_lamp(draw), Place::Ring),
        item(strip_light(draw), Place::Ring),
        item(coat_on_hanger(draw), Place::Ring),
        item(waiting_bench(draw), Place::AtWall(0.05)),
        item(pedestal(draw), Place::Ring),
        item(bin(draw), Place::Ring),
        item(screen_table(draw), Place::AtWall(0.1)),
    ]);
    items
}

fn dining_items(draw: &mut Draw) -> Vec<Item> {
    use dining::*;
    let mut items = chairs(slat_chair(draw), padded_chair(draw), padded_chair(draw), spindle_chair(draw));
    items.extend([
        item(dining_table(draw), Place::Ring),
        item(bookcase(draw), Place::AtWall(0.02)),
        item(tripod_lamp(draw), Place::Ring),
        item(pendant(draw), Place::Ring),
        item(settle(draw), Place::AtWall(0.04)),
        item(sideboard(draw), Place::AtWall(0.02)),
        item(milking_stool(draw), Place::Ring),
        item(crate_of_boards(draw), Place::Ring),
    ]);
    items
}

fn living_items(draw: &mut Draw) -> Vec<Item> {
    use living::*;
    let mut items = chairs(wire_chair(draw), armchair(draw), wire_chair(draw), cantilever_chair(draw));
    items.extend([
        item(glass_table(draw), Place::Ring),
        item(ladder_shelf(draw), Place::AtWall(0.02)),
        item(sofa(draw), Place::AtWall(0.1)),
        item(arc_lamp(draw), Place::Ring),
        item(hanging_pot(draw), Place::Ring),
        item(plant(draw), Place::Ring),
        item(cables(draw), Place::Ring),
        item(steps(draw), Place::AtWall(0.0)),
        item(television(draw), Place::AtWall(0.08)),
        item(pouffe(draw), Place::Ring),
    ]);
    items
}

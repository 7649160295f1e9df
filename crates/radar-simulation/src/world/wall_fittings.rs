//! Chooses the walls for a room's door and window, and for what hangs on walls.

use glam::DVec3;

use radar_sar::math;

use crate::furniture::Draw;

use super::family::Family;
use super::floor_plan::{Ceiling, FloorPlan, WallLine};
use super::object::{Furniture, WorldObject};
use super::placement::Footprint;
use super::shell::{Opening, OpeningKind};

/// Width and height of a door, and width of a window, metres. Source: DIN 18101; a usual window.
const DOOR_M: [f64; 2] = [0.86, 2.0];
const WINDOW_M: f64 = 1.3;
/// Shortest wall that gets a fitting, metres. Choice: a window with 40 cm on either side.
const MIN_WALL_M: f64 = 2.2;
/// Floor that stays free before a door, and before a radiator, metres. Choice: one can pass, and heat can.
const BEFORE_DOOR_M: f64 = 0.4;
const BEFORE_RADIATOR_M: f64 = 0.1;
/// A window that begins below this has its radiator on another wall, metres. Choice: a radiator's height.
const LOW_WINDOW_M: f64 = 0.7;

/// Openings in the walls, what hangs on them, and the floor that it takes.
#[derive(Debug, Default)]
pub(super) struct WallFittings {
    pub openings: Vec<Opening>,
    pub objects: Vec<WorldObject>,
    pub taken: Vec<Footprint>,
}

impl WallFittings {
    pub fn new(family: Family, plan: &FloorPlan, draw: &mut Draw) -> Self {
        let (walls, mut fittings) = (plan.walls(), Self::default());
        if family == Family::Bare {
            return fittings;
        }
        let free = free_walls(plan, &walls, draw);
        if let Some(&index) = free.first() {
            fittings.add_door(family, index, &walls[index], draw);
        }
        if let Some(&index) = free.get(1) {
            fittings.add_window(family, index, &walls[index], draw);
        }
        if let Some(&index) = free.get(2) {
            let (wall, style) = (&walls[index], family.style());
            let along_m = draw.uniform(0.8, wall.length_m() - 0.8);
            fittings.hang(&family.wall_hanging(draw), wall, along_m, 0.0);
            if style.window_heights_m[0] < LOW_WINDOW_M {
                fittings.hang(&(style.radiator)(draw.uniform(0.6, 1.0), 0.6), wall, along_m, BEFORE_RADIATOR_M);
            }
        }
        fittings
    }

    fn add_door(&mut self, family: Family, index: usize, wall: &WallLine, draw: &mut Draw) {
        let along_m = self.open(OpeningKind::Door, index, wall, DOOR_M[0], [0.0, DOOR_M[1]], draw);
        let [frame, _] = family.frames(DOOR_M, WINDOW_M);
        self.hang(&frame, wall, along_m, BEFORE_DOOR_M);
    }

    fn add_window(&mut self, family: Family, index: usize, wall: &WallLine, draw: &mut Draw) {
        let style = family.style();
        let [low, high] = style.window_heights_m;
        let along_m = self.open(OpeningKind::Window, index, wall, WINDOW_M, [low, high], draw);
        let [_, frame] = family.frames(DOOR_M, WINDOW_M);
        self.hang(&frame, wall, along_m, 0.0);
        let cover = (style.cover)(style.cover_width_m, [(low - 0.4).max(0.05), high]);
        self.hang(&cover, wall, along_m - 0.5 * WINDOW_M, 0.05);
        if low >= LOW_WINDOW_M {
            self.hang(&(style.radiator)(draw.uniform(0.7, 1.1), 0.5), wall, along_m, BEFORE_RADIATOR_M);
        }
    }

    /// Opens a wall somewhere; the opening's middle along it, metres.
    fn open(
        &mut self,
        kind: OpeningKind,
        index: usize,
        wall: &WallLine,
        width_m: f64,
        heights_m: [f64; 2],
        draw: &mut Draw,
    ) -> f64 {
        let margin_m = 0.5 * width_m + 0.4;
        let middle_m = draw.uniform(margin_m, wall.length_m() - margin_m);
        let along_m = [middle_m - 0.5 * width_m, middle_m + 0.5 * width_m];
        self.openings.push(Opening { kind, wall: index, along_m, heights_m });
        middle_m
    }

    /// Hangs an object on a wall, with free floor before it.
    fn hang(&mut self, furniture: &Furniture, wall: &WallLine, along_m: f64, free_m: f64) {
        let at = wall.from + wall.along() * along_m;
        let (at_m, yaw_rad) = (DVec3::new(at.x, 0.0, at.y), math::atan2(-wall.inward().x, -wall.inward().y));
        let extent = furniture.extent();
        self.taken.push(Footprint::new(extent.min - DVec3::Z * free_m, extent.max, at_m, yaw_rad));
        self.objects.push(furniture.placed(at_m, yaw_rad));
    }
}

/// Walls that are long and high enough, in random order.
fn free_walls(plan: &FloorPlan, walls: &[WallLine], draw: &mut Draw) -> Vec<usize> {
    let is_under_slope = |wall: &WallLine| plan.ceiling != Ceiling::Flat && wall.inward().x < -0.5;
    let mut free: Vec<usize> =
        (0..walls.len()).filter(|&n| walls[n].length_m() >= MIN_WALL_M && !is_under_slope(&walls[n])).collect();
    for n in (1..free.len()).rev() {
        free.swap(n, (draw.uniform(0.0, (n + 1) as f64) as usize).min(n));
    }
    free
}

//! Furniture of a dining room: solid wood, turned legs, cushions, books.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

use radar_sar::math;

use crate::furniture::Draw;

use super::assembly::{Assembly, four_corners};
use super::material::{METAL, PAPER, ROUGH_WOOD, TEXTILE, UPHOLSTERY, WOOD};
use super::object::{Furniture, ObjectKind};

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// A square wooden post on the floor.
fn post(assembly: &mut Assembly, foot: DVec3, side_m: f64, height_m: f64) {
    assembly.cuboid_on_floor(foot, v(side_m, height_m, side_m), WOOD);
}

/// A dining chair: four square legs, aprons, a wooden seat, a back of slats.
pub(crate) fn slat_chair(draw: &mut Draw) -> Furniture {
    let (half_m, seat_m) = (draw.uniform(0.18, 0.21), draw.uniform(0.44, 0.47));
    let leg_m = draw.uniform(0.034, 0.045);
    let back_m = draw.uniform(0.88, 1.02);
    let mut chair = Assembly::default();
    for (n, foot) in four_corners(half_m, 0.0, half_m).into_iter().enumerate() {
        let height_m = if n < 2 { seat_m - 0.015 } else { back_m };
        post(&mut chair, foot, leg_m, height_m);
    }
    for z in [-half_m, half_m] {
        chair.upright_board(v(0.0, seat_m - 0.06, z), 2.0 * half_m - leg_m, 0.07, WOOD);
    }
    chair.cuboid(v(0.0, seat_m, -0.01), v(2.0 * half_m + 0.03, 0.025, 2.0 * half_m), WOOD);
    let slats = if draw.uniform(0.0, 1.0) < 0.5 { 3 } else { 4 };
    for n in 0..slats {
        let y = back_m - 0.06 - 0.1 * f64::from(n);
        chair.upright_board(v(0.0, y, half_m), 2.0 * half_m - leg_m, 0.055, WOOD);
    }
    Furniture::new("slat chair", ObjectKind::HardChair, chair)
}

/// A dining chair with an upholstered seat and back on a wooden frame.
pub(crate) fn padded_chair(draw: &mut Draw) -> Furniture {
    let (half_m, seat_m) = (draw.uniform(0.2, 0.23), draw.uniform(0.46, 0.49));
    let mut chair = Assembly::default();
    for (n, foot) in four_corners(half_m, 0.0, half_m).into_iter().enumerate() {
        let splay = if n < 2 { 0.0 } else { 0.07 };
        chair.tube(foot + DVec3::Z * splay, v(foot.x, seat_m - 0.05, foot.z), 0.018, WOOD);
    }
    chair.cuboid(v(0.0, seat_m - 0.02, 0.0), v(2.0 * half_m + 0.04, 0.08, 2.0 * half_m + 0.02), UPHOLSTERY);
    let mut back = Assembly::default();
    back.cuboid(DVec3::ZERO, v(2.0 * half_m, draw.uniform(0.4, 0.52), 0.05), UPHOLSTERY);
    chair.add(back, v(0.0, seat_m + 0.28, half_m + 0.06), DQuat::from_rotation_x(0.18));
    for x in [-0.15, 0.0, 0.15] {
        chair.lobed_fitting(v(x, seat_m + 0.4, half_m + 0.03), DVec3::NEG_Z, draw.uniform(-46.0, -40.0));
    }
    Furniture::new("padded chair", ObjectKind::SoftChair, chair)
}

/// A spindle-back chair: turned legs with stretchers, a row of spindles under a rail, arm rests.
pub(crate) fn spindle_chair(draw: &mut Draw) -> Furniture {
    let seat_m = draw.uniform(0.42, 0.45);
    let mut chair = Assembly::default();
    let tops = four_corners(0.17, seat_m - 0.02, 0.16);
    let feet = four_corners(0.23, 0.0, 0.22);
    for (foot, top) in feet.into_iter().zip(tops) {
        chair.tube(foot, top, 0.017, WOOD);
    }
    for (a, b) in [(0, 3), (1, 2)] {
        chair.tube(feet[a].lerp(tops[a], 0.4), feet[b].lerp(tops[b], 0.4), 0.011, WOOD);
    }
    chair.tube(v(-0.21, 0.4 * seat_m, 0.0), v(0.21, 0.4 * seat_m, 0.0), 0.011, WOOD);
    chair.cuboid(v(0.0, seat_m, 0.0), v(0.44, 0.035, 0.42), WOOD);
    let spindles = 7;
    let rail =
        |share: f64, y: f64| v(0.38 * (share - 0.5), y, 0.19 + 0.05 * (y - seat_m) - 0.08 * (share - 0.5).powi(2));
    for n in 0..spindles {
        let share = (f64::from(n) + 0.5) / f64::from(spindles);
        chair.tube(rail(share, seat_m + 0.02), rail(share, seat_m + 0.42), 0.007, WOOD);
    }
    chair.upright_board(rail(0.5, seat_m + 0.45), 0.44, 0.06, WOOD);
    for x in [-0.22, 0.22] {
        chair.tube(v(x, seat_m, -0.1), v(x, seat_m + 0.22, -0.1), 0.012, WOOD);
        chair.cuboid(v(x, seat_m + 0.23, 0.03), v(0.05, 0.02, 0.34), WOOD);
    }
    Furniture::new("spindle chair", ObjectKind::HardChair, chair)
}

/// A dining table: thick top, four square legs, aprons, a runner of cloth, a bowl.
pub(crate) fn dining_table(draw: &mut Draw) -> Furniture {
    let (width_m, depth_m) = (draw.uniform(1.1, 1.5), draw.uniform(0.75, 0.9));
    let mut table = Assembly::default();
    table.cuboid(v(0.0, 0.74, 0.0), v(width_m, 0.04, depth_m), WOOD);
    let (x, z) = (0.5 * width_m - 0.07, 0.5 * depth_m - 0.07);
    for foot in four_corners(x, 0.0, z) {
        post(&mut table, foot, 0.075, 0.72);
    }
    for z in [-z, z] {
        table.upright_board(v(0.0, 0.67, z), 2.0 * x, 0.1, WOOD);
    }
    for x in [-x, x] {
        table.board(v(x, 0.67, 0.0), DVec3::Z * z, DVec3::Y * 0.05, WOOD);
    }
    table.sheet(v(0.0, 0.765, 0.0), DVec3::Z * 0.18, DVec3::X * (0.5 * width_m), TEXTILE);
    table.ring(v(draw.uniform(-0.2, 0.2), 0.765, 0.0), [0.06, 0.13], 0.08, 8, WOOD);
    Furniture::new("dining table", ObjectKind::Table, table)
}

/// A bookcase with books of unequal depth; its inner corners are right angles.
pub(crate) fn bookcase(draw: &mut Draw) -> Furniture {
    let (width_m, height_m) = (draw.uniform(0.7, 0.95), draw.uniform(1.5, 2.0));
    let depth_m = draw.uniform(0.26, 0.32);
    let mut shelf = Assembly::default();
    let half_m = 0.5 * width_m;
    for x in [-half_m, half_m] {
        shelf.cuboid_on_floor(v(x, 0.0, 0.0), v(0.022, height_m, depth_m), WOOD);
    }
    shelf.upright_board(v(0.0, 0.5 * height_m, 0.5 * depth_m - 0.005), width_m, height_m, WOOD);
    let boards = (height_m / 0.36).round() as usize;
    for n in 0..=boards {
        let y = 0.06 + (height_m - 0.08) * n as f64 / boards as f64;
        shelf.shelf_board(v(0.0, y, 0.0), width_m - 0.022, depth_m, WOOD);
        if n == boards {
            continue;
        }
        let back = v(half_m - 0.011, y, 0.5 * depth_m - 0.005);
        shelf.inner_edge([back * v(-1.0, 1.0, 1.0), back], v(0.0, 1.0, -1.0), WOOD);
        let mut x = 0.03 - half_m;
        let end = draw.uniform(-0.1, half_m - 0.05);
        while x < end {
            let size = v(draw.uniform(0.1, 0.25), draw.uniform(0.18, 0.28), draw.uniform(0.14, 0.22));
            let z = 0.5 * depth_m - 0.01 - 0.5 * size.z;
            shelf.cuboid(v(x + 0.5 * size.x, y + 0.5 * size.y, z), size, PAPER);
            x += size.x + 0.003;
        }
    }
    Furniture::new("bookcase", ObjectKind::Shelf, shelf)
}

/// A settle: a wooden chest with cushions and a panelled back.
pub(crate) fn settle(draw: &mut Draw) -> Furniture {
    let width_m = draw.uniform(1.2, 1.6);
    let mut settle = Assembly::default();
    settle.cuboid_on_floor(v(0.0, 0.0, 0.0), v(width_m, 0.4, 0.5), WOOD);
    for x in [-0.25 * width_m, 0.25 * width_m] {
        settle.cuboid(v(x, 0.44, -0.01), v(0.46 * width_m, 0.08, 0.46), UPHOLSTERY);
        settle.upright_board(v(x, 0.72, 0.22), 0.44 * width_m, 0.4, ROUGH_WOOD);
    }
    for x in [-0.5 * width_m, 0.5 * width_m] {
        settle.cuboid(v(x, 0.5, 0.0), v(0.03, 0.35, 0.5), WOOD);
    }
    settle.tube(v(-0.5 * width_m, 0.96, 0.23), v(0.5 * width_m, 0.96, 0.23), 0.02, WOOD);
    for x in [-0.3, 0.3] {
        settle.fitting(v(x, 0.38, 0.24), draw.uniform(-42.0, -34.0));
    }
    Furniture::new("settle", ObjectKind::Sofa, settle)
}

/// A tripod lamp: three wooden legs, a shade of cloth around a bulb with a metal socket.
pub(crate) fn tripod_lamp(draw: &mut Draw) -> Furniture {
    let height_m = draw.uniform(1.15, 1.4);
    let mut lamp = Assembly::default();
    let first = draw.uniform(0.0, TAU);
    for n in 0..3 {
        let (sin, cos) = math::sin_cos(first + TAU * f64::from(n) / 3.0);
        lamp.tube(v(0.27 * cos, 0.0, 0.27 * sin), v(0.03 * cos, height_m, 0.03 * sin), 0.014, WOOD);
    }
    lamp.ring(v(0.0, height_m - 0.02, 0.0), [0.24, 0.17], 0.3, 10, TEXTILE);
    lamp.tube(v(0.0, height_m, 0.0), v(0.0, height_m + 0.08, 0.0), 0.018, METAL);
    lamp.fitting(v(0.0, height_m - 0.01, 0.0), -32.0);
    Furniture::new("tripod lamp", ObjectKind::Lamp, lamp)
}

/// A pendant lamp: a metal dome on a cable, low over a table.
pub(crate) fn pendant(draw: &mut Draw) -> Furniture {
    let low_m = draw.uniform(1.45, 1.65);
    let mut lamp = Assembly::default();
    lamp.ring(v(0.0, low_m, 0.0), [draw.uniform(0.18, 0.25), 0.05], 0.18, 10, METAL);
    lamp.tube(v(0.0, low_m + 0.18, 0.0), v(0.0, 2.35, 0.0), 0.003, METAL);
    lamp.fitting(v(0.0, low_m + 0.05, 0.0), -30.0);
    Furniture::new("pendant lamp", ObjectKind::Hanging, lamp)
}

/// A sideboard on short legs with two doors and knobs.
pub(crate) fn sideboard(draw: &mut Draw) -> Furniture {
    let width_m = draw.uniform(1.0, 1.4);
    let mut board = Assembly::default();
    board.cuboid(v(0.0, 0.47, 0.0), v(width_m, 0.66, 0.4), WOOD);
    for foot in four_corners(0.45 * width_m, 0.0, 0.16) {
        board.tube(foot, foot + DVec3::Y * 0.14, 0.02, WOOD);
    }
    for x in [-0.06, 0.06] {
        board.lobed_fitting(v(x, 0.5, -0.22), DVec3::NEG_Z, draw.uniform(-38.0, -32.0));
    }
    board.ring(v(0.3, 0.8, 0.0), [0.07, 0.05], 0.25, 8, ROUGH_WOOD);
    Furniture::new("sideboard", ObjectKind::Cabinet, board)
}

/// A three-legged stool.
pub(crate) fn milking_stool(draw: &mut Draw) -> Furniture {
    let height_m = draw.uniform(0.4, 0.48);
    let mut stool = Assembly::default();
    for n in 0..3 {
        let (sin, cos) = math::sin_cos(TAU * f64::from(n) / 3.0);
        stool.tube(v(0.19 * cos, 0.0, 0.19 * sin), v(0.1 * cos, height_m, 0.1 * sin), 0.016, WOOD);
    }
    stool.cuboid(v(0.0, height_m + 0.015, 0.0), v(0.28, 0.03, 0.28), WOOD);
    Furniture::new("stool", ObjectKind::Stool, stool)
}

/// A crate of rough boards with gaps.
pub(crate) fn crate_of_boards(draw: &mut Draw) -> Furniture {
    let half_m = draw.uniform(0.18, 0.24);
    let mut open = Assembly::default();
    for n in 0..3 {
        let y = 0.06 + 0.11 * f64::from(n);
        for side in [-half_m, half_m] {
            open.upright_board(v(0.0, y, side), 2.0 * half_m, 0.08, ROUGH_WOOD);
            open.board(v(side, y, 0.0), DVec3::Z * half_m, DVec3::Y * 0.04, ROUGH_WOOD);
        }
    }
    open.shelf_board(v(0.0, 0.02, 0.0), 2.0 * half_m, 2.0 * half_m, ROUGH_WOOD);
    Furniture::new("crate", ObjectKind::Bin, open)
}

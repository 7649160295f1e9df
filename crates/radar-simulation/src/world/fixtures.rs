//! What hangs on walls: frames of doors and windows, pictures, boards, radiators, curtains, blinds. Each stands with
//! its back at z = 0, the wall's surface, and its front towards −z.

use glam::{DQuat, DVec3};

use radar_sar::math;

use super::assembly::Assembly;
use super::material::{GLASS, METAL, Material, TEXTILE};
use super::object::{Furniture, ObjectKind};

/// The frame of a door: two posts and a lintel around the opening, and the handle.
pub(crate) fn door_frame(width_m: f64, height_m: f64, board_m: f64, material: Material) -> Furniture {
    let mut frame = Assembly::default();
    let out_m = 0.5 * (width_m + board_m);
    for x in [-out_m, out_m] {
        frame.cuboid_on_floor(DVec3::new(x, 0.0, -0.01), DVec3::new(board_m, height_m + board_m, 0.02), material);
    }
    frame.cuboid(DVec3::new(0.0, height_m + 0.5 * board_m, -0.01), DVec3::new(width_m, board_m, 0.02), material);
    let handle = DVec3::new(0.5 * width_m - 0.07, 1.05, 0.0);
    frame.tube(handle + DVec3::Z * 0.02, handle - DVec3::Z * 0.03, 0.009, METAL);
    frame.tube(handle - DVec3::Z * 0.03, handle + DVec3::new(-0.11, 0.0, -0.03), 0.009, METAL);
    frame.lobed_fitting(handle - DVec3::Z * 0.03, DVec3::NEG_Z, -30.0);
    Furniture::new("door frame", ObjectKind::Fixture, frame)
}

/// The frame and sill of a window.
pub(crate) fn window_frame(width_m: f64, heights_m: [f64; 2], board_m: f64, material: Material) -> Furniture {
    let mut frame = Assembly::default();
    let [low, high] = heights_m;
    let middle = 0.5 * (low + high);
    let half_m = 0.5 * width_m - 0.5 * board_m;
    for x in [-half_m, half_m] {
        frame.cuboid(DVec3::new(x, middle, 0.06), DVec3::new(board_m, high - low, 0.05), material);
    }
    for y in [low + 0.5 * board_m, high - 0.5 * board_m] {
        frame.cuboid(DVec3::new(0.0, y, 0.06), DVec3::new(width_m - 2.0 * board_m, board_m, 0.05), material);
    }
    frame.shelf_board(DVec3::new(0.0, low, -0.03), width_m + 0.08, 0.18, material);
    Furniture::new("window frame", ObjectKind::Fixture, frame)
}

/// A picture behind glass, in a frame.
pub(crate) fn picture(width_m: f64, height_m: f64, middle_m: f64, material: Material) -> Furniture {
    let mut picture = Assembly::default();
    let middle = DVec3::new(0.0, middle_m, -0.012);
    picture.sheet(middle, DVec3::Y * (0.5 * height_m), DVec3::X * (0.5 * width_m), GLASS);
    for side in [-1.0, 1.0] {
        let upright = middle + DVec3::new(side * 0.5 * width_m, 0.0, -0.003);
        picture.cuboid(upright, DVec3::new(0.025, height_m + 0.025, 0.025), material);
        let level = middle + DVec3::new(0.0, side * 0.5 * height_m, -0.003);
        picture.cuboid(level, DVec3::new(width_m - 0.025, 0.025, 0.025), material);
    }
    Furniture::new("picture", ObjectKind::Fixture, picture)
}

/// A flat board with a metal surface and a rail.
pub(crate) fn whiteboard(width_m: f64, height_m: f64) -> Furniture {
    let mut board = Assembly::default();
    let middle = DVec3::new(0.0, 1.45, -0.02);
    board.upright_board(middle, width_m, height_m, METAL);
    let below = middle - DVec3::new(0.0, 0.5 * height_m, 0.04);
    board.shelf_board(below, 0.6 * width_m, 0.08, METAL);
    Furniture::new("whiteboard", ObjectKind::Fixture, board)
}

/// A radiator of round metal columns.
pub(crate) fn column_radiator(width_m: f64, height_m: f64) -> Furniture {
    let mut radiator = Assembly::default();
    let columns = (width_m / 0.05).round() as usize;
    for n in 0..columns {
        let x = (n as f64 + 0.5) * 0.05 - 0.5 * width_m;
        for z in [-0.05, -0.12] {
            radiator.tube(DVec3::new(x, 0.12, z), DVec3::new(x, 0.12 + height_m, z), 0.0125, METAL);
        }
    }
    for y in [0.13, 0.11 + height_m] {
        let end = DVec3::new(0.5 * width_m, y, -0.085);
        radiator.tube(end * DVec3::new(-1.0, 1.0, 1.0), end, 0.02, METAL);
    }
    valve(&mut radiator, 0.5 * width_m + 0.04, 0.11 + height_m);
    Furniture::new("radiator", ObjectKind::Fixture, radiator)
}

/// A radiator of a smooth or profiled metal plate.
pub(crate) fn plate_radiator(width_m: f64, height_m: f64) -> Furniture {
    let mut radiator = Assembly::default();
    radiator.cuboid(DVec3::new(0.0, 0.12 + 0.5 * height_m, -0.09), DVec3::new(width_m, height_m, 0.1), METAL);
    let ribs = (width_m / 0.1).round() as usize;
    for n in 0..ribs {
        let x = (n as f64 + 0.5) * 0.1 - 0.5 * width_m;
        let rib = DVec3::new(x, 0.15, -0.14);
        radiator.tube(rib, rib + DVec3::Y * (height_m - 0.06), 0.012, METAL);
    }
    valve(&mut radiator, 0.5 * width_m + 0.04, 0.15);
    Furniture::new("radiator", ObjectKind::Fixture, radiator)
}

fn valve(radiator: &mut Assembly, x_m: f64, y_m: f64) {
    radiator.tube(DVec3::new(x_m, y_m, -0.08), DVec3::new(x_m + 0.07, y_m, -0.08), 0.02, METAL);
    radiator.fitting(DVec3::new(x_m, y_m, -0.1), -32.0);
    radiator.tube(DVec3::new(x_m, 0.0, -0.07), DVec3::new(x_m, y_m, -0.07), 0.009, METAL);
}

/// A curtain in folds, under a metal rod.
pub(crate) fn curtain(width_m: f64, heights_m: [f64; 2]) -> Furniture {
    let mut curtain = Assembly::default();
    let [low, high] = heights_m;
    let folds = (width_m / 0.07).round().max(2.0) as usize;
    let half_up = DVec3::Y * (0.5 * (high - low));
    for n in 0..folds {
        let lean = if n % 2 == 0 { 0.6 } else { -0.6 };
        let x = (n as f64 + 0.5) * 0.07 - 0.5 * width_m;
        let half_width = DQuat::from_rotation_y(lean) * (DVec3::X * (0.035 / math::cos(0.6)));
        curtain.sheet(DVec3::new(x, 0.5 * (low + high), -0.09), half_up, half_width, TEXTILE);
    }
    let rod = DVec3::new(0.5 * width_m + 0.05, high + 0.02, -0.09);
    curtain.tube(rod * DVec3::new(-1.0, 1.0, 1.0), rod, 0.01, METAL);
    Furniture::new("curtain", ObjectKind::Fixture, curtain)
}

/// Metal slats before a window.
pub(crate) fn blind(width_m: f64, heights_m: [f64; 2]) -> Furniture {
    let mut blind = Assembly::default();
    let slats = ((heights_m[1] - heights_m[0]) / 0.08).round().max(1.0) as usize;
    for n in 0..slats {
        let y = heights_m[0] + 0.08 * (n as f64 + 0.5);
        let across = DVec3::new(0.0, 0.0125, 0.0216);
        blind.board(DVec3::new(0.0, y, -0.03), across, DVec3::X * (0.5 * width_m), METAL);
    }
    Furniture::new("blind", ObjectKind::Fixture, blind)
}

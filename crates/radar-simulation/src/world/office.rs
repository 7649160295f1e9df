//! Furniture of an office: steel tube and sheet metal, laminate, plastic shells.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

use radar_sar::math;

use crate::furniture::Draw;

use super::assembly::{Assembly, four_corners};
use super::material::{METAL, PLASTIC, TEXTILE, UPHOLSTERY, WOOD};
use super::object::{Furniture, ObjectKind};

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// A visitor's chair: four steel legs under a moulded plywood seat and back.
pub(crate) fn visitor_chair(draw: &mut Draw) -> Furniture {
    let (half_m, seat_m) = (draw.uniform(0.19, 0.22), draw.uniform(0.43, 0.46));
    let radius_m = draw.uniform(0.009, 0.0125);
    let mut chair = Assembly::default();
    let tops = four_corners(half_m, seat_m - 0.02, half_m);
    for (foot, top) in four_corners(half_m + 0.02, 0.0, half_m + 0.02).into_iter().zip(tops) {
        chair.tube(foot, top, radius_m, METAL);
    }
    chair.bent_tube(&[tops[0], tops[3], tops[2], tops[1]], radius_m, METAL);
    let back_m = seat_m + draw.uniform(0.36, 0.42);
    for top in [tops[2], tops[3]] {
        chair.tube(top, v(top.x, back_m, top.z + 0.06), radius_m, METAL);
    }
    chair.shelf_board(v(0.0, seat_m, 0.0), 2.0 * half_m + 0.02, 2.0 * half_m, WOOD);
    let lean = DQuat::from_rotation_x(0.12);
    let mut back = Assembly::default();
    back.upright_board(DVec3::ZERO, 2.0 * half_m, 0.22, WOOD);
    chair.add(back, v(0.0, back_m - 0.1, half_m + 0.04), lean);
    for (x, y) in [(half_m, seat_m), (-half_m, seat_m), (half_m, back_m - 0.1), (-half_m, back_m - 0.1)] {
        chair.fitting(v(x, y, half_m), draw.uniform(-44.0, -36.0));
    }
    Furniture::new("visitor chair", ObjectKind::HardChair, chair)
}

/// A swivel chair: five-star foot with castors, gas column, upholstered seat and back, arm rests.
pub(crate) fn swivel_chair(draw: &mut Draw) -> Furniture {
    let seat_m = draw.uniform(0.42, 0.52);
    let foot = if draw.uniform(0.0, 1.0) < 0.5 { METAL } else { PLASTIC };
    let mut chair = Assembly::default();
    let first = draw.uniform(0.0, TAU);
    for n in 0..5 {
        let (sin, cos) = math::sin_cos(first + TAU * f64::from(n) / 5.0);
        let tip = v(0.3 * cos, 0.075, 0.3 * sin);
        chair.tube(v(0.0, 0.11, 0.0), tip, 0.018, foot);
        // Two wheels at right angles to the floor.
        chair.tube(tip - v(0.02 * sin, 0.045, -0.02 * cos), tip - v(-0.02 * sin, 0.045, 0.02 * cos), 0.028, PLASTIC);
        chair.fitting(tip - DVec3::Y * 0.03, draw.uniform(-36.0, -29.0));
    }
    chair.tube(v(0.0, 0.08, 0.0), v(0.0, seat_m - 0.06, 0.0), 0.025, METAL);
    chair.cuboid(v(0.0, seat_m - 0.04, 0.0), v(0.18, 0.04, 0.25), METAL);
    chair.cuboid(v(0.0, seat_m, 0.0), v(0.48, 0.07, 0.46), UPHOLSTERY);
    chair.tube(v(0.0, seat_m - 0.05, 0.2), v(0.0, seat_m + 0.25, 0.27), 0.02, METAL);
    let mut back = Assembly::default();
    back.cuboid(DVec3::ZERO, v(0.44, draw.uniform(0.42, 0.58), 0.06), UPHOLSTERY);
    chair.add(back, v(0.0, seat_m + 0.38, 0.26), DQuat::from_rotation_x(0.15));
    for x in [-0.28, 0.28] {
        chair.tube(v(0.7 * x, seat_m - 0.03, 0.05), v(x, seat_m + 0.2, 0.05), 0.013, foot);
        chair.cuboid(v(x, seat_m + 0.21, 0.0), v(0.07, 0.03, 0.26), PLASTIC);
    }
    chair.fitting(v(0.2, seat_m - 0.06, 0.0), -33.0);
    Furniture::new("swivel chair", ObjectKind::SoftChair, chair)
}

/// A strip light over a place of work: a trough of sheet metal on two wires, at head height.
pub(crate) fn strip_light(draw: &mut Draw) -> Furniture {
    let (low_m, length_m) = (draw.uniform(1.5, 1.9), draw.uniform(0.9, 1.3));
    let mut light = Assembly::default();
    light.cuboid(v(0.0, low_m + 0.03, 0.0), v(length_m, 0.06, draw.uniform(0.06, 0.12)), METAL);
    for x in [-0.42 * length_m, 0.42 * length_m] {
        light.tube(v(x, low_m + 0.06, 0.0), v(x, 2.35, 0.0), 0.0015, METAL);
        light.fitting(v(x, low_m + 0.07, 0.0), draw.uniform(-40.0, -33.0));
    }
    Furniture::new("strip light", ObjectKind::Hanging, light)
}

/// A folding chair of crossed steel tubes with sheet metal seat and back.
pub(crate) fn folding_chair(draw: &mut Draw) -> Furniture {
    let (half_m, seat_m) = (draw.uniform(0.19, 0.21), draw.uniform(0.43, 0.46));
    let mut chair = Assembly::default();
    for x in [-half_m, half_m] {
        chair.bent_tube(&[v(x, 0.0, -0.22), v(x, seat_m, 0.08), v(x, seat_m + 0.38, 0.22)], 0.01, METAL);
        chair.tube(v(0.9 * x, 0.0, 0.2), v(0.9 * x, seat_m - 0.03, -0.15), 0.01, METAL);
        chair.fitting(v(x, 0.25, 0.0), draw.uniform(-40.0, -33.0));
    }
    for (y, z) in [(0.12, -0.14), (0.1, 0.15)] {
        chair.tube(v(-half_m, y, z), v(half_m, y, z), 0.008, METAL);
    }
    chair.shelf_board(v(0.0, seat_m, -0.02), 2.0 * half_m - 0.03, 0.36, METAL);
    let mut back = Assembly::default();
    back.upright_board(DVec3::ZERO, 2.0 * half_m, 0.2, METAL);
    chair.add(back, v(0.0, seat_m + 0.3, 0.19), DQuat::from_rotation_x(0.35));
    Furniture::new("folding chair", ObjectKind::HardChair, chair)
}

/// A desk on two steel T-feet with a cable tray and a modesty panel.
pub(crate) fn desk(draw: &mut Draw) -> Furniture {
    let (width_m, depth_m, top_m) = (draw.uniform(1.2, 1.6), draw.uniform(0.7, 0.8), draw.uniform(0.71, 0.75));
    let mut desk = Assembly::default();
    desk.cuboid(v(0.0, top_m, 0.0), v(width_m, 0.025, depth_m), WOOD);
    for x in [-0.42 * width_m, 0.42 * width_m] {
        desk.cuboid(v(x, 0.03, 0.0), v(0.07, 0.04, 0.9 * depth_m), METAL);
        desk.cuboid(v(x, 0.37, 0.05), v(0.06, 0.66, 0.09), METAL);
        for z in [-0.4 * depth_m, 0.4 * depth_m] {
            desk.tube(v(x, 0.0, z), v(x, 0.02, z), 0.02, PLASTIC);
            desk.fitting(v(x, 0.04, z), draw.uniform(-42.0, -34.0));
        }
    }
    desk.tube(v(-0.42 * width_m, top_m - 0.06, 0.1), v(0.42 * width_m, top_m - 0.06, 0.1), 0.02, METAL);
    desk.upright_board(v(0.0, top_m - 0.2, 0.3), 0.75 * width_m, 0.32, WOOD);
    Furniture::new("desk", ObjectKind::Table, desk)
}

/// A metal shelf: four posts, sheet metal boards with folded edges, a crossed brace behind, boxes.
pub(crate) fn metal_shelf(draw: &mut Draw) -> Furniture {
    let (width_m, depth_m, height_m) = (draw.uniform(0.8, 1.0), draw.uniform(0.3, 0.4), draw.uniform(1.6, 1.95));
    let mut shelf = Assembly::default();
    let [x, z] = [0.5 * width_m, 0.5 * depth_m];
    for foot in four_corners(x, 0.0, z) {
        shelf.tube(foot, foot + DVec3::Y * height_m, 0.016, METAL);
    }
    for n in 0..5 {
        let y = 0.1 + f64::from(n) * (height_m - 0.15) / 4.0;
        shelf.shelf_board(v(0.0, y, 0.0), width_m, depth_m, METAL);
        for z in [-z, z] {
            shelf.upright_board(v(0.0, y - 0.017, z), width_m, 0.034, METAL);
        }
        for corner in four_corners(x, y, z) {
            shelf.fitting(corner, draw.uniform(-46.0, -38.0));
        }
        if n < 4 && draw.uniform(0.0, 1.0) < 0.7 {
            let size = v(draw.uniform(0.2, 0.4), draw.uniform(0.15, 0.3), draw.uniform(0.2, 0.28));
            shelf.cuboid(v(draw.uniform(-0.15, 0.15), y + 0.5 * size.y + 0.005, 0.0), size, PLASTIC);
        }
    }
    shelf.tube(v(-x, 0.2, z), v(x, height_m - 0.2, z), 0.005, METAL);
    shelf.tube(v(x, 0.2, z + 0.01), v(-x, height_m - 0.2, z + 0.01), 0.005, METAL);
    Furniture::new("metal shelf", ObjectKind::Shelf, shelf)
}

/// A waiting bench: plastic shells with pads on a steel beam.
pub(crate) fn waiting_bench(draw: &mut Draw) -> Furniture {
    let seats = if draw.uniform(0.0, 1.0) < 0.5 { 3 } else { 4 };
    let half_m = 0.27 * f64::from(seats);
    let mut bench = Assembly::default();
    bench.cuboid(v(0.0, 0.33, 0.0), v(2.0 * half_m, 0.05, 0.08), METAL);
    for x in [-0.8 * half_m, 0.8 * half_m] {
        bench.tube(v(x, 0.02, 0.0), v(x, 0.31, 0.0), 0.025, METAL);
        bench.tube(v(x, 0.02, -0.28), v(x, 0.02, 0.25), 0.02, METAL);
    }
    for n in 0..seats {
        let x = 0.54 * f64::from(n) + 0.27 - half_m;
        bench.shelf_board(v(x, 0.42, -0.02), 0.46, 0.42, PLASTIC);
        bench.shelf_board(v(x, 0.435, -0.02), 0.4, 0.36, TEXTILE);
        let mut back = Assembly::default();
        back.upright_board(DVec3::ZERO, 0.46, 0.36, PLASTIC);
        bench.add(back, v(x, 0.65, 0.24), DQuat::from_rotation_x(0.2));
        bench.fitting(v(x, 0.37, 0.1), draw.uniform(-40.0, -32.0));
    }
    Furniture::new("waiting bench", ObjectKind::Sofa, bench)
}

/// A floor lamp: round steel base, pole, flat metal head.
pub(crate) fn office_lamp(draw: &mut Draw) -> Furniture {
    let height_m = draw.uniform(1.6, 1.9);
    let mut lamp = Assembly::default();
    lamp.cuboid_on_floor(DVec3::ZERO, v(0.3, 0.02, 0.26), METAL);
    lamp.tube(v(0.0, 0.02, 0.0), v(0.0, height_m, 0.0), 0.014, METAL);
    lamp.cuboid(v(0.0, height_m, -0.12), v(0.2, 0.03, 0.55), METAL);
    lamp.lobed_fitting(v(0.0, 1.1, -0.02), DVec3::NEG_Z, -30.0);
    Furniture::new("office lamp", ObjectKind::Lamp, lamp)
}

/// A coat on a steel hanger on a coat stand's arm; it hangs free, its hook at 1.7 m.
pub(crate) fn coat_on_hanger(draw: &mut Draw) -> Furniture {
    let hook_m = draw.uniform(1.6, 1.75);
    let mut coat = Assembly::default();
    let tips = [v(-0.21, hook_m - 0.16, 0.0), v(0.21, hook_m - 0.16, 0.0)];
    let neck = v(0.0, hook_m - 0.06, 0.0);
    coat.bent_tube(&[neck, tips[0], tips[1], neck], 0.002, METAL);
    coat.bent_tube(&[neck, v(0.0, hook_m, 0.0), v(0.03, hook_m + 0.02, 0.0)], 0.002, METAL);
    for (z, lean) in [(-0.06, 0.05), (0.06, -0.05)] {
        let mut side = Assembly::default();
        side.sheet(DVec3::ZERO, DVec3::Y * 0.42, DVec3::X * 0.22, TEXTILE);
        coat.add(side, v(0.0, hook_m - 0.58, z), DQuat::from_rotation_x(lean));
    }
    for x in [-0.25, 0.25] {
        let mut sleeve = Assembly::default();
        sleeve.ring(DVec3::ZERO, [0.06, 0.07], 0.55, 5, TEXTILE);
        coat.add(sleeve, v(x, hook_m - 0.75, 0.0), DQuat::IDENTITY);
    }
    for n in 0..4 {
        coat.lobed_fitting(v(0.0, hook_m - 0.3 - 0.15 * f64::from(n), -0.08), DVec3::NEG_Z, -41.0);
    }
    coat.fitting(v(0.0, hook_m, 0.0), -30.0);
    Furniture::new("coat on a hanger", ObjectKind::Hanging, coat)
}

/// A pedestal with steel drawers on castors.
pub(crate) fn pedestal(draw: &mut Draw) -> Furniture {
    let depth_m = draw.uniform(0.5, 0.7);
    let mut pedestal = Assembly::default();
    pedestal.cuboid(v(0.0, 0.32, 0.0), v(0.42, 0.5, depth_m), METAL);
    for corner in four_corners(0.17, 0.035, 0.4 * depth_m) {
        pedestal.fitting(corner, draw.uniform(-34.0, -28.0));
    }
    for n in 0..3 {
        let y = 0.2 + 0.16 * f64::from(n);
        pedestal.tube(v(-0.08, y, -0.5 * depth_m - 0.03), v(0.08, y, -0.5 * depth_m - 0.03), 0.006, METAL);
    }
    Furniture::new("pedestal", ObjectKind::Cabinet, pedestal)
}

/// An open sheet-metal bin: its wall and its bottom form a right angle.
pub(crate) fn bin(draw: &mut Draw) -> Furniture {
    let (radius_m, height_m) = (draw.uniform(0.12, 0.15), draw.uniform(0.28, 0.36));
    let mut bin = Assembly::default();
    bin.ring(DVec3::ZERO, [0.9 * radius_m, radius_m], height_m, 8, METAL);
    bin.sheet(v(0.0, 0.015, 0.0), DVec3::Z * (0.8 * radius_m), DVec3::X * (0.8 * radius_m), METAL);
    Furniture::new("bin", ObjectKind::Bin, bin)
}

/// A computer screen on a stand on a small laminate table.
pub(crate) fn screen_table(draw: &mut Draw) -> Furniture {
    let width_m = draw.uniform(0.5, 0.65);
    let mut table = Assembly::default();
    table.shelf_board(v(0.0, 0.7, 0.0), 0.7, 0.5, WOOD);
    table.tube(v(0.0, 0.04, 0.0), v(0.0, 0.69, 0.0), 0.03, METAL);
    table.cuboid_on_floor(DVec3::ZERO, v(0.4, 0.03, 0.4), METAL);
    table.tube(v(0.0, 0.71, 0.05), v(0.0, 0.9, 0.05), 0.02, METAL);
    table.cuboid(v(0.0, 1.0, 0.02), v(width_m, 0.6 * width_m, 0.03), PLASTIC);
    Furniture::new("screen on a table", ObjectKind::Screen, table)
}

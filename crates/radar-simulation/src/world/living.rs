//! Furniture of a living room: upholstery, wire, glass, plants, cables, steps.

use std::f64::consts::{PI, TAU};

use glam::{DQuat, DVec3};

use radar_sar::math;

use crate::furniture::Draw;

use super::assembly::{Assembly, four_corners};
use super::material::{
    CONCRETE, GLASS, LEAF, LEATHER, METAL, Material, PLASTIC, ROUGH_METAL, TEXTILE, TILE, UPHOLSTERY, WOOD,
};
use super::object::{Furniture, ObjectKind};

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// An armchair, upholstered all around, on short feet.
pub(crate) fn armchair(draw: &mut Draw) -> Furniture {
    let cover = if draw.uniform(0.0, 1.0) < 0.6 { UPHOLSTERY } else { LEATHER };
    let (width_m, seat_m) = (draw.uniform(0.72, 0.85), draw.uniform(0.4, 0.44));
    let mut chair = Assembly::default();
    chair.cuboid(v(0.0, 0.5 * seat_m + 0.04, 0.0), v(width_m - 0.28, seat_m - 0.08, 0.7), cover);
    for x in [-0.5 * width_m + 0.07, 0.5 * width_m - 0.07] {
        chair.cuboid(v(x, 0.34, -0.02), v(0.14, 0.52, 0.7), cover);
    }
    let mut back = Assembly::default();
    back.cuboid(DVec3::ZERO, v(width_m - 0.1, 0.62, 0.16), cover);
    chair.add(back, v(0.0, 0.6, 0.33), DQuat::from_rotation_x(0.22));
    for foot in four_corners(0.4 * width_m, 0.0, 0.28) {
        chair.tube(foot, foot + DVec3::Y * 0.08, 0.022, WOOD);
    }
    Furniture::new("armchair", ObjectKind::SoftChair, chair)
}

/// A moulded plastic shell on a base of thin wires.
pub(crate) fn wire_chair(draw: &mut Draw) -> Furniture {
    let seat_m = draw.uniform(0.42, 0.46);
    let mut chair = Assembly::default();
    let under = four_corners(0.13, seat_m - 0.04, 0.12);
    let feet = four_corners(0.23, 0.0, 0.22);
    for n in 0..4 {
        chair.tube(feet[n], under[n], 0.0055, METAL);
        chair.tube(feet[n].lerp(under[n], 0.35), under[(n + 1) % 4], 0.004, METAL);
        chair.fitting(feet[n] + DVec3::Y * 0.01, draw.uniform(-46.0, -39.0));
    }
    chair.bent_tube(&[under[0], under[1], under[2], under[3], under[0]], 0.0055, METAL);
    // The shell: a flat middle and sides bent up.
    chair.shelf_board(v(0.0, seat_m, 0.0), 0.3, 0.4, PLASTIC);
    for side in [-1.0, 1.0] {
        let mut flank = Assembly::default();
        flank.shelf_board(DVec3::ZERO, 0.1, 0.4, PLASTIC);
        chair.add(flank, v(side * 0.19, seat_m + 0.02, 0.0), DQuat::from_rotation_z(side * 0.5));
        let mut wing = Assembly::default();
        wing.upright_board(DVec3::ZERO, 0.09, 0.3, PLASTIC);
        chair.add(wing, v(side * 0.2, seat_m + 0.24, 0.2), DQuat::from_rotation_y(side * 0.5));
    }
    let mut back = Assembly::default();
    back.upright_board(DVec3::ZERO, 0.32, 0.38, PLASTIC);
    chair.add(back, v(0.0, seat_m + 0.22, 0.24), DQuat::from_rotation_x(0.25));
    Furniture::new("wire chair", ObjectKind::HardChair, chair)
}

/// A cantilever chair: one bent steel tube on either side, slings of cloth.
pub(crate) fn cantilever_chair(draw: &mut Draw) -> Furniture {
    let (half_m, seat_m) = (draw.uniform(0.22, 0.25), draw.uniform(0.43, 0.46));
    let cover = if draw.uniform(0.0, 1.0) < 0.5 { TEXTILE } else { LEATHER };
    let mut chair = Assembly::default();
    for x in [-half_m, half_m] {
        let bends = [(0.013, 0.24), (0.013, -0.2), (0.07, -0.25), (seat_m - 0.04, -0.24), (seat_m, -0.19)];
        let rest = [(seat_m - 0.01, 0.17), (seat_m + 0.05, 0.22), (seat_m + 0.42, 0.3)];
        let points: Vec<DVec3> = bends.iter().chain(&rest).map(|&(y, z)| v(x, y, z)).collect();
        chair.bent_tube(&points, 0.0125, METAL);
    }
    chair.tube(v(-half_m, 0.013, 0.24), v(half_m, 0.013, 0.24), 0.0125, METAL);
    chair.sheet(v(0.0, seat_m, -0.01), DVec3::Z * 0.19, DVec3::X * half_m, cover);
    let mut back = Assembly::default();
    back.sheet(DVec3::ZERO, DVec3::Y * 0.16, DVec3::X * half_m, cover);
    chair.add(back, v(0.0, seat_m + 0.26, 0.265), DQuat::from_rotation_x(0.2));
    Furniture::new("cantilever chair", ObjectKind::HardChair, chair)
}

/// A glass table on a metal frame with a lower board.
pub(crate) fn glass_table(draw: &mut Draw) -> Furniture {
    let (width_m, depth_m, top_m) = (draw.uniform(0.9, 1.2), draw.uniform(0.5, 0.65), draw.uniform(0.38, 0.5));
    let frame: Material = if draw.uniform(0.0, 1.0) < 0.5 { METAL } else { ROUGH_METAL };
    let mut table = Assembly::default();
    table.shelf_board(v(0.0, top_m, 0.0), width_m, depth_m, GLASS);
    let (x, z) = (0.45 * width_m, 0.42 * depth_m);
    let tops = four_corners(x, top_m - 0.01, z);
    for (foot, top) in four_corners(x, 0.0, z).into_iter().zip(tops) {
        table.tube(foot, top, 0.012, frame);
        table.fitting(top, draw.uniform(-42.0, -36.0));
    }
    table.bent_tube(&[tops[0], tops[1], tops[2], tops[3], tops[0]], 0.009, frame);
    table.shelf_board(v(0.0, 0.15, 0.0), 0.85 * width_m, 0.8 * depth_m, WOOD);
    Furniture::new("glass table", ObjectKind::Table, table)
}

/// A ladder shelf: two slanted rails, boards of falling depth, small things on them.
pub(crate) fn ladder_shelf(draw: &mut Draw) -> Furniture {
    let (width_m, height_m) = (draw.uniform(0.55, 0.7), draw.uniform(1.6, 1.85));
    let mut shelf = Assembly::default();
    for x in [-0.5 * width_m, 0.5 * width_m] {
        shelf.tube(v(x, 0.0, -0.26), v(x, height_m, 0.17), 0.016, WOOD);
        shelf.tube(v(x, 0.0, 0.18), v(x, height_m, 0.18), 0.012, WOOD);
    }
    for n in 0..5 {
        let y = 0.15 + f64::from(n) * (height_m - 0.3) / 4.0;
        let front_m = -0.26 + 0.43 * y / height_m;
        let depth_m = 0.18 - front_m;
        shelf.shelf_board(v(0.0, y, front_m + 0.5 * depth_m), width_m, depth_m, WOOD);
        let at = v(draw.uniform(-0.15, 0.15), y + 0.005, 0.1);
        match n % 3 {
            0 => shelf.ring(at, [0.05, 0.06], draw.uniform(0.12, 0.22), 6, TILE),
            1 => shelf.cuboid(at + DVec3::Y * 0.06, v(0.18, 0.12, 0.1), PLASTIC),
            _ => shelf.upright_board(at + DVec3::Y * 0.1, 0.14, 0.19, GLASS),
        }
    }
    Furniture::new("ladder shelf", ObjectKind::Shelf, shelf)
}

/// A sofa: base, arms, back, seat and back cushions.
pub(crate) fn sofa(draw: &mut Draw) -> Furniture {
    let width_m = draw.uniform(1.6, 2.0);
    let cover = if draw.uniform(0.0, 1.0) < 0.7 { UPHOLSTERY } else { LEATHER };
    let mut sofa = Assembly::default();
    sofa.cuboid(v(0.0, 0.2, 0.0), v(width_m, 0.24, 0.84), cover);
    for x in [-0.5 * width_m + 0.1, 0.5 * width_m - 0.1] {
        sofa.cuboid(v(x, 0.45, 0.0), v(0.2, 0.3, 0.84), cover);
    }
    sofa.cuboid(v(0.0, 0.55, 0.34), v(width_m - 0.4, 0.5, 0.16), cover);
    let seat_m = 0.5 * (width_m - 0.42);
    for side in [-0.5, 0.5] {
        sofa.cuboid(v(side * seat_m, 0.39, -0.1), v(seat_m, 0.14, 0.62), cover);
        let mut cushion = Assembly::default();
        cushion.cuboid(DVec3::ZERO, v(0.45, 0.4, 0.14), TEXTILE);
        sofa.add(cushion, v(side * seat_m, 0.66, 0.17), DQuat::from_rotation_x(0.3));
    }
    for foot in four_corners(0.45 * width_m, 0.0, 0.36) {
        sofa.tube(foot, foot + DVec3::Y * 0.08, 0.015, METAL);
    }
    Furniture::new("sofa", ObjectKind::Sofa, sofa)
}

/// An arc lamp: a stone base, a bent metal arc, a dome at its end.
pub(crate) fn arc_lamp(draw: &mut Draw) -> Furniture {
    let (height_m, reach_m) = (draw.uniform(1.7, 1.95), draw.uniform(0.5, 0.8));
    let mut lamp = Assembly::default();
    lamp.cuboid_on_floor(DVec3::ZERO, v(0.28, 0.05, 0.28), TILE);
    let arc: Vec<DVec3> = (0..=8)
        .map(|n| {
            let angle = PI * f64::from(n) / 9.0;
            v(0.5 * reach_m * (1.0 - math::cos(angle)), 0.6 * height_m + 0.4 * height_m * math::sin(angle), 0.0)
        })
        .collect();
    lamp.tube(v(0.0, 0.05, 0.0), arc[0], 0.0125, METAL);
    lamp.bent_tube(&arc, 0.011, METAL);
    let end = arc[arc.len() - 1];
    lamp.ring(end - DVec3::Y * 0.14, [0.15, 0.06], 0.13, 8, METAL);
    lamp.fitting(end - DVec3::Y * 0.06, -31.0);
    Furniture::new("arc lamp", ObjectKind::Lamp, lamp)
}

/// A plant in a pot: stems and leaves at random angles.
pub(crate) fn plant(draw: &mut Draw) -> Furniture {
    let height_m = draw.uniform(0.8, 1.5);
    let mut plant = Assembly::default();
    plant.ring(DVec3::ZERO, [0.12, 0.16], 0.28, 8, TILE);
    for _ in 0..3 {
        let top = v(draw.uniform(-0.15, 0.15), 0.28 + 0.8 * (height_m - 0.28), draw.uniform(-0.15, 0.15));
        plant.tube(v(0.0, 0.26, 0.0), top, 0.007, LEAF);
    }
    for n in 0..26 {
        let angle = 2.4 * f64::from(n);
        let out_m = draw.uniform(0.05, 0.28);
        let at = v(out_m * math::cos(angle), draw.uniform(0.4, height_m), out_m * math::sin(angle));
        let turn = DQuat::from_rotation_y(-angle) * DQuat::from_rotation_z(draw.uniform(-1.2, 0.4));
        let (long, wide) = (draw.uniform(0.05, 0.1), draw.uniform(0.02, 0.05));
        plant.sheet(at, turn * (DVec3::Z * wide), turn * (DVec3::X * long), LEAF);
    }
    Furniture::new("plant", ObjectKind::Plant, plant)
}

/// Cables on the floor with a socket strip.
pub(crate) fn cables(draw: &mut Draw) -> Furniture {
    let mut cables = Assembly::default();
    for _ in 0..2 {
        let (mut at, mut heading) = (v(-0.45, 0.004, draw.uniform(-0.05, 0.05)), draw.uniform(-0.6, 0.6));
        for _ in 0..7 {
            let next = at + v(0.13 * math::cos(heading), 0.0, 0.13 * math::sin(heading));
            // A copper core under plastic.
            cables.tube(at, next, 0.0035, ROUGH_METAL);
            (at, heading) = (next, -0.4 * heading + draw.uniform(-0.9, 0.9));
        }
    }
    cables.cuboid_on_floor(v(0.3, 0.0, 0.1), v(0.3, 0.045, 0.06), PLASTIC);
    for n in 0..4 {
        cables.lobed_fitting(v(0.2 + 0.065 * f64::from(n), 0.04, 0.1), DVec3::Y, -40.0);
    }
    Furniture::new("cables", ObjectKind::Cable, cables)
}

/// The lowest steps of a staircase, with metal edges.
pub(crate) fn steps(draw: &mut Draw) -> Furniture {
    let (width_m, rise_m, going_m) = (draw.uniform(0.8, 1.0), draw.uniform(0.16, 0.19), draw.uniform(0.24, 0.28));
    let mut steps = Assembly::default();
    for n in 0..3 {
        let depth_m = going_m * f64::from(3 - n);
        let at = v(0.0, rise_m * f64::from(n), 0.5 * (3.0 * going_m - depth_m));
        let size = v(width_m, rise_m, depth_m);
        if n == 0 {
            steps.cuboid_on_floor(at, size, CONCRETE);
        } else {
            steps.cuboid(at + DVec3::Y * (0.5 * rise_m), size, CONCRETE);
            let inner = v(0.5 * width_m, at.y, at.z - 0.5 * depth_m);
            steps.inner_edge([inner * v(-1.0, 1.0, 1.0), inner], v(0.0, 1.0, -1.0), CONCRETE);
        }
        let nose = v(0.5 * width_m, at.y + rise_m, at.z - 0.5 * depth_m);
        steps.tube(nose * v(-1.0, 1.0, 1.0), nose, 0.004, METAL);
    }
    Furniture::new("steps", ObjectKind::Step, steps)
}

/// A pot that hangs from the ceiling on four cords, with trailing leaves.
pub(crate) fn hanging_pot(draw: &mut Draw) -> Furniture {
    let low_m = draw.uniform(1.3, 1.5);
    let mut pot = Assembly::default();
    pot.ring(v(0.0, low_m, 0.0), [0.08, 0.13], 0.16, 8, TILE);
    let hook = v(0.0, 2.2, 0.0);
    for corner in four_corners(0.09, low_m + 0.16, 0.09) {
        pot.tube(corner, hook, 0.003, TEXTILE);
    }
    pot.tube(hook, v(0.0, 2.3, 0.0), 0.003, METAL);
    for n in 0..9 {
        let (sin, cos) = math::sin_cos(TAU * f64::from(n) / 9.0);
        let at = v(0.16 * cos, low_m + draw.uniform(-0.25, 0.2), 0.16 * sin);
        let turn = DQuat::from_rotation_y(-TAU * f64::from(n) / 9.0) * DQuat::from_rotation_z(-1.0);
        pot.sheet(at, turn * (DVec3::Z * 0.025), turn * (DVec3::X * 0.06), LEAF);
    }
    Furniture::new("hanging pot", ObjectKind::Hanging, pot)
}

/// A low board with a television.
pub(crate) fn television(draw: &mut Draw) -> Furniture {
    let width_m = draw.uniform(0.95, 1.25);
    let mut board = Assembly::default();
    board.cuboid_on_floor(DVec3::ZERO, v(1.3, 0.42, 0.4), WOOD);
    for x in [-0.3, 0.3] {
        board.tube(v(x, 0.42, -0.12), v(x, 0.5, 0.0), 0.01, METAL);
        board.tube(v(x, 0.42, 0.12), v(x, 0.5, 0.0), 0.01, METAL);
    }
    let middle = v(0.0, 0.5 + 0.28 * width_m, 0.0);
    board.sheet(middle - DVec3::Z * 0.02, DVec3::Y * (0.28 * width_m), DVec3::X * (0.5 * width_m), GLASS);
    board.cuboid(middle, v(width_m, 0.57 * width_m, 0.03), PLASTIC);
    Furniture::new("television", ObjectKind::Screen, board)
}

/// A pouffe.
pub(crate) fn pouffe(draw: &mut Draw) -> Furniture {
    let radius_m = draw.uniform(0.22, 0.28);
    let mut pouffe = Assembly::default();
    pouffe.ring(DVec3::ZERO, [radius_m, radius_m], 0.36, 12, UPHOLSTERY);
    pouffe.sheet(v(0.0, 0.36, 0.0), DVec3::Z * (0.85 * radius_m), DVec3::X * (0.85 * radius_m), UPHOLSTERY);
    Furniture::new("pouffe", ObjectKind::Stool, pouffe)
}

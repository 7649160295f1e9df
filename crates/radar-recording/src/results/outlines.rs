//! Outlines of boxes, uncertainties, walls and the beam as dots, for viewers that show points but
//! not lines.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

use super::beam::BeamCone;
use super::cloud::Dot;
use super::shapes::{edges, moving_lines, uncertainty, wall_patch};
use radar_mapping::{Obstacle, Scene};

/// Spacing of the dots on a line, metres, and dots per circle of an uncertainty. Choice: dots merge
/// to lines with a whole room in view.
const DOT_SPACING_M: f64 = 0.04;
const DOTS_PER_CIRCLE: u32 = 20;
/// Limit of the dots of a line, and of a scene. Choice: 8 m of a line; a scene takes at most 240
/// kB, with 20 bytes a dot.
const MAX_DOTS_PER_LINE: usize = 200;
const MAX_DOTS: usize = 12_000;

/// Colours, red, green, blue and alpha. Choice: told apart on the viewers' dark background.
pub const OBSTACLE: [u8; 4] = [255, 140, 26, 255];
pub const UNCERTAINTY: [u8; 4] = [255, 230, 90, 255];
pub const WALL: [u8; 4] = [77, 153, 255, 255];
pub const MOVING: [u8; 4] = [255, 70, 160, 255];
pub const BEAM: [u8; 4] = [90, 220, 150, 255];

/// Outlines of a scene; `value` is the id of the obstacle or wall.
pub fn scene_dots(scene: &Scene) -> Vec<Dot> {
    let mut dots = Vec::new();
    for obstacle in &scene.obstacles {
        for edge in obstacle.around().iter().flat_map(edges) {
            line(&mut dots, &edge, obstacle.id, OBSTACLE);
        }
        circles(&mut dots, obstacle);
    }
    for wall in &scene.walls {
        let [a, b, c, d] = wall_patch(wall);
        line(&mut dots, &[a, b, c, d, a], wall.id, WALL);
        line(&mut dots, &[a, c], wall.id, WALL);
        line(&mut dots, &[b, d], wall.id, WALL);
    }
    for moving in &scene.moving {
        for corners in moving_lines(moving) {
            line(&mut dots, &corners, moving.id, MOVING);
        }
    }
    dots.truncate(MAX_DOTS);
    dots
}

/// The beam's outline.
pub fn beam_dots(beam: &BeamCone) -> Vec<Dot> {
    let mut dots = Vec::new();
    beam.lines().iter().for_each(|corners| line(&mut dots, corners, 0, BEAM));
    dots.truncate(MAX_DOTS);
    dots
}

fn line(dots: &mut Vec<Dot>, corners: &[DVec3], id: u64, rgba: [u8; 4]) {
    let mut taken = 0;
    for pair in corners.windows(2) {
        let steps =
            ((pair[0].distance(pair[1]) / DOT_SPACING_M).ceil().max(1.0) as usize).min(MAX_DOTS_PER_LINE - taken);
        let position = |n: usize| pair[0].lerp(pair[1], n as f64 / steps.max(1) as f64).as_vec3();
        dots.extend((0..steps).map(|n| Dot { position: position(n), value: id as f32, rgba }));
        taken += steps;
    }
}

/// Three great circles of the uncertainty ellipsoid.
fn circles(dots: &mut Vec<Dot>, obstacle: &Obstacle) {
    let (pose, radii_m) = uncertainty(obstacle);
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        for n in 0..DOTS_PER_CIRCLE {
            let turn = DQuat::from_axis_angle(axis, f64::from(n) / f64::from(DOTS_PER_CIRCLE) * TAU);
            let on_circle = turn * DVec3::new(axis.z + axis.y, axis.x, 0.0) * radii_m;
            let position = pose.transform_point(on_circle).as_vec3();
            dots.push(Dot { position, value: obstacle.id as f32, rgba: UNCERTAINTY });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dots_lie_on_the_line_with_bounded_spacing_and_count() {
        let mut dots = Vec::new();
        line(&mut dots, &[DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y], 3, WALL);
        assert!(dots.windows(2).all(|pair| pair[0].position.distance(pair[1].position) <= DOT_SPACING_M as f32 + 1e-6));
        assert!(dots.iter().all(|dot| dot.position.y == 0.0 || (dot.position.x - 1.0).abs() < 1e-6));
        dots.clear();
        line(&mut dots, &[DVec3::ZERO, DVec3::X * 1e9, DVec3::Y], 3, WALL);
        assert_eq!(dots.len(), MAX_DOTS_PER_LINE);
    }
}

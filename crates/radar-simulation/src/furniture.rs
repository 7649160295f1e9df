//! Furniture as point scatterers: where a radar of 60 GHz gets its echoes from legs, edges, corners and hooks.

use glam::DVec3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::{Scatterer, SceneObject};

use radar_sar::math;

pub(super) fn corner_reflector(draw: &mut Draw, position_m: DVec3) -> SceneObject {
    let phase_rad = draw.phase();
    let scatterer = Scatterer { position_m, rcs_dbsm: -5.0, lobe: DVec3::ZERO, phase_rad };
    SceneObject { name: "corner reflector".into(), scatterers: vec![scatterer] }
}

/// Cross-sections of a chair's parts, dBsm.
#[derive(Clone, Copy)]
pub(super) struct ChairRcs {
    legs: f64,
    seat: f64,
    back: f64,
}

/// Metal legs, wooden seat and back.
pub(super) const METAL_CHAIR: ChairRcs = ChairRcs { legs: -18.0, seat: -24.0, back: -22.0 };
/// Plastic and fabric: 8 dB less.
pub(super) const PLASTIC_CHAIR: ChairRcs = ChairRcs { legs: -26.0, seat: -30.0, back: -28.0 };

/// Draws everything random of a room.
pub(super) struct Draw(pub ChaCha8Rng);

impl Draw {
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        self.0.random_range(low..high)
    }

    pub fn phase(&mut self) -> f64 {
        self.uniform(0.0, std::f64::consts::TAU)
    }

    /// A point whose lobe points away from `center`, tilted at random; its strength varies by ±3 dB.
    fn point(&mut self, position_m: DVec3, center: DVec3, rcs_dbsm: f64) -> Scatterer {
        let tilt = DVec3::new(self.uniform(-0.7, 0.7), self.uniform(-0.3, 0.7), self.uniform(-0.7, 0.7));
        let outward = (position_m - center).normalize_or(DVec3::Y);
        Scatterer {
            position_m,
            rcs_dbsm: rcs_dbsm + self.uniform(-3.0, 3.0),
            lobe: (outward + tilt).normalize_or(DVec3::Y),
            phase_rad: self.phase(),
        }
    }

    pub fn thing(&mut self, name: &str, center: DVec3, points: &[(DVec3, f64)]) -> SceneObject {
        let scatterers = points.iter().map(|&(at, rcs)| self.point(at, center, rcs)).collect();
        SceneObject { name: name.into(), scatterers }
    }
}

/// Turns a local offset (x right, z back) about +y and puts it at `base`.
pub(super) fn placed(base: DVec3, yaw: f64, x: f64, y: f64, z: f64) -> DVec3 {
    let (sin, cos) = math::sin_cos(yaw);
    base + DVec3::new(cos * x + sin * z, y, cos * z - sin * x)
}

/// A chair whose seat's middle is above `foot` (its y is the floor).
pub(super) fn chair(draw: &mut Draw, name: &str, foot: DVec3, yaw: f64, rcs: ChairRcs) -> SceneObject {
    let mut points = Vec::new();
    for (x, z) in [(-0.2, -0.2), (0.2, -0.2), (-0.2, 0.2), (0.2, 0.2)] {
        points.push((placed(foot, yaw, x, 0.05, z), rcs.legs));
        points.push((placed(foot, yaw, x, 0.44, z), rcs.seat));
    }
    for x in [-0.18, 0.18] {
        points.push((placed(foot, yaw, x, 0.88, 0.22), rcs.back));
    }
    draw.thing(name, placed(foot, yaw, 0.0, 0.4, 0.0), &points)
}

/// A metal clothes hanger, hook at `hook`: bar, shoulders, hook.
pub(super) fn clothes_hanger(draw: &mut Draw, hook: DVec3, yaw: f64) -> SceneObject {
    let at = |x: f64, y: f64| placed(hook, yaw, x, y, 0.0);
    let points = [
        (at(0.0, 0.0), -14.0),
        (at(0.0, -0.06), -12.0),
        (at(-0.1, -0.1), -18.0),
        (at(0.1, -0.1), -18.0),
        (at(-0.2, -0.15), -15.0),
        (at(0.2, -0.15), -15.0),
        (at(0.0, -0.15), -19.0),
    ];
    draw.thing("clothes hanger", at(0.0, -0.1), &points)
}

pub(super) fn table(draw: &mut Draw, foot: DVec3, yaw: f64) -> SceneObject {
    let mut points = Vec::new();
    for (x, z) in [(-0.5, -0.3), (0.5, -0.3), (-0.5, 0.3), (0.5, 0.3)] {
        points.push((placed(foot, yaw, x, 0.74, z), -19.0));
        points.push((placed(foot, yaw, x * 0.9, 0.05, z * 0.9), -22.0));
    }
    draw.thing("table", placed(foot, yaw, 0.0, 0.5, 0.0), &points)
}

pub(super) fn shelf(draw: &mut Draw, foot: DVec3, yaw: f64) -> SceneObject {
    let mut points = Vec::new();
    for y in [0.1, 0.6, 1.1, 1.6] {
        for x in [-0.4, 0.4] {
            points.push((placed(foot, yaw, x, y, -0.15), -17.0));
        }
    }
    draw.thing("shelf", placed(foot, yaw, 0.0, 0.9, 0.15), &points)
}

pub(super) fn sofa(draw: &mut Draw, foot: DVec3, yaw: f64) -> SceneObject {
    let mut points = Vec::new();
    for x in [-0.8, 0.8] {
        points.push((placed(foot, yaw, x, 0.6, -0.4), -22.0));
        points.push((placed(foot, yaw, x, 0.1, -0.4), -24.0));
    }
    for x in [-0.4, 0.4] {
        points.push((placed(foot, yaw, x, 0.42, -0.38), -24.0));
        points.push((placed(foot, yaw, x, 0.85, 0.3), -22.0));
    }
    draw.thing("sofa", placed(foot, yaw, 0.0, 0.4, 0.2), &points)
}

pub(super) fn lamp(draw: &mut Draw, foot: DVec3) -> SceneObject {
    let points = [(0.03, -18.0), (0.5, -23.0), (1.0, -23.0), (1.5, -17.0)];
    let points: Vec<_> = points.iter().map(|&(y, rcs)| (foot + DVec3::Y * y, rcs)).collect();
    let mut lamp = draw.thing("lamp", foot, &points);
    // A round pole looks alike from all sides.
    for scatterer in &mut lamp.scatterers {
        scatterer.lobe = DVec3::ZERO;
    }
    lamp
}

/// A stool of metal legs: its seat's middle above `foot`.
pub(super) fn stool(draw: &mut Draw, foot: DVec3, yaw: f64) -> SceneObject {
    let mut points = vec![(placed(foot, yaw, 0.0, 0.46, 0.0), -20.0)];
    for (x, z) in [(-0.15, -0.15), (0.15, -0.15), (0.0, 0.17)] {
        points.push((placed(foot, yaw, x, 0.04, z), -21.0));
        points.push((placed(foot, yaw, x * 0.9, 0.45, z * 0.9), -19.0));
    }
    draw.thing("stool", placed(foot, yaw, 0.0, 0.25, 0.0), &points)
}

/// A metal cabinet: corners and edges that send much of what comes back where it came from. Its front is towards −z.
pub(super) fn cabinet(draw: &mut Draw, foot: DVec3, yaw: f64) -> SceneObject {
    let mut points = Vec::new();
    for x in [-0.3, 0.3] {
        for (y, rcs) in [(0.05, 4.0), (0.55, -4.0), (1.05, 7.0)] {
            points.push((placed(foot, yaw, x, y, -0.2), rcs));
        }
    }
    points.push((placed(foot, yaw, 0.1, 0.7, -0.22), 0.0));
    draw.thing("cabinet", placed(foot, yaw, 0.0, 0.6, 0.1), &points)
}

/// The frame of an open door: two posts and a lintel, the opening's middle at `foot`.
pub(super) fn door_frame(draw: &mut Draw, foot: DVec3, yaw: f64) -> SceneObject {
    let mut points = Vec::new();
    for x in [-0.43, 0.43] {
        for y in [0.1, 0.6, 1.1, 1.6, 2.0] {
            points.push((placed(foot, yaw, x, y, -0.03), -18.0));
        }
    }
    points.push((placed(foot, yaw, 0.0, 2.02, -0.03), -20.0));
    draw.thing("door frame", placed(foot, yaw, 0.0, 1.0, 0.3), &points)
}

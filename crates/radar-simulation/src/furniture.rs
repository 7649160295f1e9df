//! Furniture as point scatterers, at legs, edges, corners and hooks, where a 60 GHz radar gets its
//! echoes.

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

/// Radar cross-sections of the parts of a chair, dBsm.
#[derive(Clone, Copy)]
pub(super) struct ChairRcs {
    legs: f64,
    seat: f64,
    back: f64,
}

/// Metal legs, wooden seat and back. Choice: no measurement of chairs at 60 GHz was found; rooms
/// also have [`PLASTIC_CHAIR`], so that results do not hang on it.
pub(super) const METAL_CHAIR: ChairRcs = ChairRcs { legs: -18.0, seat: -24.0, back: -22.0 };
/// Plastic and fabric, about 8 dB less. Choice: the weakest that should still be found.
pub(super) const PLASTIC_CHAIR: ChairRcs = ChairRcs { legs: -26.0, seat: -30.0, back: -28.0 };

/// Random numbers of a room.
pub(super) struct Draw(pub ChaCha8Rng);

impl Draw {
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        self.0.random_range(low..high)
    }

    pub fn phase(&mut self) -> f64 {
        self.uniform(0.0, std::f64::consts::TAU)
    }

    /// A scatterer whose lobe points away from `center` with a random tilt; its cross-section
    /// varies by ±3 dB.
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

    pub fn object(&mut self, name: &str, center: DVec3, points: &[(DVec3, f64)]) -> SceneObject {
        let scatterers = points.iter().map(|&(at, rcs)| self.point(at, center, rcs)).collect();
        SceneObject { name: name.into(), scatterers }
    }
}

/// Rotates a local offset (x right, z back) about +y and adds it to `base`.
pub(super) fn placed(base: DVec3, yaw: f64, x: f64, y: f64, z: f64) -> DVec3 {
    let (sin, cos) = math::sin_cos(yaw);
    base + DVec3::new(cos * x + sin * z, y, cos * z - sin * x)
}

/// A chair with its seat centred above `foot` (on the floor).
pub(super) fn chair(draw: &mut Draw, name: &str, foot: DVec3, yaw: f64, rcs: ChairRcs) -> SceneObject {
    let mut points = Vec::new();
    for (x, z) in [(-0.2, -0.2), (0.2, -0.2), (-0.2, 0.2), (0.2, 0.2)] {
        points.push((placed(foot, yaw, x, 0.05, z), rcs.legs));
        points.push((placed(foot, yaw, x, 0.44, z), rcs.seat));
    }
    for x in [-0.18, 0.18] {
        points.push((placed(foot, yaw, x, 0.88, 0.22), rcs.back));
    }
    draw.object(name, placed(foot, yaw, 0.0, 0.4, 0.0), &points)
}

/// A metal clothes hanger with its hook at `hook`: bar, shoulders, hook.
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
    draw.object("clothes hanger", at(0.0, -0.1), &points)
}

pub(super) fn table(draw: &mut Draw, foot: DVec3, yaw: f64) -> SceneObject {
    let mut points = Vec::new();
    for (x, z) in [(-0.5, -0.3), (0.5, -0.3), (-0.5, 0.3), (0.5, 0.3)] {
        points.push((placed(foot, yaw, x, 0.74, z), -19.0));
        points.push((placed(foot, yaw, x * 0.9, 0.05, z * 0.9), -22.0));
    }
    draw.object("table", placed(foot, yaw, 0.0, 0.5, 0.0), &points)
}

pub(super) fn shelf(draw: &mut Draw, foot: DVec3, yaw: f64) -> SceneObject {
    let mut points = Vec::new();
    for y in [0.1, 0.6, 1.1, 1.6] {
        for x in [-0.4, 0.4] {
            points.push((placed(foot, yaw, x, y, -0.15), -17.0));
        }
    }
    draw.object("shelf", placed(foot, yaw, 0.0, 0.9, 0.15), &points)
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
    draw.object("sofa", placed(foot, yaw, 0.0, 0.4, 0.2), &points)
}

pub(super) fn lamp(draw: &mut Draw, foot: DVec3) -> SceneObject {
    let points = [(0.03, -18.0), (0.5, -23.0), (1.0, -23.0), (1.5, -17.0)];
    let points: Vec<_> = points.iter().map(|&(y, rcs)| (foot + DVec3::Y * y, rcs)).collect();
    let mut lamp = draw.object("lamp", foot, &points);
    // A round pole reflects equally to all sides.
    for scatterer in &mut lamp.scatterers {
        scatterer.lobe = DVec3::ZERO;
    }
    lamp
}

/// A stool with metal legs and its seat centred above `foot`.
pub(super) fn stool(draw: &mut Draw, foot: DVec3, yaw: f64) -> SceneObject {
    let mut points = vec![(placed(foot, yaw, 0.0, 0.46, 0.0), -20.0)];
    for (x, z) in [(-0.15, -0.15), (0.15, -0.15), (0.0, 0.17)] {
        points.push((placed(foot, yaw, x, 0.04, z), -21.0));
        points.push((placed(foot, yaw, x * 0.9, 0.45, z * 0.9), -19.0));
    }
    draw.object("stool", placed(foot, yaw, 0.0, 0.25, 0.0), &points)
}

/// A metal cabinet, with corners and edges that are strong retroreflectors. Its front is towards
/// −z.
pub(super) fn cabinet(draw: &mut Draw, foot: DVec3, yaw: f64) -> SceneObject {
    let mut points = Vec::new();
    for x in [-0.3, 0.3] {
        for (y, rcs) in [(0.05, 4.0), (0.55, -4.0), (1.05, 7.0)] {
            points.push((placed(foot, yaw, x, y, -0.2), rcs));
        }
    }
    points.push((placed(foot, yaw, 0.1, 0.7, -0.22), 0.0));
    draw.object("cabinet", placed(foot, yaw, 0.0, 0.6, 0.1), &points)
}

/// The frame of an open door: two posts and a lintel; the opening is centred at `foot`.
pub(super) fn door_frame(draw: &mut Draw, foot: DVec3, yaw: f64) -> SceneObject {
    let mut points = Vec::new();
    for x in [-0.43, 0.43] {
        for y in [0.1, 0.6, 1.1, 1.6, 2.0] {
            points.push((placed(foot, yaw, x, y, -0.03), -18.0));
        }
    }
    points.push((placed(foot, yaw, 0.0, 2.02, -0.03), -20.0));
    draw.object("door frame", placed(foot, yaw, 0.0, 1.0, 0.3), &points)
}

//! Outline of the beam in the sensor's frame: a cone at the cut-off angle, between the first and
//! the last range.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

use radar_sar::math;

/// The beam's outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BeamCone {
    /// Cut-off angle from the boresight, radians.
    pub cut_off_rad: f64,
    /// First and last range, metres.
    pub ranges_m: [f64; 2],
}

/// Points of a circle, and edges of the cone. Choice: round to the eye, and few enough lines to see
/// through.
const CIRCLE_POINTS: u32 = 32;
const CONE_EDGES: u32 = 4;
/// Steps of an arc from the boresight to the edge. Choice: steps of 4° or less for a beam of 45°.
const ARC_STEPS: u32 = 12;

impl BeamCone {
    /// Lines of the outline: circles at both ranges, edges between them, and arcs at the last range
    /// through the boresight.
    pub fn lines(&self) -> Vec<Vec<DVec3>> {
        let [first_m, last_m] = self.ranges_m;
        let turn = |n: u32, of: u32| f64::from(n) / f64::from(of) * TAU;
        let circle =
            |range_m: f64| (0..=CIRCLE_POINTS).map(|n| self.point_at(range_m, 1.0, turn(n, CIRCLE_POINTS))).collect();
        let edge = |n: u32| [first_m, last_m].map(|range_m| self.point_at(range_m, 1.0, turn(n, CONE_EDGES))).to_vec();
        let arc = |n: u32| {
            let step = |k: u32| self.point_at(last_m, f64::from(k) / f64::from(ARC_STEPS), turn(n, CONE_EDGES));
            (0..=ARC_STEPS).map(step).collect()
        };
        let edges = (0..CONE_EDGES).map(edge).chain((0..CONE_EDGES).map(arc));
        [circle(first_m), circle(last_m)].into_iter().chain(edges).collect()
    }

    /// The point at a range, a share of the cut-off angle and a turn about the boresight.
    fn point_at(&self, range_m: f64, share: f64, turn_rad: f64) -> DVec3 {
        let (sin, cos) = math::sin_cos(self.cut_off_rad * share);
        (DQuat::from_rotation_z(turn_rad) * DVec3::X * sin + DVec3::NEG_Z * cos) * range_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outline_stays_within_beam_and_ranges() {
        let beam = BeamCone { cut_off_rad: 0.7, ranges_m: [0.2, 3.0] };
        let points: Vec<DVec3> = beam.lines().concat();
        for point in &points {
            assert!((0.2 - 1e-9..=3.0 + 1e-9).contains(&point.length()));
            assert!(point.normalize().dot(DVec3::NEG_Z) >= 0.7f64.cos() - 1e-9);
        }
        assert!(points.iter().any(|p| (*p - DVec3::NEG_Z * 3.0).length() < 1e-9));
    }
}

//! The reflector that a track follows: a point or a plane.

use glam::DVec3;

use super::corrections::Corrections;
use super::path::PathState;

/// Number of a reflector's unknowns: range and two rotations of its direction.
pub(super) const REFLECTOR: usize = 3;
/// Greatest steps of a descent: range, metres, and direction, rad. Choice: the pulse's width and half the beam, beyond
/// which the linear model does not hold.
const MAX_RANGE_STEP_M: f64 = 0.2;
const MAX_TURN_RAD: f64 = 0.3;
/// Least range from the middle of the path, metres. Choice: keeps the direction defined.
const MIN_RANGE_M: f64 = 0.02;
/// Two reflectors of one kind within this angle are the same, rad. Choice: descents that end closer to each other have
/// found the same minimum.
const SAME_RAD: f64 = 0.05;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ReflectorKind {
    Point,
    Plane,
}

/// A reflector, relative to the middle of the path.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reflector {
    pub kind: ReflectorKind,
    pub direction: DVec3,
    pub range_m: f64,
}

impl Reflector {
    /// Range from a position relative to the middle of the path, and the unit vector towards the reflector.
    pub fn seen_from(&self, position_m: DVec3) -> (f64, DVec3) {
        let to = self.direction * self.range_m - position_m;
        match self.kind {
            ReflectorKind::Point => (to.length(), to.normalize_or(self.direction)),
            ReflectorKind::Plane => (self.direction.dot(to), self.direction),
        }
    }

    /// The directions that it moves in when its direction turns.
    pub fn turns(&self) -> [DVec3; 2] {
        self.direction.any_orthonormal_pair().into()
    }

    /// Range from a position, and its derivatives with respect to the unknowns; `turns`: see [`Self::turns`].
    pub fn range_and_derivatives(&self, turns: [DVec3; 2], position_m: DVec3) -> (f64, [f64; REFLECTOR]) {
        let (range_m, towards) = self.seen_from(position_m);
        let own = match self.kind {
            ReflectorKind::Point => {
                let [first, second] = turns.map(|turn| self.range_m * towards.dot(turn));
                [towards.dot(self.direction), first, second]
            }
            ReflectorKind::Plane => [1.0, -position_m.dot(turns[0]), -position_m.dot(turns[1])],
        };
        (range_m, own)
    }

    /// Derivatives of the range with respect to the unknowns and to the corrections.
    pub fn derivatives(&self, state: &PathState) -> ([f64; REFLECTOR], Corrections) {
        let (_, own) = self.range_and_derivatives(self.turns(), state.position_m);
        let (_, towards) = self.seen_from(state.position_m);
        let shift = -(state.tracking_from_sensor.transpose() * towards);
        (own, [-towards.dot(state.velocity_m_per_s), shift.x, shift.y, shift.z, 1.0])
    }

    /// After a step of the unknowns.
    pub fn moved(&self, step: &[f64]) -> Self {
        let [a, b] = self.turns();
        let turn = (a * step[1] + b * step[2]).clamp_length_max(MAX_TURN_RAD);
        let range_m = self.range_m + step[0].clamp(-MAX_RANGE_STEP_M, MAX_RANGE_STEP_M);
        Self { direction: (self.direction + turn).normalize(), range_m: range_m.max(MIN_RANGE_M), ..*self }
    }

    /// How far the direction lies from the expected one along each rotation, rad.
    pub fn expected_turns(&self, expected: DVec3) -> [f64; 2] {
        let [a, b] = self.turns();
        [expected.dot(a), expected.dot(b)]
    }

    pub fn is_same(&self, other: &Self) -> bool {
        self.kind == other.kind && self.direction.distance(other.direction) < SAME_RAD
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::self_calibration::corrections::{BIAS, OFFSET, SHIFT};
    use glam::{DMat3, DQuat};

    #[test]
    fn derivatives_are_those_of_the_range() {
        let rotation = DMat3::from_quat(DQuat::from_rotation_y(0.4) * DQuat::from_rotation_x(-0.3));
        let state = PathState {
            position_m: DVec3::new(0.1, -0.05, 0.2),
            velocity_m_per_s: DVec3::new(0.3, 0.2, -0.5),
            tracking_from_sensor: rotation,
        };
        for kind in [ReflectorKind::Point, ReflectorKind::Plane] {
            let reflector = Reflector { kind, direction: DVec3::new(0.3, 0.2, -0.9).normalize(), range_m: 1.4 };
            let range = |reflector: &Reflector, position_m: DVec3| reflector.seen_from(position_m).0;
            let here = range(&reflector, state.position_m);
            let (own, corrections) = reflector.derivatives(&state);
            let h = 1e-6;
            for k in 0..REFLECTOR {
                let mut step = [0.0; REFLECTOR];
                step[k] = h;
                let slope = (range(&reflector.moved(&step), state.position_m) - here) / h;
                assert!((slope - own[k]).abs() < 1e-5, "{kind:?} {k}: {slope} {}", own[k]);
            }
            let moved = |by: DVec3| (range(&reflector, state.position_m + by * h) - here) / h;
            assert!((moved(state.velocity_m_per_s) - corrections[OFFSET]).abs() < 1e-5);
            for k in 0..3 {
                assert!((moved(rotation.col(k)) - corrections[SHIFT + k]).abs() < 1e-5);
            }
            assert_eq!(corrections[BIAS], 1.0);
        }
    }
}

//! Motions that repeat along a line: rests, and smooth strokes between them.
//!
//! Two motions use it. `approach-chair`: a person walks up to a chair from 2 m to 0.4 m, stays, and
//! walks backwards again, always looking at it; for tests of warnings. `to-and-fro`: the sensor
//! moves straight towards a reflector and back several times, with strokes of different lengths and
//! speeds (thesis, 3.5.4); for estimating the time offset between poses and sweeps.

use glam::{DQuat, DVec3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::Scene;
use super::smooth::{Wander, smoothstep};
use radar_sar::geometry::Pose;
use radar_sar::math;

/// Rests along a line by rising time, repeated with a period.
#[derive(Debug, Clone)]
struct Strokes {
    rests: Vec<Rest>,
    /// Period, seconds.
    period_s: f64,
}

#[derive(Debug, Clone, Copy)]
struct Rest {
    from_s: f64,
    until_s: f64,
    /// Position along the line, metres.
    along_m: f64,
}

impl Strokes {
    /// Creates strokes from legs: travel time (s), time at rest (s), position (m).
    fn new(legs: impl IntoIterator<Item = (f64, f64, f64)>) -> Self {
        let mut rests: Vec<Rest> = Vec::new();
        for (way_s, stay_s, along_m) in legs {
            let from_s = rests.last().map_or(0.0, |rest| rest.until_s + way_s);
            rests.push(Rest { from_s, until_s: from_s + stay_s, along_m });
        }
        let period_s = rests.last().map_or(1.0, |rest| rest.until_s);
        Self { rests, period_s }
    }

    fn along_m(&self, time_s: f64) -> f64 {
        let time_s = time_s.rem_euclid(self.period_s);
        let later = self.rests.partition_point(|rest| rest.from_s <= time_s).min(self.rests.len() - 1);
        let (a, b) = (&self.rests[later.saturating_sub(1)], &self.rests[later]);
        let share = smoothstep((time_s - a.until_s) / (b.from_s - a.until_s).max(1e-6));
        a.along_m + (b.along_m - a.along_m) * share
    }
}

/// Walk up to a chair: poses of the head.
#[derive(Debug, Clone)]
pub struct ChairWalk {
    strokes: Strokes,
    /// Start of the eyes of a standing person, metres.
    start_m: DVec3,
    /// Horizontal unit vectors, towards the chair and to the right.
    ahead: DVec3,
    right: DVec3,
    /// Centre of the chair, metres.
    look_at_m: DVec3,
    sway: Wander,
    weave: Wander,
}

/// Height of the eyes, metres. Choice: a standing adult's.
const EYES_M: f64 = 1.6;
/// Farthest and nearest horizontal distance from the nearest part of the chair, metres. Choice:
/// from beyond the distance at which warnings begin to that of their full brightness.
const FAR_M: f64 = 2.0;
const NEAR_M: f64 = 0.4;
/// Seconds: rest before, approach, rest at the chair, return, rest after. Choice: a walk of 1.6 m
/// in 4 s, with rests in which warnings settle and fade.
const WALK_S: [f64; 5] = [2.0, 4.0, 3.0, 4.0, 1.0];
/// Steepest downward view, rad. Choice: 49°, as far as one bends the neck to look at a chair's
/// seat.
const MAX_PITCH_RAD: f64 = 0.85;
/// Lateral deviation of a walking or standing person, and other deviations, metres. Choice: a
/// walking person's weaving; straight motion would leave the direction open.
const WEAVE_M: f64 = 0.07;
const SWAY_M: f64 = 0.02;
/// Wanted distance from walls and other objects, metres. Choice: a body's half width and a hand's
/// breadth.
const CLEARANCE_M: f64 = 0.45;

impl ChairWalk {
    /// A walk to the first chair of a scene, from the direction with the most room; `None` if there
    /// is no chair.
    pub(super) fn new(scene: &Scene, duration_s: f64, rng: &mut ChaCha8Rng) -> Option<Self> {
        let chair = scene.room.things.iter().find(|object| object.name.contains("chair"))?;
        let parts: Vec<DVec3> = chair.scatterers.iter().map(|s| s.position_m).collect();
        let look_at_m = parts.iter().sum::<DVec3>() / parts.len() as f64;
        let level = |v: DVec3| DVec3::new(v.x, 0.0, v.z);
        let nearest_m = |at: DVec3| parts.iter().map(|p| level(*p - at).length()).fold(f64::INFINITY, f64::min);
        let position = |away: DVec3, away_m: f64| level(look_at_m) + away * away_m + DVec3::Y * EYES_M;
        let freedom = |away: &DVec3| {
            let way = (0..=8).map(|n| position(*away, 0.5 + 0.2 * f64::from(n)));
            way.map(|at| free_m(scene, at, &chair.name).min(CLEARANCE_M)).fold(f64::INFINITY, f64::min)
        };
        let ways = (0..16).map(|n| DQuat::from_rotation_y(f64::from(n) * std::f64::consts::TAU / 16.0) * DVec3::Z);
        // Among equal directions the first: from the front in the scene's axes.
        let away = ways.reduce(|best, way| if freedom(&way) > freedom(&best) { way } else { best })?;
        let until_m = |wanted_m: f64| {
            let steps = (0..400).map(|n| 0.01 * f64::from(n));
            steps.into_iter().find(|m| nearest_m(position(away, *m)) >= wanted_m).unwrap_or(wanted_m)
        };
        let (far_m, near_m) = (until_m(FAR_M), until_m(NEAR_M));
        let [before_s, there_s, stay_s, back_s, after_s] = WALK_S;
        let legs = [(0.0, before_s, 0.0), (there_s, stay_s, far_m - near_m), (back_s, after_s, 0.0)];
        Some(Self {
            strokes: Strokes::new(legs),
            start_m: position(away, far_m),
            ahead: -away,
            right: (-away).cross(DVec3::Y),
            look_at_m,
            sway: Wander::new(SWAY_M, DVec3::ONE, duration_s, rng),
            weave: Wander::new(WEAVE_M, DVec3::X, duration_s, rng),
        })
    }

    /// `tracking_from_head` at a time.
    pub(super) fn at(&self, time_s: f64) -> Pose {
        let (sway, weave) = (self.sway.at(time_s), self.weave.at(time_s));
        let eyes_m = self.start_m + self.ahead * self.strokes.along_m(time_s) + self.right * weave.x + sway;
        let to = self.look_at_m - eyes_m;
        let pitch_rad = math::atan2(to.y, DVec3::new(to.x, 0.0, to.z).length()).max(-MAX_PITCH_RAD);
        let rotation = DQuat::from_rotation_y(math::atan2(-to.x, -to.z) + sway.z * 1.5)
            * DQuat::from_rotation_x(pitch_rad + sway.x * 1.5);
        Pose::new(eyes_m, rotation)
    }
}

/// Horizontal distance to the walls and to all objects but one, metres.
fn free_m(scene: &Scene, at: DVec3, but: &str) -> f64 {
    let level = |v: DVec3| DVec3::new(v.x, 0.0, v.z).length();
    let others = scene.room.things.iter().filter(|object| object.name != but).flat_map(|object| &object.scatterers);
    let walls = scene.room.walls.iter().filter(|wall| wall.plane.outward.y == 0.0);
    let to_things = others.map(|s| level(s.position_m - at)).fold(f64::INFINITY, f64::min);
    walls.map(|wall| wall.plane.distance(at)).fold(to_things, f64::min)
}

/// A sensor that moves straight ahead and back: offsets in its frame at the start, metres.
#[derive(Debug, Clone)]
pub struct ToAndFro {
    strokes: Strokes,
    lateral: Wander,
}

/// Number of strokes before they repeat. Choice: about half a minute without repetition.
const STROKES: usize = 24;
/// Lateral deviation of a careful hand, metres. Choice: no hand moves on a straight line; half a
/// centimetre leaves the direction open.
const LATERAL_M: f64 = 0.005;

impl ToAndFro {
    pub(super) fn new(duration_s: f64, rng: &mut ChaCha8Rng) -> Self {
        let mut legs = vec![(0.0, 1.0, 0.0)];
        for n in 0..STROKES {
            let along_m = if n % 2 == 0 { rng.random_range(0.3..0.6) } else { rng.random_range(0.0..0.12) };
            legs.push((rng.random_range(0.7..1.4), rng.random_range(0.05..0.4), along_m));
        }
        legs.push((1.0, 0.2, 0.0));
        Self {
            strokes: Strokes::new(legs),
            lateral: Wander::new(LATERAL_M, DVec3::new(1.0, 1.0, 0.0), duration_s, rng),
        }
    }

    pub(super) fn offset_m(&self, time_s: f64) -> DVec3 {
        DVec3::NEG_Z * self.strokes.along_m(time_s) + self.lateral.at(time_s)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Motion, scene};
    use super::*;

    #[test]
    fn chair_walk_approaches_and_faces_the_chair() {
        for (name, seed) in (0..6).map(|seed| ("furnished-room", seed)).chain([("chair", 1), ("two-chairs", 2)]) {
            let scene = scene(name, seed).unwrap();
            let motion = Motion::from_name("approach-chair", &scene, 30.0, seed).unwrap();
            let chair = scene.room.things.iter().find(|object| object.name.contains("chair")).unwrap();
            let poses: Vec<Pose> =
                (0..3000).map(|n| motion.tracking_from_head(f64::from(n) * 0.01, &Pose::IDENTITY)).collect();
            let level = |v: DVec3| DVec3::new(v.x, 0.0, v.z).length();
            let far_m = |pose: &Pose| {
                chair.scatterers.iter().map(|s| level(s.position_m - pose.translation)).fold(f64::INFINITY, f64::min)
            };
            let (nearest, farthest) =
                poses.iter().map(far_m).fold((9.0f64, 0.0f64), |(low, high), m| (low.min(m), high.max(m)));
            assert!((0.3..=0.5).contains(&nearest) && (1.9..2.15).contains(&farthest), "{seed}: {nearest} {farthest}");
            for pair in poses.windows(2) {
                let speed = pair[0].translation.distance(pair[1].translation) / 0.01;
                assert!(speed < 1.3, "{speed}");
            }
            for pose in &poses {
                let other_m = free_m(&scene, pose.translation, &chair.name);
                assert!(other_m > 0.3, "{name} {seed}: {other_m}");
                let middle = chair.scatterers.iter().map(|s| s.position_m).sum::<DVec3>() / 10.0;
                let cos = (middle - pose.translation).normalize().dot(pose.forward());
                assert!(cos > 0.9, "{cos}");
            }
        }
        assert!(Motion::from_name("approach-chair", &scene("nothing", 1).unwrap(), 30.0, 1).is_err());
    }

    #[test]
    fn strokes_are_continuous() {
        let scene = scene("corner-reflector", 1).unwrap();
        let motion = Motion::from_name("to-and-fro", &scene, 100.0, 5).unwrap();
        let along = |t: f64| (motion.tracking_from_head(t, &Pose::IDENTITY).translation - scene.start_m).z;
        let steps: Vec<f64> = (0..10_000).map(|n| along(f64::from(n) * 0.01)).collect();
        assert!(steps.windows(2).all(|pair| (pair[0] - pair[1]).abs() < 0.02));
        let strokes = steps.windows(2).filter(|w| w[0] > -0.2 && w[1] <= -0.2).count();
        assert!(strokes > 20, "{strokes}");
        assert!(steps.iter().all(|z| (-0.61..0.01).contains(z)) && steps[90].abs() < 1e-9);
    }
}

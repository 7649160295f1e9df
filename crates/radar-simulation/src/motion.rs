//! Motion of the sensor or the head: smooth and seeded, with a pose at any time.

use glam::{DQuat, DVec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::Scene;
use super::arm::{raster, swinging_arm};
use super::smooth::{Wander, smoothstep};
use super::strokes::{ChairWalk, ToAndFro};
use radar_sar::geometry::Pose;
use radar_sar::math;

/// Names of all motions: those of the thesis (3.5.4 to 3.5.6, 3.6), a robot arm, natural play, and
/// a walk up to a chair.
pub const MOTIONS: [&str; 14] = [
    "stationary",
    "sphere-10cm",
    "sphere-50cm",
    "x-10cm",
    "x-50cm",
    "approach-1.0",
    "approach-1.5",
    "approach-2.5",
    "straight-0.3",
    "to-and-fro",
    "swinging-arm",
    "robot-arm",
    "natural",
    "approach-chair",
];

/// Why a motion cannot be created.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MotionError {
    /// Unknown name.
    #[error("motion \"{0}\" is not known: use {list}", list = MOTIONS.join(", "))]
    Unknown(String),
    /// A walk up to a chair in a scene without a chair.
    #[error("motion \"approach-chair\" needs a chair to walk up to: use it in chair, two-chairs or furnished-room")]
    NoChair,
}

/// A motion.
#[derive(Debug, Clone)]
pub enum Motion {
    /// Motions of the thesis: `tracking_from_sensor`.
    Sensor(SensorMotion),
    /// Natural play: `tracking_from_head`.
    Head(NaturalMotion),
    /// A walk up to a chair: `tracking_from_head`.
    Walk(ChairWalk),
}

impl Motion {
    /// The motion with this name in a scene, for a recording of `duration_s`.
    ///
    /// # Errors
    /// An unknown name, or no chair in the scene to walk up to.
    pub fn from_name(name: &str, scene: &Scene, duration_s: f64, seed: u64) -> Result<Self, MotionError> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x0070_710A);
        let kind = match name {
            "natural" => return Ok(Self::Head(NaturalMotion::new(scene, duration_s, &mut rng))),
            "approach-chair" => {
                return ChairWalk::new(scene, duration_s, &mut rng).map(Self::Walk).ok_or(MotionError::NoChair);
            }
            "to-and-fro" => Shape::ToAndFro(ToAndFro::new(duration_s, &mut rng)),
            "swinging-arm" => Shape::Mechanical(swinging_arm),
            "robot-arm" => Shape::Mechanical(raster),
            "stationary" => Shape::Still,
            "sphere-10cm" => Shape::wander(0.10, DVec3::ONE, duration_s, &mut rng),
            "sphere-50cm" => Shape::wander(0.50, DVec3::ONE, duration_s, &mut rng),
            "x-10cm" => Shape::wander(0.10, DVec3::X, duration_s, &mut rng),
            "x-50cm" => Shape::wander(0.50, DVec3::X, duration_s, &mut rng),
            "approach-1.0" => Shape::Approach { speed_m_per_s: 1.0 },
            "approach-1.5" => Shape::Approach { speed_m_per_s: 1.5 },
            "approach-2.5" => Shape::Approach { speed_m_per_s: 2.5 },
            "straight-0.3" => Shape::Straight { speed_m_per_s: 0.3 },
            other => return Err(MotionError::Unknown(other.into())),
        };
        // Hand-held motion also turns the sensor by a few degrees; the other motions do not.
        let gaze = match name.starts_with("sphere") {
            true => Wander::new(6f64.to_radians(), DVec3::new(1.0, 1.0, 0.4), duration_s, &mut rng),
            false => Wander::none(),
        };
        Ok(Self::Sensor(SensorMotion { start: Pose::looking_at(scene.start_m, scene.look_at_m, DVec3::Y), kind, gaze }))
    }

    /// `tracking_from_head` at a time, seconds.
    pub fn tracking_from_head(&self, time_s: f64, head_from_sensor: &Pose) -> Pose {
        match self {
            Self::Sensor(motion) => motion.at(time_s) * head_from_sensor.inverse(),
            Self::Head(play) => play.at(time_s),
            Self::Walk(walk) => walk.at(time_s),
        }
    }
}

/// Motion of the sensor relative to its start.
#[derive(Debug, Clone)]
enum Shape {
    Still,
    Wander(Wander),
    ToAndFro(ToAndFro),
    /// Motion of a machine: pose at a time, seconds.
    Mechanical(fn(f64) -> Pose),
    /// Straight ahead and back by 0.6 m, as a sine with this peak speed.
    Approach {
        speed_m_per_s: f64,
    },
    /// Straight ahead at constant speed, from before the start of the recording to its end.
    Straight {
        speed_m_per_s: f64,
    },
}

/// Length of the approach, metres. Choice: an arm's stroke, which at the thesis' 2.5 m/s still
/// lasts a quarter of a second.
const APPROACH_M: f64 = 0.6;

impl Shape {
    fn wander(reach_m: f64, axes: DVec3, duration_s: f64, rng: &mut ChaCha8Rng) -> Self {
        Self::Wander(Wander::new(reach_m, axes, duration_s, rng))
    }

    /// Pose in the frame of the sensor at the start.
    fn pose(&self, time_s: f64) -> Pose {
        match self {
            Self::Mechanical(at) => at(time_s),
            _ => Pose::from_translation(self.offset_m(time_s)),
        }
    }

    /// Offset in the frame of the sensor at the start, metres.
    fn offset_m(&self, time_s: f64) -> DVec3 {
        match self {
            Self::Still => DVec3::ZERO,
            Self::Mechanical(at) => at(time_s).translation,
            Self::Wander(wander) => wander.at(time_s),
            Self::ToAndFro(strokes) => strokes.offset_m(time_s),
            Self::Straight { speed_m_per_s } => DVec3::NEG_Z * (speed_m_per_s * time_s),
            // A sine with this peak speed.
            Self::Approach { speed_m_per_s } => {
                let omega = 2.0 * speed_m_per_s / APPROACH_M;
                DVec3::NEG_Z * (APPROACH_M * 0.5 * (1.0 - math::cos(omega * time_s)))
            }
        }
    }
}

/// A sensor held or slid by hand.
#[derive(Debug, Clone)]
pub struct SensorMotion {
    start: Pose,
    kind: Shape,
    gaze: Wander,
}

impl SensorMotion {
    fn at(&self, time_s: f64) -> Pose {
        let turn = DQuat::from_scaled_axis(self.gaze.at(time_s));
        self.start * self.kind.pose(time_s) * Pose::new(DVec3::ZERO, turn)
    }
}

/// Natural play while standing: the head moves between stances, looks in the direction of its steps
/// or around, sways, and sometimes crouches.
#[derive(Debug, Clone)]
pub struct NaturalMotion {
    stances: Vec<Stance>,
    sway: Wander,
}

#[derive(Debug, Clone, Copy)]
struct Stance {
    /// Arrival and departure, seconds.
    from_s: f64,
    until_s: f64,
    position_m: DVec3,
    yaw_rad: f64,
    pitch_rad: f64,
}

/// Half the size of the play area, metres. Choice: a small play area, as in most homes, with
/// furniture around it.
const PLAY_HALF_M: f64 = 0.8;
/// A player looks in the direction of a step longer than this, metres. Choice: shorter ones only
/// shift the weight.
const LOOK_AHEAD_STEP_M: f64 = 0.25;
/// Smallest distance to furniture, metres. Choice: half a body's width and a hand's breadth, so
/// that the player passes close to furniture and not through it.
const CLEARANCE_M: f64 = 0.4;

impl NaturalMotion {
    fn new(scene: &Scene, duration_s: f64, rng: &mut ChaCha8Rng) -> Self {
        let mut stances =
            vec![Stance { from_s: 0.0, until_s: 0.3, position_m: DVec3::Y * 1.65, yaw_rad: 0.0, pitch_rad: -0.1 }];
        while let Some(&last) = stances.last().filter(|s| s.until_s < duration_s) {
            stances.push(Self::next_stance(&last, scene, rng));
        }
        // 2 cm and about 2° of sway.
        Self { stances, sway: Wander::new(0.02, DVec3::ONE, duration_s, rng) }
    }

    fn next_stance(last: &Stance, scene: &Scene, rng: &mut ChaCha8Rng) -> Stance {
        let crouch = rng.random_range(0.0..1.0) < 0.12;
        let height_m = if crouch { rng.random_range(1.0..1.3) } else { rng.random_range(1.55..1.72) };
        let mut position_m = DVec3::new(last.position_m.x, height_m, last.position_m.z);
        // A step to a free position; the whole path keeps clear of furniture.
        for _ in 0..20 {
            let to = DVec3::new(
                rng.random_range(-PLAY_HALF_M..PLAY_HALF_M),
                height_m,
                rng.random_range(-PLAY_HALF_M..PLAY_HALF_M),
            );
            let way_is_free =
                (0..=10).all(|i| scene.room.clearance_m(last.position_m.lerp(to, f64::from(i) / 10.0)) >= CLEARANCE_M);
            if way_is_free && to.distance(last.position_m) < 0.9 {
                position_m = to;
                break;
            }
        }
        let way = position_m - last.position_m;
        let way_m = way.length();
        // Players look roughly in the direction of their steps; while standing they look around.
        let turn_rad = match DVec3::new(way.x, 0.0, way.z).length() > LOOK_AHEAD_STEP_M {
            true => turn_between(last.yaw_rad, math::atan2(-way.x, -way.z)) + rng.random_range(-0.6..0.6),
            false => rng.random_range(-1.6..1.6),
        };
        let yaw_rad = last.yaw_rad + turn_rad;
        let pitch_rad = rng.random_range(-0.75..0.15);
        // On average about 0.6 m/s over the ground and 90°/s of rotation.
        let travel_s = (way_m / 0.6).max(turn_rad.abs() / 1.6).max(0.4) * rng.random_range(0.9..1.3);
        let from_s = last.until_s + travel_s;
        Stance { from_s, until_s: from_s + rng.random_range(0.1..0.8), position_m, yaw_rad, pitch_rad }
    }

    fn at(&self, time_s: f64) -> Pose {
        let later = self.stances.partition_point(|s| s.from_s <= time_s).min(self.stances.len() - 1);
        let (a, b) = (&self.stances[later.saturating_sub(1)], &self.stances[later]);
        let share = smoothstep((time_s - a.until_s) / (b.from_s - a.until_s).max(1e-6));
        let mix = |from: f64, to: f64| from + (to - from) * share;
        let sway = self.sway.at(time_s);
        let rotation = DQuat::from_rotation_y(mix(a.yaw_rad, b.yaw_rad) + sway.z * 1.5)
            * DQuat::from_rotation_x(mix(a.pitch_rad, b.pitch_rad) + sway.x * 1.5);
        Pose::new(a.position_m.lerp(b.position_m, share) + sway, rotation)
    }
}

/// The shorter rotation from one yaw to another, within ±π.
pub(super) fn turn_between(from_rad: f64, to_rad: f64) -> f64 {
    (to_rad - from_rad + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI
}

#[cfg(test)]
mod tests {
    use super::super::scene;
    use super::*;

    #[test]
    fn sphere_motion_reaches_its_radius_and_stays_inside() {
        let scene = scene("corner-reflector", 1).unwrap();
        for (name, radius) in [("sphere-10cm", 0.1), ("sphere-50cm", 0.5)] {
            for seed in 0..5 {
                let motion = Motion::from_name(name, &scene, 10.0, seed).unwrap();
                let at = |t: f64| motion.tracking_from_head(t, &Pose::IDENTITY).translation.distance(scene.start_m);
                let farthest = (0..1000).map(|i| at(f64::from(i) * 0.01)).fold(0.0, f64::max);
                assert_eq!(at(0.0), 0.0);
                assert!((farthest - radius).abs() < 0.02 * radius, "{name} {seed}: {farthest}");
            }
        }
    }

    #[test]
    fn x_motion_stays_on_axis_and_approach_has_its_speed() {
        let scene = scene("corner-reflector", 1).unwrap();
        let at = |motion: &Motion, t: f64| motion.tracking_from_head(t, &Pose::IDENTITY);
        let along_x = Motion::from_name("x-50cm", &scene, 10.0, 3).unwrap();
        assert!((0..100).all(|i| {
            let offset = at(&along_x, f64::from(i) * 0.1).translation - scene.start_m;
            offset.y.abs() < 1e-12 && offset.z.abs() < 1e-12
        }));
        let approach = Motion::from_name("approach-2.5", &scene, 10.0, 3).unwrap();
        let speed = |t: f64| at(&approach, t + 1e-4).translation.distance(at(&approach, t).translation) / 1e-4;
        let fastest = (0..1000).map(|i| speed(f64::from(i) * 1e-3)).fold(0.0, f64::max);
        assert!((fastest - 2.5).abs() < 0.01, "{fastest}");
        let straight = Motion::from_name("straight-0.3", &scene, 10.0, 3).unwrap();
        let position = |t: f64| at(&straight, t).translation;
        assert!((-2..50).all(|i| {
            let step = position(0.1 * f64::from(i) + 0.1) - position(0.1 * f64::from(i));
            (step - at(&straight, 0.0).forward() * 0.03).length() < 1e-9
        }));
    }

    #[test]
    fn natural_motion_is_smooth_and_keeps_clearance() {
        for seed in 0..5 {
            let scene = scene("furnished-room", seed).unwrap();
            let motion = Motion::from_name("natural", &scene, 30.0, seed).unwrap();
            let mut before = motion.tracking_from_head(0.0, &Pose::IDENTITY);
            for i in 1..3000 {
                let pose = motion.tracking_from_head(f64::from(i) * 0.01, &Pose::IDENTITY);
                assert!(pose.translation.distance(before.translation) < 0.025, "seed {seed} at {i}");
                assert!(scene.room.clearance_m(pose.translation) > CLEARANCE_M - 0.1);
                before = pose;
            }
        }
    }
}

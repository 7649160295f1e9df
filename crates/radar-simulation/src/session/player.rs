//! The player's head: it moves between stances in the play area and near the furniture, usually
//! looks in the direction of its steps, sometimes crouches, and sways. The body below the head
//! keeps clear of objects.

use std::f64::consts::FRAC_PI_2;

use glam::{DQuat, DVec3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::super::Room;
use super::super::motion::turn_between;
use super::super::smooth::{Wander, smoothstep};
use super::outline::Outline;
use radar_sar::geometry::Pose;
use radar_sar::math;

/// Half the size of the play area, metres. Choice: a small play area, within the ring of furniture.
const PLAY_HALF_M: f64 = 0.9;
/// Smallest distance of the body's axis from furniture and walls, metres. Choice: half a body's
/// width; the player may touch furniture with an arm.
const CLEARANCE_M: f64 = 0.28;
/// Share of stances near an object, and their distance from its nearest part, metres. Choice: a few
/// approaches to each object within five minutes, to just outside of touching it.
const NEAR_OBJECT_SHARE: f64 = 0.3;
const NEAR_OBJECT_M: (f64, f64) = (0.3, 0.55);
/// Share of stances near a wall. Choice: seldom, as walls are beyond the furniture.
const WALL_SHARE: f64 = 0.05;
/// Longest step, metres. Choice: what a player walks between two stances without crossing the whole
/// area.
const MAX_STEP_M: f64 = 1.3;
/// The player looks in the direction of a step longer than this, metres, except for this share of
/// steps. Choice: shorter steps only shift the weight; backward steps into what was not seen do
/// happen in play.
const LOOK_AHEAD_STEP_M: f64 = 0.25;
const STEP_WITHOUT_LOOKING_SHARE: f64 = 0.15;
/// Distances from the walls of who looks about in a corner, metres. Choice: a step and a half back and forth.
const CORNER_M: (f64, f64) = (0.5, 1.2);

#[derive(Debug, Clone, Copy)]
struct Stance {
    from_s: f64,
    until_s: f64,
    position_m: DVec3,
    yaw_rad: f64,
    pitch_rad: f64,
}

/// Motion of the player's head.
#[derive(Debug, Clone)]
pub(super) struct Player {
    stances: Vec<Stance>,
    sway: Wander,
}

impl Player {
    pub fn new(room: &Room, outline: Outline<'_>, duration_s: f64, rng: &mut ChaCha8Rng) -> Self {
        let ground = Ground::new(room, outline);
        Self::with_stances(DVec3::Y * 1.65, |last, rng| next_stance(last, &ground, rng), duration_s, rng)
    }

    /// Who looks about in the corner at the least x and z of a box about the origin, half of whose size is given, metres.
    pub fn in_corner(half_m: DVec3, duration_s: f64, rng: &mut ChaCha8Rng) -> Self {
        let corner_m = DVec3::new(-half_m.x, 0.0, -half_m.z);
        let start_m = corner_m + DVec3::new(1.0, 1.65, 1.0);
        Self::with_stances(start_m, |last, rng| next_stance_in_corner(last, corner_m, rng), duration_s, rng)
    }

    fn with_stances(
        position_m: DVec3,
        next: impl Fn(&Stance, &mut ChaCha8Rng) -> Stance,
        duration_s: f64,
        rng: &mut ChaCha8Rng,
    ) -> Self {
        let mut stances = vec![Stance { from_s: 0.0, until_s: 0.3, position_m, yaw_rad: 0.0, pitch_rad: -0.1 }];
        while let Some(&last) = stances.last().filter(|s| s.until_s < duration_s) {
            stances.push(next(&last, rng));
        }
        // 2 cm and about 2° of sway.
        Self { stances, sway: Wander::new(0.02, DVec3::ONE, duration_s, rng) }
    }

    /// `room_from_head`.
    pub fn head_at(&self, time_s: f64) -> Pose {
        let (a, b, share) = self.between(time_s);
        let sway = self.sway.at(time_s);
        let mix = |from: f64, to: f64| from + (to - from) * share;
        let rotation = DQuat::from_rotation_y(mix(a.yaw_rad, b.yaw_rad) + sway.z * 1.5)
            * DQuat::from_rotation_x(mix(a.pitch_rad, b.pitch_rad) + sway.x * 1.5);
        Pose::new(a.position_m.lerp(b.position_m, share) + sway, rotation)
    }

    /// Yaw of the head, without wrapping, rad.
    pub fn yaw_at(&self, time_s: f64) -> f64 {
        let (a, b, share) = self.between(time_s);
        a.yaw_rad + (b.yaw_rad - a.yaw_rad) * share
    }

    fn between(&self, time_s: f64) -> (&Stance, &Stance, f64) {
        let later = self.stances.partition_point(|s| s.from_s <= time_s).min(self.stances.len() - 1);
        let (a, b) = (&self.stances[later.saturating_sub(1)], &self.stances[later]);
        (a, b, smoothstep((time_s - a.until_s) / (b.from_s - a.until_s).max(1e-6)))
    }
}

/// Floor plan for finding free positions.
struct Ground<'w> {
    /// Scatterers of all objects, at floor level, metres.
    parts: Vec<DVec3>,
    /// The same, by object.
    objects: Vec<Vec<DVec3>>,
    outline: Outline<'w>,
}

impl<'w> Ground<'w> {
    fn new(room: &Room, outline: Outline<'w>) -> Self {
        let level = |p: DVec3| DVec3::new(p.x, 0.0, p.z);
        let objects: Vec<Vec<DVec3>> =
            room.things.iter().map(|t| t.scatterers.iter().map(|s| level(s.position_m)).collect()).collect();
        Self { parts: objects.concat(), objects, outline }
    }

    /// Distance from a body's axis to the nearest scatterer or wall, metres.
    fn clearance_m(&self, point: DVec3) -> f64 {
        let level = DVec3::new(point.x, 0.0, point.z);
        self.parts.iter().map(|p| p.distance(level)).fold(self.outline.clearance_m(point), f64::min)
    }

    /// Whether the straight path keeps clear of everything.
    fn is_free(&self, from: DVec3, to: DVec3) -> bool {
        (0..=12).all(|n| self.clearance_m(from.lerp(to, f64::from(n) / 12.0)) >= CLEARANCE_M)
    }
}

fn next_stance(last: &Stance, ground: &Ground<'_>, rng: &mut ChaCha8Rng) -> Stance {
    let crouch = rng.random_range(0.0..1.0) < 0.12;
    let height_m = if crouch { rng.random_range(1.0..1.3) } else { rng.random_range(1.55..1.72) };
    let position_m = next_position(last, height_m, ground, rng);
    let way = position_m - last.position_m;
    // Players look roughly in the direction of their steps; while standing they look around;
    // sometimes they step without looking.
    let steps = DVec3::new(way.x, 0.0, way.z).length() > LOOK_AHEAD_STEP_M;
    let faces_step = rng.random_range(0.0..1.0) >= STEP_WITHOUT_LOOKING_SHARE;
    let turn_rad = match steps && faces_step {
        true => turn_between(last.yaw_rad, math::atan2(-way.x, -way.z)) + rng.random_range(-0.6..0.6),
        false => rng.random_range(-1.6..1.6),
    };
    let pitch_rad = rng.random_range(-0.75..0.15);
    last.then(position_m, turn_rad, pitch_rad, rng)
}

/// Somewhere before the corner, looking at one of the walls, at the edge between them, or at the floor.
fn next_stance_in_corner(last: &Stance, corner_m: DVec3, rng: &mut ChaCha8Rng) -> Stance {
    let mut off_m = || rng.random_range(CORNER_M.0..CORNER_M.1);
    let off_m = DVec3::new(off_m(), 0.0, off_m());
    let position_m = corner_m + off_m + DVec3::Y * rng.random_range(1.1..1.72);
    // The walls are at 0° and at 90°.
    let turn_rad = rng.random_range(-0.4..FRAC_PI_2 + 0.4) - last.yaw_rad;
    last.then(position_m, turn_rad, rng.random_range(-1.2..0.2), rng)
}

impl Stance {
    /// The next one: on average about 0.6 m/s over the ground and 90°/s of rotation.
    fn then(&self, position_m: DVec3, turn_rad: f64, pitch_rad: f64, rng: &mut ChaCha8Rng) -> Self {
        let way = position_m - self.position_m;
        let travel_s = (way.length() / 0.6).max(turn_rad.abs() / 1.6).max(0.4) * rng.random_range(0.9..1.3);
        let from_s = self.until_s + travel_s;
        let until_s = from_s + rng.random_range(0.1..0.8);
        Self { from_s, until_s, position_m, yaw_rad: self.yaw_rad + turn_rad, pitch_rad }
    }
}

fn next_position(last: &Stance, height_m: f64, ground: &Ground<'_>, rng: &mut ChaCha8Rng) -> DVec3 {
    let kind = rng.random_range(0.0..1.0);
    for _ in 0..30 {
        let somewhere = DVec3::new(
            rng.random_range(-PLAY_HALF_M..PLAY_HALF_M),
            height_m,
            rng.random_range(-PLAY_HALF_M..PLAY_HALF_M),
        );
        let to = if kind < NEAR_OBJECT_SHARE && !ground.objects.is_empty() {
            let parts = &ground.objects[rng.random_range(0..ground.objects.len())];
            // At a random distance from the part that is nearest to a random position.
            let level = DVec3::new(somewhere.x, 0.0, somewhere.z);
            let nearest = parts.iter().copied().min_by(|a, b| a.distance(level).total_cmp(&b.distance(level)));
            let part = nearest.unwrap_or(level);
            let away = (level - part).normalize_or(DVec3::X);
            part + away * rng.random_range(NEAR_OBJECT_M.0..NEAR_OBJECT_M.1) + DVec3::Y * height_m
        } else if kind < NEAR_OBJECT_SHARE + WALL_SHARE {
            let toward = somewhere.normalize_or(DVec3::X);
            let reach_m = ground.outline.reach_m(toward);
            let level = DVec3::new(toward.x, 0.0, toward.z) * (reach_m - rng.random_range(0.4..0.6));
            level + DVec3::Y * height_m
        } else {
            somewhere
        };
        let level = DVec3::new(to.x - last.position_m.x, 0.0, to.z - last.position_m.z);
        if level.length() < MAX_STEP_M && ground.is_free(last.position_m, to) {
            return to;
        }
    }
    DVec3::new(last.position_m.x, height_m, last.position_m.z)
}

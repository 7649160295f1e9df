//! The player's hands, each with a controller: held in front of the chest with some sway, and
//! reaching out every few seconds. They turn with the torso, which follows the head's yaw with a
//! delay of half a second.

use glam::{DQuat, DVec3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::super::Scatterer;
use super::super::smooth::{Wander, smoothstep};
use super::Player;

use radar_sar::math;

/// Position of the right shoulder from the eyes, metres; −z is ahead. Choice: an adult's shoulder,
/// below, aside and behind of the eyes.
const SHOULDER_M: DVec3 = DVec3::new(0.19, -0.28, 0.08);
/// Rest position of the right hand from the shoulder, metres. Choice: a controller held before the
/// belt with a bent elbow, in the lower part of the beam.
const REST_M: DVec3 = DVec3::new(0.02, -0.25, -0.36);
/// Distance of the elbow below the middle of the line from shoulder to hand, metres. Choice: an arm
/// hangs from the shoulder.
const ELBOW_DROP_M: f64 = 0.14;
/// Sway of a hand, metres. Choice: hands are never still in play; it moves the echoes through many
/// wavelengths.
const SWAY_M: f64 = 0.07;

/// Radar cross-sections, dBsm: palm with knuckles, plastic controller with electronics, forearm.
/// Choice: no measurement of hands at 60 GHz was found; as strong as a chair's parts, so that they
/// can be mistaken for furniture.
const PALM_DBSM: f64 = -22.0;
const CONTROLLER_DBSM: f64 = -21.0;
const FOREARM_DBSM: f64 = -24.0;

/// One reach: out, hold, back.
#[derive(Debug, Clone, Copy)]
struct Reach {
    from_s: f64,
    out_s: f64,
    stay_s: f64,
    back_s: f64,
    /// Target from the shoulder, torso's frame, metres.
    to_m: DVec3,
}

#[derive(Debug, Clone)]
struct Hand {
    /// −1: left, +1: right.
    side: f64,
    reaches: Vec<Reach>,
    sway: Wander,
    phases_rad: [f64; 5],
}

/// Both hands.
#[derive(Debug, Clone)]
pub(super) struct Hands([Hand; 2]);

impl Hands {
    pub fn new(duration_s: f64, rng: &mut ChaCha8Rng) -> Self {
        Self([-1.0, 1.0].map(|side| Hand::new(side, duration_s, rng)))
    }

    /// Positions of the left and right palm.
    pub fn palms_at(&self, player: &Player, time_s: f64) -> [DVec3; 2] {
        let torso = Torso::at(player, time_s);
        self.0.each_ref().map(|hand| torso.tracking_point(hand.shoulder() + hand.reach_m(time_s)))
    }

    /// Horizontal direction of the chest.
    pub fn facing_at(&self, player: &Player, time_s: f64) -> DVec3 {
        Torso::at(player, time_s).turn * DVec3::NEG_Z
    }

    /// Scatterers of both hands.
    pub fn scatterers_at(&self, player: &Player, time_s: f64) -> Vec<Scatterer> {
        let torso = Torso::at(player, time_s);
        self.0.iter().flat_map(|hand| hand.scatterers(&torso, time_s)).collect()
    }
}

/// Position of the head and rotation of the chest.
struct Torso {
    head_m: DVec3,
    turn: DQuat,
}

impl Torso {
    fn at(player: &Player, time_s: f64) -> Self {
        let yaw_rad = [0.1, 0.5, 0.9].map(|late_s| player.yaw_at(time_s - late_s)).iter().sum::<f64>() / 3.0;
        Self { head_m: player.head_at(time_s).translation, turn: DQuat::from_rotation_y(yaw_rad) }
    }

    fn tracking_point(&self, from_head_m: DVec3) -> DVec3 {
        self.head_m + self.turn * from_head_m
    }
}

impl Hand {
    fn new(side: f64, duration_s: f64, rng: &mut ChaCha8Rng) -> Self {
        let (mut reaches, mut time_s) = (Vec::new(), rng.random_range(0.5..3.0));
        while time_s < duration_s {
            // Mostly ahead and to its own side, from the hip to above the head.
            let azimuth = side * rng.random_range(-0.5..1.1f64);
            let elevation = rng.random_range(-0.9..0.7f64);
            let level = math::cos(elevation);
            let direction = DVec3::new(level * math::sin(azimuth), math::sin(elevation), -level * math::cos(azimuth));
            let reach = Reach {
                from_s: time_s,
                out_s: rng.random_range(0.3..0.6),
                stay_s: rng.random_range(0.1..0.7),
                back_s: rng.random_range(0.35..0.7),
                to_m: direction * rng.random_range(0.45..0.68),
            };
            time_s += reach.out_s + reach.stay_s + reach.back_s + rng.random_range(0.4..3.0);
            reaches.push(reach);
        }
        let sway = Wander::new(SWAY_M, DVec3::ONE, duration_s, rng);
        let phases_rad = [(); 5].map(|()| rng.random_range(0.0..std::f64::consts::TAU));
        Self { side, reaches, sway, phases_rad }
    }

    fn shoulder(&self) -> DVec3 {
        DVec3::new(self.side * SHOULDER_M.x, SHOULDER_M.y, SHOULDER_M.z)
    }

    fn reach_m(&self, time_s: f64) -> DVec3 {
        let rest = DVec3::new(self.side * REST_M.x, REST_M.y, REST_M.z) + self.sway.at(time_s);
        let latest = self.reaches.partition_point(|reach| reach.from_s <= time_s).checked_sub(1);
        let Some(reach) = latest.map(|n| &self.reaches[n]) else { return rest };
        let since_s = time_s - reach.from_s;
        let out = smoothstep(since_s / reach.out_s);
        let back = smoothstep((since_s - reach.out_s - reach.stay_s) / reach.back_s);
        rest.lerp(reach.to_m, out - back)
    }

    fn scatterers(&self, torso: &Torso, time_s: f64) -> [Scatterer; 5] {
        let (shoulder, hand) = (self.shoulder(), self.shoulder() + self.reach_m(time_s));
        let elbow = (shoulder + hand) * 0.5 - DVec3::Y * ELBOW_DROP_M;
        let ahead = (hand - elbow).normalize_or(DVec3::NEG_Z);
        let parts = [
            (hand, PALM_DBSM),
            (hand + ahead * 0.06 + DVec3::Y * 0.02, CONTROLLER_DBSM),
            (hand - DVec3::Y * 0.05, CONTROLLER_DBSM),
            (elbow.lerp(hand, 0.6), FOREARM_DBSM),
            (elbow, FOREARM_DBSM),
        ];
        let mut phases = self.phases_rad.into_iter();
        parts.map(|(at, rcs_dbsm)| Scatterer {
            position_m: torso.tracking_point(at),
            rcs_dbsm,
            lobe: DVec3::ZERO,
            phase_rad: phases.next().unwrap_or(0.0),
        })
    }
}

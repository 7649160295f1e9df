//! A person who crosses the room twice, or a pet that crosses it three times, on straight paths that
//! keep clear of the player and, if possible, of the furniture.

use std::f64::consts::TAU;

use glam::DVec3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::super::echoes::Walk;
use super::super::{Room, Scatterer};
use super::Player;

use radar_sar::math;

/// How someone crosses the room.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gait {
    /// Starts of the crossings, as shares of the session.
    starts: &'static [f64],
    /// Range of walking speeds, m/s.
    speed_m_per_s: (f64, f64),
    /// Cycles of the limbs, Hz.
    strides_per_s: f64,
    /// Smallest distance from the player, metres.
    player_clearance_m: f64,
}

/// A person. Choice: an unhurried walk indoors, once before and once after a chair is removed halfway;
/// a person keeps an arm's length from a player.
pub(super) const PERSON: Gait =
    Gait { starts: &[0.3, 0.75], speed_m_per_s: (0.8, 1.2), strides_per_s: 0.9, player_clearance_m: 0.9 };
/// A cat. Choice: slower with quicker steps, and nearer to the player.
pub(super) const CAT: Gait =
    Gait { starts: &[0.15, 0.55, 0.9], speed_m_per_s: (0.4, 0.8), strides_per_s: 1.6, player_clearance_m: 0.4 };
/// Number of random candidate paths for a crossing; the clearest one is used. Choice: enough that
/// one mostly keeps clear of player and furniture.
const CANDIDATE_PATHS: usize = 60;

#[derive(Debug, Clone, Copy)]
struct Crossing {
    from_s: f64,
    until_s: f64,
    start_m: DVec3,
    velocity_m_per_s: DVec3,
}

/// A walking person.
#[derive(Debug, Clone)]
pub(super) struct Visitor {
    gait: Gait,
    crossings: Vec<Crossing>,
    phases_rad: [f64; PARTS.len()],
}

/// Scatterers of the body: lateral offset, height and swing along the path, metres; radar
/// cross-section, dBsm. Choice: torso about the 95 % quantile of chests in the vendor's recordings
/// (−8 to −16 dBsm at 0.5 to 3 m), limbs weaker; no measurement of whole bodies was found.
const PARTS: [(f64, f64, f64, f64); 13] = [
    (0.0, 1.68, 0.0, -12.0),
    (-0.12, 1.35, 0.0, -8.0),
    (0.12, 1.35, 0.0, -8.0),
    (0.0, 1.15, 0.0, -7.0),
    (0.0, 0.95, 0.0, -9.0),
    (-0.24, 1.1, 0.10, -16.0),
    (0.24, 1.1, -0.10, -16.0),
    (-0.26, 0.85, 0.22, -17.0),
    (0.26, 0.85, -0.22, -17.0),
    (-0.1, 0.5, -0.16, -13.0),
    (0.1, 0.5, 0.16, -13.0),
    (-0.1, 0.08, -0.32, -15.0),
    (0.1, 0.08, 0.32, -15.0),
];

impl Visitor {
    /// `half_m`: half the size of the part of the room that is crossed.
    pub fn new(gait: Gait, room: &Room, half_m: DVec3, player: &Player, duration_s: f64, rng: &mut ChaCha8Rng) -> Self {
        let crossings =
            gait.starts.iter().map(|share| crossing(&gait, room, half_m, player, share * duration_s, rng)).collect();
        Self { gait, crossings, phases_rad: [(); PARTS.len()].map(|()| rng.random_range(0.0..TAU)) }
    }

    /// Where the person walks at a time; `None` while there is no visitor.
    pub fn walk_at(&self, time_s: f64) -> Option<Walk> {
        let now = self.crossings.iter().find(|c| (c.from_s..c.until_s).contains(&time_s))?;
        let since_s = time_s - now.from_s;
        Some(Walk {
            at_m: now.start_m + now.velocity_m_per_s * since_s,
            facing: now.velocity_m_per_s.normalize_or(DVec3::Z),
            stride_phase_rad: TAU * self.gait.strides_per_s * since_s,
            stride: 1.0,
        })
    }

    /// Scatterers at a time; empty while there is no visitor.
    pub fn scatterers_at(&self, time_s: f64) -> Vec<Scatterer> {
        let Some(now) = self.crossings.iter().find(|c| (c.from_s..c.until_s).contains(&time_s)) else {
            return Vec::new();
        };
        let since_s = time_s - now.from_s;
        let ahead = now.velocity_m_per_s.normalize_or(DVec3::Z);
        let right = ahead.cross(DVec3::Y);
        let swing = math::sin(TAU * self.gait.strides_per_s * since_s);
        let middle = now.start_m + now.velocity_m_per_s * since_s;
        let part = |(&(side, height, along, rcs_dbsm), &phase_rad): (&(f64, f64, f64, f64), &f64)| Scatterer {
            position_m: middle + right * side + DVec3::Y * height + ahead * (along * swing),
            rcs_dbsm,
            lobe: DVec3::ZERO,
            phase_rad,
        };
        PARTS.iter().zip(&self.phases_rad).map(part).collect()
    }
}

fn crossing(gait: &Gait, room: &Room, half: DVec3, player: &Player, from_s: f64, rng: &mut ChaCha8Rng) -> Crossing {
    let ways = (0..CANDIDATE_PATHS).map(|_| {
        // From one short wall to the other, so that there is room to pass the player.
        let side = if rng.random_range(0.0..1.0) < 0.5 { 1.0 } else { -1.0 };
        let x = |rng: &mut ChaCha8Rng| rng.random_range(-half.x + 0.3..half.x - 0.3);
        let (start, end) = (DVec3::new(x(rng), 0.0, side * half.z), DVec3::new(x(rng), 0.0, -side * half.z));
        let speed = rng.random_range(gait.speed_m_per_s.0..gait.speed_m_per_s.1);
        let lasts_s = start.distance(end) / speed;
        let velocity_m_per_s = (end - start) / lasts_s;
        Crossing { from_s, until_s: from_s + lasts_s, start_m: start, velocity_m_per_s }
    });
    let clear = |way: &Crossing| {
        let steps = (0..=20).map(|n| (way.until_s - way.from_s) * f64::from(n) / 20.0);
        let level = |p: DVec3| DVec3::new(p.x, 0.0, p.z);
        let clear = steps.map(|s| {
            let at = way.start_m + way.velocity_m_per_s * s;
            let player_m = level(player.head_at(way.from_s + s).translation).distance(at);
            let things_m = room.scatterers().map(|t| level(t.position_m).distance(at)).fold(f64::INFINITY, f64::min);
            // Walking through furniture matters less to a simulation than walking through the
            // player.
            (player_m - gait.player_clearance_m).min(0.0) * 10.0 + things_m.min(0.4)
        });
        clear.fold(f64::INFINITY, f64::min)
    };
    let ways: Vec<Crossing> = ways.collect();
    let best = ways.into_iter().max_by(|a, b| clear(a).total_cmp(&clear(b)));
    best.unwrap_or(Crossing { from_s, until_s: from_s, start_m: DVec3::ZERO, velocity_m_per_s: DVec3::ZERO })
}

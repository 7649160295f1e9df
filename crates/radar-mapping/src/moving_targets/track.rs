//! One thing that moves, followed: a small Kalman filter of range and own speed, the gate before it, and what confirms it.

use std::collections::VecDeque;

use glam::DVec3;

use super::MtiSettings;
use radar_sar::geometry::Pose;
use radar_sar::subaperture::{MtiEcho, MtiResult};

/// 1σ of an echo's range about the middle of a body, and of its speed about the body's: limbs swing.
const RANGE_SIGMA_M: f64 = 0.12;
const SPEED_SIGMA_M_PER_S: f64 = 0.3;
/// How people speed up and slow down along the line of sight, metres a second squared: 1σ, held for a block.
const ACCELERATION_M_PER_S2: f64 = 3.0;
/// What begins may have any speed of this 1σ about what its echo says.
const INITIAL_SPEED_SIGMA_M_PER_S: f64 = 0.3;
/// An echo farther from where a track should be is not its own: 1σ's, and metres.
const GATE_SIGMAS: f64 = 3.0;
const GATE_M: f64 = 0.5;
/// Speeds that differ by more are of something else, metres a second.
const GATE_M_PER_S: f64 = 1.2;
/// Within the hands' reach so much of that.
const HAND_GATE_FACTOR: f64 = 0.4;
/// Nothing in a room goes faster towards or away from the player, metres a second: where range rates are ambiguous, no other is tried.
const MAX_SPEED_M_PER_S: f64 = 1.5;
/// Blocks that are looked back on; what is not confirmed and misses so many in a row is none.
const RECENT_SUBAPERTURES: usize = 6;
const MAX_MISSES: usize = 3;
/// An echo so long after the last one stands alone, nanoseconds.
const MAX_ECHO_GAP_NS: i64 = 300_000_000;
/// Share of the sensor's way, and of its speeds, that is unknown of what is not straight ahead.
const TANGENTIAL_SHARE: f64 = 0.35;
/// No block counts for more of a way, seconds.
const MAX_SUBAPERTURE_S: f64 = 0.2;

/// Something that may move, from its first echo on.
#[derive(Debug, Clone)]
pub(super) struct MtiTrack {
    /// Of a confirmed one.
    pub id: Option<u64>,
    pub range_m: f64,
    pub speed_m_per_s: f64,
    /// Covariance of both: range, range and speed, speed.
    pub covariance: [f64; 3],
    pub seen_from: Pose,
    /// Range when it was last seen.
    pub seen_range_m: f64,
    pub evidence: f64,
    pub first_ns: i64,
    pub last_ns: i64,
    /// When an echo came that none was near to in time.
    pub lone_echo_ns: Option<i64>,
    pub recent_hits: VecDeque<bool>,
    pub travel_m: f64,
}

/// How an echo fits a track.
pub(super) struct Association {
    /// In 1σ's, squared.
    pub distance2: f64,
    /// The speed of its own that it then has, metres a second.
    pub speed_m_per_s: f64,
}

impl MtiTrack {
    /// From its first echo on, with one of the speeds of its own that this may have; it lasted so long, seconds.
    pub fn start(
        sensor: &Pose,
        now_ns: i64,
        echo: &MtiEcho,
        movers: &MtiResult,
        (speed_m_per_s, passed_s): (f64, f64),
    ) -> Self {
        Self {
            id: None,
            range_m: echo.range_m,
            speed_m_per_s,
            covariance: [RANGE_SIGMA_M.powi(2), 0.0, INITIAL_SPEED_SIGMA_M_PER_S.powi(2)],
            seen_from: *sensor,
            seen_range_m: echo.range_m,
            evidence: echo.power,
            first_ns: now_ns,
            last_ns: now_ns,
            lone_echo_ns: None,
            recent_hits: VecDeque::from([true]),
            travel_m: travel_m(speed_m_per_s, movers, passed_s),
        }
    }

    /// Whether it turned out to be nothing: not confirmed, and missed too often in a row.
    pub fn is_abandoned(&self) -> bool {
        let misses = self.recent_hits.iter().rev().take_while(|hit| !**hit).count();
        self.id.is_none() && misses >= MAX_MISSES
    }

    /// Time passes, and the sensor goes a way.
    pub fn predict(&mut self, passed_s: f64, way: DVec3, before: &Pose) {
        let [range2, both, speed2] = self.covariance;
        self.range_m += self.speed_m_per_s * passed_s - way.dot(before.forward());
        let noise = (ACCELERATION_M_PER_S2 * passed_s).powi(2);
        // The way counts less for what is not straight ahead.
        let aside2 = (way.length() * TANGENTIAL_SHARE).powi(2);
        self.covariance = [
            range2 + 2.0 * passed_s * both + passed_s.powi(2) * (speed2 + 0.25 * noise) + aside2,
            both + passed_s * (speed2 + 0.5 * noise),
            speed2 + noise,
        ];
    }

    /// Whether an echo is its own, and with which of the range rates that it may have.
    pub fn associate(&self, echo: &MtiEcho, movers: &MtiResult, reach_m: f64) -> Option<Association> {
        let speed_m_per_s = candidate_speeds(echo, movers)
            .min_by(|a, b| (a - self.speed_m_per_s).abs().total_cmp(&(b - self.speed_m_per_s).abs()))?;
        let (off_m, off_m_per_s) = (echo.range_m - self.range_m, speed_m_per_s - self.speed_m_per_s);
        let range2 = self.covariance[0] + RANGE_SIGMA_M.powi(2);
        // Where hands are about less is taken for the body that came so near.
        let gate = if echo.range_m < reach_m { HAND_GATE_FACTOR } else { 1.0 };
        let gate_m = gate * GATE_M.min(GATE_SIGMAS * range2.sqrt());
        let is_near = off_m.abs() <= gate_m && off_m_per_s.abs() <= gate * GATE_M_PER_S;
        let distance2 = off_m.powi(2) / range2 + off_m_per_s.powi(2) / (self.covariance[2] + speed_sigma2(movers));
        is_near.then_some(Association { distance2, speed_m_per_s })
    }

    /// Takes an echo.
    pub fn update(
        &mut self,
        sensor: &Pose,
        now_ns: i64,
        echo: &MtiEcho,
        movers: &MtiResult,
        fit: &Association,
        passed_s: f64,
    ) {
        // After a while one echo may be noise: it takes another to go on.
        let is_recent = |then_ns: i64| now_ns.saturating_sub(then_ns) <= MAX_ECHO_GAP_NS;
        if !is_recent(self.last_ns) && !self.lone_echo_ns.replace(now_ns).is_some_and(is_recent) {
            return;
        }
        self.correct(echo.range_m - self.range_m, [1.0, 0.0], RANGE_SIGMA_M.powi(2));
        self.correct(fit.speed_m_per_s - self.speed_m_per_s, [0.0, 1.0], speed_sigma2(movers));
        self.range_m = self.range_m.max(0.1);
        self.speed_m_per_s = self.speed_m_per_s.clamp(-MAX_SPEED_M_PER_S, MAX_SPEED_M_PER_S);
        self.travel_m += travel_m(fit.speed_m_per_s, movers, passed_s);
        (self.seen_from, self.seen_range_m) = (*sensor, self.range_m);
        self.evidence = echo.power;
        self.last_ns = now_ns;
    }

    /// A measurement of one of both, by how much it is off.
    fn correct(&mut self, off: f64, [of_range, of_speed]: [f64; 2], sigma2: f64) {
        let [range2, both, speed2] = self.covariance;
        let (with_range, with_speed) = (range2 * of_range + both * of_speed, both * of_range + speed2 * of_speed);
        let total = with_range * of_range + with_speed * of_speed + sigma2;
        self.range_m += with_range / total * off;
        self.speed_m_per_s += with_speed / total * off;
        self.covariance = [
            range2 - with_range * with_range / total,
            both - with_range * with_speed / total,
            speed2 - with_speed * with_speed / total,
        ];
    }

    /// Notes whether a block had it; one that could not tell says nothing. What is not told although it would be at its speed has come to
    /// move as what stands still does, if it is there at all: somebody who walks past comes no nearer.
    pub fn record_hit(&mut self, is_seen: bool, movers: &MtiResult) {
        let [first_m, last_m] = movers.ranges_m;
        let rate = self.speed_m_per_s + movers.ahead_m_per_s;
        let is_detectable = movers.is_observable(rate);
        if is_seen || (is_detectable && (first_m..=last_m).contains(&self.range_m)) {
            self.recent_hits.push_back(is_seen);
        }
        if !is_seen && is_detectable {
            let ([least, greatest], guard) = (movers.clutter_m_per_s, movers.guard_m_per_s);
            self.speed_m_per_s = rate.clamp(least - guard, greatest + guard) - movers.ahead_m_per_s;
        }
        while self.recent_hits.len() > RECENT_SUBAPERTURES {
            self.recent_hits.pop_front();
        }
    }

    pub fn is_confirmable(&self, settings: &MtiSettings) -> bool {
        let hits = self.recent_hits.iter().filter(|hit| **hit).count();
        hits >= settings.confirm_blocks && self.travel_m.abs() >= settings.min_travel_m
    }
}

/// The speeds of its own that an echo may have, slow ones first where they are told apart at all.
pub(super) fn candidate_speeds(echo: &MtiEcho, movers: &MtiResult) -> impl Iterator<Item = f64> {
    let (measured, step) = (echo.range_rate_m_per_s - movers.ahead_m_per_s, movers.ambiguity_m_per_s);
    let all = [0.0, -1.0, 1.0, -2.0, 2.0].map(|turns| measured + turns * step);
    all.into_iter().filter(|speed| speed.abs() <= MAX_SPEED_M_PER_S)
}

/// How far something of that speed went at least while a block lasted, whatever its direction, with its sign, metres.
fn travel_m(speed_m_per_s: f64, movers: &MtiResult, passed_s: f64) -> f64 {
    let (rate, [least, greatest]) = (speed_m_per_s + movers.ahead_m_per_s, movers.clutter_m_per_s);
    ((rate - greatest).max(0.0) + (rate - least).min(0.0)) * passed_s.min(MAX_SUBAPERTURE_S)
}

/// Variance of an echo's speed about that of its body: its limbs, and what stands still aside of straight ahead.
fn speed_sigma2(movers: &MtiResult) -> f64 {
    let [least, greatest] = movers.clutter_m_per_s;
    SPEED_SIGMA_M_PER_S.powi(2) + (TANGENTIAL_SHARE * (greatest - least)).powi(2)
}

//! One moving target track: a Kalman filter of range and speed, the gate before it, and the
//! confirmation after it.

use std::collections::VecDeque;

use glam::DVec3;

use super::MtiSettings;
use radar_sar::geometry::Pose;
use radar_sar::math;
use radar_sar::subaperture::{MtiEcho, MtiResult};

/// 1σ of an echo's range about the middle of a body, and of its speed about the body's. Choice:
/// limbs swing.
const RANGE_SIGMA_M: f64 = 0.12;
const SPEED_SIGMA_M_PER_S: f64 = 0.3;
/// 1σ of a person's radial acceleration, metres a second squared, constant over a sub-aperture.
/// Choice: a person comes to walking speed within half a second; a visitor in play who stops or
/// turns stays in the gate.
const ACCELERATION_M_PER_S2: f64 = 3.0;
/// 1σ of the speed of a new track about its echo's. Choice: that of any echo,
/// [`SPEED_SIGMA_M_PER_S`].
const INITIAL_SPEED_SIGMA_M_PER_S: f64 = 0.3;
/// Gate: an echo farther from the predicted range than the lesser of these, in 1σ and in metres, is
/// not the track's. Choice: 3σ loses 0.3 % of the echoes; half a metre is a body's depth with
/// outstretched limbs, so that a poor prediction does not take another's echoes.
const GATE_SIGMAS: f64 = 3.0;
const GATE_M: f64 = 0.5;
/// Gate: a greater difference of the speeds is another object's, metres a second. Choice: four
/// times [`SPEED_SIGMA_M_PER_S`]; an ambiguity, 2.6 m/s at d16, is well beyond it.
const GATE_M_PER_S: f64 = 1.2;
/// Factor on the gate within the hands' reach. Choice: 0.2 m, about a hand's own extent, so that a
/// swinging hand does not keep a track alive.
const HAND_GATE_FACTOR: f64 = 0.4;
/// Fastest radial speed of an object in a room, metres a second. Where range rates are ambiguous,
/// no other value is tried. Choice: a brisk walk indoors; each further speed begins more false
/// tracks.
const MAX_SPEED_M_PER_S: f64 = 1.5;
/// Number of recent sub-apertures that are looked back on, and the most misses in a row of an
/// unconfirmed track. Choice: half a second of preset d16; a person is missed three times in a row
/// only where something hides them.
const RECENT_SUBAPERTURES: usize = 6;
const MAX_MISSES: usize = 3;
/// Power over the rest of the residual with which an echo counts as one towards the confirmation, what
/// it counts more for a neper of power, and the bounds of that. Measured (`--example moving --
/// --world=dining --headset=lighthouse --effects=measured --each`): echoes of a person at 1.2 to 2.5 m
/// have a median power of 32, quartiles 18 and 86 (200..232); those of the wearer's hands by way of
/// walls 13 to 36 (100..112 --seconds=60 --no-visitor), four in a row at most. Noise exceeds 12 once in
/// 30 sub-apertures.
const FULL_HIT_POWER: f64 = 25.0;
const HIT_WEIGHT_PER_NEPER: f64 = 0.7;
const HIT_WEIGHTS: [f64; 2] = [0.4, 2.0];
/// An echo this long after the last one stands alone, nanoseconds. Choice: three sub-apertures of
/// 90 ms, [`MAX_MISSES`].
const MAX_ECHO_GAP_NS: i64 = 300_000_000;
/// Share of the sensor's displacement and of the range rates that is unknown for targets off the
/// boresight. Choice: the sine of 20°, about where the power of the bare sensor's beam has halved
/// on both ways.
const TANGENTIAL_SHARE: f64 = 0.35;
/// Longest time for which a sub-aperture's travel is counted, seconds. Choice: twice the length of
/// 90 ms; beyond, time without a measurement would count as travel.
const MAX_SUBAPERTURE_S: f64 = 0.2;

/// A possible target, from its first echo on.
#[derive(Debug, Clone)]
pub(super) struct MtiTrack {
    /// Of a confirmed track.
    pub id: Option<u64>,
    pub range_m: f64,
    pub speed_m_per_s: f64,
    /// Covariance: range variance, range-speed covariance, speed variance.
    pub covariance: [f64; 3],
    pub seen_from: Pose,
    /// Range at the last detection.
    pub seen_range_m: f64,
    pub evidence: f64,
    pub first_ns: i64,
    pub last_ns: i64,
    /// Time of an echo that stood alone.
    pub lone_echo_ns: Option<i64>,
    /// Powers of its echoes in the last sub-apertures; `None` where it had none.
    pub recent_hits: VecDeque<Option<f64>>,
    pub travel_m: f64,
}

/// How an echo fits a track.
pub(super) struct Association {
    /// Squared statistical distance, in 1σ.
    pub distance2: f64,
    /// The target's own radial speed, metres a second.
    pub speed_m_per_s: f64,
}

impl MtiTrack {
    /// From its first echo, with one of the speeds that this may have. `passed_s` is the time since
    /// the sub-aperture before, for the travel.
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
            recent_hits: VecDeque::from([Some(echo.power)]),
            travel_m: travel_m(speed_m_per_s, movers, passed_s),
        }
    }

    /// Whether it is unconfirmed and missed too often in a row.
    pub fn is_abandoned(&self) -> bool {
        let misses = self.recent_hits.iter().rev().take_while(|hit| hit.is_none()).count();
        self.id.is_none() && misses >= MAX_MISSES
    }

    /// Prediction over a time in which the sensor moves.
    pub fn predict(&mut self, passed_s: f64, way: DVec3, before: &Pose) {
        let [range2, both, speed2] = self.covariance;
        self.range_m += self.speed_m_per_s * passed_s - way.dot(before.forward());
        let noise = (ACCELERATION_M_PER_S2 * passed_s).powi(2);
        // The displacement counts less for targets off the boresight.
        let aside2 = (way.length() * TANGENTIAL_SHARE).powi(2);
        self.covariance = [
            range2 + 2.0 * passed_s * both + passed_s.powi(2) * (speed2 + 0.25 * noise) + aside2,
            both + passed_s * (speed2 + 0.5 * noise),
            speed2 + noise,
        ];
    }

    /// Whether an echo falls into the gate, and with which of the speeds that its range rate may
    /// mean.
    pub fn associate(&self, echo: &MtiEcho, movers: &MtiResult, reach_m: f64) -> Option<Association> {
        let speed_m_per_s = candidate_speeds(echo, movers)
            .min_by(|a, b| (a - self.speed_m_per_s).abs().total_cmp(&(b - self.speed_m_per_s).abs()))?;
        let (off_m, off_m_per_s) = (echo.range_m - self.range_m, speed_m_per_s - self.speed_m_per_s);
        let range2 = self.covariance[0] + RANGE_SIGMA_M.powi(2);
        // Fewer echoes are accepted where hands are.
        let gate = if echo.range_m < reach_m { HAND_GATE_FACTOR } else { 1.0 };
        let gate_m = gate * GATE_M.min(GATE_SIGMAS * range2.sqrt());
        let is_near = off_m.abs() <= gate_m && off_m_per_s.abs() <= gate * GATE_M_PER_S;
        let distance2 = off_m.powi(2) / range2 + off_m_per_s.powi(2) / (self.covariance[2] + speed_sigma2(movers));
        is_near.then_some(Association { distance2, speed_m_per_s })
    }

    /// Updates the track with an echo.
    pub fn update(
        &mut self,
        sensor: &Pose,
        now_ns: i64,
        echo: &MtiEcho,
        movers: &MtiResult,
        fit: &Association,
        passed_s: f64,
    ) {
        // After a gap, one echo may be noise. A second one must follow it.
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

    /// Kalman correction by a measurement of range or speed, with this innovation and variance.
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

    /// Records the power of the target's echo in a sub-aperture; `None` without one. A miss does not count
    /// where the target's range rate cannot be distinguished from that of objects at rest, or where its
    /// range was not measured.
    /// After a miss that counts by its range rate, the speed is limited to the range rates that
    /// objects at rest hide: a person who walks past comes no nearer.
    pub fn record_hit(&mut self, power: Option<f64>, movers: &MtiResult) {
        let is_seen = power.is_some();
        let [first_m, last_m] = movers.ranges_m;
        let rate = self.speed_m_per_s + movers.ahead_m_per_s;
        let is_detectable = movers.is_observable(rate);
        if is_seen || (is_detectable && (first_m..=last_m).contains(&self.range_m)) {
            self.recent_hits.push_back(power);
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
        let hits: f64 = self.recent_hits.iter().flatten().map(|power| hit_weight(*power)).sum();
        hits >= settings.confirm_subapertures as f64 && self.travel_m.abs() >= settings.min_travel_m
    }
}

/// What an echo of a power counts towards the confirmation of its track.
fn hit_weight(power: f64) -> f64 {
    let [least, greatest] = HIT_WEIGHTS;
    (1.0 + HIT_WEIGHT_PER_NEPER * math::ln(power / FULL_HIT_POWER)).clamp(least, greatest)
}

/// The radial speeds that an echo may have: the measured one and those one or two ambiguities away,
/// as far as they occur in a room.
pub(super) fn candidate_speeds(echo: &MtiEcho, movers: &MtiResult) -> impl Iterator<Item = f64> {
    let (measured, step) = (echo.range_rate_m_per_s - movers.ahead_m_per_s, movers.ambiguity_m_per_s);
    let all = [0.0, -1.0, 1.0, -2.0, 2.0].map(|turns| measured + turns * step);
    all.into_iter().filter(|speed| speed.abs() <= MAX_SPEED_M_PER_S)
}

/// The least distance travelled in a sub-aperture whatever the direction, with its sign, metres:
/// from the part of the range rate beyond that of all objects at rest.
fn travel_m(speed_m_per_s: f64, movers: &MtiResult, passed_s: f64) -> f64 {
    let (rate, [least, greatest]) = (speed_m_per_s + movers.ahead_m_per_s, movers.clutter_m_per_s);
    ((rate - greatest).max(0.0) + (rate - least).min(0.0)) * passed_s.min(MAX_SUBAPERTURE_S)
}

/// Variance of an echo's speed about that of its body: limbs, and objects at rest off the
/// boresight.
fn speed_sigma2(movers: &MtiResult) -> f64 {
    let [least, greatest] = movers.clutter_m_per_s;
    SPEED_SIGMA_M_PER_S.powi(2) + (TANGENTIAL_SHARE * (greatest - least)).powi(2)
}

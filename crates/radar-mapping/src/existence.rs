//! Whether a known place still has something in it: log odds that grow when blocks see it and fall when blocks should and do not.
//!
//! A thing that returned so much, at its range and in the beam's gain there, is expected to return as much again. Echoes fluctuate
//! (Swerling's first case), so under presence m is exponential with mean 1 + m̂, under absence with mean 1, and a block's log likelihood
//! ratio is m·m̂/(1 + m̂) − ln(1 + m̂). Other energy at the same range lowers m̂ as it lowers m: a thing that is drowned is not gone.
//! Furniture returns well into some directions and badly into others, so what was seen from a direction is expected from there more
//! surely than from elsewhere: the ratio is that of a mixture, and never being seen from a new side costs little. How surely is learned
//! for every side: what is seen from there each time is missed at once, what is seen now and then is given time.
//!
//! Furniture goes as a whole: where one thing has gone, what stands beside it and was not seen since is in doubt too. Else a leg at the floor,
//! which nobody looks at, would be all that is left of a chair, and be warned of for ever.
//!
//! What is only ever where something else accounts for the echoes has to go too: so blocks that have a thing in their beam without seeing
//! it by itself cost a little.

use std::f64::consts::TAU;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::responses::Response;
use radar_sar::math;
use radar_sar::subaperture::Subaperture;

/// Parameters of forgetting.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ExistenceSettings {
    /// Log odds that a thing needs to be confirmed.
    pub confirm: f64,
    /// A new thing begins with so much of the log odds that it was believed with.
    pub newly: f64,
    /// Log odds that are not exceeded: how much it takes to forget what was seen for long.
    pub most: f64,
    /// How sure it is that a thing is seen from where it was seen before, 0 to 1, before that is learned.
    pub familiar: f64,
    /// So many blocks that should see it from there say as much as `familiar` does.
    pub familiar_blocks: f64,
    /// How sure it is from a side that it was never seen from, 0 to 1.
    pub unfamiliar: f64,
    /// Log odds lost in every block that would see it if nothing else were there.
    pub leak: f64,
    /// The same in blocks where its echo is accounted for by something else.
    pub shadow_leak: f64,
    /// Log odds that are left to what stands beside a thing that is gone and was not seen since; what has no more goes with it.
    pub beside: f64,
}

impl Default for ExistenceSettings {
    fn default() -> Self {
        Self {
            confirm: 3.0,
            newly: 1.0,
            most: 4.0,
            familiar: 0.5,
            familiar_blocks: 8.0,
            unfamiliar: 0.2,
            leak: 0.02,
            shadow_leak: 0.1,
            beside: 1.0,
        }
    }
}

/// Sides that a thing is seen from, around the vertical.
pub(super) const AZIMUTH_SECTORS: usize = 16;
/// Log odds that what is remembered begins with: two or three blocks that miss it do away with it.
const RESTORED_LOG_ODDS: f64 = 1.5;
/// Nothing begins with less, log odds.
const MIN_INITIAL_LOG_ODDS: f64 = 0.5;
/// Share that a new echo has in what is expected of a side.
const STRENGTH_SMOOTHING: f64 = 0.2;
/// What would stand so far out of the noise should be seen.
const MIN_DETECTABLE_POWER: f64 = 3.0;
/// Nothing is learned to be seen less or more surely than this.
const P_DETECT_BOUNDS: (f64, f64) = (0.05, 0.9);
/// From an unfamiliar side so much of the strongest side's power is expected.
const UNSEEN_SECTOR_POWER_SHARE: f64 = 0.3;
/// Greatest that one block adds to the log odds.
const MAX_LOG_ODDS_PER_SUBAPERTURE: f64 = 1.0;

/// Log odds do not fall lower: what comes to a place where nothing was is believed soon.
const MIN_LOG_ODDS: f64 = -2.0;

/// The log odds of one place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Existence {
    log_odds: f64,
    /// Power at 1 m on the axis, in units of the noise, by side; 0: never seen.
    strengths: [f64; AZIMUTH_SECTORS],
    /// By side: blocks that should have seen it, and that did.
    opportunities: [f64; AZIMUTH_SECTORS],
    hits: [f64; AZIMUTH_SECTORS],
    newest_ns: i64,
    /// The last block that spoke for it.
    last_support_ns: i64,
    /// Whether it ever was as sure as can be.
    reached_max_log_odds: bool,
}

/// What a block says of a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Likelihood {
    pub response: Response,
    /// Something else accounts for what comes from there.
    pub is_masked: bool,
}

impl Existence {
    /// Nothing seen yet.
    pub fn new() -> Self {
        let [strengths, opportunities, hits] = [[0.0; AZIMUTH_SECTORS]; 3];
        Self {
            log_odds: 0.0,
            strengths,
            opportunities,
            hits,
            newest_ns: i64::MIN,
            last_support_ns: i64::MIN,
            reached_max_log_odds: false,
        }
    }

    /// Known for sure, and gone now.
    #[cfg(test)]
    pub fn known_and_gone() -> Self {
        Self { reached_max_log_odds: true, ..Self::new() }
    }

    /// Remembered from before, with what it returned to each side.
    pub fn restored(strengths: [f64; AZIMUTH_SECTORS]) -> Self {
        Self { log_odds: RESTORED_LOG_ODDS, strengths, ..Self::new() }
    }

    /// What it returned to each side.
    pub fn strengths(&self) -> [f64; AZIMUTH_SECTORS] {
        self.strengths
    }

    /// The most that it returned to any side; 0: never seen.
    pub fn greatest_strength(&self) -> f64 {
        self.strengths.iter().copied().fold(0.0, f64::max)
    }

    /// How surely something is there: 0 is even odds.
    pub fn log_odds(&self) -> f64 {
        self.log_odds
    }

    /// Believed with these log odds, and so no surer: the blocks that it was seen in are what they come from and do not count twice.
    pub fn limit_initial_log_odds(&mut self, log_odds: f64) {
        self.log_odds = self.log_odds.min(log_odds.max(MIN_INITIAL_LOG_ODDS));
        self.reached_max_log_odds = false;
    }

    /// Takes what blocks that are newer than the last ones say of it.
    pub fn update<'b>(
        &mut self,
        likelihoods: impl Iterator<Item = (&'b Subaperture, Likelihood)>,
        settings: &ExistenceSettings,
    ) {
        let since_ns = self.newest_ns;
        for (block, likelihood) in likelihoods.filter(|(block, _)| block.mid_time_ns > since_ns) {
            self.newest_ns = self.newest_ns.max(block.mid_time_ns);
            if self.apply(&likelihood, settings) > 0.0 {
                self.last_support_ns = block.mid_time_ns;
            }
        }
    }

    /// Whether it ever was as sure as can be: what never was may have been nothing from the beginning.
    pub fn reached_max_log_odds(&self) -> bool {
        self.reached_max_log_odds
    }

    /// Something beside it has turned out to be gone: unless this was seen since then it is in doubt too, and goes where it was already.
    pub fn weaken(&mut self, since_ns: i64, settings: &ExistenceSettings) {
        if self.last_support_ns < since_ns {
            self.log_odds = if self.log_odds > settings.beside { settings.beside } else { 0.0 };
        }
    }

    /// Gives what it changes in the log odds.
    fn apply(&mut self, likelihood: &Likelihood, settings: &ExistenceSettings) -> f64 {
        let response = &likelihood.response;
        let side = sector_of(-response.toward);
        let (strength, p_detect) = self.expected_return(side, settings);
        let would_be_seen = strength * response.gain >= MIN_DETECTABLE_POWER;
        let change = match likelihood.is_masked {
            true if would_be_seen => -settings.shadow_leak,
            true => 0.0,
            false => {
                let ratio = response.likelihood_ratio(strength);
                let leak = if would_be_seen { settings.leak } else { 0.0 };
                self.learn(side, response, response.expected_m(strength));
                math::ln(p_detect * ratio + 1.0 - p_detect).min(MAX_LOG_ODDS_PER_SUBAPERTURE) - leak
            }
        };
        self.log_odds = (self.log_odds + change).clamp(MIN_LOG_ODDS, settings.most);
        self.reached_max_log_odds |= self.log_odds >= settings.most;
        change
    }

    /// Learns what is seen from a side, and how surely.
    fn learn(&mut self, side: usize, response: &Response, expected: f64) {
        if expected >= MIN_DETECTABLE_POWER || response.is_significant() {
            self.opportunities[side] += 1.0;
            self.hits[side] += f64::from(u8::from(response.is_significant()));
        }
        if response.is_significant() && response.gain > 0.0 {
            let newest = response.power / response.gain;
            let known = &mut self.strengths[side];
            *known = if *known > 0.0 { *known + STRENGTH_SMOOTHING * (newest - *known) } else { newest };
        }
    }

    /// The strength that is expected from a side, and how surely.
    fn expected_return(&self, side: usize, settings: &ExistenceSettings) -> (f64, f64) {
        let beside = [side, (side + 1) % AZIMUTH_SECTORS, (side + AZIMUTH_SECTORS - 1) % AZIMUTH_SECTORS]
            .map(|n| self.strengths[n]);
        if beside[0] > 0.0 {
            let before = settings.familiar_blocks;
            let p_detect =
                (self.hits[side] + settings.familiar * before) / (self.opportunities[side] + before).max(1e-9);
            return (beside[0], p_detect.clamp(P_DETECT_BOUNDS.0, P_DETECT_BOUNDS.1));
        }
        let near = beside[1].max(beside[2]);
        if near > 0.0 {
            return (near * 0.5, 0.5 * (settings.familiar + settings.unfamiliar));
        }
        (self.greatest_strength() * UNSEEN_SECTOR_POWER_SHARE, settings.unfamiliar)
    }
}

/// The direction from the thing that a side's middle lies in.
pub(super) fn sector_direction(side: usize) -> DVec3 {
    let turn = (side as f64 + 0.5) / AZIMUTH_SECTORS as f64 * TAU;
    DVec3::new(math::sin(turn), 0.0, math::cos(turn))
}

/// The side that a direction from the thing leads to.
pub(super) fn sector_of(from_thing: DVec3) -> usize {
    let turn = math::atan2(from_thing.x, from_thing.z).rem_euclid(TAU) / TAU;
    ((turn * AZIMUTH_SECTORS as f64) as usize).min(AZIMUTH_SECTORS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn response(m: f64, power: f64, toward: DVec3) -> Response {
        let ln_strength = (m >= 3.0).then(|| power.ln());
        Response { m, evidence: 0.0, power, range_m: 1.0, toward, cos: 0.0, gain: 1.0, ln_strength }
    }

    fn likelihood(response: Response) -> Likelihood {
        Likelihood { response, is_masked: false }
    }

    /// What a thing that is known for sure loses by less than this, it outlasts.
    fn outlasts(log_odds: f64, loss: f64) -> bool {
        log_odds > ExistenceSettings::default().most - loss
    }

    fn after(responses: &[Response]) -> f64 {
        let settings = ExistenceSettings::default();
        let mut existence = Existence::new();
        responses.iter().for_each(|response| _ = existence.apply(&likelihood(*response), &settings));
        existence.log_odds
    }

    #[test]
    fn log_odds_rise_when_seen_and_fall_when_missed() {
        let (seen, empty) = (response(30.0, 30.0, DVec3::X), response(0.5, 0.5, DVec3::X));
        assert_eq!(after(&[seen; 10]), ExistenceSettings::default().most);
        let gone: Vec<Response> = [vec![seen; 10], vec![empty; 12]].concat();
        assert!(after(&gone) <= 0.0, "{}", after(&gone));
        let glimpse: Vec<Response> = [vec![seen; 10], vec![empty; 3], vec![seen; 1]].concat();
        assert!(outlasts(after(&glimpse), 3.0), "{}", after(&glimpse));
    }

    #[test]
    fn misses_from_unseen_sector_cost_little() {
        let (seen, empty) = (response(30.0, 30.0, DVec3::X), response(0.5, 0.5, DVec3::NEG_X));
        let elsewhere: Vec<Response> = [vec![seen; 10], vec![empty; 10]].concat();
        let there: Vec<Response> = [vec![seen; 10], vec![response(0.5, 0.5, DVec3::X); 10]].concat();
        assert!(outlasts(after(&elsewhere), 2.5) && after(&there) <= 0.0, "{} {}", after(&elsewhere), after(&there));
    }

    #[test]
    fn clutter_at_same_range_does_not_remove_object() {
        // Ten times its power from beside it at the same range.
        let (seen, drowned) = (response(30.0, 30.0, DVec3::X), response(1.0, 300.0, DVec3::X));
        let responses: Vec<Response> = [vec![seen; 10], vec![drowned; 30]].concat();
        assert!(outlasts(after(&responses), 1.5), "it leaks a little: {}", after(&responses));
    }

    #[test]
    fn permanently_masked_object_is_removed_slowly() {
        let settings = ExistenceSettings::default();
        let mut existence = Existence::new();
        let seen = response(30.0, 30.0, DVec3::X);
        (0..10).for_each(|_| _ = existence.apply(&likelihood(seen), &settings));
        let shadowed = Likelihood { response: seen, is_masked: true };
        (0..20).for_each(|_| _ = existence.apply(&shadowed, &settings));
        assert!(existence.log_odds > 1.5, "{}", existence.log_odds);
        (0..60).for_each(|_| _ = existence.apply(&shadowed, &settings));
        assert!(existence.log_odds <= 0.0, "{}", existence.log_odds);
    }

    #[test]
    fn neighbour_of_removed_object_is_weakened_unless_seen_since() {
        let settings = ExistenceSettings::default();
        let mut leg = Existence::new();
        (0..10).for_each(|_| _ = leg.apply(&likelihood(response(30.0, 30.0, DVec3::X)), &settings));
        leg.last_support_ns = 1000;
        let known = leg.log_odds;
        leg.weaken(900, &settings);
        assert_eq!(leg.log_odds, known, "it was seen after the seat was not");
        leg.weaken(1100, &settings);
        assert_eq!(leg.log_odds, settings.beside, "the seat is gone");
        leg.apply(&likelihood(response(30.0, 30.0, DVec3::X)), &settings);
        assert!(leg.log_odds > settings.beside, "it is there all the same");
        leg.weaken(1100, &settings);
        leg.weaken(1100, &settings);
        assert!(leg.log_odds <= 0.0, "the back is gone too");
        assert!(leg.reached_max_log_odds());
        leg.limit_initial_log_odds(9.0);
        assert!(!leg.reached_max_log_odds(), "the blocks it is believed by do not count twice");
    }

    #[test]
    fn intermittent_object_survives_longer_than_steady_one() {
        let (seen, empty) = (response(30.0, 30.0, DVec3::X), response(0.5, 0.5, DVec3::X));
        let until_gone = |before: &[Response]| {
            let settings = ExistenceSettings::default();
            let mut existence = Existence::new();
            before.iter().for_each(|response| _ = existence.apply(&likelihood(*response), &settings));
            (0..).find(|_| {
                existence.apply(&likelihood(empty), &settings);
                existence.log_odds <= 0.0
            })
        };
        let always = until_gone(&[seen; 40]);
        let now_and_then = until_gone(&[seen, empty].repeat(30));
        assert!(always.unwrap() * 2 < now_and_then.unwrap(), "{always:?} {now_and_then:?}");
    }

    #[test]
    fn undetectable_far_object_is_not_removed() {
        let settings = ExistenceSettings::default();
        let mut existence = Existence::new();
        (0..10).for_each(|_| _ = existence.apply(&likelihood(response(30.0, 30.0, DVec3::X)), &settings));
        let far = Response { gain: 0.002, ..response(1.0, 1.0, DVec3::X) };
        (0..100).for_each(|_| _ = existence.apply(&likelihood(far), &settings));
        assert!(outlasts(existence.log_odds, 1.0), "{}", existence.log_odds);
    }
}

//! Existence of a known object as log odds: they grow when sub-apertures see it and fall when
//! sub-apertures should see it and do not.
//!
//! The model: an object is expected to reflect as much again as it did before, at its range and in
//! the beam's gain there. Echoes fluctuate (Swerling case 1). With an object present, m is
//! exponential with mean 1 + m̂, without one it is exponential with mean 1. A sub-aperture's log
//! likelihood ratio is therefore m·m̂/(1 + m̂) − ln(1 + m̂). Clutter at the same range lowers m̂ as
//! it lowers m, so a masked object is not taken for a removed one.
//!
//! Furniture reflects well into some directions and badly into others: an edge or a tube only across
//! itself. The expectation is therefore kept for each side, a sector of azimuth and elevation, and the
//! ratio is that of a mixture with a probability of detection. That is learned for each side: an
//! object that is always seen from there is missed at once, one that is seen now and then is given
//! time. From a new side it may be seen always or never, so the misses of one side are no independent
//! evidence: each costs less than the one before, down to a floor at which an object goes in some
//! seconds.
//!
//! Furniture is removed as a whole. When an object is removed, its neighbours that were not seen
//! since then are weakened too. Otherwise the leg of a chair that has been taken away would stay,
//! which is rarely in the beam, and would be warned of for ever.
//!
//! What was detected again in a later window is established: an artefact of one path rarely comes back (`recurrence.rs`).
//! An established object is given more time. From nearly the same direction it is missed for the same reason again and again,
//! so each further miss from one direction counts less; what is gone is missed from each direction that the head moves to.
//!
//! An object that is only ever where another one masks its echoes must go as well. Sub-apertures
//! that have it in their beam, without seeing it by itself, therefore cost a little.

use std::f64::consts::TAU;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::responses::Response;
use radar_sar::subaperture::Subaperture;
use radar_sar::{BoundedSettings, SettingBound, bounds, math};

/// Parameters of the existence model.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ExistenceSettings {
    /// Log odds that a new object must reach to be confirmed.
    pub confirm_log_odds: f64,
    /// Share of the classifier's log odds that a new object begins with.
    pub initial_share: f64,
    /// Greatest log odds: bounds the evidence needed to remove an object that was seen for long.
    pub max_log_odds: f64,
    /// The same of an established object.
    pub established_max_log_odds: f64,
    /// Probability of detection from a side that it was seen from, 0 to 1, before it is learned.
    pub detection_seen_side: f64,
    /// Weight of `detection_seen_side` as a prior, in sub-apertures that should see the object from a side.
    pub detection_prior_subapertures: f64,
    /// Probability of detection from a side that it was never seen from, 0 to 1, before it is learned.
    pub detection_new_side: f64,
    /// Log odds lost in every sub-aperture that would see it if there were no clutter.
    pub loss: f64,
    /// The same in sub-apertures where something else masks its echo.
    pub masked_loss: f64,
    /// Log odds left to a neighbour of a removed object, unless it was seen since. A neighbour that
    /// has no more than this is removed too.
    pub neighbour_log_odds: f64,
}

/// At the end of each interval that makes mapping hardest, as far as the other settings allow it, a furnished room gives obstacles (`tests/program/settings_file.rs`), as long as the log odds can
/// reach what confirms ([`MappingSettings::check`](crate::MappingSettings::check)).
impl BoundedSettings for ExistenceSettings {
    const BOUNDS: &'static [SettingBound<Self>] = bounds![
        confirm_log_odds: -100.0, 10.0;
        initial_share: 0.0, 100.0;
        max_log_odds: 0.1, 100.0;
        established_max_log_odds: 0.1, 100.0;
        detection_seen_side: 0.0, 0.99;
        detection_prior_subapertures: 0.0, 1e9;
        detection_new_side: 0.0, 0.99;
        loss: 0.0, 0.3;
        masked_loss: 0.0, 1e3;
        neighbour_log_odds: 0.0, 100.0;
    ];
}

impl Default for ExistenceSettings {
    fn default() -> Self {
        Self {
            confirm_log_odds: 3.0,
            initial_share: 1.0,
            max_log_odds: 4.0,
            established_max_log_odds: 6.0,
            detection_seen_side: 0.5,
            detection_prior_subapertures: 8.0,
            detection_new_side: 0.2,
            loss: 0.02,
            masked_loss: 0.1,
            neighbour_log_odds: 1.0,
        }
    }
}

/// Number of azimuth sectors that an object is seen from, around the vertical. Choice: 22.5° each;
/// wider ones mix faces of furniture that reflect differently, narrower ones are rarely seen twice.
/// Part of the saved map's format.
pub(super) const AZIMUTH_SECTORS: usize = 16;
/// Number of elevation bands, as wide as a sector, about the horizontal; the outer ones reach to the
/// vertical. Choice: who crouches or comes near looks from another side.
const ELEVATION_BANDS: usize = 5;
/// Weight of `detection_new_side` as a prior, in sub-apertures. Choice: 2, so that a few misses settle that a
/// face does not reflect to this side.
const NEW_SIDE_PRIOR_SUBAPERTURES: f64 = 2.0;
/// Log odds of a restored object. Choice: two or three missed sub-apertures remove it.
const RESTORED_LOG_ODDS: f64 = 1.5;
/// Least log odds that a new object begins with. Choice: above 0, where objects are removed, by
/// more than a miss from a new side costs, ln(1 − `detection_new_side`) = −0.22.
const MIN_INITIAL_LOG_ODDS: f64 = 0.5;
/// Weight of a new echo in the running mean of a side's strength. Choice: a mean of about nine
/// echoes, which reduces the fluctuation of Swerling case 1 from 100 % to 33 %; a longer one would
/// not follow a change of aspect.
const STRENGTH_SMOOTHING: f64 = 0.2;
/// Expected power, relative to noise, from which on an object should be seen. Choice: that of
/// `SIGNIFICANT_COHERENCE`, which noise reaches in 5 % of the sub-apertures (e⁻³).
const MIN_DETECTABLE_POWER: f64 = 3.0;
/// Bounds of the learned probability of detection. Choice: at 0.9 a miss costs at most ln 10 = 2.3,
/// so that a single one removes no object at the greatest log odds of 4; at 0.05 a miss still costs
/// something.
const P_DETECT_BOUNDS: (f64, f64) = (0.05, 0.9);
/// Share of the strongest side's power that is expected from a side never seen from. Choice: −5
/// dB, as furniture has a best side; with the full power every new side would count as a miss.
const UNSEEN_SIDE_POWER_SHARE: f64 = 0.3;
/// The same of a side beside those it was seen from, of the strongest of these. Choice: −3 dB.
const NEIGHBOUR_POWER_SHARE: f64 = 0.5;
/// Most that one sub-aperture adds to the log odds. Choice: one sub-aperture can be a passing hand
/// or a sidelobe; an object needs four to reach the greatest log odds.
const MAX_LOG_ODDS_PER_SUBAPERTURE: f64 = 1.0;

/// Edge of a cell of azimuth and elevation within which an object is seen from the same direction, radians: 6°. Choice: 15 cm of the
/// head's path at 1.5 m.
const SAME_DIRECTION_RAD: f64 = 6.0 * TAU / 360.0;

/// Least log odds. Choice: an object put where nothing was is accepted soon.
const MIN_LOG_ODDS: f64 = -2.0;

/// The existence of one object.
#[derive(Debug, Clone, Copy)]
pub(super) struct Existence {
    log_odds: f64,
    /// By azimuth and elevation.
    sides: [[Side; ELEVATION_BANDS]; AZIMUTH_SECTORS],
    newest_ns: i64,
    /// Time of the last sub-aperture that raised the log odds.
    last_support_ns: i64,
    /// Whether the log odds ever reached their greatest value.
    reached_max_log_odds: bool,
    /// It was detected in two separate windows.
    established: bool,
    /// A neighbour was removed: it is not established again before it has been seen enough.
    doubted: bool,
    glance: Glance,
}

/// The sub-apertures in a row that should have seen an object from the same direction.
#[derive(Debug, Clone, Copy, Default)]
struct Glance {
    /// Cell of azimuth and elevation.
    cell: (i32, i32),
    subapertures: f64,
}

impl Glance {
    /// Counts a sub-aperture that sees the object in this direction; returns what its evidence weighs: n^(−3/4) for the n-th.
    fn weight(&mut self, from_object: DVec3) -> f64 {
        let cell_of = |angle: f64| (angle / SAME_DIRECTION_RAD).floor() as i32;
        let elevation = math::atan2(from_object.y, math::hypot(from_object.x, from_object.z));
        let cell = (cell_of(math::atan2(from_object.x, from_object.z)), cell_of(elevation));
        if cell != self.cell {
            *self = Self { cell, subapertures: 0.0 };
        }
        self.subapertures += 1.0;
        // IEEE 754 rounds a square root the same on every system; a power it leaves open.
        let root = self.subapertures.sqrt();
        1.0 / (root * root.sqrt())
    }
}

/// What is known of an object from one side.
#[derive(Debug, Clone, Copy, Default)]
struct Side {
    /// Power at 1 m on the axis, relative to noise; 0: never seen.
    strength: f64,
    /// Sub-apertures that should have seen it, and those that did.
    opportunities: f64,
    hits: f64,
}

impl Side {
    /// Probability of detection, with a prior of this weight in sub-apertures.
    fn p_detect(&self, prior: f64, weight: f64) -> f64 {
        let learned = (self.hits + prior * weight) / (self.opportunities + weight).max(1e-9);
        learned.clamp(P_DETECT_BOUNDS.0, P_DETECT_BOUNDS.1)
    }
}

/// One sub-aperture's response to an object.
#[derive(Debug, Clone, Copy)]
pub(super) struct Likelihood {
    pub response: Response,
    /// Something else accounts for the echo.
    pub is_masked: bool,
}

impl Existence {
    /// Nothing observed yet.
    pub fn new() -> Self {
        Self {
            log_odds: 0.0,
            sides: Default::default(),
            newest_ns: i64::MIN,
            last_support_ns: i64::MIN,
            reached_max_log_odds: false,
            established: false,
            doubted: false,
            glance: Glance::default(),
        }
    }

    /// Whether it was detected again in a later window.
    pub fn is_established(&self) -> bool {
        self.established
    }

    /// It was detected again in a later window. Without effect while a removed neighbour leaves it in doubt.
    pub fn establish(&mut self) {
        self.established = !self.doubted;
    }

    /// An object that had reached the greatest log odds and is gone now.
    #[cfg(test)]
    pub fn known_and_gone() -> Self {
        Self { reached_max_log_odds: true, ..Self::new() }
    }

    /// A restored object, with the power that it reflected by azimuth sector.
    pub fn restored(strengths: [f64; AZIMUTH_SECTORS]) -> Self {
        let sides = strengths.map(|strength| [Side { strength, ..Side::default() }; ELEVATION_BANDS]);
        Self { log_odds: RESTORED_LOG_ODDS, sides, ..Self::new() }
    }

    /// It was seen with wrong poses: as little is certain as of a restored object, the sub-apertures with right poses
    /// count anew, and two windows with right poses establish it.
    pub fn distrust(&mut self) {
        self.established = false;
        self.log_odds = self.log_odds.min(RESTORED_LOG_ODDS);
        self.newest_ns = i64::MIN;
    }

    /// The greatest power that it reflected in each azimuth sector.
    pub fn strengths(&self) -> [f64; AZIMUTH_SECTORS] {
        self.sides.map(|bands| bands.iter().map(|side| side.strength).fold(0.0, f64::max))
    }

    /// The greatest power over all sides; 0: never seen.
    pub fn greatest_strength(&self) -> f64 {
        self.strengths().into_iter().fold(0.0, f64::max)
    }

    /// Log odds that it exists: 0 is even odds.
    pub fn log_odds(&self) -> f64 {
        self.log_odds
    }

    /// Limits the log odds to these, but not below `MIN_INITIAL_LOG_ODDS`. The sub-apertures in which a new
    /// object was seen are those that its log odds come from, so they do not count twice.
    pub fn limit_initial_log_odds(&mut self, log_odds: f64) {
        self.log_odds = self.log_odds.min(log_odds.max(MIN_INITIAL_LOG_ODDS));
        self.reached_max_log_odds = false;
    }

    /// Takes the responses of sub-apertures newer than the last ones.
    pub fn update<'b>(
        &mut self,
        likelihoods: impl Iterator<Item = (&'b Subaperture, Likelihood)>,
        settings: &ExistenceSettings,
    ) {
        let since_ns = self.newest_ns;
        for (subaperture, likelihood) in likelihoods.filter(|(subaperture, _)| subaperture.mid_time_ns > since_ns) {
            self.newest_ns = self.newest_ns.max(subaperture.mid_time_ns);
            if self.apply(&likelihood, settings) > 0.0 {
                self.last_support_ns = subaperture.mid_time_ns;
            }
        }
    }

    /// Whether the log odds ever reached their greatest value. An object that never did may have
    /// been an artefact from the beginning.
    pub fn reached_max_log_odds(&self) -> bool {
        self.reached_max_log_odds
    }

    /// A neighbour has been removed. Unless this object was seen since then its log odds drop to
    /// `settings.neighbour_log_odds`, and to 0 if they were no greater already; and it is no longer established.
    pub fn weaken(&mut self, since_ns: i64, settings: &ExistenceSettings) {
        if self.last_support_ns < since_ns {
            (self.established, self.doubted) = (false, true);
            self.log_odds = if self.log_odds > settings.neighbour_log_odds { settings.neighbour_log_odds } else { 0.0 };
        }
    }

    /// Returns the change in the log odds.
    fn apply(&mut self, likelihood: &Likelihood, settings: &ExistenceSettings) -> f64 {
        let response = &likelihood.response;
        let at = (sector_of(-response.toward), elevation_band_of(-response.toward));
        let (strength, p_detect) = self.expected_return(at, settings);
        let would_be_seen = strength * response.gain >= MIN_DETECTABLE_POWER;
        let change = match likelihood.is_masked {
            true if would_be_seen => -settings.masked_loss,
            true => 0.0,
            false => {
                let ratio = response.likelihood_ratio(strength);
                let loss = if would_be_seen { settings.loss } else { 0.0 };
                let weight = match would_be_seen || response.is_significant() {
                    true if self.established => self.glance.weight(-response.toward),
                    _ => 1.0,
                };
                self.learn(at, response, response.expected_m(strength), weight);
                let change = math::ln(p_detect * ratio + 1.0 - p_detect).min(MAX_LOG_ODDS_PER_SUBAPERTURE) - loss;
                if change < 0.0 { change * weight } else { change }
            }
        };
        let max_log_odds = if self.established { settings.established_max_log_odds } else { settings.max_log_odds };
        self.log_odds = (self.log_odds + change).clamp(MIN_LOG_ODDS, max_log_odds);
        self.doubted &= self.log_odds < settings.max_log_odds;
        self.reached_max_log_odds |= self.log_odds >= settings.max_log_odds;
        change
    }

    /// Learns the side's strength and, with this weight, its probability of detection.
    fn learn(&mut self, (azimuth, band): (usize, usize), response: &Response, expected: f64, weight: f64) {
        let side = &mut self.sides[azimuth][band];
        if expected >= MIN_DETECTABLE_POWER || response.is_significant() {
            side.opportunities += weight;
            side.hits += if response.is_significant() { weight } else { 0.0 };
        }
        if response.is_significant() && response.gain > 0.0 {
            let (newest, known) = (response.power / response.gain, &mut side.strength);
            *known = if *known > 0.0 { *known + STRENGTH_SMOOTHING * (newest - *known) } else { newest };
        }
    }

    /// Expected strength from a side, and the probability of detection.
    fn expected_return(&self, (azimuth, band): (usize, usize), settings: &ExistenceSettings) -> (f64, f64) {
        let side = &self.sides[azimuth][band];
        let (seen, new) = (settings.detection_seen_side, settings.detection_new_side);
        if side.strength > 0.0 {
            return (side.strength, side.p_detect(seen, settings.detection_prior_subapertures));
        }
        let beside = self.strength_beside(azimuth, band);
        if beside > 0.0 {
            return (NEIGHBOUR_POWER_SHARE * beside, side.p_detect(0.5 * (seen + new), NEW_SIDE_PRIOR_SUBAPERTURES));
        }
        (self.greatest_strength() * UNSEEN_SIDE_POWER_SHARE, side.p_detect(new, NEW_SIDE_PRIOR_SUBAPERTURES))
    }

    /// The greatest strength of the four sides around one; 0: it was seen from none of them.
    fn strength_beside(&self, azimuth: usize, band: usize) -> f64 {
        let around = [1, AZIMUTH_SECTORS - 1].map(|by| (azimuth + by) % AZIMUTH_SECTORS);
        let level = around.into_iter().map(|azimuth| self.sides[azimuth][band].strength);
        let bands = self.sides[azimuth][band.saturating_sub(1)..].iter().take(if band == 0 { 2 } else { 3 });
        level.chain(bands.map(|side| side.strength)).fold(0.0, f64::max)
    }
}

/// The direction from the object to the middle of a sector.
pub(super) fn sector_direction(side: usize) -> DVec3 {
    let turn = (side as f64 + 0.5) / AZIMUTH_SECTORS as f64 * TAU;
    DVec3::new(math::sin(turn), 0.0, math::cos(turn))
}

/// The sector that a direction from the object lies in.
pub(super) fn sector_of(from_thing: DVec3) -> usize {
    let turn = math::atan2(from_thing.x, from_thing.z).rem_euclid(TAU) / TAU;
    ((turn * AZIMUTH_SECTORS as f64) as usize).min(AZIMUTH_SECTORS - 1)
}

/// The elevation band that a direction from the object lies in, from below to above.
fn elevation_band_of(from_thing: DVec3) -> usize {
    let elevation = math::atan2(from_thing.y, math::hypot(from_thing.x, from_thing.z));
    let from_level = (elevation * AZIMUTH_SECTORS as f64 / TAU).round();
    (from_level + (ELEVATION_BANDS / 2) as f64).clamp(0.0, (ELEVATION_BANDS - 1) as f64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    fn response(m: f64, power: f64, toward: DVec3) -> Response {
        let ln_strength = (m >= 3.0).then(|| power.ln());
        Response { m, evidence: 0.0, power, range_m: 1.0, toward, cos: 0.0, gain: 1.0, ln_strength }
    }

    fn likelihood(response: Response) -> Likelihood {
        Likelihood { response, is_masked: false }
    }

    /// Whether an object at the greatest log odds lost less than this.
    fn outlasts(log_odds: f64, loss: f64) -> bool {
        log_odds > ExistenceSettings::default().max_log_odds - loss
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
        assert_eq!(after(&[seen; 10]), ExistenceSettings::default().max_log_odds);
        let gone: Vec<Response> = [vec![seen; 10], vec![empty; 12]].concat();
        assert!(after(&gone) <= 0.0, "{}", after(&gone));
        let glimpse: Vec<Response> = [vec![seen; 10], vec![empty; 3], vec![seen; 1]].concat();
        assert!(outlasts(after(&glimpse), 3.0), "{}", after(&glimpse));
    }

    #[test]
    fn misses_from_unseen_side_cost_little() {
        let (seen, empty) = (response(30.0, 30.0, DVec3::X), response(0.5, 0.5, DVec3::NEG_X));
        let elsewhere: Vec<Response> = [vec![seen; 10], vec![empty; 10]].concat();
        let there: Vec<Response> = [vec![seen; 10], vec![response(0.5, 0.5, DVec3::X); 10]].concat();
        assert!(outlasts(after(&elsewhere), 2.5) && after(&there) <= 0.0, "{} {}", after(&elsewhere), after(&there));
    }

    #[test]
    fn misses_of_one_new_side_are_no_independent_evidence() {
        let (seen, empty) = (response(30.0, 30.0, DVec3::X), |toward: DVec3| response(0.5, 0.5, toward));
        let below = DVec3::new(0.7, 0.7, 0.0);
        for toward in [DVec3::NEG_X, below] {
            let long: Vec<Response> = [vec![seen; 10], vec![empty(toward); 40]].concat();
            assert!(outlasts(after(&long), 3.0), "{toward}: {}", after(&long));
        }
        let around = (0..12).map(|n| DQuat::from_rotation_y(f64::from(n) * 0.5) * below);
        let everywhere: Vec<Response> =
            vec![seen; 10].into_iter().chain(around.flat_map(|at| [empty(at); 8])).collect();
        assert!(after(&everywhere) <= 0.0, "{}", after(&everywhere));
    }

    #[test]
    fn elevation_bands_reach_from_below_to_above() {
        let band = |deg: f64| elevation_band_of(DQuat::from_rotation_z(deg.to_radians()) * DVec3::X);
        assert_eq!([-90.0, -40.0, -20.0, 0.0, 11.0, 12.0, 40.0, 90.0].map(band), [0, 0, 1, 2, 2, 3, 4, 4]);
    }

    #[test]
    fn clutter_at_same_range_does_not_remove_object() {
        // Clutter of ten times its power at the same range.
        let (seen, masked) = (response(30.0, 30.0, DVec3::X), response(1.0, 300.0, DVec3::X));
        let responses: Vec<Response> = [vec![seen; 10], vec![masked; 30]].concat();
        assert!(outlasts(after(&responses), 1.5), "it loses a little: {}", after(&responses));
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
        assert_eq!(leg.log_odds, known, "it was seen after the seat was missed");
        leg.weaken(1100, &settings);
        assert_eq!(leg.log_odds, settings.neighbour_log_odds, "the seat was removed");
        leg.apply(&likelihood(response(30.0, 30.0, DVec3::X)), &settings);
        assert!(leg.log_odds > settings.neighbour_log_odds, "it was seen again");
        leg.weaken(1100, &settings);
        leg.weaken(1100, &settings);
        assert!(leg.log_odds <= 0.0, "the back was removed too");
        assert!(leg.reached_max_log_odds());
        leg.limit_initial_log_odds(9.0);
        assert!(!leg.reached_max_log_odds(), "the sub-apertures that it was detected by do not count twice");
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

    /// Misses, turning by this much from one to the next, until an established object is removed.
    fn misses_until_gone(turn_deg: f64) -> usize {
        let settings = ExistenceSettings::default();
        let mut existence = Existence::new();
        existence.establish();
        let around = |n: usize| DQuat::from_rotation_y((n as f64 * turn_deg).to_radians()) * DVec3::X;
        (0..40).for_each(|n| _ = existence.apply(&likelihood(response(30.0, 30.0, around(n))), &settings));
        (0..1000)
            .take_while(|n| {
                existence.apply(&likelihood(response(0.5, 0.5, around(*n))), &settings) < 0.0
                    && existence.log_odds > 0.0
            })
            .count()
    }

    #[test]
    fn established_object_is_missed_from_several_directions_before_it_is_removed() {
        let (from_one, as_head_moves) = (misses_until_gone(0.0), misses_until_gone(2.0));
        assert!(as_head_moves < 24, "two seconds of a moving head: {as_head_moves}");
        assert!(from_one > 2 * as_head_moves, "{from_one} {as_head_moves}");
        let (seen, empty) = (response(30.0, 30.0, DVec3::X), response(0.5, 0.5, DVec3::X));
        assert!(
            after(&[vec![seen; 40], vec![empty; as_head_moves / 2]].concat()) <= 0.0,
            "one that is not goes sooner"
        );
    }

    #[test]
    fn object_seen_with_wrong_poses_is_removed_soon() {
        let settings = ExistenceSettings::default();
        let mut existence = Existence::new();
        existence.establish();
        (0..40).for_each(|_| _ = existence.apply(&likelihood(response(30.0, 30.0, DVec3::X)), &settings));
        existence.distrust();
        assert!(!existence.is_established());
        (0..3).for_each(|_| _ = existence.apply(&likelihood(response(0.5, 0.5, DVec3::X)), &settings));
        assert!(existence.log_odds <= 0.0, "{}", existence.log_odds);
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

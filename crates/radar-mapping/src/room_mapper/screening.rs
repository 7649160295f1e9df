//! Screening of detections: which may count, and how likely each is an object.

use std::collections::VecDeque;

use glam::DVec3;

use super::super::classifier::{HistorySummary, ScoredCandidate, Surroundings, features, log_odds, raise_if_certain};
use super::super::existence::{Existence, Likelihood};
use super::super::responses::{Response, information, sigma_m};
use super::super::{Detection, Detections, HandTrail, Track, same_point};
use super::config::RoomConfig;
use super::objects::{ObjectMap, with_subaperture};
use super::recurrence::Recurrences;
use super::walls::WallMap;
use super::window::Window;
use radar_sar::math;
use radar_sar::subaperture::Subaperture;

/// Detections no higher than this, metres, may be the reflection of the floor. The floor is at
/// height 0 of the standing universe; at the beam's edge its echo is placed badly. Choice: what
/// stands on the floor is known by parts above it.
const MAX_FLOOR_HEIGHT_M: f64 = 0.3;
/// Horizontal distance from the sensor within which the floor's echo is placed, metres; the same
/// for echoes at the beam's edge; and the two-way beam amplitude below which an echo is at the
/// edge. Choice: the floor returns from right below the sensor, and nothing stands where the wearer
/// does; at the edge of the beam the direction is worse by half a metre.
const FLOOR_ECHO_RADIUS_M: f64 = 0.35;
const FLOOR_ECHO_RADIUS_AT_BEAM_EDGE_M: f64 = 0.8;
const BEAM_EDGE_AMPLITUDE: f64 = 0.4;
/// A detection this near to a known wall, floor or ceiling may be its reflection, metres. Choice:
/// the pulse's width and a wall's error of position of a decimetre.
const AT_SURFACE_M: f64 = 0.25;
/// No object is accepted this near to a hand's position, metres. Choice: palm, fingers, what it
/// holds, and the uncertainty of the detection.
const HAND_EXCLUSION_M: f64 = 0.25;
/// The hand has left when it was not there for this long, nanoseconds. Measured: in play sessions
/// (`lab play`) 4 s let false detections at the hands' places through.
const HAND_EXCLUSION_NS: i64 = 10_000_000_000;
/// Updates whose candidates are kept. Choice: two seconds.
const CANDIDATE_HISTORY_UPDATES: usize = 8;

/// For a point for which the history was not queried.
fn no_history(detection: &Detection<DVec3>) -> HistorySummary {
    HistorySummary { log_odds: 0.0, sigma_m: detection.sigma_m, significant: 0 }
}

/// What detections are screened with.
#[derive(Clone, Copy)]
pub(super) struct Screening<'a> {
    pub config: &'a RoomConfig,
    pub window: &'a Window,
    pub hands: &'a HandTrail,
    pub objects: &'a ObjectMap,
    pub walls: &'a WallMap,
    pub candidates: &'a CandidateLog,
    pub recurrences: &'a Recurrences,
    /// Time from which on the sensor's own signal is known and subtracted, host nanoseconds; `None`: not yet.
    pub background_known_since_ns: Option<i64>,
}

impl Screening<'_> {
    /// Confirmed objects that still exist. Objects just removed are excluded, so the same
    /// sub-apertures cannot confirm them again.
    pub fn known_detections(&self, detections: &Detections) -> Vec<(Detection<DVec3>, ScoredCandidate)> {
        let is_same = same_point(self.config.settings.tracks.match_m);
        let is_known = |detection: DVec3| self.objects.confirmed().any(|known| is_same(&known.estimate, &detection));
        let known = detections.places.iter().filter(|detection| is_known(detection.estimate));
        known.map(|detection| self.score_candidate(detection, no_history(detection))).collect()
    }

    /// New detections that still exist by the newest sub-apertures that could see them.
    pub fn new_detections(&self, new: &Detections) -> Vec<(Detection<DVec3>, ScoredCandidate)> {
        let settings = &self.config.settings.tracks.existence;
        let is_there = |responses: &[Option<Response>]| {
            let mut existence = Existence::new();
            let likelihoods =
                responses.iter().map(|response| response.map(|response| Likelihood { response, is_masked: false }));
            existence.update(with_subaperture(self.window, likelihoods), settings);
            existence.log_odds() >= settings.confirm_log_odds
        };
        let queried = new.places.iter().zip(&new.query_indices);
        let there = queried.filter(|(detection, query_index)| {
            !self.is_floor_below(detection.estimate, detection.aspect.beam)
                && !self.is_near_recent_hand(detection.estimate)
                && !self.may_be_background(detection)
                && is_there(&new.responses[**query_index])
        });
        let with_history = |(detection, query_index): (&Detection<DVec3>, &usize)| {
            self.with_history(detection, &new.responses[*query_index])
        };
        there.map(with_history).map(|(detection, history)| self.score_candidate(&detection, history)).collect()
    }

    /// The floor returns most from right below the sensor, and so near to other objects that it may
    /// be taken for part of them. No other object is there, because the wearer stands on it.
    /// Farther away it is the floor if it was seen at the beam's edge alone.
    fn is_floor_below(&self, point: DVec3, beam: f64) -> bool {
        let reach_m = if beam < BEAM_EDGE_AMPLITUDE { FLOOR_ECHO_RADIUS_AT_BEAM_EDGE_M } else { FLOOR_ECHO_RADIUS_M };
        let is_over =
            |subaperture: &Subaperture| (subaperture.middle.translation - point).with_y(0.0).length() < reach_m;
        point.y.abs() < MAX_FLOOR_HEIGHT_M && self.window.iter().any(is_over)
    }

    /// Rejects new detections where a tracked hand was in the last 10 s. What is seen there is the
    /// hand, what it holds, or an artefact. A touched object was mostly known before; if not, it is
    /// detected once the hand has left.
    fn is_near_recent_hand(&self, point: DVec3) -> bool {
        let now_ns = self.window.now_ns();
        self.hands.came_near(point, HAND_EXCLUSION_M, now_ns.saturating_sub(HAND_EXCLUSION_NS))
    }

    /// The sensor's own signal is strongest near it. In sub-apertures from before it was known, it may be taken for
    /// something near.
    fn may_be_background(&self, detection: &Detection<DVec3>) -> bool {
        let is_from_before = self.background_known_since_ns.is_none_or(|since_ns| detection.first_ns < since_ns);
        is_from_before && self.config.settings.tracks.is_near_only(detection)
    }

    /// A detection with its log odds, from its surroundings and the history.
    fn score_candidate(
        &self,
        detection: &Detection<DVec3>,
        history: HistorySummary,
    ) -> (Detection<DVec3>, ScoredCandidate) {
        let features = features(detection, &self.surroundings(detection.estimate, history));
        let at_surface =
            self.walls.confirmed().any(|wall| wall.estimate.distance(detection.estimate).abs() < AT_SURFACE_M);
        let recurrence_log_odds =
            f64::from(self.recurrences.earlier_windows(detection)) * self.config.settings.tracks.recurrence_log_odds;
        let log_odds = raise_if_certain(log_odds(&features) + recurrence_log_odds, detection, at_surface);
        let detection = Detection { log_odds, ..*detection };
        (
            detection,
            ScoredCandidate {
                position_m: detection.estimate,
                features,
                log_odds,
                recurrence_log_odds,
                may_be_new: self.may_be_new(&detection),
            },
        )
    }

    fn surroundings(&self, point: DVec3, history: HistorySummary) -> Surroundings {
        let is_same = same_point(self.config.settings.tracks.match_m);
        let level = |to: DVec3| to.with_y(0.0).length();
        let others = || self.objects.confirmed().filter(|known| !is_same(&known.estimate, &point));
        let distance_m = |known: &&Track<DVec3>| known.estimate.distance(point);
        let nearest = others().min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)));
        let strength = |known: &Track<DVec3>| self.objects.greatest_strength(known.id);
        let upright = self.walls.confirmed().filter(|wall| wall.estimate.is_upright());
        let to_sensor = self.window.newest().map_or(DVec3::ZERO, |subaperture| point - subaperture.middle.translation);
        Surroundings {
            nearest_track_m: nearest.map_or(f64::INFINITY, |known| distance_m(&known)),
            nearest_track_horizontal_m: others()
                .map(|known| level(known.estimate - point))
                .fold(f64::INFINITY, f64::min),
            wall_m: upright.map(|wall| wall.estimate.distance(point)).fold(f64::INFINITY, f64::min),
            nearest_track_ln_strength: nearest.and_then(strength).map_or(0.0, |strength| math::ln(strength.max(1e-9))),
            history,
            sensor_m: to_sensor.length(),
            sensor_horizontal_m: level(to_sensor),
            age_s: self.window.age_s(),
            recent_updates: self.candidates.recent_updates(|other| is_same(other, &point)),
        }
    }

    /// Whether a detection may be a new object, within the limits of the settings.
    fn may_be_new(&self, detection: &Detection<DVec3>) -> bool {
        self.is_new(detection) && !self.config.settings.tracks.may_be_hand(detection)
    }

    /// Whether it is observable and not a known object.
    fn is_new(&self, detection: &Detection<DVec3>) -> bool {
        detection.observable && self.would_be_new(detection)
    }

    /// Whether it would be new if it were observable.
    fn would_be_new(&self, detection: &Detection<DVec3>) -> bool {
        let map = &self.config.settings.tracks;
        let is_same = same_point(map.match_m);
        detection.score >= map.confirm_score
            && !self.objects.confirmed().any(|known| is_same(&known.estimate, &detection.estimate))
    }

    /// A detection that would be new, with the history's evidence: how likely it is and, where the
    /// window leaves it open along its range circle and the history agrees, whether it is
    /// observable.
    fn with_history(
        &self,
        detection: &Detection<DVec3>,
        responses: &[Option<Response>],
    ) -> (Detection<DVec3>, HistorySummary) {
        if !self.would_be_new(detection) {
            return (*detection, no_history(detection));
        }
        let evidence = self.window.history.evidence_at(
            detection.estimate,
            responses,
            (&self.config.settings.subapertures, self.config.min_cos),
            &self.config.beam,
        );
        let seen = self
            .window
            .iter()
            .zip(responses)
            .filter_map(|(subaperture, response)| Some((subaperture, response.as_ref()?)));
        let significant = seen.filter(|(_, response)| response.is_significant());
        let sigma_m = sigma_m(&information(evidence.information, significant).inverse());
        let is_determined = evidence.log_odds > 0.0 && sigma_m <= self.config.settings.clean.max_sigma_m;
        let history = HistorySummary { log_odds: evidence.log_odds, sigma_m, significant: evidence.significant };
        (Detection { observable: detection.observable || is_determined, ..*detection }, history)
    }
}

/// Candidates that updates have scored.
#[derive(Debug, Default)]
pub(super) struct CandidateLog {
    /// Those of the last update.
    scored: Vec<ScoredCandidate>,
    /// Positions of those of the last updates that may be new.
    recent: VecDeque<Vec<DVec3>>,
}

impl CandidateLog {
    /// Those of the last update.
    pub fn scored(&self) -> &[ScoredCandidate] {
        &self.scored
    }

    /// Keeps the scored candidates of an update, and for some updates the positions of those that
    /// may be new.
    pub fn record(&mut self, scored: Vec<ScoredCandidate>) {
        let new = scored.iter().filter(|scored| scored.may_be_new).map(|scored| scored.position_m);
        self.recent.push_back(new.collect());
        if self.recent.len() > CANDIDATE_HISTORY_UPDATES {
            self.recent.pop_front();
        }
        self.scored = scored;
    }

    /// Number of recent updates that scored a candidate there that may be new.
    fn recent_updates(&self, is_there: impl Fn(&DVec3) -> bool) -> usize {
        self.recent.iter().filter(|update| update.iter().any(&is_there)).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CleanWindow, ResponseCache, RoomMapper, RoomMapperSettings};
    use radar_sar::Beam;
    use radar_sar::PositionErrors;
    use radar_sar::test_data::{Echo, sweeps, winding};

    #[test]
    fn detection_near_recent_tracked_hand_is_rejected() {
        let mut search = RoomMapper::new(RoomMapperSettings::default(), &Beam::Lensless, PositionErrors::default());
        let point = DVec3::new(0.2, -0.3, -0.5);
        for sweep in sweeps(1.0, winding, &[], 3) {
            search.push(sweep);
        }
        let now_ns = search.window.now_ns();
        search.push_hands(now_ns, [Some(point + DVec3::Y * 0.2), Some(point + DVec3::X * 0.5)]);
        assert!(search.screening().is_near_recent_hand(point));
        assert!(!search.screening().is_near_recent_hand(point + DVec3::Z), "elsewhere");
        search.window.shift_ns(HAND_EXCLUSION_NS + 1);
        assert!(!search.screening().is_near_recent_hand(point), "the hand left long ago");
    }

    #[test]
    fn history_and_window_on_two_straight_paths_make_point_observable() {
        let object = DVec3::new(0.1, 0.1, -1.2);
        let (level, upright) = (|t: f64| DVec3::X * (0.15 * t), |t: f64| DVec3::Y * (0.15 * t));
        let glimpsed = |ways: [fn(f64) -> DVec3; 2]| {
            // What is known already is not asked of the history.
            let mut settings = RoomMapperSettings::default();
            settings.tracks.confirm_log_odds = 100.0;
            let mut search = RoomMapper::new(settings, &Beam::Lensless, PositionErrors::default());
            for (n, way) in ways.into_iter().enumerate() {
                for mut sweep in sweeps(1.5, way, &[(Echo::Point(object), 2.0)], 3) {
                    // The first glimpse has left the window by the second.
                    sweep.mid_time_ns += n as i64 * 6_000_000_000;
                    search.push(sweep);
                }
            }
            let (settings, mut memory) = (search.config.settings, ResponseCache::default());
            let window = search.window.iter();
            let mut window =
                CleanWindow::new(window, &search.hands, &settings.clean, search.config.query(), &mut memory);
            let detections = window.detect(&[], &[object]);
            let detection = detections.places[0];
            (detection.observable, search.screening().with_history(&detection, &detections.responses[0]).0.observable)
        };
        assert_eq!(glimpsed([level, upright]), (false, true));
        assert_eq!(glimpsed([upright, upright]), (false, false), "the same range circle twice");
    }

    #[test]
    fn floor_echo_below_sensor_is_rejected() {
        let mut search = RoomMapper::new(RoomMapperSettings::default(), &Beam::Lensless, PositionErrors::default());
        let way = |t: f64| winding(t) + DVec3::Y * 1.6;
        let echoes = [(Echo::Point(DVec3::new(0.0, 1.5, -1.2)), 2.0)];
        sweeps(1.0, way, &echoes, 3).into_iter().for_each(|sweep| search.push(sweep));
        let below = way(0.9).with_y(0.0);
        assert!(
            search.screening().is_floor_below(below, 0.9)
                && search.screening().is_floor_below(below + DVec3::new(0.2, -0.1, 0.1), 0.9)
        );
        let elsewhere = [DVec3::Y * 0.4, DVec3::X * 1.5, DVec3::NEG_Z * 1.5];
        assert!(elsewhere.iter().all(|offset| !search.screening().is_floor_below(below + *offset, 0.2)));
        let ahead = below + DVec3::NEG_Z * 0.6;
        assert!(
            search.screening().is_floor_below(ahead, 0.2) && !search.screening().is_floor_below(ahead, 0.9),
            "a chair's foot is seen away from the beam's edge"
        );
    }
}

//! Track list: detections over time become tracks, which are confirmed by hits in M of N updates
//! and kept while unseen. `existence.rs` decides when a confirmed point track is removed.

use std::collections::VecDeque;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::clean::Detection;
use super::existence::ExistenceSettings;
use radar_sar::geometry::Plane;
use radar_sar::{BoundedSettings, SettingBound, bounds, math};

/// Parameters of the track list.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackSettings {
    /// Least score of a hit, a detection that counts for a track.
    pub confirm_score: f64,
    /// Hits among the last four updates that confirm a point.
    pub confirm_observations: usize,
    /// Hits among the last four updates that confirm a wall.
    pub confirm_wall_observations: usize,
    /// Least log odds of a hit, from the classifier, which was learned from simulated play.
    pub confirm_log_odds: f64,
    /// Added to a detection's log odds for each earlier window in which something was detected at the same
    /// place, at most twice.
    pub recurrence_log_odds: f64,
    /// A detection that was never seen from beyond this distance may be the wearer's own hand,
    /// elbow or knee, metres. It is not confirmed before it has been seen at rest, as
    /// what hangs before the face is. This holds for tracked hands too.
    pub hands_reach_m: f64,
    /// A detection within this distance of a known point belongs to it, metres.
    pub match_m: f64,
    /// When a confirmed object is removed.
    pub existence: ExistenceSettings,
}

/// At the end of each interval that makes mapping hardest, as far as the other settings allow it, a furnished room gives obstacles and walls (`tests/program/settings_file.rs`). What stands out
/// has log odds of at least 3 (`classifier.rs`).
impl BoundedSettings for TrackSettings {
    const BOUNDS: &'static [SettingBound<Self>] = bounds![
        confirm_score: 0.0, 15.0;
        confirm_observations: 1.0, RECENT_UPDATES as f64;
        confirm_wall_observations: 1.0, RECENT_UPDATES as f64;
        confirm_log_odds: -100.0, 3.0;
        recurrence_log_odds: 0.0, 100.0;
        hands_reach_m: 0.0, 10.0;
        match_m: 0.01, 1.0;
    ];
}

impl Default for TrackSettings {
    fn default() -> Self {
        let existence = ExistenceSettings::default();
        Self {
            confirm_score: 3.0,
            confirm_observations: 1,
            confirm_wall_observations: 3,
            confirm_log_odds: 1.7,
            recurrence_log_odds: 1.5,
            hands_reach_m: 0.9,
            match_m: 0.15,
            existence,
        }
    }
}

impl TrackSettings {
    /// The same for planes, which have tests of their own before they are detected.
    pub fn for_planes(&self) -> Self {
        let confirm_observations = self.confirm_wall_observations;
        Self { confirm_observations, hands_reach_m: 0.0, ..*self }
    }

    /// Whether a detection counts as a hit.
    pub fn is_hit<T>(&self, detection: &Detection<T>) -> bool {
        self.may_be_hit(detection) && detection.log_odds >= self.confirm_log_odds
    }

    /// Whether a detection counts as a hit if it is likely enough.
    pub fn may_be_hit<T>(&self, detection: &Detection<T>) -> bool {
        detection.observable && detection.score >= self.confirm_score && !self.may_be_hand(detection)
    }

    /// Whether a detection may be the wearer's own hand, elbow or knee.
    pub fn may_be_hand<T>(&self, detection: &Detection<T>) -> bool {
        self.is_near_only(detection) && detection.robust_score < AT_REST_ROBUST_SCORE
    }

    /// Whether a detection was never seen from beyond the reach of the hands.
    pub fn is_near_only<T>(&self, detection: &Detection<T>) -> bool {
        detection.farthest_m < self.hands_reach_m
    }
}

/// A detection of this robust score has been at rest: it keeps that much without its best 0.3 s. Choice: more than twice
/// `confirm_score`. A lamp at head height that is seen from 0.75 m has 7 to 10, for about a second at a time, so a demand
/// of one or two seconds misses it (measured: `lab play --world dining`).
const AT_REST_ROBUST_SCORE: f64 = 7.0;

/// Number of updates in which hits are counted, and so the most hits that can be demanded. Choice:
/// one second; the longer the later an object is confirmed.
pub const RECENT_UPDATES: usize = 4;
/// An unconfirmed track without a hit for this many updates is removed. Choice: two seconds, within
/// which the head looks again at what it saw.
const UNCONFIRMED_TIMEOUT_UPDATES: u64 = 8;

/// The uncertainty of no detection is taken as smaller than this, metres. Choice: tracking and
/// mount leave about 2 cm, whatever the sweeps alone state.
const MIN_SIGMA_M: f64 = 0.02;

/// A tracked point or plane.
#[derive(Debug, Clone)]
pub struct Track<T> {
    /// Stays the same.
    pub id: u64,
    /// Estimate by its best detection.
    pub estimate: T,
    /// Best score.
    pub score: f64,
    /// Score over 1σ, per metre, of the detection that the estimate comes from. A better one moves
    /// it.
    pub quality: f64,
    /// Log odds of the first detection that it is a real object; infinite where the classifier was
    /// not asked.
    pub log_odds: f64,
    /// Confirmed by enough hits.
    pub confirmed: bool,
    /// Restored from a saved map, with no hit nor other confirmation since.
    pub provisional: bool,
    /// First and last time with evidence, host nanoseconds.
    pub first_ns: i64,
    /// See `first_ns`.
    pub last_ns: i64,
    recent_hits: VecDeque<bool>,
    last_update: u64,
}

/// The tracks of one kind.
#[derive(Debug)]
pub struct TrackList<T> {
    tracks: Vec<Track<T>>,
    update: u64,
    next_id: u64,
}

impl<T> Default for TrackList<T> {
    fn default() -> Self {
        Self { tracks: Vec::new(), update: 0, next_id: 0 }
    }
}

impl<T: Copy> TrackList<T> {
    /// Takes one update's detections, strongest first. Those that are not observable are ignored.
    /// `same` decides whether two estimates belong to one track.
    pub fn update(&mut self, found: &[Detection<T>], settings: &TrackSettings, same: impl Fn(&T, &T) -> bool) {
        self.update += 1;
        for known in &mut self.tracks {
            known.recent_hits.push_back(false);
            if known.recent_hits.len() > RECENT_UPDATES {
                known.recent_hits.pop_front();
            }
        }
        for detection in found.iter().filter(|detection| settings.is_hit(detection)) {
            match self.tracks.iter_mut().find(|k| same(&k.estimate, &detection.estimate)) {
                Some(known) => known.record_hit(detection, self.update, settings),
                None => {
                    self.next_id += 1;
                    self.tracks.push(Track {
                        id: self.next_id,
                        estimate: detection.estimate,
                        score: detection.score,
                        quality: quality(detection),
                        log_odds: detection.log_odds,
                        confirmed: settings.confirm_observations <= 1,
                        provisional: false,
                        first_ns: detection.first_ns,
                        last_ns: detection.last_ns,
                        recent_hits: VecDeque::from([true]),
                        last_update: self.update,
                    });
                }
            }
        }
        let now = self.update;
        self.tracks.retain(|k| k.confirmed || now - k.last_update < UNCONFIRMED_TIMEOUT_UPDATES);
    }

    /// Restores a track from a saved map, unless it is known already. Takes another id if its own
    /// is in use. Returns the id.
    pub fn restore(
        &mut self,
        id: u64,
        estimate: T,
        score: f64,
        [first_ns, last_ns]: [i64; 2],
        same: impl Fn(&T, &T) -> bool,
    ) -> Option<u64> {
        if self.tracks.iter().any(|known| same(&known.estimate, &estimate)) {
            return None;
        }
        let id = if self.tracks.iter().any(|known| known.id == id) { self.next_id + 1 } else { id };
        self.next_id = self.next_id.max(id);
        self.tracks.push(Track {
            id,
            estimate,
            score,
            // The first hit replaces the position.
            quality: 0.0,
            log_odds: f64::INFINITY,
            confirmed: true,
            provisional: true,
            first_ns,
            last_ns,
            recent_hits: VecDeque::new(),
            last_update: self.update,
        });
        Some(id)
    }

    /// The estimates are wrong by an unknown amount: the next hit replaces each, and tracks that are not confirmed are
    /// dropped.
    pub fn distrust(&mut self) {
        self.tracks.retain(|known| known.confirmed);
        self.tracks.iter_mut().for_each(|known| known.quality = 0.0);
    }

    /// Clears the provisional flag of tracks that exist with certainty.
    pub fn confirm_provisional(&mut self, is_surely_there: impl Fn(u64) -> bool) {
        self.tracks.iter_mut().for_each(|known| known.provisional &= !is_surely_there(known.id));
    }

    /// Keeps the tracks for which `keep` returns true.
    pub fn retain(&mut self, keep: impl Fn(&Track<T>) -> bool) {
        self.tracks.retain(keep);
    }

    /// The confirmed tracks.
    pub fn confirmed(&self) -> impl Iterator<Item = &Track<T>> {
        self.tracks.iter().filter(|k| k.confirmed)
    }
}

impl<T: Copy> Track<T> {
    fn record_hit(&mut self, detection: &Detection<T>, update: u64, settings: &TrackSettings) {
        if let Some(newest) = self.recent_hits.back_mut() {
            *newest = true;
        }
        self.score = if self.provisional { detection.score } else { self.score.max(detection.score) };
        self.provisional = false;
        if quality(detection) > self.quality {
            (self.quality, self.estimate) = (quality(detection), detection.estimate);
        }
        self.first_ns = self.first_ns.min(detection.first_ns);
        self.last_ns = self.last_ns.max(detection.last_ns);
        self.last_update = update;
        self.confirmed |= self.recent_hits.iter().filter(|seen| **seen).count() >= settings.confirm_observations;
    }
}

/// Strong evidence with small uncertainty gives the best position.
fn quality<T>(detection: &Detection<T>) -> f64 {
    detection.score / detection.sigma_m.max(MIN_SIGMA_M)
}

/// Whether two points are the same: within the settings' distance.
pub fn same_point(match_m: f64) -> impl Fn(&DVec3, &DVec3) -> bool {
    move |a, b| a.distance(*b) <= match_m
}

/// Whether two planes are the same: within 8° and 15 cm at a point near the room's middle.
pub fn same_plane(middle: DVec3) -> impl Fn(&Plane, &Plane) -> bool {
    move |a, b| {
        a.outward.dot(b.outward) > math::cos(8f64.to_radians())
            && (a.distance(middle) - b.distance(middle)).abs() < 0.15
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clean::Aspect;

    fn detection(x: f64, score: f64, observable: bool) -> Detection<DVec3> {
        Detection {
            estimate: DVec3::X * x,
            score,
            subapertures: 5,
            observable,
            sigma_m: 0.05,
            robust_score: score - 1.0,
            ln_clutter: 0.0,
            farthest_m: 1.5,
            amplitude_spread: 0.0,
            miss_fraction: 0.0,
            ambiguity: 0.0,
            aspect: Aspect::default(),
            log_odds: f64::INFINITY,
            first_ns: 1,
            last_ns: 2,
        }
    }

    fn after(updates: &[&[Detection<DVec3>]]) -> Vec<(u64, f64)> {
        let mut track_list = TrackList::default();
        let settings = TrackSettings { confirm_score: 6.0, confirm_observations: 2, ..Default::default() };
        updates.iter().for_each(|found| track_list.update(found, &settings, same_point(settings.match_m)));
        track_list.confirmed().map(|s| (s.id, s.estimate.x)).collect()
    }

    #[test]
    fn low_log_odds_is_not_a_hit() {
        let settings = TrackSettings::default();
        let with = |odds: f64| settings.is_hit(&Detection { log_odds: odds, ..detection(0.0, 60.0, true) });
        assert!(with(settings.confirm_log_odds) && !with(settings.confirm_log_odds - 0.1) && !with(f64::NAN));
        assert!(settings.for_planes().is_hit(&detection(0.0, 60.0, true)), "the classifier does not apply to planes");
    }

    #[test]
    fn what_was_seen_near_only_is_a_hit_once_it_has_been_at_rest() {
        let settings = TrackSettings::default();
        let near = |robust_score: f64| Detection { farthest_m: 0.75, robust_score, ..detection(0.0, 60.0, true) };
        assert!(settings.is_hit(&near(AT_REST_ROBUST_SCORE)), "a lamp");
        assert!(!settings.is_hit(&near(AT_REST_ROBUST_SCORE - 0.1)), "a hand");
        assert!(settings.is_hit(&Detection { farthest_m: 1.0, ..near(0.0) }));
    }

    #[test]
    fn two_hits_of_four_confirm_and_best_estimate_stays() {
        let (good, better) = (&[detection(0.0, 7.0, true)][..], &[detection(0.05, 9.0, true)][..]);
        assert_eq!(after(&[good]), []);
        assert_eq!(after(&[good, &[], &[], better]), [(1, 0.05)]);
        assert_eq!(after(&[better, good]), [(1, 0.05)]);
        // Five updates apart, the first hit has left the four recent ones.
        assert_eq!(after(&[good, &[], &[], &[], good]), []);
    }

    #[test]
    fn confirmed_tracks_stay_and_unconfirmed_time_out() {
        let seen = &[detection(0.0, 7.0, true)][..];
        let mut updates = vec![seen, seen];
        updates.extend(vec![&[][..]; 50]);
        assert_eq!(after(&updates).len(), 1);
        let mut once = vec![seen];
        once.extend(vec![&[][..]; UNCONFIRMED_TIMEOUT_UPDATES as usize]);
        once.extend([seen, seen]);
        // A new id, because the first track is gone.
        assert_eq!(after(&once), [(2, 0.0)]);
    }

    #[test]
    fn restored_track_is_confirmed_by_hit_and_moves_to_it() {
        let mut track_list = TrackList::default();
        let settings = TrackSettings { confirm_score: 6.0, confirm_observations: 2, ..Default::default() };
        let same = same_point(settings.match_m);
        assert_eq!(track_list.restore(7, DVec3::ZERO, 30.0, [-9, -8], &same), Some(7));
        assert_eq!(track_list.restore(8, DVec3::X * 0.1, 30.0, [-9, -8], &same), None, "known already");
        assert_eq!(track_list.restore(7, DVec3::X, 30.0, [-9, -8], &same), Some(8), "another id");
        track_list.update(&[], &settings, &same);
        let summary = |track_list: &TrackList<DVec3>| -> Vec<(u64, f64, bool)> {
            track_list.confirmed().map(|s| (s.id, s.estimate.x, s.provisional)).collect()
        };
        assert_eq!(summary(&track_list), [(7, 0.0, true), (8, 1.0, true)]);
        track_list.update(&[detection(0.05, 7.0, true), detection(3.0, 7.0, true)], &settings, &same);
        track_list.update(&[detection(3.0, 7.0, true)], &settings, &same);
        assert_eq!(summary(&track_list), [(7, 0.05, false), (8, 1.0, true), (9, 3.0, false)]);
        track_list.confirm_provisional(|id| id == 8);
        assert!(track_list.confirmed().all(|s| !s.provisional));
    }

    #[test]
    fn weak_and_unobservable_detections_are_not_hits() {
        let (weak, open) = (&[detection(0.0, 5.9, true)][..], &[detection(0.0, 20.0, false)][..]);
        assert_eq!(after(&[weak, weak, open, open]), []);
    }

    #[test]
    fn same_plane_compares_direction_and_offset() {
        let same = same_plane(DVec3::Y);
        let wall = |yaw_deg: f64, offset_m| {
            let yaw = f64::to_radians(yaw_deg);
            Plane { outward: DVec3::new(yaw.sin(), 0.0, -yaw.cos()), offset_m }
        };
        assert!(same(&wall(0.0, 2.0), &wall(5.0, 2.1)));
        assert!(!same(&wall(0.0, 2.0), &wall(10.0, 2.0)));
        assert!(!same(&wall(0.0, 2.0), &wall(0.0, 2.2)));
    }
}

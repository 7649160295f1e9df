//! Places where something was detected that may be an object, and in how many separate windows.
//!
//! The classifier judges a detection by one window of some seconds and what lies around it. An artefact
//! needs the path of that window: parts of several objects that fit, or the wrong side of a range circle.
//! From another path it is elsewhere, or nowhere. An object is where it was. Each earlier window without
//! a sub-aperture in common with the present one therefore adds to the log odds. Known objects are recorded too: one that was
//! detected in a second window is established, and one that was removed by mistake is soon known again.

use glam::DVec3;

use crate::Detection;

/// Detections this near to each other are of the same place, metres. Measured on the candidates of play sessions (two
/// simulated dining rooms and two offices, 10 minutes each): within 10 cm, one artefact in 20 came back in a second window,
/// of the parts of objects one in three; within 20 cm, one in five and two in three.
const SAME_PLACE_M: f64 = 0.10;
/// What was detected this near to a removed object was it, metres. Choice: the default of `tracks.match_m`, within which a
/// detection belongs to a known object. Measured (`lab play`, ten simulated dining rooms of 4 minutes): what was carried away goes
/// as soon as with 0.6 m, and 77.4 instead of 76.5 % of approaches are warned of in time.
const REMOVED_PLACE_M: f64 = 0.15;
/// A place is forgotten when nothing was detected there for this long, nanoseconds. Choice: a player looks
/// at every side of a room within five minutes; what comes back later may be another coincidence.
const MEMORY_NS: i64 = 300_000_000_000;
/// Most earlier windows that count. Measured as above: 5 artefacts and 264 parts of objects came back twice; too few
/// artefacts are left to say more of a third time.
const MOST_COUNTED: u32 = 2;
/// Most places in memory; the one of longest ago is dropped. Choice: rooms of ten minutes have a thousand.
const MAX_PLACES: usize = 4096;

/// A place, and the windows in which something was detected there.
#[derive(Debug, Clone, Copy)]
struct Place {
    /// Where its most certain detection was.
    position_m: DVec3,
    log_odds: f64,
    /// Windows without a sub-aperture in common.
    windows: u32,
    /// The last update that detected something there, host nanoseconds.
    last_ns: i64,
}

/// The places of the last minutes.
#[derive(Debug, Default)]
pub(super) struct Recurrences {
    places: Vec<Place>,
}

impl Recurrences {
    /// Number of earlier windows in which something was detected where this detection is, at most two.
    /// None of them shares a sub-aperture with the detection.
    pub fn earlier_windows(&self, detection: &Detection<DVec3>) -> u32 {
        let Some(at) = self.same_place(detection) else { return 0 };
        let place = &self.places[at];
        let includes_this = u32::from(detection.first_ns <= place.last_ns);
        (place.windows - includes_this).min(MOST_COUNTED)
    }

    /// Whether something was detected at a point in two separate windows.
    pub fn is_established(&self, point: DVec3) -> bool {
        self.places.iter().any(|place| place.windows >= 2 && place.position_m.distance(point) <= SAME_PLACE_M)
    }

    /// Takes an update's detections of known objects and of what may be new ones.
    pub fn record<'d>(&mut self, detections: impl Iterator<Item = &'d Detection<DVec3>>, now_ns: i64) {
        self.places.retain(|place| now_ns.saturating_sub(place.last_ns) <= MEMORY_NS);
        for detection in detections {
            let Detection { estimate: position_m, first_ns, log_odds, .. } = *detection;
            let Some(at) = self.same_place(detection) else {
                self.add(Place { position_m, log_odds, windows: 1, last_ns: now_ns });
                continue;
            };
            let place = &mut self.places[at];
            place.windows += u32::from(first_ns > place.last_ns);
            place.last_ns = now_ns;
            if log_odds > place.log_odds {
                (place.position_m, place.log_odds) = (position_m, log_odds);
            }
        }
    }

    /// Forgets what was detected where an object was removed.
    pub fn forget(&mut self, removed_m: DVec3) {
        self.places.retain(|place| place.position_m.distance(removed_m) > REMOVED_PLACE_M);
    }

    fn add(&mut self, place: Place) {
        if self.places.len() >= MAX_PLACES {
            self.places.sort_by_key(|place| place.last_ns);
            self.places.remove(0);
        }
        self.places.push(place);
    }

    /// The nearest place that is a detection's, if one is remembered.
    fn same_place(&self, detection: &Detection<DVec3>) -> Option<usize> {
        let distance_m = |at: &usize| self.places[*at].position_m.distance(detection.estimate);
        let is_same = |at: &usize| {
            distance_m(at) <= SAME_PLACE_M && detection.last_ns.saturating_sub(self.places[*at].last_ns) <= MEMORY_NS
        };
        let same = (0..self.places.len()).filter(is_same);
        same.min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clean::Aspect;

    const PLACE: DVec3 = DVec3::new(0.4, 1.5, -1.2);
    const SECOND_NS: i64 = 1_000_000_000;

    /// Detected at an update by the sub-apertures of the four seconds before.
    fn detection(estimate: DVec3, now_s: i64) -> Detection<DVec3> {
        Detection {
            estimate,
            score: 5.0,
            subapertures: 9,
            observable: true,
            sigma_m: 0.1,
            robust_score: 4.0,
            ln_clutter: 0.0,
            farthest_m: 1.9,
            amplitude_spread: 0.2,
            miss_fraction: 0.0,
            ambiguity: 0.0,
            aspect: Aspect::default(),
            log_odds: -1.0,
            first_ns: (now_s - 4) * SECOND_NS + 1,
            last_ns: now_s * SECOND_NS,
        }
    }

    fn recorded(detections: &[(DVec3, i64)]) -> Recurrences {
        let mut recurrences = Recurrences::default();
        for &(estimate, now_s) in detections {
            recurrences.record([detection(estimate, now_s)].iter(), now_s * SECOND_NS);
        }
        recurrences
    }

    fn earlier(recurrences: &Recurrences, now_s: i64) -> u32 {
        recurrences.earlier_windows(&detection(PLACE, now_s))
    }

    #[test]
    fn windows_without_a_common_subaperture_count_twice_at_most() {
        let once: Vec<_> = (10..20).map(|now_s| (PLACE, now_s)).collect();
        let recurrences = recorded(&once);
        assert_eq!([19, 22, 23, 24, 60].map(|now_s| earlier(&recurrences, now_s)), [0, 0, 1, 1, 1]);
        let thrice: Vec<_> = [10, 20, 30, 40].map(|now_s| (PLACE, now_s)).into();
        assert_eq!([40, 43, 50].map(|now_s| earlier(&recorded(&thrice), now_s)), [2, 2, 2]);
        assert_eq!(earlier(&recorded(&thrice[..2]), 20), 1);
    }

    #[test]
    fn what_was_elsewhere_or_long_ago_does_not_count() {
        let beside = PLACE + DVec3::X * 1.1 * SAME_PLACE_M;
        assert_eq!(earlier(&recorded(&[(beside, 10)]), 20), 0);
        let forgotten_s = 10 + MEMORY_NS / SECOND_NS + 1;
        let mut recurrences = recorded(&[(PLACE, 10)]);
        assert_eq!([forgotten_s - 1, forgotten_s].map(|now_s| earlier(&recurrences, now_s)), [1, 0]);
        recurrences.record([detection(beside, forgotten_s)].iter(), forgotten_s * SECOND_NS);
        assert_eq!(recurrences.places.len(), 1, "memory is freed");
    }

    #[test]
    fn what_was_where_an_object_was_removed_is_forgotten() {
        let mut recurrences = recorded(&[(PLACE, 10), (PLACE + DVec3::Y, 10)]);
        recurrences.forget(PLACE + DVec3::X * 0.1);
        assert_eq!(earlier(&recurrences, 20), 0);
        assert_eq!(recurrences.places.len(), 1);
    }

    #[test]
    fn second_separate_window_establishes_a_place() {
        let once = recorded(&(10..20).map(|now_s| (PLACE, now_s)).collect::<Vec<_>>());
        assert!(!once.is_established(PLACE), "one window, however long");
        let twice = recorded(&[(PLACE, 10), (PLACE, 20)]);
        assert!(twice.is_established(PLACE) && !twice.is_established(PLACE + DVec3::X * 1.1 * SAME_PLACE_M));
    }

    #[test]
    fn memory_is_bounded_and_drops_the_place_of_longest_ago() {
        let mut recurrences = recorded(&[(PLACE, 1)]);
        for n in 0..MAX_PLACES {
            let elsewhere = DVec3::new(n as f64, 20.0, 0.0);
            recurrences.record([detection(elsewhere, 2)].iter(), 2 * SECOND_NS);
        }
        assert_eq!((recurrences.places.len(), earlier(&recurrences, 20)), (MAX_PLACES, 0));
    }
}

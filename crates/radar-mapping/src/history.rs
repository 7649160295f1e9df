//! History: a share of the sub-apertures that have left the window, for most of a minute.
//!
//! An artefact of the last seconds' movement appears where the beam has been before and nothing was
//! seen, while a weak object was seen a little each time. A new detection is therefore tested
//! against the history: had an object of this strength been there, some sub-apertures should have
//! seen it. Objects are moved, so the history is evidence among other evidence and no proof. Only
//! the newest sub-apertures that have the point in their beam count, so a chair that was just
//! placed is accepted after some seconds in view.

use std::collections::VecDeque;

use glam::{DMat3, DVec3};

use super::responses::Response;
use radar_sar::Beam;
use radar_sar::math;
use radar_sar::subaperture::{PointSubaperture, Subaperture, SubapertureSettings};

/// One of this many sub-apertures is kept. Choice: 190 sub-apertures span 50 s, at a third of the
/// memory; neighbours see a point from nearly the same place.
const KEEP_EVERY: u64 = 3;
/// Number of sub-apertures kept. Choice: 50 s of preset d16.
const MAX_SUBAPERTURES: usize = 190;
/// Probability that a sub-aperture sees a present object. Choice: most objects reflect into some
/// directions only.
const P_DETECT: f64 = 0.5;
/// Number of the newest sub-apertures, with the point in their beam, that are used. Choice: 4 s in
/// view at d16 (16 · 3 · 90 ms), after which a chair that was just placed is accepted.
const MAX_QUERIED: usize = 16;
/// A removal applies to points within this distance of it, metres. Choice: parts of a chair are
/// that far from its middle, and what was seen of one part must not count for another.
const REMOVED_RADIUS_M: f64 = 0.4;
/// Most that one sub-aperture adds to the log odds. Choice: as for existence, one sub-aperture can
/// be a passing hand or a sidelobe.
const MAX_LOG_ODDS_PER_SUBAPERTURE: f64 = 1.0;

/// Evidence of the history about a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct HistoryEvidence {
    /// Log odds that it adds for an object there; 0 where it indicates nothing.
    pub log_odds: f64,
    /// Number of sub-apertures with a significant response.
    pub significant: usize,
    /// Information of these on the position, 1/m².
    pub information: DMat3,
}

/// Sub-apertures that have left the window.
#[derive(Debug, Default)]
pub(super) struct History {
    subapertures: VecDeque<PointSubaperture>,
    received: u64,
    /// Positions of removed objects, and the time of the newest sub-aperture known at the removal.
    removed: VecDeque<(DVec3, i64)>,
}

impl History {
    /// Adds a sub-aperture that leaves the window.
    pub fn push(&mut self, subaperture: &Subaperture) {
        self.received += 1;
        if !self.received.is_multiple_of(KEEP_EVERY) {
            return;
        }
        // Reuses the memory of the oldest, as freeing it among live data would fragment the heap.
        let oldest = if self.subapertures.len() == MAX_SUBAPERTURES { self.subapertures.pop_front() } else { None };
        self.subapertures.push_back(PointSubaperture::of(subaperture, oldest));
        let from_ns = self.subapertures.front().map_or(i64::MAX, PointSubaperture::mid_time_ns);
        self.removed.retain(|(_, until_ns)| *until_ns >= from_ns);
    }

    /// Records that the object at a point was removed. Sub-apertures up to then are ignored for
    /// that point.
    pub fn mark_removed(&mut self, point: DVec3, until_ns: i64) {
        self.removed.push_back((point, until_ns));
    }

    /// The history's evidence for an object at a point, of the strength that the window's responses
    /// imply.
    pub fn evidence_at(
        &self,
        point: DVec3,
        responses: &[Option<Response>],
        (settings, min_cos): (&SubapertureSettings, f64),
        beam: &Beam,
    ) -> HistoryEvidence {
        let mut evidence = HistoryEvidence { log_odds: 0.0, significant: 0, information: DMat3::ZERO };
        let Some(strength) = strength(responses) else { return evidence };
        let sees = |subaperture: &&PointSubaperture| {
            settings.within(&subaperture.geometry().axis).sees(subaperture.middle(), min_cos, point)
        };
        let near = self.removed.iter().filter(|(removed, _)| removed.distance(point) <= REMOVED_RADIUS_M);
        let gone_ns = near.map(|(_, until_ns)| *until_ns).max().unwrap_or(i64::MIN);
        let since = self.subapertures.iter().rev().take_while(|subaperture| subaperture.mid_time_ns() > gone_ns);
        let that_see_it = since.filter(sees).take(MAX_QUERIED);
        for subaperture in that_see_it {
            let range_m = subaperture.distance_m(point);
            let toward = (point - subaperture.middle().translation) / range_m.max(1e-9);
            let seen_from = (subaperture.middle(), subaperture.motion());
            let response = Response::new(seen_from, subaperture.coherence_at(point), range_m, toward, beam);
            evidence.log_odds += math::ln(P_DETECT * response.likelihood_ratio(strength) + 1.0 - P_DETECT)
                .min(MAX_LOG_ODDS_PER_SUBAPERTURE);
            if response.is_significant() {
                evidence.significant += 1;
                evidence.information +=
                    response.information(subaperture.motion(), subaperture.geometry(), subaperture.aperture_m());
            }
        }
        evidence
    }
}

/// Strength at 1 m on the axis, relative to noise: the geometric mean of the significant responses.
fn strength(responses: &[Option<Response>]) -> Option<f64> {
    let logs = || responses.iter().flatten().filter_map(|response| response.ln_strength);
    let count = logs().count();
    (count > 0).then(|| math::exp(logs().sum::<f64>() / count as f64))
}

#[cfg(test)]
mod tests {
    use super::*;
    use radar_sar::subaperture::SubapertureBuilder;
    use radar_sar::test_data::{Echo, sweeps, winding};

    const THING: DVec3 = DVec3::new(0.2, 0.1, -1.2);
    const NOTHING: DVec3 = DVec3::new(-0.4, -0.1, -1.4);

    fn subapertures(duration_s: f64, echoes: &[(Echo, f64)]) -> Vec<Subaperture> {
        let mut builder = SubapertureBuilder::new(SubapertureSettings::default());
        sweeps(duration_s, winding, echoes, 3).into_iter().filter_map(|o| builder.push(o)).collect()
    }

    fn view_of_thing(subaperture: &Subaperture) -> Option<Response> {
        let range_m = subaperture.distance_m(THING);
        let toward = (THING - subaperture.middle.translation) / range_m;
        let coherence = PointSubaperture::of(subaperture, None).coherence_at(THING);
        Some(Response::new((&subaperture.middle, subaperture.motion), coherence, range_m, toward, &Beam::Lensless))
    }

    /// Log odds that these sub-apertures, having left the window, give to an object of the strength
    /// of `THING` at a point.
    fn log_odds(point: DVec3, left: Vec<Subaperture>) -> f64 {
        let (settings, beam, mut past) = (SubapertureSettings::default(), Beam::Lensless, History::default());
        let responses: Vec<_> = subapertures(2.0, &SEEN).iter().map(view_of_thing).collect();
        left.iter().for_each(|subaperture| past.push(subaperture));
        assert!(past.subapertures.len() <= MAX_SUBAPERTURES);
        past.evidence_at(point, &responses, (&settings, settings.min_cos(&beam)), &beam).log_odds
    }

    const SEEN: [(Echo, f64); 1] = [(Echo::Point(THING), 2.0)];

    #[test]
    fn history_supports_old_object_and_opposes_new_one() {
        let (present, absent) =
            (log_odds(THING, subapertures(3.0, &SEEN)), log_odds(NOTHING, subapertures(3.0, &SEEN)));
        assert!(present > 5.0 && absent < -4.0, "{present} {absent}");
        let behind = log_odds(DVec3::new(0.0, 0.0, 1.5), subapertures(3.0, &SEEN));
        assert_eq!(behind, 0.0, "never in the beam");
        assert_eq!(
            History::default()
                .evidence_at(THING, &[None], (&SubapertureSettings::default(), 0.5), &Beam::Lensless)
                .log_odds,
            0.0
        );
    }

    #[test]
    fn new_object_overcomes_history_within_seconds() {
        let after = |seconds: f64| log_odds(THING, [subapertures(20.0, &[]), subapertures(seconds, &SEEN)].concat());
        assert!(after(0.3) < -4.0 && after(3.0) > 0.0, "{} {}", after(0.3), after(3.0));
    }

    #[test]
    fn history_before_removal_is_ignored() {
        let (settings, beam, mut past) = (SubapertureSettings::default(), Beam::Lensless, History::default());
        let left = subapertures(3.0, &SEEN);
        let responses: Vec<_> = left.iter().map(view_of_thing).collect();
        left.iter().for_each(|subaperture| past.push(subaperture));
        let evidence =
            |past: &History| past.evidence_at(THING, &responses, (&settings, settings.min_cos(&beam)), &beam);
        let before = evidence(&past);
        assert!(before.log_odds > 5.0 && before.significant > 3 && before.information.x_axis.x > 0.0);
        past.mark_removed(NOTHING + DVec3::X, left[left.len() - 1].mid_time_ns);
        assert_eq!(evidence(&past).significant, before.significant, "another object was removed");
        past.mark_removed(THING + DVec3::X * 0.2, left[left.len() / 2].mid_time_ns);
        let after = evidence(&past);
        assert!(
            after.significant > 0 && after.significant < before.significant,
            "{} {}",
            after.significant,
            before.significant
        );
    }

    #[test]
    fn point_subaperture_equals_subaperture() {
        for subaperture in subapertures(0.5, &SEEN) {
            let relative = (THING - subaperture.middle.translation).as_vec3().to_array();
            let direct = subaperture.coherence_at_points(&[relative])[0];
            let other = PointSubaperture::of(&subapertures(0.3, &[])[0], None);
            assert_eq!(PointSubaperture::of(&subaperture, Some(other)).coherence_at(THING), direct);
        }
    }
}

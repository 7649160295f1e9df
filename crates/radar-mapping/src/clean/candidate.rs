//! Candidates: planes and points that may account for what is left of the window.

use glam::DVec3;

use super::CleanSettings;
use super::scoring::Score;
use crate::responses::Response;
use radar_sar::geometry::Plane;

/// A candidate's geometry.
#[derive(Debug, Clone, Copy)]
pub(super) enum Hypothesis {
    Plane(Plane),
    Point(DVec3),
}

/// A candidate and the response of each sub-aperture to it; masked responses are removed.
pub(super) struct Candidate {
    pub hypothesis: Hypothesis,
    /// Index of the queried point that it started from.
    pub query_index: Option<usize>,
    /// `[sub-aperture]`
    pub responses: Vec<Option<Response>>,
    pub unmasked: Option<Score>,
}

impl Candidate {
    /// Stores its responses for the caller.
    pub fn store_responses(&self, responses: &mut [Vec<Option<Response>>]) {
        if let Some(query_index) = self.query_index.and_then(|n| responses.get_mut(n)) {
            query_index.clone_from(&self.responses);
        }
    }

    fn suffices(&self, settings: &CleanSettings) -> bool {
        let min_score = match self.hypothesis {
            Hypothesis::Plane(_) => settings.plane_min_score,
            Hypothesis::Point(_) => settings.min_score,
        };
        self.unmasked.is_some_and(|unmasked| unmasked.score >= min_score)
    }
}

/// Removes the candidate with the highest score, if that suffices. Masks only remove responses, so
/// a candidate that falls short now is dropped for good.
pub(super) fn take_best(
    open: &mut Vec<Candidate>,
    settings: &CleanSettings,
    responses: &mut [Vec<Option<Response>>],
) -> Option<Candidate> {
    open.retain(|c| {
        let suffices = c.suffices(settings);
        if !suffices {
            c.store_responses(responses);
        }
        suffices
    });
    let score = |c: &Candidate| c.unmasked.map_or(f64::NEG_INFINITY, |unmasked| unmasked.score);
    let best = (0..open.len()).max_by(|&a, &b| score(&open[a]).total_cmp(&score(&open[b])).then(b.cmp(&a)));
    best.map(|n| open.remove(n))
}

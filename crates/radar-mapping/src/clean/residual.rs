//! What the window holds beyond what is accounted for: candidates are scored on their unmasked
//! responses, and a detection masks its own in all the others.

use super::candidate::{Candidate, Hypothesis};
use super::masks::{Mask, MaskStore, masks_of};
use super::scoring::Score;
use super::subapertures::WeightedSubapertures;
use super::{CleanSettings, HandTrail};
use crate::responses::Response;
use radar_sar::subaperture::{PlaneAt, Subaperture};

/// The sub-apertures, and what is masked in each so far.
pub(super) struct Residual<'a> {
    pub subapertures: WeightedSubapertures<'a>,
    masks: MaskStore,
    pub settings: &'a CleanSettings,
}

impl<'a> Residual<'a> {
    /// Everything but the wearer's tracked hands.
    pub fn new(subapertures: WeightedSubapertures<'a>, hands: &HandTrail, settings: &'a CleanSettings) -> Self {
        let masks = MaskStore::of_hands(subapertures.all(), hands);
        Self { subapertures, masks, settings }
    }

    /// A candidate without its masked responses.
    pub fn candidate(&self, hypothesis: Hypothesis, mut responses: Vec<Option<Response>>) -> Candidate {
        self.masks.apply(&mut responses);
        let unmasked = self.score(responses.iter().map(Option::as_ref));
        Candidate { hypothesis, query_index: None, responses, unmasked }
    }

    /// Score of a hypothesis over its unmasked responses.
    pub fn score<'v>(&self, unmasked: impl Iterator<Item = Option<&'v Response>>) -> Option<Score> {
        Score::of(self.subapertures.weighted(unmasked))
    }

    /// What is masked in each sub-aperture.
    pub fn masks(&self) -> &MaskStore {
        &self.masks
    }

    /// What a candidate would mask, `[sub-aperture]`. A plane masks what wall cancellation left of its echo, because points are
    /// queried in the cleaned sub-apertures.
    pub fn masks_of(&self, candidate: &Candidate) -> Vec<Option<Mask>> {
        let all = self.subapertures.all();
        let Hypothesis::Plane(_) = candidate.hypothesis else {
            return masks_of(all, &candidate.responses, self.settings);
        };
        let each = all.iter().zip(&candidate.responses);
        let left: Vec<_> = each.map(|(one, response)| response.map(|of_plane| cleaned(one, of_plane))).collect();
        masks_of(all, &left, self.settings)
    }

    /// Masks what a detection accounts for and removes it from the other candidates.
    pub fn subtract(&mut self, best: &Candidate, open: &mut [Candidate]) {
        let masks = self.masks_of(best);
        for candidate in open {
            let seen_before = candidate.responses.iter().flatten().count();
            let responses = candidate.responses.iter_mut().zip(&masks);
            responses.for_each(|(response, mask)| mask.iter().for_each(|mask| mask.apply(response)));
            if candidate.responses.iter().flatten().count() < seen_before {
                candidate.unmasked = self.score(candidate.responses.iter().map(Option::as_ref));
            }
        }
        self.masks.add(masks);
    }
}

/// A plane's response with the power that the cleaned sub-aperture has there.
fn cleaned(one: &Subaperture, of_plane: Response) -> Response {
    let plane = PlaneAt { toward: of_plane.toward.as_vec3().to_array(), distance_m: of_plane.range_m as f32 };
    Response { power: f64::from(one.coherence_of_planes(&[plane])[0].power), ..of_plane }
}

//! The sub-apertures of the window and how much each counts.

use radar_sar::math;
use radar_sar::subaperture::Subaperture;

use super::scoring::WeightedResponse;
use crate::responses::Response;

/// Sub-apertures in rising time. Older ones weigh less.
pub(super) struct WeightedSubapertures<'a> {
    all: Vec<&'a Subaperture>,
    weights: Vec<f64>,
}

impl<'a> WeightedSubapertures<'a> {
    /// `decay_s`: a sub-aperture this much older than the newest weighs 1/e of it.
    pub fn new(all: impl Iterator<Item = &'a Subaperture>, decay_s: f64) -> Self {
        let all: Vec<_> = all.collect();
        let newest_ns = all.last().map_or(0, |b| b.mid_time_ns);
        let age_s = |b: &&Subaperture| (newest_ns - b.mid_time_ns) as f64 * 1e-9;
        let weights = all.iter().map(|b| math::exp(-age_s(b) / decay_s)).collect();
        Self { all, weights }
    }

    /// Without the weights.
    pub fn all(&self) -> &[&'a Subaperture] {
        &self.all
    }

    /// With the weights.
    pub fn iter(&self) -> impl Iterator<Item = (&'a Subaperture, f64)> {
        self.all.iter().copied().zip(self.weights.iter().copied())
    }

    /// Responses with the weights and times of their sub-apertures.
    pub fn weighted<'v>(
        &self,
        responses: impl Iterator<Item = Option<&'v Response>>,
    ) -> impl Iterator<Item = WeightedResponse<'v>> {
        responses.zip(self.iter()).filter_map(|(response, (subaperture, weight))| {
            Some(WeightedResponse { response: response?, weight, time_ns: subaperture.mid_time_ns })
        })
    }

    /// Significant responses, each with its sub-aperture.
    pub fn significant<'v>(
        &self,
        responses: &'v [Option<Response>],
    ) -> impl Iterator<Item = (&'a Subaperture, &'v Response)> {
        let seen = self.all.iter().zip(responses).filter_map(|(one, response)| Some((*one, response.as_ref()?)));
        seen.filter(|(_, response)| response.is_significant())
    }
}

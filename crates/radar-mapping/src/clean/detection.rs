//! Detections and their features, which separate objects from artefacts.

use glam::DMat3;

use super::Aspect;
use super::candidate::{Candidate, Hypothesis};
use super::residual::Residual;
use super::scoring::{Score, amplitude_spread_of, robust_score};
use crate::responses::{Response, information, sigma_m};

/// Points closer than this are the same object and so not ambiguous, metres. Choice: twice the
/// pulse's width; parts of one object live on the same echoes.
const MIN_AMBIGUITY_DISTANCE_M: f64 = 0.3;

/// A detected plane or point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection<T> {
    /// Estimated plane or point.
    pub estimate: T,
    /// A/√B over the unmasked sub-apertures; for a point, A is reduced by what its uneven strengths
    /// cost.
    pub score: f64,
    /// Number of unmasked sub-apertures.
    pub subapertures: usize,
    /// Observable: a point is distinguishable from the rest of its range circle, a plane from a
    /// point. This holds for these sub-apertures or, once the mapper has queried the history, for
    /// them together with those from before the window.
    pub observable: bool,
    /// For a point: 1σ, all directions together, from ranges and directions, metres. For a plane:
    /// 1σ of its position 1 m beside where it was seen, metres.
    pub sigma_m: f64,
    /// The score without the best `ROBUST_SEGMENT_NS` of the window. An object that is present for
    /// longer than a passing hand, or than an artefact of one movement, keeps most of its score.
    pub robust_score: f64,
    /// Mean of the logarithm of the clutter at its range, relative to noise, over the significant
    /// responses. Artefacts need such clutter.
    pub ln_clutter: f64,
    /// Greatest range among the significant responses, metres.
    pub farthest_m: f64,
    /// Spread of the reflected powers that the significant responses imply, 1σ in e-folds of power.
    pub amplitude_spread: f64,
    /// Share of the unmasked sub-apertures whose response is not significant.
    pub miss_fraction: f64,
    /// The highest score of a point elsewhere that the same echoes would support, relative to its
    /// own score. At 1 the two cannot be told apart.
    pub ambiguity: f64,
    /// Geometry and strength at which it was seen.
    pub aspect: Aspect,
    /// Log odds that it is a real object and not an artefact; infinite where the classifier was not
    /// asked.
    pub log_odds: f64,
    /// Middle times of the first and last of these sub-apertures, host nanoseconds.
    pub first_ns: i64,
    /// See `first_ns`.
    pub last_ns: i64,
}

impl<T> Detection<T> {
    /// Of the best candidate; `open`: the others. `covariance_m2`: of a point. What is particular
    /// to a plane is left to the caller.
    pub(super) fn new(
        estimate: T,
        unmasked: Score,
        covariance_m2: Option<DMat3>,
        best: &Candidate,
        open: &[Candidate],
        residual: &Residual,
    ) -> Self {
        let significant = || residual.subapertures.significant(&best.responses).map(|(_, response)| response);
        let count = significant().count();
        let sigma_m = covariance_m2.as_ref().map_or(0.0, sigma_m);
        Self {
            estimate,
            score: unmasked.score,
            subapertures: unmasked.subapertures,
            observable: sigma_m <= residual.settings.max_sigma_m,
            sigma_m,
            robust_score: robust_score(residual.subapertures.weighted(best.responses.iter().map(Option::as_ref))),
            ln_clutter: significant().map(Response::ln_clutter).sum::<f64>() / count.max(1) as f64,
            farthest_m: significant().map(|response| response.range_m).fold(0.0, f64::max),
            amplitude_spread: amplitude_spread_of(significant()),
            miss_fraction: 1.0 - count as f64 / unmasked.subapertures.max(1) as f64,
            ambiguity: ambiguity(best, open, residual) / unmasked.score.max(1e-9),
            aspect: Aspect::of(significant(), covariance_m2.map_or(0.0, |c| c.y_axis.y.sqrt())),
            log_odds: f64::INFINITY,
            first_ns: unmasked.first_ns,
            last_ns: unmasked.last_ns,
        }
    }
}

/// Covariance of a point, m², from ranges and from directions relative to the sensor's motion.
pub(super) fn covariance_m2(responses: &[Option<Response>], residual: &Residual) -> DMat3 {
    information(DMat3::IDENTITY * 1e-6, residual.subapertures.significant(responses)).inverse()
}

/// The highest score of a point elsewhere that would lose more than half of it to this candidate's
/// masks; 0 when there is none.
fn ambiguity(best: &Candidate, open: &[Candidate], residual: &Residual) -> f64 {
    let Hypothesis::Point(place) = best.hypothesis else { return 0.0 };
    let masks = residual.masks_of(best);
    let after = |candidate: &Candidate| {
        let unmasked = candidate.responses.iter().zip(&masks).map(|(response, mask)| {
            response.as_ref().filter(|v| !mask.is_some_and(|mask| mask.covers(v.range_m, v.cos)))
        });
        residual.score(unmasked).map_or(0.0, |unmasked| unmasked.score)
    };
    let mut greatest = 0.0;
    for candidate in open {
        let (Hypothesis::Point(other), Some(unmasked)) = (candidate.hypothesis, candidate.unmasked) else {
            continue;
        };
        let may_be = unmasked.score > greatest && other.distance(place) >= MIN_AMBIGUITY_DISTANCE_M;
        if may_be && after(candidate) < 0.5 * unmasked.score {
            greatest = unmasked.score;
        }
    }
    greatest
}

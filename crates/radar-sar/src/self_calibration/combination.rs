//! Corrections from all tracks, robustly.

use std::collections::BTreeMap;

use super::corrections::{CORRECTIONS, Corrections, Matrix, Quadratic, dot, inverse, product, solution};
use super::information::Information;

/// Rounds of reweighting. Choice: the weights change little after the third.
const ROUNDS: usize = 5;
/// A track that deviates by this many 1σ counts half. Choice: more than one of a hundred honest tracks does not reach
/// it.
const HALF_WEIGHT_DEVIATION: f64 = 3.0;
/// A track of less than this share of its weight is counted as contradicting the others.
const CONTRADICTING_SHARE: f64 = 0.5;
/// 1σ of what a single track may deviate by beyond its own errors: it bounds what a track tells of a correction that it
/// does not observe. Choice: ten times what matters.
const TRACK_SPREAD: Corrections = [10e-3, 30e-3, 30e-3, 30e-3, 5e-3];
/// Tracks whose middles lie within this time share the errors of their poses, nanoseconds. Choice: tracks last up to 5 s.
const SHARED_ERROR_NS: i64 = 5_000_000_000;

/// The step to the best corrections, with their covariance.
#[derive(Debug, Clone)]
pub(super) struct Combination {
    pub step: Corrections,
    pub covariance: Matrix,
    /// Weight of each track.
    pub weights: Vec<f64>,
    /// By how much the tracks disagree beyond their own errors, as a factor of the variance, over all corrections; at
    /// least 1.
    pub disagreement: f64,
    /// Tracks used, and tracks that contradict the others.
    pub counts: (usize, usize),
}

/// Combines what tracks tell, all of it at the same corrections, with what is known before. `None` when that does not
/// determine every correction.
pub(super) fn combine(tracks: &[(Quadratic, f64, i64)], known: &Quadratic) -> Option<Combination> {
    let own: Vec<f64> = tracks.iter().map(|(_, variance_factor, _)| 1.0 / variance_factor).collect();
    let mut weights = own.clone();
    let mut step = Corrections::default();
    for _ in 0..ROUNDS {
        let sum = sum(tracks, &weights, known);
        step = solution(&sum.factor()?, &sum.gradient);
        for ((weight, own), (quadratic, ..)) in weights.iter_mut().zip(&own).zip(tracks) {
            let deviation2 = squared_deviation(&quadratic.after(&step), *own);
            *weight = own / (1.0 + deviation2 / (HALF_WEIGHT_DEVIATION * HALF_WEIGHT_DEVIATION));
        }
    }
    let covariance = inverse(&sum(tracks, &weights, known).factor()?);
    let factors = disagreement(tracks, &weights, &step, &covariance);
    let scale = factors.map(f64::sqrt);
    let contradicting = weights.iter().zip(&own).filter(|(weight, own)| **weight < CONTRADICTING_SHARE * **own).count();
    Some(Combination {
        step,
        covariance: std::array::from_fn(|i| std::array::from_fn(|j| covariance[i][j] * scale[i] * scale[j])),
        disagreement: factors.iter().sum::<f64>() / CORRECTIONS as f64,
        counts: (tracks.len() - contradicting, contradicting),
        weights,
    })
}

/// What [`combine`] takes of a track that tells `information` and whose fit lies a step away.
pub(super) fn seen_after(information: &Information, step: &Corrections) -> (Quadratic, f64, i64) {
    (information.quadratic.after(step), information.variance_factor, information.middle_ns)
}

/// Sum of the weighted tracks and of what is known.
pub(super) fn sum(tracks: &[(Quadratic, f64, i64)], weights: &[f64], known: &Quadratic) -> Quadratic {
    let mut sum = *known;
    tracks.iter().zip(weights).for_each(|((quadratic, ..), weight)| sum.add(quadratic, *weight));
    sum
}

/// Squared deviation of a track's own optimum from the present corrections, in standard deviations.
fn squared_deviation(track: &Quadratic, weight: f64) -> f64 {
    let mut bounded = Quadratic::default();
    bounded.add(track, weight);
    let gradient = bounded.gradient;
    (0..CORRECTIONS).for_each(|k| bounded.expect(k, 0.0, TRACK_SPREAD[k]));
    bounded.factor().map_or(f64::INFINITY, |factor| dot(&gradient, &solution(&factor, &gradient)))
}

/// By how much the variance of each correction exceeds what the tracks' own errors explain, at least 1: from what each
/// track, and all tracks of one time together, change of it.
fn disagreement(
    tracks: &[(Quadratic, f64, i64)],
    weights: &[f64],
    step: &Corrections,
    covariance: &Matrix,
) -> Corrections {
    let mut together: BTreeMap<i64, Corrections> = BTreeMap::new();
    let mut single = Corrections::default();
    for ((quadratic, _, middle_ns), weight) in tracks.iter().zip(weights) {
        let pull = quadratic.after(step).gradient.map(|gradient| gradient * weight);
        let change = product(covariance, &pull);
        let sum = together.entry(middle_ns.div_euclid(SHARED_ERROR_NS)).or_default();
        for k in 0..CORRECTIONS {
            single[k] += change[k] * change[k];
            sum[k] += change[k];
        }
    }
    std::array::from_fn(|k| {
        let shared: f64 = together.values().map(|change| change[k] * change[k]).sum();
        (single[k].max(shared) / covariance[k][k]).max(1.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A track that says the first correction is `offset` ± `sigma`, and nothing else.
    fn track(offset: f64, sigma: f64, middle_s: i64) -> (Quadratic, f64, i64) {
        let mut quadratic = Quadratic::default();
        quadratic.expect(0, offset, sigma);
        (quadratic, 1.0, middle_s * 1_000_000_000)
    }

    fn vague() -> Quadratic {
        let mut known = Quadratic::default();
        (0..CORRECTIONS).for_each(|k| known.expect(k, 0.0, 0.1));
        known
    }

    #[test]
    fn tracks_are_weighted_and_outliers_lose_their_weight() {
        let tracks = [track(20e-3, 1e-3, 0), track(21e-3, 1e-3, 10), track(19e-3, 1e-3, 20), track(-30e-3, 2e-3, 30)];
        let all = combine(&tracks, &vague()).unwrap();
        assert!((all.step[0] - 20e-3).abs() < 0.2e-3, "{all:?}");
        assert_eq!(all.counts, (3, 1));
        let sigma = all.covariance[0][0].sqrt();
        assert!((0.5e-3..2e-3).contains(&sigma), "{sigma}");
        assert!(all.covariance[1][1].sqrt() > 0.09, "nothing is told of the shift");
    }

    #[test]
    fn two_that_contradict_each_other_are_uncertain_together() {
        let two = combine(&[track(20e-3, 1e-3, 0), track(-20e-3, 1e-3, 0)], &vague()).unwrap();
        assert!(two.covariance[0][0].sqrt() > 5e-3, "{two:?}");
    }

    #[test]
    fn tracks_of_one_time_do_not_average_their_common_error() {
        let at = |times: [i64; 6]| {
            let offsets = [4e-3, 4.1e-3, 3.9e-3, -4e-3, -4.1e-3, -3.9e-3];
            let tracks: Vec<_> = offsets.iter().zip(times).map(|(offset, s)| track(*offset, 2e-3, s)).collect();
            combine(&tracks, &vague()).unwrap().covariance[0][0].sqrt()
        };
        assert!(at([0, 0, 0, 30, 30, 30]) > 1.3 * at([0, 10, 20, 30, 40, 50]));
    }
}

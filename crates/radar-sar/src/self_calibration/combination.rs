//! What all tracks agree on, robustly: the corrections, or the turns of the boresight.

use std::collections::BTreeMap;

use super::corrections::{CORRECTIONS, Matrix, Quadratic, dot, inverse, product, solution};

/// Rounds of reweighting. Choice: the weights change little after the third.
const ROUNDS: usize = 5;
/// A track that deviates by this many 1σ counts half. Choice: more than one of a hundred honest tracks does not reach
/// it.
const HALF_WEIGHT_DEVIATION: f64 = 3.0;
/// A track of less than this share of its weight is counted as contradicting the others.
const CONTRADICTING_SHARE: f64 = 0.5;
/// Tracks whose middles lie within this time share the errors of their poses, nanoseconds. Choice: tracks last up to 5 s.
const SHARED_ERROR_NS: i64 = 5_000_000_000;

/// One track's information at the present values of the unknowns that all tracks share.
#[derive(Debug, Clone, Copy)]
pub(super) struct TrackTerm<const N: usize = CORRECTIONS> {
    pub quadratic: Quadratic<N>,
    /// See [`Information`](super::information::Information).
    pub variance_factor: f64,
    /// Middle of the track, host nanoseconds.
    pub middle_ns: i64,
}

/// The step to the best values, with their covariance.
#[derive(Debug, Clone)]
pub(super) struct Combination<const N: usize = CORRECTIONS> {
    pub step: [f64; N],
    pub covariance: Matrix<N>,
    /// Weight of each track.
    pub weights: Vec<f64>,
    /// By how much the tracks disagree beyond their own errors, as a factor of the variance, over all unknowns; at
    /// least 1.
    pub disagreement: f64,
    /// Tracks used, and tracks that contradict the others.
    pub counts: (usize, usize),
}

/// Combines the tracks' terms, all at the same values, with the prior. `None` when that does not determine every
/// unknown. `spread`: 1σ of what a single track may deviate by beyond its own errors; it bounds the deviation in an
/// unknown that the track does not observe.
pub(super) fn combine<const N: usize>(
    tracks: &[TrackTerm<N>],
    prior: &Quadratic<N>,
    spread: &[f64; N],
) -> Option<Combination<N>> {
    let own: Vec<f64> = tracks.iter().map(|track| 1.0 / track.variance_factor).collect();
    let mut weights = own.clone();
    let mut step = [0.0; N];
    for _ in 0..ROUNDS {
        let sum = sum(tracks, &weights, prior);
        step = solution(&sum.factor()?, &sum.gradient);
        for ((weight, own), track) in weights.iter_mut().zip(&own).zip(tracks) {
            let deviation2 = squared_deviation(&track.quadratic.after(&step), *own, spread);
            *weight = own / (1.0 + deviation2 / (HALF_WEIGHT_DEVIATION * HALF_WEIGHT_DEVIATION));
        }
    }
    let covariance: Matrix<N> = inverse(&sum(tracks, &weights, prior).factor()?);
    let factors = disagreement(tracks, &weights, &step, &covariance);
    let scale = factors.map(f64::sqrt);
    let contradicting = weights.iter().zip(&own).filter(|(weight, own)| **weight < CONTRADICTING_SHARE * **own).count();
    Some(Combination {
        step,
        covariance: std::array::from_fn(|i| std::array::from_fn(|j| covariance[i][j] * scale[i] * scale[j])),
        disagreement: factors.iter().sum::<f64>() / N as f64,
        counts: (tracks.len() - contradicting, contradicting),
        weights,
    })
}

/// Sum of the weighted tracks and the prior.
fn sum<const N: usize>(tracks: &[TrackTerm<N>], weights: &[f64], prior: &Quadratic<N>) -> Quadratic<N> {
    let mut sum = *prior;
    tracks.iter().zip(weights).for_each(|(track, weight)| sum.add(&track.quadratic, *weight));
    sum
}

/// Squared deviation of a track's own optimum from the present values, in standard deviations.
fn squared_deviation<const N: usize>(track: &Quadratic<N>, weight: f64, spread: &[f64; N]) -> f64 {
    let mut bounded = Quadratic::default();
    bounded.add(track, weight);
    let gradient = bounded.gradient;
    (0..N).for_each(|k| bounded.expect(k, 0.0, spread[k]));
    bounded.factor().map_or(f64::INFINITY, |factor| dot(&gradient, &solution(&factor, &gradient)))
}

/// By how much the variance of each unknown exceeds what the tracks' own errors explain, at least 1: from what each
/// track, and all tracks of one time together, change of it.
fn disagreement<const N: usize>(
    tracks: &[TrackTerm<N>],
    weights: &[f64],
    step: &[f64; N],
    covariance: &Matrix<N>,
) -> [f64; N] {
    let mut together: BTreeMap<i64, [f64; N]> = BTreeMap::new();
    let mut single = [0.0; N];
    for (track, weight) in tracks.iter().zip(weights) {
        let pull = track.quadratic.after(step).gradient.map(|gradient| gradient * weight);
        let change = product(covariance, &pull);
        let sum = together.entry(track.middle_ns.div_euclid(SHARED_ERROR_NS)).or_insert([0.0; N]);
        for k in 0..N {
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

    const SPREAD: [f64; CORRECTIONS] = [10e-3, 30e-3, 30e-3, 30e-3, 5e-3];

    /// A track that says the first correction is `offset` ± `sigma`, and nothing else.
    fn track(offset: f64, sigma: f64, middle_s: i64) -> TrackTerm {
        let mut quadratic = Quadratic::default();
        quadratic.expect(0, offset, sigma);
        TrackTerm { quadratic, variance_factor: 1.0, middle_ns: middle_s * 1_000_000_000 }
    }

    fn vague() -> Quadratic {
        let mut prior = Quadratic::default();
        (0..CORRECTIONS).for_each(|k| prior.expect(k, 0.0, 0.1));
        prior
    }

    #[test]
    fn tracks_are_weighted_and_outliers_lose_their_weight() {
        let tracks = [track(20e-3, 1e-3, 0), track(21e-3, 1e-3, 10), track(19e-3, 1e-3, 20), track(-30e-3, 2e-3, 30)];
        let all = combine(&tracks, &vague(), &SPREAD).unwrap();
        assert!((all.step[0] - 20e-3).abs() < 0.2e-3, "{all:?}");
        assert_eq!(all.counts, (3, 1));
        let sigma = all.covariance[0][0].sqrt();
        assert!((0.5e-3..2e-3).contains(&sigma), "{sigma}");
        assert!(all.covariance[1][1].sqrt() > 0.09, "no track observes the shift");
    }

    #[test]
    fn two_that_contradict_each_other_are_uncertain_together() {
        let two = combine(&[track(20e-3, 1e-3, 0), track(-20e-3, 1e-3, 0)], &vague(), &SPREAD).unwrap();
        assert!(two.covariance[0][0].sqrt() > 5e-3, "{two:?}");
    }

    #[test]
    fn tracks_of_one_time_do_not_average_their_common_error() {
        let at = |times: [i64; 6]| {
            let offsets = [4e-3, 4.1e-3, 3.9e-3, -4e-3, -4.1e-3, -3.9e-3];
            let tracks: Vec<_> = offsets.iter().zip(times).map(|(offset, s)| track(*offset, 2e-3, s)).collect();
            combine(&tracks, &vague(), &SPREAD).unwrap().covariance[0][0].sqrt()
        };
        assert!(at([0, 0, 0, 30, 30, 30]) > 1.3 * at([0, 10, 20, 30, 40, 50]));
    }
}

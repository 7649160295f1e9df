//! Score of one hypothesis over a window's responses, and other features that separate objects from
//! artefacts.

use std::collections::BTreeMap;

use super::super::responses::Response;

/// Length of the time segments, of which the robust score leaves out the best one, nanoseconds.
/// Choice: three sub-apertures of 90 ms; an artefact of one gesture lives in about as many, while
/// an object is left with the rest of the window's 4 s.
const ROBUST_SEGMENT_NS: i64 = 300_000_000;
/// Least number of sub-apertures of a score. Choice: with fewer, one or two bursts of noise reach
/// the score of an object.
const MIN_SUBAPERTURES: usize = 3;

/// A response with its sub-aperture's weight and time.
#[derive(Debug, Clone, Copy)]
pub(super) struct WeightedResponse<'v> {
    pub response: &'v Response,
    pub weight: f64,
    pub time_ns: i64,
}

/// Score over responses.
#[derive(Debug, Clone, Copy)]
pub(super) struct Score {
    /// A/√B.
    pub score: f64,
    pub subapertures: usize,
    pub first_ns: i64,
    pub last_ns: i64,
}

impl Score {
    /// Over the unmasked responses of a point or a plane; `None` with too few.
    pub fn of<'v>(responses: impl Iterator<Item = WeightedResponse<'v>>) -> Option<Self> {
        let (mut a, mut b, mut subapertures) = (0.0, 0.0, 0);
        let (mut first_ns, mut last_ns) = (i64::MAX, i64::MIN);
        for WeightedResponse { response, weight, time_ns } in responses {
            a += weight * response.evidence;
            b += weight * weight;
            subapertures += 1;
            (first_ns, last_ns) = (first_ns.min(time_ns), last_ns.max(time_ns));
        }
        (subapertures >= MIN_SUBAPERTURES).then_some(Self { score: a / b.sqrt(), subapertures, first_ns, last_ns })
    }
}

/// Spread of the strengths that significant responses imply, 1σ in e-folds of power; 0 without any.
///
/// An object returns about the same power from sub-aperture to sub-aperture, once distance and beam
/// are allowed for. A point on the wrong side of a range circle, or one put together from parts of
/// several objects, does not.
pub(super) fn amplitude_spread_of<'v>(responses: impl Iterator<Item = &'v Response>) -> f64 {
    let ln_strengths: Vec<f64> = responses.filter_map(|response| response.ln_strength).collect();
    let count = ln_strengths.len().max(1) as f64;
    let mean = ln_strengths.iter().sum::<f64>() / count;
    (ln_strengths.iter().map(|ln_strength| (ln_strength - mean).powi(2)).sum::<f64>() / count).sqrt()
}

/// The score without the segment of time that contributes most to it; −∞ when there is only one.
pub(super) fn robust_score<'v>(responses: impl Iterator<Item = WeightedResponse<'v>>) -> f64 {
    let (mut whole, mut segments) = ([0.0; 2], BTreeMap::<i64, [f64; 2]>::new());
    for WeightedResponse { response, weight, time_ns } in responses {
        let segment = segments.entry(time_ns.div_euclid(ROBUST_SEGMENT_NS)).or_default();
        for (part, sum) in [weight * response.evidence, weight * weight].into_iter().enumerate() {
            (whole[part], segment[part]) = (whole[part] + sum, segment[part] + sum);
        }
    }
    let without = segments.values().map(|[a, b]| (whole[0] - a, whole[1] - b)).filter(|(_, b)| *b > 1e-9);
    let least = without.map(|(a, b)| a / b.sqrt()).reduce(f64::min);
    least.filter(|_| segments.len() > 1).unwrap_or(f64::NEG_INFINITY)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn response(m: f64, power: f64, gain: f64) -> Response {
        let (evidence, ln_strength) = (m.ln_1p() - 0.596347, (m >= 3.0).then(|| (power / gain).ln()));
        Response { m, evidence, power, range_m: 1.0, toward: DVec3::X, cos: 0.0, gain, ln_strength }
    }

    fn weighted(responses: &[Response]) -> impl Iterator<Item = WeightedResponse<'_>> + Clone {
        responses.iter().enumerate().map(|(n, response)| WeightedResponse {
            response,
            weight: 1.0,
            time_ns: n as i64 * 90_000_000,
        })
    }

    #[test]
    fn spread_is_that_of_the_strengths_and_not_of_the_echoes() {
        let even: Vec<Response> = (1..=10).map(|n| response(20.0, 20.0, 0.1 * f64::from(n))).collect();
        // Echoes as strong as the gain lets them be, and against it.
        let as_expected: Vec<Response> = even.iter().map(|v| response(20.0, 100.0 * v.gain, v.gain)).collect();
        let against: Vec<Response> = even.iter().map(|v| response(20.0, 100.0 / v.gain, v.gain)).collect();
        assert!(amplitude_spread_of(as_expected.iter()) < 1e-9);
        let off = against.iter().filter_map(|response| response.ln_strength);
        let mean = off.clone().sum::<f64>() / 10.0;
        let squares: f64 = off.map(|x| (x - mean).powi(2)).sum();
        assert!((amplitude_spread_of(against.iter()) - (squares / 10.0).sqrt()).abs() < 1e-9);
        assert_eq!(amplitude_spread_of([].iter()), 0.0);
    }

    #[test]
    fn single_burst_has_low_robust_score() {
        let (seen, empty) = (response(20.0, 20.0, 1.0), response(0.6, 0.6, 1.0));
        assert_eq!(robust_score(weighted(&[seen; 3])), f64::NEG_INFINITY);
        let burst = [vec![empty; 12], vec![seen; 3], vec![empty; 12]].concat();
        assert!(robust_score(weighted(&burst)) < 1.0 && robust_score(weighted(&[seen; 27])) > 10.0);
    }

    #[test]
    fn two_subapertures_give_no_score() {
        assert!(Score::of(weighted(&[response(20.0, 20.0, 1.0); 2])).is_none());
    }
}

//! Converts measurements at a point to lengths along lines of sight, and fits a position to all of
//! them.

use glam::{DMat3, DVec3};

use super::path_filter::{OUTLIER_SIGMA, PathFilter, Sight};
use super::unwrapped::Unwrapped;
use super::{PositionErrors, Prior, direction, regular_inverse};
use crate::PHASE_RAD_PER_M;
use crate::math;
use crate::range_power::{RangePower, Reading};
use crate::symmetric::outer;

/// One sweep's lengths, as differences from the distance to the linearisation point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measured {
    pub sight: Sight,
    pub range_off_m: f64,
    pub range_variance_m2: f64,
    /// Known up to multiples of λ/2 and an offset.
    pub phase_off_m: f64,
    /// `None`: too weak for a phase.
    pub phase_variance_m2: Option<f64>,
}

/// Least |z|²/σ² of a sweep to be used for range, and for phase. Choice: weaker sweeps add noise
/// and no range; the phase's error is then at most 0.2 rad, which can be unwrapped.
const MIN_RANGE_POWER: f64 = 1.5;
const MIN_PHASE_POWER: f64 = 12.0;
/// Variation of a reflector's own phase with aspect, 1σ, metres. Choice: a corner's or tube's
/// centre of reflection moves by some hundredths of a millimetre; no measurement at 60 GHz was
/// found.
const PHASE_FLOOR_M: f64 = 0.03e-3;
/// 1σ of an unknown position, metres. Choice: larger than a room, small enough for f64's matrices.
const OPEN_M: f64 = 10.0;
/// Mean normalised square of the phase innovations above which they do not follow the model.
/// Choice: 1 is expected; twice that over tens of phases is no chance, and the ranges alone are
/// used.
const MAX_PHASE_MISFIT: f64 = 2.0;

/// Gain of the log-likelihood from which on more drift than the settings state is believed. Choice: exceeded by chance in 1 %
/// (half of a chi-square of one degree of freedom).
const MIN_DRIFT_GAIN: f64 = 2.7;
/// Factor between the drifts that are tried, the least and the greatest, metres. Choice: 20 % matters little to a covariance; more
/// than 30 mm no tracking that is of use drifts.
const DRIFT_STEP: f64 = 1.25;
const MIN_DRIFT_M: f64 = 0.2e-3;
const MAX_DRIFT_M: f64 = 30e-3;

/// Variance of the length from a phase, given the power over the noise.
fn phase_variance_m2(power: f64) -> f64 {
    0.5 / (power * PHASE_RAD_PER_M * PHASE_RAD_PER_M) + PHASE_FLOOR_M * PHASE_FLOOR_M
}

/// Measurements as lengths, in time order.
pub(super) fn measured(power: &RangePower, readings: &[Reading], place: DVec3) -> Vec<Measured> {
    let observations = power.observations();
    let start_ns = readings.first().map_or(0, |r| observations[r.sweep].mid_time_ns);
    let strong = readings.iter().filter(|r| r.power > MIN_RANGE_POWER && r.curvature_per_m2 > 0.0);
    let mut all: Vec<Measured> = strong
        .map(|reading| {
            let observation = &observations[reading.sweep];
            let toward = direction(power, reading, place);
            let sight = Sight {
                time_s: (observation.mid_time_ns - start_ns) as f64 * 1e-9,
                toward,
                toward_in_sensor: observation.tracking_from_sensor.rotation.conjugate() * toward,
            };
            // |z|² includes one unit of noise: the signal is power − 1, and the slope's variance
            // follows from the power, not from the signal.
            let signal = (reading.power - 1.0) / reading.power;
            Measured {
                sight,
                range_off_m: reading.slope_per_m / (reading.curvature_per_m2 * signal),
                range_variance_m2: 1.0 / (reading.curvature_per_m2 * signal * signal),
                phase_off_m: reading.phase_off_m,
                phase_variance_m2: (reading.power >= MIN_PHASE_POWER).then(|| phase_variance_m2(reading.power)),
            }
        })
        .collect();
    all.sort_by(|a, b| a.sight.time_s.total_cmp(&b.sight.time_s));
    all
}

/// Result of the filter for the position.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    /// Information matrix times the offset of the most likely position.
    information_vector: DVec3,
    information: DMat3,
    misfit: f64,
}

impl Fit {
    /// `likely`: probability of each of the filter's hypotheses; they sum to 1.
    fn of(filter: &PathFilter, likely: &[f64], misfit: f64) -> Self {
        let open = DMat3::IDENTITY * (1.0 / (OPEN_M * OPEN_M));
        let guesses = || filter.places_m().zip(likely);
        let mean_m = guesses().map(|(place, share)| place * *share).sum::<DVec3>();
        let spread_m2 = guesses().fold(DMat3::ZERO, |sum, (place, share)| sum + outer(place - mean_m) * *share);
        let information = regular_inverse(&(filter.place_covariance_m2() + spread_m2));
        // The initial covariance pulls towards 0, so it contributes to the information only.
        Self { information_vector: information * mean_m, information: information - open, misfit }
    }

    /// Step to the most likely position, including the beam's prior. `data_m2`: the data's
    /// covariance including effects unknown to the filter.
    pub fn step(&self, data_m2: &DMat3, prior: &Prior, place: DVec3) -> DVec3 {
        let worth = regular_inverse(data_m2);
        let information_vector = worth * (regular_inverse(&self.information) * self.information_vector)
            + prior.information() * (prior.at - place);
        regular_inverse(&(worth + prior.information())) * information_vector
    }

    /// Covariance from the data alone, m².
    pub fn covariance_m2(&self) -> DMat3 {
        regular_inverse(&self.information) * self.misfit
    }
}

/// Mean normalised square of innovations, divided by what chance explains; at least 1. Three
/// degrees of freedom belong to the position.
fn misfit(squares: &[f64]) -> f64 {
    let free = squares.len().saturating_sub(3);
    if free == 0 {
        return 1.0;
    }
    let mean = squares.iter().sum::<f64>() / free as f64;
    // Two sigma of a mean of that many values.
    (mean / (1.0 + 2.0 * (2.0 / free as f64).sqrt())).max(1.0)
}

fn open_start(errors: &PositionErrors) -> PathFilter {
    PathFilter::new(&DMat3::from_diagonal(DVec3::splat(OPEN_M * OPEN_M)), errors)
}

/// Fits the ranges alone.
pub(super) fn fit_ranges(all: &[Measured], errors: &PositionErrors) -> Fit {
    let mut filter = open_start(errors);
    let mut squares = Vec::with_capacity(all.len());
    for one in all {
        filter.advance(&one.sight);
        let expected = filter.predict(&one.sight, false, one.range_variance_m2);
        squares.extend(filter.update(&expected, &[one.range_off_m], 0));
    }
    Fit::of(&filter, &[1.0], misfit(&squares))
}

/// The pose errors with the drift that makes the ranges most likely, at least that of `errors`.
pub(super) fn with_drift_of(all: &[Measured], errors: &PositionErrors) -> PositionErrors {
    let cost = |errors: &PositionErrors| {
        let mut filter = open_start(errors);
        let costs = all.iter().map(|one| {
            filter.advance(&one.sight);
            let expected = filter.predict(&one.sight, false, one.range_variance_m2);
            let square = filter.update(&expected, &[one.range_off_m], 0)[0];
            0.5 * (limited(square) + math::ln(expected.variance_m2))
        });
        costs.sum::<f64>()
    };
    let as_set = cost(errors);
    let mut best = (as_set - MIN_DRIFT_GAIN, *errors);
    let mut drifting = *errors;
    while drifting.wander_m < MAX_DRIFT_M {
        drifting.wander_m = (drifting.wander_m * DRIFT_STEP).max(MIN_DRIFT_M);
        let cost = cost(&drifting);
        // The likelihood has one maximum.
        if cost > best.0 && best.1 != *errors {
            break;
        }
        if cost < best.0 {
            best = (cost, drifting);
        }
    }
    best.1
}

/// The square of an innovation; an outlier's counts as the least outlier's, whatever the drift.
fn limited(square: f64) -> f64 {
    square.min(OUTLIER_SIGMA * OUTLIER_SIGMA)
}

/// Fits ranges and phases together, every hypothesis weighted by its likelihood; `None` when the
/// phases do not follow the model.
pub(super) fn fit_ranges_and_phases(all: &[Measured], unwrapped: &Unwrapped, errors: &PositionErrors) -> Option<Fit> {
    let mut filter = open_start(errors);
    let count = unwrapped.guesses.len();
    filter.branch(std::iter::repeat_n(0, count));
    let (mut costs, mut joined, mut joins) = (vec![0.0; count], vec![0.0; count], 0);
    let mut ranges = vec![Vec::with_capacity(all.len()); count];
    for (n, (one, phase)) in all.iter().zip(&unwrapped.phases).enumerate() {
        filter.advance(&one.sight);
        let expected = filter.predict(&one.sight, false, one.range_variance_m2);
        let squares = filter.update(&expected, &vec![one.range_off_m; count], least(&costs));
        for ((range, cost), square) in ranges.iter_mut().zip(&mut costs).zip(squares) {
            range.push(square);
            *cost += 0.5 * square;
        }
        let Some(phase) = phase else { continue };
        if phase.begins {
            filter.open_offset();
        }
        let off_m: Vec<f64> = unwrapped.guesses.iter().map(|guess| guess[n]).collect();
        let expected = filter.predict(&one.sight, true, phase.variance_m2);
        let squares = filter.update(&expected, &off_m, least(&costs));
        if !phase.begins {
            joins += 1;
            for ((sum, cost), square) in joined.iter_mut().zip(&mut costs).zip(squares) {
                *sum += square;
                *cost += 0.5 * square;
            }
        }
    }
    let best = least(&costs);
    let weights: Vec<f64> = costs.iter().map(|cost| math::exp(costs[best] - cost)).collect();
    let whole: f64 = weights.iter().sum();
    let likely: Vec<f64> = weights.iter().map(|weight| weight / whole).collect();
    let follows = joined[best] <= MAX_PHASE_MISFIT * f64::from(joins.max(1));
    follows.then(|| Fit::of(&filter, &likely, misfit(&ranges[best])))
}

/// Index of the least value.
fn least(costs: &[f64]) -> usize {
    (0..costs.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).unwrap_or(0)
}

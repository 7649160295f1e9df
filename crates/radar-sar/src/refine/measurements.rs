//! Readings of a place as measured lengths along sights, and what the filter makes of all of them.

use glam::{DMat3, DVec3};

use super::path_filter::{PathFilter, Sight};
use super::phase::Unwrapped;
use super::{PositionErrors, Prior, direction, outer, regular_inverse};
use crate::PHASE_RAD_PER_M;
use crate::math;
use crate::range_power::{RangePower, Reading};

/// One sweep's lengths, as offsets from the distance to the place that the sights were taken at.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measured {
    pub sight: Sight,
    pub range_off_m: f64,
    pub range_variance_m2: f64,
    /// Known up to λ/2 and an offset.
    pub phase_off_m: f64,
    /// `None`: too weak to have a phase.
    pub phase_variance_m2: Option<f64>,
}

/// |z|²/σ² from which on a sweep has a range, and from which on a phase.
const MIN_RANGE_POWER: f64 = 1.5;
const MIN_PHASE_POWER: f64 = 12.0;
/// What a reflector's phase wanders by itself as it is seen from elsewhere, 1σ, metres.
const PHASE_FLOOR_M: f64 = 0.03e-3;
/// 1σ of a place of which nothing is known, metres.
const OPEN_M: f64 = 10.0;
/// Mean normalised square of the phases' innovations beyond which they do not follow the model.
const MAX_PHASE_MISFIT: f64 = 2.0;

/// Variance of the length that a phase shows, with the power over the noise.
fn phase_variance_m2(power: f64) -> f64 {
    0.5 / (power * PHASE_RAD_PER_M * PHASE_RAD_PER_M) + PHASE_FLOOR_M * PHASE_FLOOR_M
}

/// Readings as lengths, in time.
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
            // Of |z|² one part is noise: signal is power − 1, and the slope's variance is that of power, not of signal.
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

/// What the filter says of the place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    /// Information times the offset of the most likely place.
    information_vector: DVec3,
    information: DMat3,
    misfit: f64,
}

impl Fit {
    /// `likely`: how likely each of the filter's guesses is; they sum to 1.
    fn of(filter: &PathFilter, likely: &[f64], misfit: f64) -> Self {
        let open = DMat3::IDENTITY * (1.0 / (OPEN_M * OPEN_M));
        let guesses = || filter.places_m().zip(likely);
        let mean_m = guesses().map(|(place, share)| place * *share).sum::<DVec3>();
        let spread_m2 = guesses().fold(DMat3::ZERO, |sum, (place, share)| sum + outer(place - mean_m) * *share);
        let information = regular_inverse(&(filter.place_covariance_m2() + spread_m2));
        // The open start pulls towards 0, so it adds to the information alone.
        Self { information_vector: information * mean_m, information: information - open, misfit }
    }

    /// The step to the most likely place, the beam's prior in it. `data_m2`: the data's covariance with all that the filter
    /// does not know.
    pub fn step(&self, data_m2: &DMat3, prior: &Prior, place: DVec3) -> DVec3 {
        let worth = regular_inverse(data_m2);
        let information_vector = worth * (regular_inverse(&self.information) * self.information_vector)
            + prior.information() * (prior.at - place);
        regular_inverse(&(worth + prior.information())) * information_vector
    }

    /// Covariance as the data alone give it, m².
    pub fn covariance_m2(&self) -> DMat3 {
        regular_inverse(&self.information) * self.misfit
    }
}

/// Mean normalised square of innovations, as far as chance does not explain it; at least 1. Three of them went into the
/// place.
fn misfit(squares: &[f64]) -> f64 {
    let free = squares.len().saturating_sub(3);
    if free == 0 {
        return 1.0;
    }
    let mean = squares.iter().sum::<f64>() / free as f64;
    // Two sigmas of the mean of that many.
    (mean / (1.0 + 2.0 * (2.0 / free as f64).sqrt())).max(1.0)
}

fn open_start(errors: &PositionErrors) -> PathFilter {
    PathFilter::new(&DMat3::from_diagonal(DVec3::splat(OPEN_M * OPEN_M)), errors)
}

/// From ranges alone.
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

/// A sweep's phase.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Phase {
    pub variance_m2: f64,
    /// Nothing joins it to what was before: a new offset.
    pub begins: bool,
}

/// From ranges and phases together, every way that phases may be continuous weighed by its likelihood; `None` when the
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

/// Where the least is.
fn least(costs: &[f64]) -> usize {
    (0..costs.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).unwrap_or(0)
}

//! Phase unwrapping from sweep to sweep: finds the whole number of half wavelengths in each length.
//!
//! A filter initialised with the ranges' position and then updated with phases alone predicts each
//! next phase. Every whole number that it cannot rule out becomes a hypothesis. Hypotheses
//! accumulate cost for later phases that fit badly, and hopeless ones are dropped. Where the
//! prediction is too uncertain, a new segment with a new offset begins. All remaining hypotheses
//! contribute to the position, weighted by their likelihood given all ranges and phases, so the
//! ambiguity is part of the covariance.

use glam::{DMat3, DVec3};

use super::PositionErrors;
use super::measurements::Measured;
use super::path_filter::PathFilter;
use super::unwrapped::{Phase, Unwrapped};
use crate::WAVELENGTH_M;

/// The phase repeats with this length, metres.
const PERIOD_M: f64 = WAVELENGTH_M * 0.5;
/// A phase is unwrapped when half a period is at least this many sigma of its prediction. Choice:
/// at one sigma, one in three would be assigned to a neighbouring whole number, and hypotheses
/// cover that; fewer sigma open as many hypotheses as phases.
const FOLLOWED_SIGMAS: f64 = 1.0;
/// Whole numbers farther than this many sigma from the prediction are not considered. Choice:
/// beyond lies one of 16 000 regular predictions.
const WIDEST_SIGMAS: f64 = 4.0;
/// A hypothesis is dropped when its log-likelihood is this far below the best. Choice: odds of
/// e⁻¹², six in a million.
const MAX_COST_ABOVE_BEST: f64 = 12.0;
/// Greatest number of hypotheses. Choice: bounds the work; more survive only where the phase says
/// nothing.
const MAX_GUESSES: usize = 64;

/// One way of unwrapping the phases.
#[derive(Debug, Clone)]
struct Guess {
    /// Negative log-likelihood.
    cost: f64,
    /// One length offset per sweep; 0 where it has no phase.
    off_m: Vec<f64>,
}

/// Unwraps the phases of sweeps in time order, given the position relative to the linearisation
/// point, and its covariance. `None` where no two phases can be joined.
pub(super) fn unwrap_phases(
    all: &[Measured],
    place_m: DVec3,
    covariance_m2: &DMat3,
    errors: &PositionErrors,
) -> Option<Unwrapped> {
    let mut filter = PathFilter::new(covariance_m2, errors).starting_at(place_m);
    let mut guesses = vec![Guess { cost: 0.0, off_m: Vec::with_capacity(all.len()) }];
    let (mut phases, mut joins, mut stretch_open) = (Vec::with_capacity(all.len()), 0, false);
    for one in all {
        filter.advance(&one.sight);
        let Some(variance_m2) = one.phase_variance_m2 else {
            phases.push(None);
            guesses.iter_mut().for_each(|guess| guess.off_m.push(0.0));
            continue;
        };
        let mut expected = filter.predict(&one.sight, true, variance_m2);
        let begins = !(stretch_open && PERIOD_M * 0.5 >= FOLLOWED_SIGMAS * expected.variance_m2.sqrt());
        stretch_open = true;
        phases.push(Some(Phase { variance_m2, begins }));
        if begins {
            filter.open_offset();
            guesses.iter_mut().for_each(|guess| guess.off_m.push(one.phase_off_m));
        } else {
            joins += 1;
            let (from, next) = branched(&guesses, one.phase_off_m, &expected.expected_m, expected.variance_m2);
            filter.branch(from.into_iter());
            guesses = next;
        }
        expected = filter.predict(&one.sight, true, variance_m2);
        let off_m: Vec<f64> = guesses.iter().filter_map(|guess| guess.off_m.last().copied()).collect();
        filter.update(&expected, &off_m, 0);
    }
    let guesses = guesses.into_iter().map(|guess| guess.off_m).collect();
    (joins > 0).then_some(Unwrapped { phases, guesses })
}

/// Every hypothesis extended by every sufficiently likely whole number: the parent of each, and the
/// new hypotheses, the likeliest first.
fn branched(guesses: &[Guess], phase_off_m: f64, expected_m: &[f64], variance_m2: f64) -> (Vec<usize>, Vec<Guess>) {
    let sigma_m = variance_m2.sqrt();
    let mut next: Vec<(f64, usize, f64)> = Vec::new();
    for (n, (guess, expected_m)) in guesses.iter().zip(expected_m).enumerate() {
        let periods = (phase_off_m - expected_m) / PERIOD_M;
        let nearest = periods.round();
        let reach = (WIDEST_SIGMAS * sigma_m / PERIOD_M - 0.5).max(0.0).ceil() as i32;
        for whole in (-reach..=reach).map(|more| nearest + f64::from(more)) {
            let surprise_m = (periods - whole) * PERIOD_M;
            if whole == nearest || surprise_m.abs() <= WIDEST_SIGMAS * sigma_m {
                let cost = guess.cost + 0.5 * surprise_m * surprise_m / variance_m2;
                next.push((cost, n, phase_off_m - whole * PERIOD_M));
            }
        }
    }
    next.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.total_cmp(&b.2)));
    let worst = next.first().map_or(0.0, |best| best.0 + MAX_COST_ABOVE_BEST);
    next.truncate(MAX_GUESSES);
    next.retain(|(cost, ..)| *cost <= worst);
    let of = |&(cost, n, off_m): &(f64, usize, f64)| {
        let mut all = guesses[n].off_m.clone();
        all.push(off_m);
        Guess { cost, off_m: all }
    };
    (next.iter().map(|(_, n, _)| *n).collect(), next.iter().map(of).collect())
}

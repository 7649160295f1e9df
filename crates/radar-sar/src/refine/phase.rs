//! Following the phase from sweep to sweep: which whole number of half wavelengths each one hides.
//!
//! A filter that starts from what ranges know of the place, and then hears phases alone, expects each next phase. Every whole
//! number that it cannot rule out makes a guess of its own; guesses fall behind by how badly later phases fit them, and the
//! hopeless ones end. Where the next phase is expected so loosely that it says nothing, a new stretch with a new offset
//! begins. All guesses that are left go into the place, each as far as all ranges and phases together make it likely, so the
//! doubt is in the covariance.

use glam::{DMat3, DVec3};

use super::PositionErrors;
use super::measurements::{Measured, Phase};
use super::path_filter::PathFilter;
use crate::WAVELENGTH_M;

/// The phase repeats with this length.
const PERIOD_M: f64 = WAVELENGTH_M * 0.5;
/// A phase is followed when half a period is this many sigmas; else one in three would go to the next whole number.
const FOLLOWED_SIGMAS: f64 = 1.0;
/// Whole numbers farther than this many sigmas from what is expected are no guess.
const WIDEST_SIGMAS: f64 = 4.0;
/// A guess ends that is e to this many times less likely than the likeliest.
const MAX_COST_ABOVE_BEST: f64 = 12.0;
/// Guesses at most.
const MAX_GUESSES: usize = 64;

/// One way of making phases continuous.
#[derive(Debug, Clone)]
struct Guess {
    /// Minus the logarithm of its likelihood.
    cost: f64,
    /// One for each sweep; 0 where it has no phase.
    off_m: Vec<f64>,
}

/// Phases made continuous.
#[derive(Debug, Clone)]
pub(super) struct Unwrapped {
    /// One for each sweep; `None` where it has none.
    pub phases: Vec<Option<Phase>>,
    /// Lengths that the phases show, one for each sweep, in each way that they may be continuous; the likeliest first.
    pub guesses: Vec<Vec<f64>>,
}

/// Phases of sweeps in time, made continuous from what is known of the place: its offset from where sights were taken, and
/// covariance. `None` where no two join.
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

/// Every guess with every whole number that is likely enough: which guess each comes from, and they themselves, the
/// likeliest first.
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

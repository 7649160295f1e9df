//! Following the phase from sweep to sweep: which whole number of half wavelengths each one hides.
//!
//! A filter that starts from what is known of the place, and then hears phases alone, expects each next phase. Where it
//! expects it to well within half a wavelength the whole number is plain; where not, a new stretch with a new offset begins.
//! Ranges are not heard again here: they went into the start already.

use glam::DMat3;

use super::PositionErrors;
use super::path_filter::PathFilter;
use super::sights::{Measured, Phase};
use crate::radar::WAVELENGTH_M;

/// The phase repeats with this length.
const PERIOD_M: f64 = WAVELENGTH_M * 0.5;
/// A whole number is plain when half a period is this many sigmas.
const PLAIN_SIGMAS: f64 = 4.0;
/// How much wider than expected the poses' errors may spread when the risk of a wrong number is told: nobody knows their
/// spectrum. Chosen over seeds 0..100 of 50 sweeps of the 10 cm sphere, where numbers are least plain.
const RISK_SPREAD: f64 = 1.0;

/// Phases made continuous.
#[derive(Debug, Clone)]
pub(super) struct Unwrapped {
    /// One for each sweep; `None` where it has none.
    pub phases: Vec<Option<Phase>>,
    /// Chance that any whole number is wrong, at most 1.
    pub risk: f64,
}

/// Phases of sweeps in time, made continuous from what is known of the place; `None` where no two join.
pub(super) fn unwrap(all: &[Measured], covariance_m2: &DMat3, errors: &PositionErrors) -> Option<Unwrapped> {
    let mut filter = PathFilter::new(covariance_m2, errors);
    let mut stretch_open = false;
    let mut joins = 0;
    let mut risk = 0.0;
    let mut phase = |one: &Measured| {
        filter.advance(&one.sight);
        let variance_m2 = one.phase_variance_m2?;
        let expected = filter.expect(&one.sight, one.phase_off_m, variance_m2);
        let sigmas = PERIOD_M * 0.5 / expected.variance_m2.sqrt();
        let begins = !(stretch_open && sigmas >= PLAIN_SIGMAS);
        stretch_open = true;
        if begins {
            filter.open_offset();
        } else {
            joins += 1;
            risk += both_tails(sigmas / RISK_SPREAD);
        }
        let whole = if begins { 0.0 } else { (expected.off_m / PERIOD_M).round() };
        let off_m = one.phase_off_m - whole * PERIOD_M;
        filter.take(&one.sight, true, off_m, variance_m2);
        Some(Phase { off_m, variance_m2, begins })
    };
    let phases = all.iter().map(&mut phase).collect();
    (joins > 0).then_some(Unwrapped { phases, risk: risk.min(1.0) })
}

/// Share of a normal distribution beyond ± so many sigmas, from 2 on, a little above the true one.
fn both_tails(sigmas: f64) -> f64 {
    (2.0 / std::f64::consts::PI).sqrt() / sigmas * (-0.5 * sigmas * sigmas).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_are_those_of_the_normal_distribution() {
        for (sigmas, share) in [(2.0, 0.0455), (3.0, 0.0027), (4.0, 6.33e-5)] {
            assert!((1.0..1.2).contains(&(both_tails(sigmas) / share)), "{sigmas}: {}", both_tails(sigmas));
        }
    }
}

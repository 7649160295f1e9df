//! Following the phase from sweep to sweep: which whole number of half wavelengths each one hides.
//!
//! A filter that starts from what the ranges say of the place, and then hears phases alone, expects each next phase. Where
//! it expects it to well within half a wavelength the whole number is plain; where not, a new stretch with a new offset
//! begins. Ranges are not heard again here: they went into the start already.

use glam::{DMat3, DVec3};

use super::PositionErrors;
use super::path_filter::PathFilter;
use super::sights::{Measured, Unwrapped};
use crate::radar::WAVELENGTH_M;

/// The phase repeats with this length.
const PERIOD_M: f64 = WAVELENGTH_M * 0.5;
/// A whole number is plain when half a period is this many sigmas: wrong once in 60 000.
const PLAIN_SIGMAS: f64 = 4.0;

/// Phases made continuous, one for each sweep; `None` where a sweep has none, or nothing joins. `moved_m`: from where the
/// ranges put the place to where the sights were taken.
pub(super) fn unwrap(
    all: &[Measured],
    moved_m: DVec3,
    ranged_covariance_m2: &DMat3,
    errors: &PositionErrors,
) -> Option<Vec<Option<Unwrapped>>> {
    let mut filter = PathFilter::new(ranged_covariance_m2, errors);
    let mut stretch_open = false;
    let mut joins = 0;
    let unwrapped = all
        .iter()
        .map(|one| {
            filter.advance(&one.sight);
            let variance_m2 = one.phase_variance_m2?;
            // The filter's place is relative to that of the ranges.
            let relative_m = one.phase_off_m + one.sight.toward.dot(moved_m);
            let expected = filter.expect(&one.sight, true, relative_m, variance_m2);
            let plain = expected.variance_m2.sqrt() * PLAIN_SIGMAS <= PERIOD_M * 0.5;
            let begins = !(stretch_open && plain);
            let whole = if begins { 0.0 } else { (expected.off_m / PERIOD_M).round() };
            if begins {
                filter.open_offset();
            }
            stretch_open = true;
            joins += usize::from(!begins);
            let hidden_m = whole * PERIOD_M;
            filter.take(&one.sight, true, relative_m - hidden_m, variance_m2);
            Some(Unwrapped { off_m: one.phase_off_m - hidden_m, variance_m2, begins })
        })
        .collect();
    (joins > 0).then_some(unwrapped)
}

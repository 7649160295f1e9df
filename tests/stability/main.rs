//! Numerical stability: every result finite, every fast path at its slow definition within the tolerance that its
//! documentation states, whatever the sweeps are.
//!
//! Quick (some seconds): `cargo test --release --test stability`. Long (minutes: more seeds and sweeps, a million sweeps
//! through the rolling image): `RADAR_CHAPERONE_LONG=1 cargo test --release --test stability`.
//! Each check is a table of cases × paths of the sensor; a failure names both, the place, the value and the oracle's.
mod backprojection;
mod cases;
mod refine;
mod rolling;
mod streams;
mod subaperture;

/// Whether the long suite is asked for.
fn long() -> bool {
    std::env::var_os("RADAR_CHAPERONE_LONG").is_some_and(|value| value != "0")
}

/// The first in the quick suite, the second in the long one.
fn quick_or_long<T>(quick: T, thorough: T) -> T {
    if long() { thorough } else { quick }
}

/// Whether a value is a number and as near to the exact one as allowed.
fn agrees(value: f64, exact: f64, allowed: f64) -> bool {
    (value - exact).abs() <= allowed
}

//! Numerical stability: every result is finite and every fast path agrees with its slow definition
//! within the documented tolerance, whatever the sweeps are.
//!
//! Quick (seconds): `cargo test --release -p radar-mapping --test stability`. With
//! `RADAR_CHAPERONE_LONG=1` minutes: more seeds and sweeps.
//!
//! Each check is a table of cases × sensor paths. A failure names both, the position, the value and
//! the oracle's value.
mod backprojection;
mod cases;
mod refine;
mod streams;
mod subaperture;

/// Whether the long suite is requested.
fn long() -> bool {
    std::env::var_os("RADAR_CHAPERONE_LONG").is_some_and(|value| value != "0")
}

/// The first value in the quick suite, the second in the long one.
fn quick_or_long<T>(quick: T, thorough: T) -> T {
    if long() { thorough } else { quick }
}

/// Whether a value is finite and within the tolerance of the exact one. False for NaN.
fn agrees(value: f64, exact: f64, allowed: f64) -> bool {
    (value - exact).abs() <= allowed
}

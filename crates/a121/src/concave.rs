//! Maximum of a concave function of one variable.

/// Maximises a concave function by ternary search.
pub(super) fn maximise_concave(value: impl Fn(f64) -> f64, low: f64, high: f64) -> f64 {
    ternary_search(value, low, high, 50)
}

/// The same with this number of rounds, each of which narrows the interval to two thirds.
pub(super) fn ternary_search(value: impl Fn(f64) -> f64, mut low: f64, mut high: f64, rounds: usize) -> f64 {
    for _ in 0..rounds {
        let third = (high - low) / 3.0;
        match value(low + third) < value(high - third) {
            true => low += third,
            false => high -= third,
        }
    }
    0.5 * (low + high)
}

//! Cubic (four-point Lagrange) interpolation in a table. At the ends the four points stay within
//! the table, so the outer intervals use the nearest four.

/// Index of the first of the four table entries around `at` (a fractional index within 0..=len−1),
/// and `at` relative to it. Needs `len ≥ 4`.
#[inline(always)]
pub(super) fn four_around(at: f64, len: usize) -> (usize, f64) {
    let first = (at.floor() as isize - 1).clamp(0, len as isize - 4) as usize;
    (first, at - first as f64)
}

/// Lagrange weights at `u` of four points at 0, 1, 2, 3.
#[inline(always)]
pub(super) fn weights(u: f64) -> [f64; 4] {
    let (a, b, c, d) = (u, u - 1.0, u - 2.0, u - 3.0);
    [-b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0]
}

/// Derivatives of the weights with respect to `u`.
pub(super) fn weight_slopes(u: f64) -> [f64; 4] {
    let (a, b, c, d) = (u, u - 1.0, u - 2.0, u - 3.0);
    [
        -(c * d + b * d + b * c) / 6.0,
        (c * d + a * d + a * c) / 2.0,
        -(b * d + a * d + a * b) / 2.0,
        (b * c + a * c + a * b) / 6.0,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubics_are_exact_with_their_slopes() {
        let f = |x: f64| 2.0 - x + 0.5 * x * x - 0.25 * x * x * x;
        let slope = |x: f64| -1.0 + x - 0.75 * x * x;
        let table: Vec<f64> = (0..7).map(|n| f(f64::from(n))).collect();
        for i in 0..=60 {
            let at = f64::from(i) * 0.1;
            let (first, u) = four_around(at, table.len());
            let sum = |w: [f64; 4]| (0..4).map(|k| w[k] * table[first + k]).sum::<f64>();
            assert!((sum(weights(u)) - f(at)).abs() < 1e-12);
            assert!((sum(weight_slopes(u)) - slope(at)).abs() < 1e-11);
        }
    }
}

//! Two reflectors with overlapping pulses in one sweep: both amplitudes free, both ranges to be
//! estimated.
//!
//! With unit-energy templates at d₁ and d₂, correlated by ρ = exp(−2 ln2 (d₁ − d₂)²/w²), the best
//! amplitudes are a = C⁻¹z, C = [[1, ρ], [ρ, 1]], and they explain the power zᴴC⁻¹z. Where the
//! ranges are nearly equal, only the sum of both is determined. A ridge, the noise over the
//! available power, keeps the difference from being fitted to noise.

use num_complex::Complex64;

use crate::math;

/// One sweep's measurement of two ranges.
#[derive(Debug, Clone, Copy)]
pub(super) struct JointReading {
    /// Explained power, in units of the noise, minus what noise alone would give.
    pub excess: f64,
    /// Derivatives of the explained power with respect to both ranges, per metre.
    pub slope_per_m: [f64; 2],
    /// Information on both ranges with unknown amplitudes: the diagonal (proportional to each
    /// amplitude's power), and the off-diagonal terms.
    pub information_per_m2: [[f64; 2]; 2],
    /// Amplitudes, in units of the noise.
    pub amplitudes: [Complex64; 2],
    /// Variance of an amplitude.
    pub amplitude_variance: f64,
    /// The information for the true amplitudes: it is lower than that of the noisy ones.
    pub true_information_per_m2: [[f64; 2]; 2],
}

/// `echoes`: distance, z/σ and its derivative at each of two points; `width_m`: the envelope's
/// FWHM.
pub(super) fn joint_reading(echoes: &[(f64, Complex64, Complex64); 2], width_m: f64, ridge: f64) -> JointReading {
    let [(d1, z1, slope1), (d2, z2, slope2)] = *echoes;
    let apart_m = d1 - d2;
    // Minus the curvature of ρ at 0.
    let c = 4.0 * std::f64::consts::LN_2 / (width_m * width_m);
    let rho = math::exp(-0.5 * c * apart_m * apart_m);
    let rho_slope = -c * apart_m * rho;
    let rho_curvature = (c * c * apart_m * apart_m - c) * rho;
    let own = 1.0 + ridge;
    let determinant = own * own - rho * rho;
    let amplitudes = [(z1 * own - z2 * rho) / determinant, (z2 * own - z1 * rho) / determinant];
    let [a1, a2] = amplitudes;
    let explained = (z1.conj() * a1 + z2.conj() * a2).re;
    let by_noise = (1.0 + rho) / (own + rho) + (1.0 - rho) / (own - rho);
    let cross = 2.0 * rho_slope * (a1.conj() * a2).re;
    let lost = rho_slope * rho_slope / determinant;
    let kept = (c - own * lost).max(0.0);
    let shared = -rho_curvature - rho * lost;
    let shared = shared.clamp(-kept, kept);
    let between = 2.0 * shared * (a1.conj() * a2).re;
    // Amplitude noise has covariance C⁻¹: it adds to the amplitudes' powers and, negatively, to
    // their product.
    let amplitude_variance = own / determinant;
    let true_power = |a: Complex64| (a.norm_sqr() - amplitude_variance).max(0.0);
    let true_between = 2.0 * shared * ((a1.conj() * a2).re + rho / determinant);
    JointReading {
        excess: explained - by_noise,
        slope_per_m: [2.0 * (a1.conj() * slope1).re - cross, 2.0 * (a2.conj() * slope2).re + cross],
        information_per_m2: [[2.0 * kept * a1.norm_sqr(), between], [between, 2.0 * kept * a2.norm_sqr()]],
        amplitudes,
        amplitude_variance,
        true_information_per_m2: [
            [2.0 * kept * true_power(a1), true_between],
            [true_between, 2.0 * kept * true_power(a2)],
        ],
    }
}

/// Solves a symmetric positive definite system of six in place by elimination; `None` when it is
/// singular.
pub(super) fn solve_six(mut matrix: [[f64; 6]; 6], mut right: [f64; 6]) -> Option<[f64; 6]> {
    for col in 0..6 {
        let pivot = matrix[col];
        if !(pivot[col] > 0.0 && pivot[col].is_finite()) {
            return None;
        }
        for row in col + 1..6 {
            let factor = matrix[row][col] / pivot[col];
            for (value, above) in matrix[row][col..].iter_mut().zip(&pivot[col..]) {
                *value -= factor * above;
            }
            right[row] -= factor * right[col];
        }
    }
    for col in (0..6).rev() {
        let known: f64 = (col + 1..6).map(|k| matrix[col][k] * right[k]).sum();
        right[col] = (right[col] - known) / matrix[col][col];
    }
    Some(right)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH_M: f64 = 0.14;

    /// z and its slope at a distance, for two unit-energy pulses without noise.
    fn echo(at_m: f64, pulses: [(f64, Complex64); 2]) -> (f64, Complex64, Complex64) {
        let c = 4.0 * std::f64::consts::LN_2 / (WIDTH_M * WIDTH_M);
        let rho = |x: f64| (-0.5 * c * x * x).exp();
        let z = pulses.iter().map(|(d, a)| a * rho(at_m - d)).sum();
        let slope = pulses.iter().map(|(d, a)| a * (-c * (at_m - d) * rho(at_m - d))).sum();
        (at_m, z, slope)
    }

    fn pulses() -> [(f64, Complex64); 2] {
        [(1.00, Complex64::from_polar(20.0, 0.4)), (1.06, Complex64::from_polar(14.0, 2.1))]
    }

    fn at(d1: f64, d2: f64) -> JointReading {
        joint_reading(&[echo(d1, pulses()), echo(d2, pulses())], WIDTH_M, 1e-9)
    }

    #[test]
    fn at_the_truth_the_amplitudes_are_found_and_the_slopes_vanish() {
        let here = at(1.00, 1.06);
        assert!(
            (here.amplitudes[0] - pulses()[0].1).norm() < 1e-6 && (here.amplitudes[1] - pulses()[1].1).norm() < 1e-6
        );
        assert!(here.slope_per_m.iter().all(|s| s.abs() < 1e-3), "{here:?}");
        assert!(here.excess > at(1.01, 1.06).excess && here.excess > at(1.00, 1.05).excess);
    }

    #[test]
    fn slopes_and_information_are_derivatives() {
        let step = 1e-5;
        let by_steps = |d1: f64, d2: f64, first: bool| {
            let (e1, e2) = if first { (step, 0.0) } else { (0.0, step) };
            (at(d1 + e1, d2 + e2).excess - at(d1 - e1, d2 - e2).excess) / (2.0 * step)
        };
        let here = at(1.012, 1.055);
        for (slope, first) in here.slope_per_m.into_iter().zip([true, false]) {
            let expected = by_steps(1.012, 1.055, first);
            assert!((slope - expected).abs() < 1e-3 * expected.abs().max(1.0), "{slope} {expected}");
        }
        // At the truth the information equals minus the second derivative.
        let truth = at(1.00, 1.06);
        let second = (at(1.00 + step, 1.06).slope_per_m[0] - at(1.00 - step, 1.06).slope_per_m[0]) / (2.0 * step);
        assert!((truth.information_per_m2[0][0] / -second - 1.0).abs() < 1e-3, "{second} {truth:?}");
        let mixed = (at(1.00, 1.06 + step).slope_per_m[0] - at(1.00, 1.06 - step).slope_per_m[0]) / (2.0 * step);
        assert!((truth.information_per_m2[0][1] / -mixed - 1.0).abs() < 1e-3, "{mixed} {truth:?}");
    }

    #[test]
    fn six_equations_are_solved() {
        let mut matrix = [[0.0; 6]; 6];
        for (row, values) in matrix.iter_mut().enumerate() {
            for (col, value) in values.iter_mut().enumerate() {
                *value = if row == col { 8.0 + row as f64 } else { 1.0 / (1.0 + (row + col) as f64) };
            }
        }
        let wanted = [1.0, -2.0, 3.0, 0.5, -0.25, 4.0];
        let right = matrix.map(|row| row.iter().zip(&wanted).map(|(a, b)| a * b).sum());
        let solved = solve_six(matrix, right).unwrap();
        assert!(solved.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 1e-12));
        assert_eq!(solve_six([[0.0; 6]; 6], [0.0; 6]), None);
    }
}

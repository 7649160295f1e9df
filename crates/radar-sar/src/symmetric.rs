//! Symmetric matrices: products of a vector with itself, and the inverse of a possibly singular matrix by its eigenvectors
//! (Jacobi rotations).
//!
//! Cofactors lose the small part of nearly singular matrices: ranges known to 0.01 mm next to
//! directions known to 100 m cancel to arbitrary values, even negative variances. Eigenvalues are
//! accurate to rounding relative to the greatest, and values below the floor count as 0. The
//! inverse is positive definite for any input.

use glam::{DMat3, DVec3};

use crate::math;

/// Choice: rotations converge quadratically, four or five rounds suffice.
const ROUNDS: usize = 12;

/// (m + floor·1)⁻¹ of a symmetric matrix whose eigenvalues are non-negative up to rounding; `floor`
/// above 0.
pub(super) fn inverse_above(m: &DMat3, floor: f64) -> DMat3 {
    let (values, vectors) = eigen(m);
    (0..3).fold(DMat3::ZERO, |sum, n| sum + outer(vectors.col(n)) * (1.0 / (values[n].max(0.0) + floor)))
}

/// v·vᵀ: information or covariance along v alone.
pub fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

/// Eigenvalues of a symmetric matrix and, in the same order, eigenvectors as columns.
pub fn eigen(m: &DMat3) -> ([f64; 3], DMat3) {
    let mut a = (*m + m.transpose()) * 0.5;
    let mut vectors = DMat3::IDENTITY;
    for _ in 0..ROUNDS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = a.col(p)[q];
            if off == 0.0 {
                continue;
            }
            // The smaller of the two angles that zero the element.
            let ratio = (a.col(q)[q] - a.col(p)[p]) / (2.0 * off);
            let tan = ratio.signum() / (ratio.abs() + math::hypot(ratio, 1.0));
            let cos = 1.0 / math::hypot(tan, 1.0);
            let mut turn = DMat3::IDENTITY;
            turn.col_mut(p)[p] = cos;
            turn.col_mut(q)[q] = cos;
            turn.col_mut(q)[p] = cos * tan;
            turn.col_mut(p)[q] = -cos * tan;
            a = turn.transpose() * a * turn;
            vectors *= turn;
        }
    }
    ([a.x_axis.x, a.y_axis.y, a.z_axis.z], vectors)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_known_very_differently_keep_their_variances() {
        let along = DVec3::new(1.0, -0.25, -10.0).normalize();
        let (across, third) = along.any_orthonormal_pair();
        let axes = DMat3::from_cols(along, across, third);
        let of = |values: DVec3| axes * DMat3::from_diagonal(values) * axes.transpose();
        let inverse = inverse_above(&of(DVec3::new(7e9, 1.0, 0.0)), 1e-3);
        let variance = |v: DVec3| v.dot(inverse * v);
        assert!((variance(along) * 7e9 - 1.0).abs() < 1e-3, "{}", variance(along));
        assert!((variance(across) * 1.001 - 1.0).abs() < 1e-3, "{}", variance(across));
        assert!((variance(third) * 1e-3 - 1.0).abs() < 1e-2, "{}", variance(third));
        let easy = of(DVec3::new(3.0, 2.0, 5.0));
        assert!((inverse_above(&easy, 1e-15) * easy).abs_diff_eq(DMat3::IDENTITY, 1e-12));
    }

    #[test]
    fn singular_matrices_are_inverted_with_the_floor() {
        assert!(inverse_above(&DMat3::ZERO, 1e-12).abs_diff_eq(DMat3::IDENTITY * 1e12, 1.0));
        let ones = DMat3::from_cols(DVec3::ONE, DVec3::ONE, DVec3::ONE);
        let inverse = inverse_above(&ones, 1e-8);
        assert!((DVec3::ONE.dot(inverse * DVec3::ONE) - 1.0).abs() < 1e-6);
        assert!((DVec3::new(1.0, -1.0, 0.0).dot(inverse * DVec3::new(1.0, -1.0, 0.0)) * 0.5e-8 - 1.0).abs() < 1e-6);
    }
}

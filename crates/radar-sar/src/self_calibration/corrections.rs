//! The corrections that all tracks share, and quadratic functions of them.

use super::normal_equations::{Factor, NormalEquations};

/// Number of corrections, in this order: time offset, seconds; shift of the sensor along its own x, y and z axes, metres;
/// range bias, metres.
pub(super) const CORRECTIONS: usize = 5;
/// Index of the time offset.
pub(super) const OFFSET: usize = 0;
/// Index of the first of the three shifts.
pub(super) const SHIFT: usize = 1;
/// Index of the range bias.
pub(super) const BIAS: usize = 4;

pub(super) type Corrections = [f64; CORRECTIONS];
pub(super) type Matrix<const N: usize = CORRECTIONS> = [[f64; N]; N];

/// Matrix times vector.
pub(super) fn product<const N: usize>(matrix: &Matrix<N>, vector: &[f64; N]) -> [f64; N] {
    matrix.map(|row| dot(&row, vector))
}

pub(super) fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Second-order approximation of a log likelihood: gradient − matrix · step is the gradient after a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Quadratic<const N: usize = CORRECTIONS> {
    /// Information: minus the second derivatives.
    pub matrix: Matrix<N>,
    /// First derivatives.
    pub gradient: [f64; N],
}

impl<const N: usize> Default for Quadratic<N> {
    fn default() -> Self {
        Self { matrix: [[0.0; N]; N], gradient: [0.0; N] }
    }
}

impl<const N: usize> Quadratic<N> {
    /// The same, seen from corrections that lie a step away.
    pub fn after(&self, step: &[f64; N]) -> Self {
        let change = product(&self.matrix, step);
        Self { gradient: std::array::from_fn(|k| self.gradient[k] - change[k]), ..*self }
    }

    pub fn add(&mut self, other: &Self, weight: f64) {
        for (row, other) in self.matrix.iter_mut().zip(&other.matrix) {
            row.iter_mut().zip(other).for_each(|(sum, value)| *sum += weight * value);
        }
        self.gradient.iter_mut().zip(&other.gradient).for_each(|(sum, value)| *sum += weight * value);
    }

    /// Adds a Gaussian prior on one correction: its mean minus the present value, and its 1σ.
    pub fn expect(&mut self, index: usize, residual: f64, sigma: f64) {
        let weight = 1.0 / (sigma * sigma);
        self.matrix[index][index] += weight;
        self.gradient[index] += weight * residual;
    }

    /// The factor of the matrix; `None` when it does not determine every correction.
    pub fn factor(&self) -> Option<Factor> {
        let mut normal = NormalEquations::new(N);
        for (i, row) in self.matrix.iter().enumerate() {
            row[..=i].iter().enumerate().for_each(|(j, value)| normal.add_entry(i, j, *value));
        }
        normal.factor(0.0)
    }

    /// What is left when one correction is not shared but has an error of its own, of this 1σ: that error is eliminated.
    /// An infinite one leaves nothing of that correction.
    pub fn without(&self, index: usize, sigma: f64) -> Self {
        let pivot = self.matrix[index][index] + 1.0 / (sigma * sigma);
        // It is not observed, up to rounding; or the error is zero.
        if pivot <= 0.0 || pivot.is_infinite() {
            return *self;
        }
        let row = self.matrix[index];
        Self {
            matrix: std::array::from_fn(|i| std::array::from_fn(|j| self.matrix[i][j] - row[i] * row[j] / pivot)),
            gradient: std::array::from_fn(|i| self.gradient[i] - row[i] * self.gradient[index] / pivot),
        }
    }
}

/// The inverse of a factored matrix.
pub(super) fn inverse<const N: usize>(factor: &Factor) -> Matrix<N> {
    std::array::from_fn(|k| {
        let unit: [f64; N] = std::array::from_fn(|j| if j == k { 1.0 } else { 0.0 });
        let column = factor.solve(&unit);
        std::array::from_fn(|j| column[j])
    })
}

/// The solution of a factored system.
pub(super) fn solution<const N: usize>(factor: &Factor, right: &[f64; N]) -> [f64; N] {
    let solved = factor.solve(right);
    std::array::from_fn(|k| solved[k])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_eliminated_correction_leaves_what_a_joint_solution_gives_the_others() {
        let rows = [[1.0, 2.0, 0.5, -1.0, 0.3], [0.2, -1.0, 0.7, 0.4, 1.0], [2.0, 0.1, -0.6, 0.9, -0.2]];
        let mut all = Quadratic::default();
        for (n, row) in rows.iter().enumerate() {
            let matrix = row.map(|a| row.map(|b| a * b));
            all.add(&Quadratic { matrix, gradient: row.map(|a| a * (n as f64 - 0.7)) }, 1.0 + n as f64);
        }
        let with_priors = |mut of: Quadratic| {
            (SHIFT..CORRECTIONS).for_each(|k| of.expect(k, 0.1, 2.0));
            of
        };
        let mut joint = with_priors(all);
        joint.expect(OFFSET, 0.0, 1e6);
        let factor = joint.factor().unwrap();
        let (found, covariance) = (solution(&factor, &joint.gradient), inverse::<CORRECTIONS>(&factor));
        let mut left = with_priors(all.without(OFFSET, f64::INFINITY));
        left.expect(OFFSET, 0.0, 1.0);
        let factor = left.factor().unwrap();
        let (found_left, covariance_left) = (solution(&factor, &left.gradient), inverse::<CORRECTIONS>(&factor));
        for k in SHIFT..CORRECTIONS {
            assert!((found[k] - found_left[k]).abs() < 1e-9, "{found:?} {found_left:?}");
            assert!((covariance[k][k] / covariance_left[k][k] - 1.0).abs() < 1e-9);
        }
        let mut own = <Quadratic>::default();
        own.expect(OFFSET, 1.0, 0.3);
        let with_error = own.without(OFFSET, 0.4);
        assert!((with_error.matrix[OFFSET][OFFSET] - 4.0).abs() < 1e-12, "0.3² + 0.4² = 0.5²");
        assert!((with_error.gradient[OFFSET] - 4.0).abs() < 1e-12, "the optimum stays");
        assert_eq!(own.without(OFFSET, 0.0), own);
        let step = [0.1, -0.2, 0.3, 0.0, 0.5];
        let after = joint.after(&step);
        let found_after = solution(&after.factor().unwrap(), &after.gradient);
        assert!((0..CORRECTIONS).all(|k| (found_after[k] - (found[k] - step[k])).abs() < 1e-12));
    }

    #[test]
    fn undetermined_corrections_have_no_factor() {
        assert!(Quadratic::<CORRECTIONS>::default().factor().is_none());
    }
}

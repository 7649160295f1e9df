//! Normal equations of a few unknowns: accumulated row by row, solved by Cholesky factorisation.
//!
//! The first [`HEAD`] unknowns may enter the model in any way. The others enter it linearly, so the
//! derivatives with respect to them are constant, and their part of the matrix is accumulated once
//! for all iterations.

/// Number of unknowns whose derivatives change between iterations.
pub(super) const HEAD: usize = 4;

/// Σ w j jᵀ and Σ w j r over rows j with residuals r, and Σ w r².
#[derive(Debug, Clone)]
pub(super) struct NormalEquations {
    size: usize,
    /// Row-major; only the lower triangle is filled.
    matrix: Vec<f64>,
    right: Vec<f64>,
    /// Σ w r².
    pub cost: f64,
}

impl NormalEquations {
    /// For at least [`HEAD`] unknowns.
    pub fn new(size: usize) -> Self {
        Self { size, matrix: vec![0.0; size * size], right: vec![0.0; size], cost: 0.0 }
    }

    /// Adds a row, except the part that [`add_rest`](Self::add_rest) adds: derivatives of the model
    /// with respect to the unknowns, measured minus modelled value, weight.
    pub fn add(&mut self, head: &[f64; HEAD], rest: &[f64], residual: f64, weight: f64) {
        let size = self.size;
        for (i, a) in head.iter().enumerate() {
            self.right[i] += weight * a * residual;
            for (sum, b) in self.matrix[i * size..].iter_mut().zip(&head[..=i]) {
                *sum += weight * a * b;
            }
        }
        let rows = self.matrix[HEAD * size..].chunks_exact_mut(size).zip(&mut self.right[HEAD..]);
        for ((row, right), a) in rows.zip(rest) {
            let weighted = weight * a;
            *right += weighted * residual;
            for (sum, b) in row.iter_mut().zip(head) {
                *sum += weighted * b;
            }
        }
        self.cost += weight * residual * residual;
    }

    /// Adds the constant part of a row: the products of the linear unknowns' derivatives.
    pub fn add_rest(&mut self, rest: &[f64], weight: f64) {
        let rows = self.matrix[HEAD * self.size..].chunks_exact_mut(self.size);
        for (i, (row, a)) in rows.zip(rest).enumerate() {
            for (sum, b) in row[HEAD..].iter_mut().zip(&rest[..=i]) {
                *sum += weight * a * b;
            }
        }
    }

    /// Adds a prior on one unknown: its mean minus the current value, and 1/variance.
    pub fn expect(&mut self, unknown: usize, residual: f64, weight: f64) {
        self.matrix[unknown * self.size + unknown] += weight;
        self.right[unknown] += weight * residual;
        self.cost += weight * residual * residual;
    }

    /// The step to the least cost, with the diagonal raised by a share (Levenberg's damping);
    /// `None` when undetermined.
    pub fn step(&self, damping: f64) -> Option<Vec<f64>> {
        let factor = self.factor(damping)?;
        Some(self.back_substituted(&factor, self.right.clone()))
    }

    /// A row of the inverse: the covariances of one unknown with all.
    pub fn inverse_row(&self, unknown: usize) -> Option<Vec<f64>> {
        let factor = self.factor(0.0)?;
        let unit = (0..self.size).map(|n| if n == unknown { 1.0 } else { 0.0 });
        Some(self.back_substituted(&factor, unit.collect()))
    }

    fn factor(&self, damping: f64) -> Option<Vec<f64>> {
        let n = self.size;
        let mut l = self.matrix.clone();
        for i in 0..n {
            l[i * n + i] *= 1.0 + damping;
        }
        for i in 0..n {
            for j in 0..=i {
                let dot: f64 = (0..j).map(|k| l[i * n + k] * l[j * n + k]).sum();
                let rest = l[i * n + j] - dot;
                l[i * n + j] = match i == j {
                    true if rest > 1e-12 * self.matrix[i * n + i] && rest.is_finite() => rest.sqrt(),
                    true => return None,
                    false => rest / l[j * n + j],
                };
            }
        }
        Some(l)
    }

    fn back_substituted(&self, l: &[f64], mut x: Vec<f64>) -> Vec<f64> {
        let n = self.size;
        for i in 0..n {
            let dot: f64 = (0..i).map(|k| l[i * n + k] * x[k]).sum();
            x[i] = (x[i] - dot) / l[i * n + i];
        }
        for i in (0..n).rev() {
            let dot: f64 = (i + 1..n).map(|k| l[k * n + i] * x[k]).sum();
            x[i] = (x[i] - dot) / l[i * n + i];
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_fitted_with_its_covariance() {
        let mut equations = NormalEquations::new(HEAD + 1);
        for x in 0..5 {
            let x = f64::from(x);
            // The constant is in the head, the slope in the rest; the other unknowns are unused.
            equations.add(&[1.0, 0.0, 0.0, 0.0], &[x], 3.0 - 0.5 * x, 4.0);
            equations.add_rest(&[x], 4.0);
        }
        (1..HEAD).for_each(|unused| equations.expect(unused, 0.0, 1.0));
        let step = equations.step(0.0).unwrap();
        assert!((step[0] - 3.0).abs() < 1e-12 && (step[HEAD] + 0.5).abs() < 1e-12);
        // Var(slope) = σ² / Σ(x − x̄)² = 0.25 / 10.
        assert!((equations.inverse_row(HEAD).unwrap()[HEAD] - 0.025).abs() < 1e-12);
    }

    #[test]
    fn undetermined_system_is_refused() {
        let mut equations = NormalEquations::new(HEAD);
        equations.add(&[1.0, 2.0, 0.0, 0.0], &[], 1.0, 1.0);
        equations.add(&[2.0, 4.0, 0.0, 0.0], &[], 1.0, 1.0);
        (2..HEAD).for_each(|unused| equations.expect(unused, 0.0, 1.0));
        assert_eq!(equations.step(0.0), None);
        equations.expect(1, 0.0, 1.0);
        assert!(equations.step(0.0).is_some());
    }
}

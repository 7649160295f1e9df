//! Normal equations of a few unknowns: accumulated row by row, solved by Cholesky factorisation.

/// Σ w j jᵀ and Σ w j r over rows j with residuals r, and Σ w r².
#[derive(Debug, Clone)]
pub(super) struct NormalEquations {
    size: usize,
    /// Row-major; only the lower triangle is filled.
    matrix: Vec<f64>,
    /// Σ w j r: half the cost's gradient, downwards.
    pub right: Vec<f64>,
    /// Σ w r².
    pub cost: f64,
}

/// The Cholesky factor of a matrix.
#[derive(Debug)]
pub(super) struct Factor {
    size: usize,
    /// Row-major lower triangle.
    lower: Vec<f64>,
}

impl NormalEquations {
    pub fn new(size: usize) -> Self {
        Self { size, matrix: vec![0.0; size * size], right: vec![0.0; size], cost: 0.0 }
    }

    /// Adds to an entry on or below the diagonal.
    pub fn add_entry(&mut self, row: usize, column: usize, value: f64) {
        self.matrix[row * self.size + column] += value;
    }

    /// Adds a row: derivatives of the model with respect to the unknowns, measured minus modelled value, weight. The
    /// model is linear in the unknowns of `rest`, which follow those of `head`, so their products with each other are
    /// the same in every iteration: [`Self::add_linear`] adds them, once.
    pub fn add(&mut self, head: &[f64], rest: &[f64], residual: f64, weight: f64) {
        let size = self.size;
        for (i, a) in head.iter().enumerate() {
            self.right[i] += weight * a * residual;
            for (sum, b) in self.matrix[i * size..].iter_mut().zip(&head[..=i]) {
                *sum += weight * a * b;
            }
        }
        let begin = head.len();
        let rows = self.matrix[begin * size..].chunks_exact_mut(size).zip(&mut self.right[begin..]);
        for ((row, right), a) in rows.zip(rest) {
            let weighted = weight * a;
            *right += weighted * residual;
            for (sum, b) in row.iter_mut().zip(head) {
                *sum += weighted * b;
            }
        }
        self.cost += weight * residual * residual;
    }

    /// Adds the products of the linear unknowns' derivatives; the first of them is unknown number `begin`.
    pub fn add_linear(&mut self, begin: usize, rest: &[f64], weight: f64) {
        let rows = self.matrix[begin * self.size..].chunks_exact_mut(self.size);
        for (i, (row, a)) in rows.zip(rest).enumerate() {
            for (sum, b) in row[begin..].iter_mut().zip(&rest[..=i]) {
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

    /// The factor, with the diagonal raised by a share (Levenberg's damping); `None` when the matrix is singular.
    pub fn factor(&self, damping: f64) -> Option<Factor> {
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
        Some(Factor { size: n, lower: l })
    }
}

impl Factor {
    /// Number of unknowns.
    pub fn size(&self) -> usize {
        self.size
    }

    /// The solution for a right side.
    pub fn solve(&self, right: &[f64]) -> Vec<f64> {
        let mut column: Vec<[f64; 1]> = right.iter().map(|value| [*value]).collect();
        self.forward(&mut column);
        self.backward(column.into_iter().map(|[value]| value).collect())
    }

    /// Forward substitution: the first half of a solution, for several right sides side by side.
    pub fn forward<const COLUMNS: usize>(&self, right: &mut [[f64; COLUMNS]]) {
        let (n, l) = (self.size, &self.lower);
        for i in 0..n {
            let (before, rest) = right.split_at_mut(i);
            let mut dot = [0.0; COLUMNS];
            for (factor, row) in l[i * n..].iter().zip(before) {
                dot.iter_mut().zip(row).for_each(|(sum, value)| *sum += factor * *value);
            }
            rest[0].iter_mut().zip(dot).for_each(|(value, dot)| *value = (*value - dot) / l[i * n + i]);
        }
    }

    /// Backward substitution: the second half.
    pub fn backward(&self, mut forward: Vec<f64>) -> Vec<f64> {
        let (n, l, x) = (self.size, &self.lower, &mut forward);
        for i in (0..n).rev() {
            let dot: f64 = (i + 1..n).map(|k| l[k * n + i] * x[k]).sum();
            x[i] = (x[i] - dot) / l[i * n + i];
        }
        forward
    }

    /// Variance of an unknown: its diagonal entry of the inverse.
    pub fn variance(&self, unknown: usize) -> f64 {
        let unit: Vec<f64> = (0..self.size).map(|n| if n == unknown { 1.0 } else { 0.0 }).collect();
        self.solve(&unit)[unknown]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_fitted_with_its_covariance() {
        let mut equations = NormalEquations::new(2);
        for x in 0..5 {
            let x = f64::from(x);
            equations.add(&[1.0], &[x], 3.0 - 0.5 * x, 4.0);
            equations.add_linear(1, &[x], 4.0);
        }
        let factor = equations.factor(0.0).unwrap();
        let step = factor.solve(&equations.right);
        assert!((step[0] - 3.0).abs() < 1e-12 && (step[1] + 0.5).abs() < 1e-12);
        // Var(slope) = σ² / Σ(x − x̄)² = 0.25 / 10.
        assert!((factor.variance(1) - 0.025).abs() < 1e-12);
    }

    #[test]
    fn undetermined_system_is_refused() {
        let mut equations = NormalEquations::new(2);
        equations.add(&[1.0, 2.0], &[], 1.0, 1.0);
        equations.add(&[2.0, 4.0], &[], 1.0, 1.0);
        assert!(equations.factor(0.0).is_none());
        equations.expect(1, 0.0, 1.0);
        assert!(equations.factor(0.0).is_some());
    }
}

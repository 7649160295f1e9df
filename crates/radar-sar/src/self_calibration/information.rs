//! A track's information on the corrections, once its own unknowns are eliminated (Schur complement).

use std::collections::BTreeMap;

use super::corrections::{BIAS, CORRECTIONS, Corrections, Matrix, OFFSET, Quadratic, dot, inverse, product};
use super::normal_equations::NormalEquations;
use super::reflector::REFLECTOR;
use super::track_fit::{Equation, Fitted, PHASE_ERROR_M, Problem};

/// Errors of the derivatives with respect to the corrections, from errors of the poses. The time offset's is a speed:
/// 0.3 mm of jitter in the smoothed path is 8 mm/s (0.23 of it per pose period), m/s. The shifts' is a rotation: 0.1°
/// of slow error, of which half changes within a track. Choice: the first with a margin of nearly two.
const DERIVATIVE_ERRORS: [f64; BIAS] = [15e-3, 1e-3, 1e-3, 1e-3];
/// Residuals within this time are summed when estimating their correlation, nanoseconds. Choice: the
/// window over which poses are smoothed, within which their errors are alike.
const CORRELATION_NS: i64 = 100_000_000;
/// Corrections that matter: 1 ms, and 3 mm. Choice: an echo is misplaced by less at 1 m/s. They weigh the
/// corrections against each other.
const RELEVANT: Corrections = [1e-3, 3e-3, 3e-3, 3e-3, 3e-3];
/// The slow error of a track is taken as the tracking's when this share of its phases is unwrapped, with this rms
/// residual, metres. Choice: a body that sways or two interfering parts lose the phase, or leave more than λ/8 of it.
const COHERENT_SHARE: f64 = 0.8;
const COHERENT_RMS_M: f64 = 0.6e-3;

/// A track's log likelihood near the corrections that it was fitted for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Information {
    pub quadratic: Quadratic,
    /// Factor by which misfit and correlation of the residuals increase the variance; at least 1.
    pub variance_factor: f64,
    /// Power of the drift relative to its prior, and how many of its unknowns the track observes (MacKay 1992, Neural
    /// Computation 4:415, eq. 4.9); `None` where it may be another error.
    pub drift: Option<(f64, f64)>,
    /// Middle of the track, host nanoseconds.
    pub middle_ns: i64,
    /// χ² of the residuals, and their number.
    pub residuals: (f64, f64),
}

impl Information {
    pub fn of(problem: &Problem, fit: &Fitted) -> Option<Self> {
        let equations = problem.equations(&fit.explanation, &fit.weights, &fit.segments);
        let normal = problem.normal_equations_at(fit, &equations);
        let factor = normal.factor(0.0)?;
        let eliminated = cross_products(&equations, &normal).map(|column| factor.solve(&column));
        let remaining: Vec<Corrections> = equations.iter().map(|e| remaining(e, &eliminated)).collect();
        let mut quadratic = quadratic(&equations, &remaining);
        // Convergence is never complete: what is left of the own unknowns' gradient.
        for (gradient, own) in quadratic.gradient.iter_mut().zip(&eliminated) {
            *gradient -= own.iter().zip(&normal.right).map(|(a, b)| a * b).sum::<f64>();
        }
        let ranges = fit.weights.iter().filter(|weight| **weight > 0.0).count();
        let squares = |of: &[Equation]| of.iter().map(|e| e.weight * e.residual_m * e.residual_m).sum::<f64>();
        let (by_range, by_phase) = (squares(&equations[..ranges]), squares(&equations[ranges..]));
        let count = equations.len() as f64;
        let misfit = ((by_range + by_phase) / (count - 4.0)).max(1.0);
        let correlated = correlation(&quadratic.matrix, &pulls(&equations, &remaining));
        let weight = equations.iter().map(|e| e.weight).sum();
        let phases = (equations.len() - ranges) as f64;
        let is_coherent = phases >= COHERENT_SHARE * problem.track.rows.len() as f64
            && PHASE_ERROR_M * (by_phase / phases.max(1.0)).sqrt() <= COHERENT_RMS_M;
        let drift = || {
            let basis = &problem.track.basis;
            let of_function = |k: usize| {
                let prior = basis.prior_variance(k, problem.drift_scale);
                let weight = fit.explanation.slow_error[k];
                (weight * weight / prior, 1.0 - factor.variance(REFLECTOR + k) / prior)
            };
            (0..basis.functions()).map(of_function).fold((0.0, 0.0), |sum, of| (sum.0 + of.0, sum.1 + of.1))
        };
        Some(Self {
            quadratic: without_pose_errors(quadratic, weight),
            variance_factor: misfit * correlated,
            drift: is_coherent.then(drift),
            middle_ns: problem.track.first_ns + (problem.track.last_ns - problem.track.first_ns) / 2,
            residuals: (by_range + by_phase, count),
        })
    }
}

/// Products of each correction's derivatives with those of the track's own unknowns.
fn cross_products(equations: &[Equation], normal: &NormalEquations) -> [Vec<f64>; CORRECTIONS] {
    let mut cross = std::array::from_fn(|_| vec![0.0; normal.right.len()]);
    for e in equations {
        for (column, derivative) in cross.iter_mut().zip(&e.corrections) {
            let weighted = e.weight * derivative;
            let own = e.reflector.iter().chain(e.slow_error);
            column.iter_mut().zip(own).for_each(|(sum, own)| *sum += weighted * own);
        }
    }
    cross
}

/// Derivatives with respect to the corrections, without what the own unknowns can take over.
fn remaining(e: &Equation, eliminated: &[Vec<f64>; CORRECTIONS]) -> Corrections {
    std::array::from_fn(|k| {
        let own = e.reflector.iter().chain(e.slow_error);
        e.corrections[k] - eliminated[k].iter().zip(own).map(|(a, b)| a * b).sum::<f64>()
    })
}

fn quadratic(equations: &[Equation], remaining: &[Corrections]) -> Quadratic {
    let mut sum = Quadratic::default();
    for (e, remaining) in equations.iter().zip(remaining) {
        for (gradient, derivative) in sum.gradient.iter_mut().zip(&e.corrections) {
            *gradient += e.weight * e.residual_m * derivative;
        }
        for (row, remaining) in sum.matrix.iter_mut().zip(remaining) {
            let weighted = e.weight * remaining;
            row.iter_mut().zip(&e.corrections).for_each(|(sum, derivative)| *sum += weighted * derivative);
        }
    }
    // Symmetric up to rounding.
    let matrix = std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (sum.matrix[i][j] + sum.matrix[j][i])));
    Quadratic { matrix, ..sum }
}

/// The gradient's parts, each summed over a time within which errors are correlated.
fn pulls(equations: &[Equation], remaining: &[Corrections]) -> Vec<Corrections> {
    let mut pulls: BTreeMap<i64, Corrections> = BTreeMap::new();
    for (e, remaining) in equations.iter().zip(remaining) {
        let pull = pulls.entry(e.time_ns.div_euclid(CORRELATION_NS)).or_default();
        pull.iter_mut().zip(remaining).for_each(|(sum, own)| *sum += e.weight * e.residual_m * own);
    }
    pulls.into_values().collect()
}

/// By how much the variance of the pulls exceeds that of independent residuals, over the corrections that matter; at
/// least 1.
fn correlation(matrix: &Matrix, pulls: &[Corrections]) -> f64 {
    let mut with_prior = Quadratic { matrix: *matrix, ..Quadratic::default() };
    (0..CORRECTIONS).for_each(|k| with_prior.expect(k, 0.0, RELEVANT[k]));
    let Some(factor) = with_prior.factor() else { return 1.0 };
    let covariance = inverse(&factor);
    let expected: f64 = (0..CORRECTIONS).map(|k| dot(&covariance[k], &matrix[k])).sum();
    let found: f64 = pulls.iter().map(|pull| dot(pull, &product(&covariance, pull))).sum();
    (found / expected.max(1e-12)).max(1.0)
}

/// Changes of a derivative that errors of the poses alone explain carry no information. The rest is what is left when
/// the track has an error of its own in that correction. `weight` is the sum of the equations' weights.
fn without_pose_errors(quadratic: Quadratic, weight: f64) -> Quadratic {
    (OFFSET..BIAS).fold(quadratic, |left, k| {
        let (all, of_errors) = (left.matrix[k][k], DERIVATIVE_ERRORS[k] * DERIVATIVE_ERRORS[k] * weight);
        let own_variance = if of_errors < all { of_errors / (all * (all - of_errors)) } else { f64::INFINITY };
        left.without(k, own_variance.sqrt())
    })
}

//! Slow tracking error along the line of sight: Gaussian basis functions over time, and a strain of the tracking frame.

use glam::DVec3;

use crate::PositionErrors;
use crate::math;

/// T of the drift's correlation exp(−Δt²/T²), in correlation times. Choice: a Gaussian of that
/// width resembles the correlation of the simulated low-pass drift.
const DRIFT_WIDTH: f64 = 0.75;
/// A function is e^(−2x²) at x widths from its middle.
const EXPONENT: f64 = -2.0;
/// Greatest number of basis functions. Choice: bounds the matrix; tracks end at 5 s.
const MAX_FUNCTIONS: usize = 20;
/// Number of unknowns of the strain: change of the error along the line of sight by position.
const STRAIN: usize = 3;
/// 1σ of the strain. Choice: a frame bent by 5 mm over 3 m; published distortions are of centimetres over a room (Bauer
/// 2021).
const STRAIN_SIGMA: f64 = 10e-3;

/// Basis functions over the time of a track, whose random sum has the drift's variance and correlation.
#[derive(Debug, Clone)]
pub(super) struct SlowErrorBasis {
    first_ns: i64,
    spacing_s: f64,
    width_s: f64,
    functions: usize,
    /// See [`math::gaussians`].
    ratio_step: f64,
    /// Prior variance of a function's weight for the errors in the settings, m².
    variance_m2: f64,
}

impl SlowErrorBasis {
    pub fn over(first_ns: i64, last_ns: i64, errors: &PositionErrors) -> Self {
        let span_s = (last_ns - first_ns) as f64 * 1e-9;
        // Drift faster than a seventh of the track acts like noise.
        let width_s = (DRIFT_WIDTH * errors.wander_s).max(span_s / 7.0);
        let spacing_s = width_s / 2.0;
        let functions = (((span_s + 2.0 * width_s) / spacing_s).ceil() as usize + 1).min(MAX_FUNCTIONS);
        // Σ exp(−4u²/T²) over the basis functions is T√π/2 divided by their spacing.
        let variance_m2 = errors.slow_variance_m2() * 2.0 * spacing_s / (width_s * std::f64::consts::PI.sqrt());
        let functions = if variance_m2 > 0.0 { functions } else { 0 };
        let ratio_step = math::gaussian_ratio_step(EXPONENT, spacing_s / width_s);
        let first_ns = first_ns.saturating_sub((width_s * 1e9) as i64);
        Self { first_ns, spacing_s, width_s, functions, ratio_step, variance_m2 }
    }

    /// Number of unknowns: functions and strain.
    pub fn len(&self) -> usize {
        self.functions + STRAIN
    }

    /// Number of functions over time, the first of the unknowns.
    pub fn functions(&self) -> usize {
        self.functions
    }

    /// Values at a time and a position relative to the middle of the path.
    pub fn at(&self, time_ns: i64, position_m: DVec3) -> impl Iterator<Item = f64> {
        let off = time_ns.saturating_sub(self.first_ns) as f64 * 1e-9 / self.width_s;
        // At most nine widths, since these are a seventh of the track or more.
        let functions = math::gaussians(EXPONENT, off, -self.spacing_s / self.width_s, self.ratio_step);
        functions.take(self.functions).chain(position_m.to_array())
    }

    /// Prior variance of the n-th unknown when the drift has this variance relative to the settings'.
    pub fn prior_variance(&self, n: usize, drift_scale: f64) -> f64 {
        if n < self.functions { self.variance_m2 * drift_scale } else { STRAIN_SIGMA * STRAIN_SIGMA }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_those_of_the_gaussians() {
        let basis = SlowErrorBasis::over(0, 5_000_000_000, &PositionErrors::default());
        assert!(basis.functions() > 8);
        for time_ns in [0, 1_234_567_890, 5_000_000_000] {
            for (n, value) in basis.at(time_ns, DVec3::ZERO).take(basis.functions()).enumerate() {
                let off = ((time_ns - basis.first_ns) as f64 * 1e-9 - n as f64 * basis.spacing_s) / basis.width_s;
                assert!((value - math::exp(-2.0 * off * off)).abs() < 1e-13, "{time_ns} {n}: {value}");
            }
        }
    }

    #[test]
    fn a_random_sum_has_the_variance_of_the_drift() {
        let errors = PositionErrors::default();
        let basis = SlowErrorBasis::over(0, 4_000_000_000, &errors);
        for time_ns in [0, 1_300_000_000, 4_000_000_000] {
            let variance_m2: f64 = basis
                .at(time_ns, DVec3::ZERO)
                .enumerate()
                .map(|(n, value)| value * value * basis.prior_variance(n, 1.0))
                .sum();
            let share = variance_m2 / errors.slow_variance_m2();
            assert!((0.95..1.05).contains(&share), "{time_ns}: {share}");
        }
        assert_eq!(SlowErrorBasis::over(0, 1_000_000_000, &PositionErrors::none()).len(), STRAIN);
    }
}

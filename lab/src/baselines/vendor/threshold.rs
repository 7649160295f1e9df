//! Detection thresholds, from the mean and spread of calibration sweeps at each range. Noise grows
//! with the square root of the number of sweeps, in every bin. Stationary echoes (leakage, the
//! robot's own parts) add up in phase, only in bin 0.

use num_complex::Complex64;

use radar_sar::math;

/// Threshold over the noise, standard deviations (source: the vendor's description).
const NOISE_SIGMAS: f64 = 5.0;
/// Additional threshold in bin 0, in means of the stationary echoes (source: the vendor's
/// description).
const STATIC_MEANS: f64 = 2.0;

/// Thresholds of the magnitude of the spectrum.
#[derive(Debug, Clone)]
pub(super) struct Thresholds {
    /// For every bin, `[range]`.
    noise: Vec<f64>,
    /// Additional for bin 0, `[range]`.
    stationary: Vec<f64>,
}

impl Thresholds {
    /// Thresholds from filtered sweeps, `[sweep][range]`, for windows of `window` sweeps.
    pub fn of(sweeps: &[Vec<Complex64>], ranges: usize, window: usize) -> Self {
        let (count, window) = (sweeps.len().max(1) as f64, window as f64);
        let mean = |n: usize| sweeps.iter().map(|sweep| sweep[n]).sum::<Complex64>() / count;
        let means: Vec<Complex64> = (0..ranges).map(mean).collect();
        let variance = |n: usize| sweeps.iter().map(|sweep| (sweep[n] - means[n]).norm_sqr()).sum::<f64>() / count;
        Self {
            noise: (0..ranges).map(|n| NOISE_SIGMAS * variance(n).sqrt() * window.sqrt()).collect(),
            stationary: means.iter().map(|mean| STATIC_MEANS * math::norm(*mean) * window).collect(),
        }
    }

    /// Threshold of a bin at a range.
    pub fn at(&self, bin: usize, range: usize) -> f64 {
        self.noise[range] + if bin == 0 { self.stationary[range] } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stationary_echoes_raise_only_bin_0() {
        let sweeps: Vec<_> =
            [1.0, -1.0].map(|side| vec![Complex64::new(100.0 + 3.0 * side, 4.0 * side), Complex64::ZERO]).into();
        let thresholds = Thresholds::of(&sweeps, 2, 16);
        assert!((thresholds.at(3, 0) - 5.0 * 5.0 * 4.0).abs() < 1e-9);
        assert!((thresholds.at(0, 0) - 100.0 - 2.0 * 100.0 * 16.0).abs() < 1e-9);
        assert_eq!(thresholds.at(0, 1), 0.0);
    }
}

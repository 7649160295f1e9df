//! Detection threshold for a given false-alarm rate: the value that the maximum of a search exceeds
//! once in so many searches of noise.
//!
//! A search takes the maximum of very many dependent values. How many independent values that
//! equals depends on pulse, path, beam and box, and no formula gives it. So the search is run some
//! hundred times on the same sweeps with noise in place of the data ([`noise_like`]). A Gumbel
//! distribution, the limit distribution of maxima, is fitted to the results ([`NoiseMaxima`]). It
//! fits well where the values' tail is exponential. A sum's tail is not, so sums are converted to
//! their surprisal ([`surprisal`]). Values must be in units of each sweep's own noise, which makes
//! them independent of the receiver's gain.

use num_complex::Complex32;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::Observation;
use crate::math;

/// Physics: Euler's constant, a Gumbel distribution's mean minus its mode, in units of its scale.
const EULER: f64 = 0.577_215_664_901_532_9;

/// Sweeps of receiver noise alone, complex rms `rms_lsb`, with the same poses and times.
pub fn noise_like(observations: &[Observation], rms_lsb: f64, seed: u64) -> Vec<Observation> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0xFA15_E0A1);
    let mut part = move || -> f32 {
        let normal: f64 = StandardNormal.sample(&mut rng);
        (normal * rms_lsb / std::f64::consts::SQRT_2) as f32
    };
    let mut noise = |o: &Observation| Observation {
        samples: (0..o.samples.len()).map(|_| Complex32::new(part(), part())).collect(),
        ..o.clone()
    };
    observations.iter().map(&mut noise).collect()
}

/// Surprisal of a sum: −ln of the probability that the sum of `count` |z|² values of noise, each of
/// mean 1, exceeds `sum`. Its tail is exponential. 0 for sums not above 0.
pub fn surprisal(sum: f64, count: usize) -> f64 {
    if !(sum > 0.0 && sum.is_finite()) || count == 0 {
        return 0.0;
    }
    // Tail of a sum of exponentials: e^−x Σ x^k/k! for k < count, in logarithms.
    let mut logarithm = 0.0;
    let logarithms: Vec<f64> = (0..count)
        .map(|k| {
            logarithm += if k > 0 { math::ln(sum / k as f64) } else { 0.0 };
            logarithm
        })
        .collect();
    let greatest = logarithms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let rest: f64 = logarithms.iter().map(|one| math::exp(one - greatest)).sum();
    (sum - greatest - math::ln(rest)).max(0.0)
}

/// The sum with a given surprisal: the inverse of [`surprisal`].
pub fn sum_from_surprisal(surprised: f64, count: usize) -> f64 {
    let (mut low, mut high) = (0.0, 2.0 * (surprised.max(0.0) + count as f64) + 60.0);
    while surprisal(high, count) < surprised && high < 1e12 {
        high *= 2.0;
    }
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if surprisal(middle, count) < surprised { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Gumbel distribution of the maximum of a search of noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseMaxima {
    mode: f64,
    scale: f64,
}

impl NoiseMaxima {
    /// From the maxima of many searches of noise, by their mean and standard deviation; `None`
    /// without two different finite ones. A hundred searches determine the 1 % threshold to about a
    /// fifth of the maxima's spread.
    pub fn of(greatest: &[f64]) -> Option<Self> {
        let finite: Vec<f64> = greatest.iter().copied().filter(|value| value.is_finite()).collect();
        let count = finite.len() as f64;
        let mean = finite.iter().sum::<f64>() / count;
        let variance = finite.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
        let scale = variance.sqrt() * 6f64.sqrt() / std::f64::consts::PI;
        (scale.is_finite() && scale > 0.0).then_some(Self { mode: mean - EULER * scale, scale })
    }

    /// Threshold that the maximum of a search exceeds at a rate strictly between 0 and 1; 0.01 is
    /// once in a hundred searches.
    pub fn threshold(&self, rate: f64) -> f64 {
        self.mode - self.scale * math::ln(-math::ln_1p(-rate))
    }

    /// Rate at which the maximum of a search exceeds a threshold: the inverse of
    /// [`Self::threshold`].
    pub fn rate_above(&self, threshold: f64) -> f64 {
        -math::exp_m1(-math::exp(-(threshold - self.mode) / self.scale))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_data::{sweeps, winding};

    /// Maxima of four hundred independent exponentials each.
    fn greatest(searches: usize, seed: u64) -> Vec<f64> {
        let path = sweeps(0.008, winding, &[], 1);
        let one = |n: usize| {
            let noise = noise_like(&path, 30.0, seed * 10_000 + n as u64);
            noise.iter().flat_map(|o| &o.samples).map(|x| f64::from(x.norm_sqr()) / 900.0).fold(0.0, f64::max)
        };
        (0..searches).map(one).collect()
    }

    #[test]
    fn noise_passes_the_threshold_as_often_as_stated() {
        let maxima = NoiseMaxima::of(&greatest(800, 1)).unwrap();
        let others = greatest(2000, 2);
        // Three standard deviations with 800 searches for calibration and 2000 for measurement.
        for (rate, allowed) in [(0.1, 0.03), (0.01, 0.008)] {
            let threshold = maxima.threshold(rate);
            assert!((maxima.rate_above(threshold) / rate - 1.0).abs() < 1e-9);
            let measured = others.iter().filter(|value| **value > threshold).count() as f64 / 2000.0;
            assert!((measured - rate).abs() < allowed, "{measured} {rate}");
            // Exact for four hundred independent exponentials.
            let exact = -(-(1.0 - rate).powf(1.0 / 400.0)).ln_1p();
            assert!((threshold - exact).abs() < 0.5, "{threshold} {exact}");
        }
    }

    #[test]
    fn surprisal_matches_the_tail_of_a_sum_and_is_invertible() {
        // One value: exponential. Two: (1 + x) e^−x.
        assert!((surprisal(3.0, 1) - 3.0).abs() < 1e-12);
        assert!((surprisal(3.0, 2) - (3.0 - 4f64.ln())).abs() < 1e-12);
        for (sum, count) in [(0.5, 1), (60.0, 50), (120.0, 50), (4000.0, 200), (1e6, 50)] {
            let surprised = surprisal(sum, count);
            assert!((sum_from_surprisal(surprised, count) / sum - 1.0).abs() < 1e-6, "{sum} {count}: {surprised}");
        }
        assert!([f64::NAN, -1.0, f64::INFINITY].iter().all(|sum| surprisal(*sum, 5) == 0.0));
        assert!(surprisal(1.0, 0) == 0.0 && sum_from_surprisal(f64::NAN, 5).is_finite());
    }

    #[test]
    fn noise_like_keeps_poses_and_has_the_requested_power() {
        let path = sweeps(0.1, winding, &[], 1);
        let noise = noise_like(&path, 30.0, 5);
        let power: f64 = noise.iter().flat_map(|o| &o.samples).map(|x| f64::from(x.norm_sqr())).sum();
        assert!((power / 900.0 / (100.0 * 50.0) - 1.0).abs() < 0.05);
        assert_eq!(noise[7].tracking_from_sensor, path[7].tracking_from_sensor);
        assert_ne!(noise[7].samples, noise_like(&path, 30.0, 6)[7].samples);
    }

    #[test]
    fn degenerate_samples_give_no_distribution() {
        for few in [vec![], vec![1.0], vec![2.0; 9], vec![f64::NAN, f64::INFINITY, 1.0]] {
            assert_eq!(NoiseMaxima::of(&few), None, "{few:?}");
        }
    }
}

//! Receiver noise level, estimated from the sweeps themselves.

use num_complex::Complex32;

/// Complex noise rms of one sweep, LSB, from the median of |x|², which is ln 2 · σ². Echoes in a
/// tenth of the points raise it by 8 %. At least 1e-3 LSB, to prevent division by zero.
pub fn sweep_noise_rms(samples: &[Complex32]) -> f64 {
    let mut powers: Vec<f64> = samples.iter().map(power).collect();
    (quantile(&mut powers, 0.5) / std::f64::consts::LN_2).sqrt().max(1e-3)
}

/// Complex noise rms of consecutive sweeps, LSB: the 20 % quantile, over points, of the mean power
/// over sweeps. Valid while at least a fifth of the points is free of echoes. At least 1e-3 LSB.
pub fn subaperture_noise_rms<'a>(sweeps: impl IntoIterator<Item = &'a [Complex32]>) -> f64 {
    let mut sums: Vec<f64> = Vec::new();
    let mut count = 0;
    for samples in sweeps {
        sums.resize(sums.len().max(samples.len()), 0.0);
        for (sum, sample) in sums.iter_mut().zip(samples) {
            *sum += power(sample);
        }
        count += 1;
    }
    if count == 0 {
        return 1e-3;
    }
    // For means of `count` exponentials, the 20 % quantile lies 0.84 standard deviations (1/√count
    // each) below 1.
    let below = 1.0 - 0.84 / f64::from(count).sqrt().max(1.7);
    (quantile(&mut sums, 0.2) / f64::from(count) / below).sqrt().max(1e-3)
}

fn power(sample: &Complex32) -> f64 {
    f64::from(sample.re).powi(2) + f64::from(sample.im).powi(2)
}

/// The given quantile; 0 without values.
fn quantile(values: &mut [f64], share: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let at = ((values.len() - 1) as f64 * share).round() as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn noisy(sigma: f64, echoes: usize, seed: u64) -> Vec<Complex32> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut sample = |n: usize| {
            let echo = if n < echoes { 50.0 * sigma } else { 0.0 };
            Complex32::new((echo + draw() * sigma / 2f64.sqrt()) as f32, (draw() * sigma / 2f64.sqrt()) as f32)
        };
        (0..300).map(&mut sample).collect()
    }

    #[test]
    fn sweep_noise_rms_is_estimated_with_echoes_in_a_tenth_of_the_points() {
        let mean = |echoes| (0..50).map(|seed| sweep_noise_rms(&noisy(40.0, echoes, seed))).sum::<f64>() / 50.0;
        assert!((mean(0) / 40.0 - 1.0).abs() < 0.02, "{}", mean(0));
        // With a tenth of the points in an echo, the median is the 5/9 quantile of the noise.
        let raised = (2.25f64.ln() / 2f64.ln()).sqrt();
        assert!((mean(30) / 40.0 - raised).abs() < 0.02, "{}", mean(30));
        assert_eq!(sweep_noise_rms(&[]), 1e-3);
    }

    #[test]
    fn noise_rms_is_estimated_with_echoes_in_half_of_the_points() {
        let sweeps: Vec<_> = (0..96).map(|seed| noisy(40.0, 150, seed)).collect();
        let rms = subaperture_noise_rms(sweeps.iter().map(Vec::as_slice));
        assert!((rms / 40.0 - 1.0).abs() < 0.05, "{rms}");
        assert_eq!(subaperture_noise_rms([]), 1e-3);
    }
}

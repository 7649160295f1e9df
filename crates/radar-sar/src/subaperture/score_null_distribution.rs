//! Distribution of the sub-aperture score A/√B under noise alone: its upper tail.
//!
//! Under noise, the coherent power of a sub-aperture is exponential. Its divisor, max(1, mean
//! incoherent power), follows from a gamma variable: the fewer the sweeps, the wider its spread,
//! and since it is never below 1, the lower m. The score is a sum of few, far from normal terms, so
//! no table holds its tail. Its cumulants are integrals over one term, and the saddle-point
//! approximation (Lugannani and Rice 1980, Advances in Applied Probability 12:475) gives the tail
//! to some percent of itself at any distance. Not modelled: the noise level is itself estimated
//! from the sub-aperture, to some percent.

use super::MEAN_LOG_OF_NOISE;

use crate::math;

/// Integration steps over ln(1 + m). Choice: Simpson's rule over a smooth function, whose error is
/// far below the approximation's some percent.
const STEPS: usize = 160;
/// Mean of the taper's fourth power; its mean square is 1. Physics: (8/9)² times the mean of (1 −
/// ½cos)⁴, 1.7734.
const TAPER_FOURTH: f64 = 1.401;
/// Quadrature points per σ for the incoherent power, out to 4σ. Choice: the integrand is smooth,
/// and the noise level itself is known to some percent.
const PARTS_OF_SIGMA: i32 = 2;
/// Weights below this share are neglected. Choice: nine decay times, with less than 1e-8 of the
/// score's variance beyond.
const NEGLIGIBLE_SHARE: f64 = 1e-4;

/// Score distribution under noise for a point seen by consecutive sub-apertures of equal length.
#[derive(Debug, Clone)]
pub struct NoiseTail {
    /// Weights of the sub-apertures divided by √B.
    shares: Vec<f64>,
    /// Divisors of the coherent power, and their probabilities.
    divisors: Vec<(f64, f64)>,
}

/// Cumulant generating function, and its first two derivatives.
#[derive(Debug, Clone, Copy, Default)]
struct Cumulants {
    value: f64,
    first: f64,
    second: f64,
}

impl NoiseTail {
    /// For `blocks` sub-apertures of `sweeps` sweeps, one every `period_s`, decaying with
    /// `decay_s`.
    pub fn new(sweeps: f64, blocks: usize, period_s: f64, decay_s: f64) -> Self {
        let weights = (0..blocks).map(|n| math::exp(-(n as f64) * period_s / decay_s));
        let weights: Vec<f64> = weights.take_while(|weight| *weight > NEGLIGIBLE_SHARE).collect();
        let root = weights.iter().map(|weight| weight * weight).sum::<f64>().sqrt();
        Self { shares: weights.iter().map(|weight| weight / root).collect(), divisors: divisors(sweeps) }
    }

    /// Mean and standard deviation of one sub-aperture's term.
    pub fn of_subaperture(&self) -> [f64; 2] {
        let one = self.subaperture_cumulants(0.0);
        [one.first, one.second.sqrt()]
    }

    /// Surprisal: −ln of the probability that noise scores more than `score`. Accurate for scores
    /// that less than a tenth of noise exceeds; 0 for scores not above the mean under noise.
    pub fn surprisal(&self, score: f64) -> f64 {
        let mut sums = self.cumulants(0.0);
        if self.shares.is_empty() || !score.is_finite() || score <= sums.first {
            return 0.0;
        }
        // Solves K′(t) = score by Newton's method, bracketed by a lower and an upper bound.
        let (mut t, mut low, mut high) = (0.0f64, 0.0, f64::INFINITY);
        for _ in 0..60 {
            let off = sums.first - score;
            if off.abs() < 1e-9 {
                break;
            }
            if off < 0.0 {
                low = t
            } else {
                high = t
            }
            let next = t - off / sums.second;
            t = match (next > low && next < high, high.is_finite()) {
                (true, _) => next.min(4.0 * t + 4.0),
                (false, true) => 0.5 * (low + high),
                (false, false) => 2.0 * t + 1.0,
            };
            sums = self.cumulants(t);
        }
        let (far, wide) = ((2.0 * (t * score - sums.value)).max(0.0).sqrt(), t * sums.second.sqrt());
        -ln_tail(far, wide)
    }

    /// The score that noise exceeds with probability e^−surprisal: the inverse of
    /// [`Self::surprisal`].
    pub fn score(&self, surprisal: f64) -> f64 {
        let (mut low, mut high) = (0.0, 1.0);
        while self.surprisal(high) < surprisal && high < 1e3 {
            (low, high) = (high, 2.0 * high);
        }
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if self.surprisal(middle) < surprisal { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    fn cumulants(&self, t: f64) -> Cumulants {
        let of = |sum: Cumulants, share: &f64| {
            let one = self.subaperture_cumulants(t * share);
            Cumulants {
                value: sum.value + one.value,
                first: sum.first + one.first * share,
                second: sum.second + one.second * share * share,
            }
        };
        self.shares.iter().fold(Cumulants::default(), of)
    }

    /// Of ln(1 + m) − 0.596. For power divided by g, u = ln(1 + m) has the density g·e^(u + g −
    /// g·e^u).
    fn subaperture_cumulants(&self, t: f64) -> Cumulants {
        let mut sums = [0.0; 3];
        // The least divisor reaches farthest. Its greatest exponent is factored out to prevent
        // overflow at any t.
        let exponent = |u: f64, g: f64| (1.0 + t) * u + g - g * math::exp(u);
        let middle = math::ln(1.0 + t);
        let greatest = exponent(middle, 1.0);
        let reach = 10.0 / (1.0 + t).sqrt();
        let (from, until) = ((middle - reach).max(0.0), middle + reach.min(4.2));
        let step = (until - from) / STEPS as f64;
        for n in 0..=STEPS {
            let u = from + n as f64 * step;
            let simpson = if n == 0 || n == STEPS { 1.0 } else { 2.0 + 2.0 * (n % 2) as f64 };
            let of_divisor = |(g, chance): &(f64, f64)| chance * g * math::exp(exponent(u, *g) - greatest);
            let weight = simpson * self.divisors.iter().map(of_divisor).sum::<f64>();
            sums = [sums[0] + weight, sums[1] + weight * u, sums[2] + weight * u * u];
        }
        let (mean, square) = (sums[1] / sums[0], sums[2] / sums[0]);
        Cumulants {
            value: math::ln(sums[0] * step / 3.0) + greatest - t * MEAN_LOG_OF_NOISE,
            first: mean - MEAN_LOG_OF_NOISE,
            second: (square - mean * mean).max(1e-12),
        }
    }
}

/// max(1, g), with g the mean incoherent power of so many sweeps: gamma, approximated by Wilson and
/// Hilferty's cube of a normal variable.
fn divisors(sweeps: f64) -> Vec<(f64, f64)> {
    let shape = ((sweeps - 1.0) / TAPER_FOURTH).max(0.5);
    let mut found: Vec<(f64, f64)> = vec![(1.0, 0.0)];
    for n in -4 * PARTS_OF_SIGMA..=4 * PARTS_OF_SIGMA {
        let z = f64::from(n) / f64::from(PARTS_OF_SIGMA);
        let g = (1.0 - 1.0 / (9.0 * shape) + z / (3.0 * shape.sqrt())).powi(3);
        let chance = math::exp(-0.5 * z * z);
        if g <= 1.0 { found[0].1 += chance } else { found.push((g, chance)) }
    }
    let all: f64 = found.iter().map(|(_, chance)| chance).sum();
    found.iter_mut().for_each(|(_, chance)| *chance /= all);
    found
}

/// ln of the Lugannani–Rice tail: Φ(−r) + φ(r)·(1/w − 1/r), with r = `far` and w = `wide`.
fn ln_tail(far: f64, wide: f64) -> f64 {
    let rest = if far > 1e-3 { 1.0 / wide - 1.0 / far } else { 0.0 };
    // In units of the density, to prevent underflow.
    let ln_density = -0.5 * far * far - 0.5 * math::ln(std::f64::consts::TAU);
    (ln_density + math::ln((mills_ratio(far) + rest).max(1e-300))).min(0.0)
}

/// Mills' ratio Φ(−x)/φ(x) for x ≥ 0: a series near 0, a continued fraction beyond.
fn mills_ratio(x: f64) -> f64 {
    if x > 2.5 {
        return 1.0 / (1..=80).rev().fold(x, |below, n| x + f64::from(n) / below);
    }
    // Φ(x) − ½ = φ(x)·(x + x³/3 + x⁵/15 + …)
    let (mut term, mut sum) = (x, x);
    for n in 1..60 {
        term *= x * x / f64::from(2 * n + 1);
        sum += term;
    }
    0.5 * math::exp(0.5 * x * x) * std::f64::consts::TAU.sqrt() - sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Exp1};

    /// So many sweeps that the divisor is exactly 1.
    const MANY: f64 = 1e12;

    #[test]
    fn mean_is_zero_for_many_sweeps_and_negative_for_few() {
        let [mean, sigma] = NoiseTail::new(MANY, 9, 0.09, 1.5).of_subaperture();
        assert!(mean.abs() < 1e-5 && (sigma * sigma - 0.176_301).abs() < 1e-5, "{mean} {sigma}");
        let means = [16.0, 40.0, 96.0].map(|sweeps| NoiseTail::new(sweeps, 9, 0.09, 1.5).of_subaperture()[0]);
        assert!(means[0] < means[1] && means[1] < means[2] && means[2] < -0.01 && means[0] > -0.1, "{means:?}");
    }

    #[test]
    fn single_subaperture_matches_exact_tail() {
        let tail = NoiseTail::new(MANY, 1, 0.09, 1.5);
        for score in [1.0, 1.5, 2.0, 2.5, 4.0] {
            // P(ln(1 + m) > y) = e^−(e^y − 1)
            let exact = (score + MEAN_LOG_OF_NOISE).exp() - 1.0;
            assert!((tail.surprisal(score) - exact).abs() < 0.05, "{score}: {} {exact}", tail.surprisal(score));
        }
    }

    #[test]
    fn draws_exceed_scores_as_often_as_stated() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        for (sweeps, blocks, draws) in [(12, 4, 60_000), (40, 25, 10_000)] {
            let tail = NoiseTail::new(f64::from(sweeps), blocks, 0.09, 1.5);
            // Plain means of independent powers, as many as give the same spread as the tapered
            // ones.
            let others = (f64::from(sweeps - 1) / TAPER_FOURTH).round() as usize;
            let mut power = || -> f64 { Exp1.sample(&mut rng) };
            let mut draw = || -> f64 {
                let mut m = || {
                    let rest = (0..others).map(|_| power()).sum::<f64>() / others as f64;
                    power() / rest.max(1.0)
                };
                tail.shares.iter().map(|share| share * (m().ln_1p() - MEAN_LOG_OF_NOISE)).sum()
            };
            let scores: Vec<f64> = (0..draws).map(|_| draw()).collect();
            for chance in [0.1f64, 0.01, 1e-3] {
                let expected = chance * f64::from(draws);
                let threshold = tail.score(-chance.ln());
                let above = scores.iter().filter(|score| **score > threshold).count() as f64;
                // Three standard deviations of the count, and the approximation's few percent.
                let allowed = 3.0 * expected.sqrt() + 0.04 * expected;
                assert!((above - expected).abs() < allowed, "{sweeps} {blocks}: {above} {expected}");
            }
        }
    }

    #[test]
    fn surprisal_is_invertible_and_handles_degenerate_input() {
        let tail = NoiseTail::new(40.0, 45, 0.09, 1.5);
        for score in [0.5, 2.5, 5.0, 12.0] {
            assert!((tail.score(tail.surprisal(score)) - score).abs() < 1e-6, "{score}");
        }
        assert!(tail.surprisal(12.0) > tail.surprisal(5.0) && tail.surprisal(5.0) > 20.0);
        assert_eq!([f64::NAN, f64::INFINITY, -1.0].map(|score| tail.surprisal(score)), [0.0; 3]);
        assert_eq!(NoiseTail::new(40.0, 0, 0.09, 1.5).surprisal(3.0), 0.0);
        assert!(NoiseTail::new(0.0, 5, 0.09, 1.5).surprisal(3.0).is_finite());
    }
}

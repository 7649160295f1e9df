//! The beam's amplitude over the cosine to the boresight, in the form that kernels look up.

use std::sync::{Arc, OnceLock};

use crate::Beam;
use crate::math;
use crate::simd::Lanes;

/// Table steps over cosines −1 to 1. Choice: linear interpolation is within 1e-4 of every named
/// beam.
const STEPS: usize = 4096;

/// A(cos) between −1 and 1, and the cosine at which the beam is cut off.
#[derive(Debug, Clone)]
pub struct BeamTable {
    /// Points at a smaller cosine are out of the beam.
    pub cut_cos: f32,
    /// Every point within the cut is in the beam; otherwise an amplitude of 0 is out of the beam
    /// too.
    pub solid: bool,
    /// The amplitude is the same everywhere, so no lookup is needed.
    pub uniform: bool,
    /// A at `index · 2 / STEPS − 1`. Beyond the cut the amplitude is continued, so that
    /// interpolation next to it is correct.
    pub amplitudes: Vec<f32>,
    /// A as a polynomial, where that is accurate enough.
    pub(super) polynomial: Option<Polynomial>,
}

/// A between the cut and the axis as a polynomial, without a lookup.
#[derive(Debug, Clone, Copy)]
pub(super) struct Polynomial {
    /// Coefficients of 1, t, t², …, where t = cos · `per_cos` + `at_zero` runs from −1 to 1.
    pub coefficients: [f32; COEFFICIENTS],
    pub per_cos: f32,
    pub at_zero: f32,
    /// Upper bound of the fourth derivative with respect to t, divided by 4!.
    fourth: f32,
}

/// Choice: degree eight, with which the smooth beams reach [`POLYNOMIAL_ERROR`]; others keep the
/// table.
const COEFFICIENTS: usize = 9;

/// Largest relative error of a polynomial. Choice: bounds allow for twice as much.
const POLYNOMIAL_ERROR: f64 = 5e-4;

impl Polynomial {
    /// Interpolates at the zeros of the next Chebyshev polynomial; `None` where the beam is not
    /// smooth enough.
    fn of(beam: &Beam, cut_cos: f64) -> Option<Self> {
        let half = 0.5 * (1.0 - cut_cos);
        let at = |t: f64| beam.amplitude((cut_cos + half * (t + 1.0)).clamp(cut_cos, 1.0));
        let angle = |i: usize| std::f64::consts::PI * (i as f64 + 0.5) / COEFFICIENTS as f64;
        let part = |k: usize| {
            let sum: f64 = (0..COEFFICIENTS).map(|i| at(math::cos(angle(i))) * math::cos(k as f64 * angle(i))).sum();
            sum * if k == 0 { 1.0 } else { 2.0 } / COEFFICIENTS as f64
        };
        // Chebyshev polynomials in powers of t, each from the two before.
        let (mut sum, mut before, mut now) = ([0.0; COEFFICIENTS], [0.0; COEFFICIENTS], [0.0; COEFFICIENTS]);
        (before[1], now[0]) = (1.0, 1.0);
        for k in 0..COEFFICIENTS {
            let part = part(k);
            sum.iter_mut().zip(now).for_each(|(sum, power)| *sum += part * power);
            let next = std::array::from_fn(|n| if n > 0 { 2.0 * now[n - 1] } else { 0.0 } - before[n]);
            (before, now) = (now, next);
        }
        let fits = |n: i32| {
            let (t, value) = (f64::from(n) / 500.0, at(f64::from(n) / 500.0));
            (sum.iter().rev().fold(0.0, |sum, c| sum * t + c) - value).abs() <= POLYNOMIAL_ERROR * value
        };
        let polynomial = Self {
            coefficients: sum.map(|c| c as f32),
            per_cos: (1.0 / half) as f32,
            at_zero: (-cut_cos / half - 1.0) as f32,
            // At |t| ≤ 1 no power exceeds 1.
            fourth: (4..COEFFICIENTS).map(|n| sum[n].abs() * binomial_4(n)).sum::<f64>() as f32,
        };
        (half > 0.0 && (-500..=500).all(fits)).then_some(polynomial)
    }

    /// A ≈ a0 + Δcos·(a1 + Δcos·a2) for cosines within `turn` of `cos`, and an upper bound of its
    /// error: Taylor's series, of whose third-order term Δ³ is replaced by ¾·turn²·Δ.
    #[inline(always)]
    pub fn parabola<S: Lanes>(&self, s: S, cos: S::F, turn: S::F) -> ([S::F; 3], S::F) {
        let per_cos = s.splat(self.per_cos);
        let t = s.mul_add(cos, per_cos, s.splat(self.at_zero));
        // The nth derivatives, divided by n!.
        let mut of_order = [s.splat(0.0); 4];
        for coefficient in self.coefficients.iter().rev() {
            let [zeroth, first, second, third] = of_order;
            of_order = [
                s.mul_add(zeroth, t, s.splat(*coefficient)),
                s.mul_add(first, t, zeroth),
                s.mul_add(second, t, first),
                s.mul_add(third, t, second),
            ];
        }
        let turn_t = s.mul(turn, per_cos);
        let square = s.mul(turn_t, turn_t);
        let [zeroth, first, second, third] = of_order;
        let third = s.mul(third, square);
        let first = s.mul_add(third, s.splat(0.75), first);
        let fourth = s.mul(s.mul(square, square), s.splat(self.fourth));
        let error = s.mul_add(s.mul(s.abs(third), turn_t), s.splat(0.25), fourth);
        ([zeroth, s.mul(first, per_cos), s.mul(second, s.mul(per_cos, per_cos))], error)
    }
}

/// n!/(4!·(n − 4)!).
fn binomial_4(n: usize) -> f64 {
    (n * (n - 1) * (n - 2) * (n - 3) / 24) as f64
}

/// Table entries per unit of cosine.
pub(super) const ENTRIES_PER_COS: f32 = STEPS as f32 * 0.5;

/// Tables of the named beams, computed once: four thousand arc cosines each.
static NAMED: [OnceLock<Arc<BeamTable>>; 5] = [const { OnceLock::new() }; 5];

impl BeamTable {
    /// The table of a beam; those of the named beams are computed once.
    pub fn of(beam: &Beam) -> Arc<Self> {
        let named = match beam {
            Beam::Uniform => 0,
            Beam::Thesis => 1,
            Beam::Lensless => 2,
            Beam::Fresnel => 3,
            Beam::Hyperbolic => 4,
            Beam::Table(_) => return Arc::new(Self::new(beam)),
        };
        Arc::clone(NAMED[named].get_or_init(|| Arc::new(Self::new(beam))))
    }

    fn new(beam: &Beam) -> Self {
        let step = 2.0 / STEPS as f64;
        let exact: Vec<f64> = (0..=STEPS).map(|n| beam.amplitude(n as f64 * step - 1.0)).collect();
        let first_in = exact.iter().position(|&a| a > 0.0).unwrap_or(STEPS);
        let cut_cos = cut(beam, first_in as f64 * step - 1.0, step);
        let at_cut = beam.amplitude(cut_cos);
        let amplitudes: Vec<f32> =
            exact.iter().enumerate().map(|(n, &a)| if n < first_in { at_cut as f32 } else { a as f32 }).collect();
        let solid = amplitudes.iter().all(|&a| a > 0.0);
        Self {
            polynomial: if solid { Polynomial::of(beam, cut_cos) } else { None },
            cut_cos: cut_cos as f32,
            solid,
            uniform: *beam == Beam::Uniform,
            amplitudes,
        }
    }
}

/// The least cosine in the beam, to 1e-12, by bisection between the entry found and the one before.
fn cut(beam: &Beam, found: f64, step: f64) -> f64 {
    if found <= -1.0 {
        return -1.0;
    }
    let (mut out, mut inside) = (found - step, found);
    while inside - out > 1e-12 {
        let middle = 0.5 * (out + inside);
        if beam.amplitude(middle) > 0.0 { inside = middle } else { out = middle }
    }
    inside.min(1.0)
}

/// The beam's amplitude at a cosine, linear between table entries.
#[inline(always)]
pub(super) fn amplitude<S: Lanes>(s: S, beam: &BeamTable, cos: S::F) -> S::F {
    let at = s.mul(s.add(cos, s.splat(1.0)), s.splat(ENTRIES_PER_COS));
    let whole = s.floor(at);
    let (here, next) = s.gather_pairs(&beam.amplitudes, s.to_int(whole));
    s.mul_add(s.sub(at, whole), s.sub(next, here), here)
}

/// The amplitude of the beam at a cosine: by its polynomial where it has one.
#[inline(always)]
pub(super) fn amplitude_at<S: Lanes>(s: S, beam: &BeamTable, cos: S::F) -> S::F {
    let Some(polynomial) = &beam.polynomial else { return amplitude(s, beam, cos) };
    let t = s.mul_add(cos, s.splat(polynomial.per_cos), s.splat(polynomial.at_zero));
    let mut sum = s.splat(0.0);
    for coefficient in polynomial.coefficients.iter().rev() {
        sum = s.mul_add(sum, t, s.splat(*coefficient));
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cut_is_where_the_beam_ends() {
        let cut = |beam: &Beam| BeamTable::new(beam).cut_cos;
        assert_eq!(cut(&Beam::Uniform), -1.0);
        assert!((cut(&Beam::Thesis) - 0.5f32.sqrt()).abs() < 1e-6);
        assert!(cut(&Beam::Lensless).abs() < 1e-6);
        let hollow = Beam::from_table(vec![[0.0, 0.0], [10.0, 0.0], [20.0, 1.0], [30.0, 0.5]]).unwrap();
        assert!((cut(&hollow) - 30f32.to_radians().cos()).abs() < 1e-6);
        assert!(!BeamTable::new(&hollow).solid && BeamTable::new(&Beam::Thesis).solid);
    }

    #[test]
    fn polynomials_are_close_where_there_are_any() {
        assert!(BeamTable::new(&Beam::Fresnel).polynomial.is_none());
        let bent = Beam::from_table(vec![[0.0, 1.0], [10.0, 0.9], [20.0, 0.3], [30.0, 0.2]]).unwrap();
        assert!(BeamTable::new(&bent).polynomial.is_none());
        for beam in [Beam::Thesis, Beam::Lensless] {
            let table = BeamTable::new(&beam);
            let polynomial = table.polynomial.unwrap();
            for i in 0..=3000 {
                let cos = table.cut_cos + (1.0 - table.cut_cos) * i as f32 / 3000.0;
                let t = cos * polynomial.per_cos + polynomial.at_zero;
                let near = polynomial.coefficients.iter().rev().fold(0.0, |sum, c| sum * t + c);
                // The cut rounded to f32 may lie out of the beam.
                let exact = beam.amplitude(f64::from(cos) + 1e-7);
                assert!((f64::from(near) - exact).abs() < 6e-4 * exact, "{beam:?} {cos} {near} {exact}");
            }
        }
    }

    #[test]
    fn parabolas_are_as_close_as_they_say() {
        let s = crate::simd::Portable;
        for beam in [Beam::Thesis, Beam::Lensless] {
            let table = BeamTable::new(&beam);
            let polynomial = table.polynomial.unwrap();
            for (i, turn) in (0..400).flat_map(|i| [(i, 0.01f32), (i, 0.05), (i, 0.1), (i, 0.25)]) {
                let cos = table.cut_cos + (1.0 - table.cut_cos) * i as f32 / 400.0;
                let (terms, error) = polynomial.parabola(s, s.splat(cos), s.splat(turn));
                let [a0, a1, a2] = terms.map(|term| s.store(term)[0]);
                for n in -10..=10 {
                    let off = turn * n as f32 / 10.0;
                    if (table.cut_cos..=1.0).contains(&(cos + off)) {
                        let exact = s.store(amplitude_at(s, &table, s.splat(cos + off)))[0];
                        let near = a0 + off * (a1 + off * a2);
                        assert!(
                            (near - exact).abs() <= s.store(error)[0] + 1e-5,
                            "{beam:?} {cos} {off} {near} {exact}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn lookups_are_close_to_every_named_beam() {
        for beam in [Beam::Uniform, Beam::Thesis, Beam::Lensless, Beam::Fresnel, Beam::Hyperbolic] {
            let table = BeamTable::new(&beam);
            for i in 1..9000 {
                let cos = f64::from(table.cut_cos) + (1.0 - f64::from(table.cut_cos)) * f64::from(i) / 9000.0;
                let at = (cos + 1.0) * f64::from(ENTRIES_PER_COS);
                let (n, w) = (at.floor() as usize, at.fract() as f32);
                let near = table.amplitudes[n] * (1.0 - w) + table.amplitudes[(n + 1).min(STEPS)] * w;
                assert!((f64::from(near) - beam.amplitude(cos)).abs() < 1e-4, "{beam:?} {cos}");
            }
        }
    }
}

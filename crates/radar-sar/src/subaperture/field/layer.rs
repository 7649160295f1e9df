//! Evidence of sixteen voxels, and adding a sub-aperture to it.

use super::LAYERS;
use crate::simd::{Kernel, LANES, Lanes};
use crate::subaperture::MEAN_LOG_OF_NOISE;

/// The weight grows by 2 to this power in an epoch. Choice: a weight within an epoch stays below
/// 256, so that f32 sums keep their precision, and whole epochs are exact powers of two.
pub(super) const EPOCH_DOUBLINGS: i32 = 8;
/// Ticks in an epoch, as a power of two. Choice: a tick of 0.1 ms is far shorter than a
/// sub-aperture, and i32 lasts for three days at the default decay.
pub(super) const TICKS_LOG2: u32 = 16;

/// Evidence of sixteen voxels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layer {
    pub a: [f32; LANES],
    pub b: [f32; LANES],
    /// Time last in the beam, ticks of the field's clock; negative when never.
    pub seen: [i32; LANES],
}

/// Time and weight of a sub-aperture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moment {
    pub ticks: i32,
    /// e^(time since the epoch began / memory).
    pub weight: f32,
}

impl Layer {
    pub const EMPTY: Self = Self { a: [0.0; LANES], b: [0.0; LANES], seen: [-1; LANES] };

    /// Adds m to the lanes in the beam.
    #[inline(always)]
    pub fn add(&mut self, m: &[f32; LANES], seen: &[bool; LANES], now: Moment) {
        for l in 0..LANES {
            // 2^(−doublings · epochs since), exact; 0 from sixteen epochs on.
            let epochs = (now.ticks >> TICKS_LOG2) - (self.seen[l] >> TICKS_LOG2);
            let exponent = (127 - EPOCH_DOUBLINGS * epochs.min(16)).max(0);
            let faded = f32::from_bits((exponent as u32) << 23);
            let log = ln_1p(m[l]) - MEAN_LOG_OF_NOISE as f32;
            let a = now.weight.mul_add(log, self.a[l] * faded);
            let b = now.weight.mul_add(now.weight, self.b[l] * (faded * faded));
            let ticks = now.ticks.max(self.seen[l]);
            (self.a[l], self.b[l], self.seen[l]) =
                if seen[l] { (a, b, ticks) } else { (self.a[l], self.b[l], self.seen[l]) };
        }
    }

    /// The greatest score, squared with its sign; −∞ when never in the beam.
    #[inline(always)]
    fn greatest2(&self) -> f32 {
        let mut scores2 = [f32::NEG_INFINITY; LANES];
        for ((score2, a), b) in scores2.iter_mut().zip(&self.a).zip(&self.b) {
            let of_seen = a * a.abs() / b;
            *score2 = if *b > 0.0 { of_seen } else { f32::NEG_INFINITY };
        }
        // By halves, so that whole vectors are compared, not one lane at a time.
        let mut half = LANES / 2;
        while half > 0 {
            let (low, high) = scores2.split_at_mut(half);
            for (a, b) in low.iter_mut().zip(high) {
                *a = if *a > *b { *a } else { *b };
            }
            half /= 2;
        }
        scores2[0]
    }
}

/// Adds m to layers of a brick.
pub(super) struct AddLayers<'a> {
    pub layers: &'a mut [Layer; LAYERS],
    pub greatest2: &'a mut [f32; LAYERS],
    /// Mask of the lanes in the beam, and the layer's number.
    pub seen: &'a [([bool; LANES], usize)],
    /// One for each of `seen`.
    pub m: &'a [[f32; LANES]],
    pub now: Moment,
}

impl Kernel for AddLayers<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) {
        for ((mask, at), m) in self.seen.iter().zip(self.m) {
            let layer = &mut self.layers[*at];
            layer.add(m, mask, self.now);
            self.greatest2[*at] = layer.greatest2();
        }
    }
}

/// ln(1 + m) to 4e-7, for m ≥ 0; 0 for NaN and for values of 1e30 and above, so that they never
/// reach a sum.
#[inline(always)]
fn ln_1p(m: f32) -> f32 {
    let y = 1.0 + if m < 1e30 { m } else { 0.0 };
    // y = 2^e · (1 + x), x within √½ − 1 to √2 − 1.
    let bits = y.to_bits().wrapping_sub(SQRT_HALF_BITS);
    let exponent = (bits as i32) >> 23;
    let x = f32::from_bits((bits & 0x007F_FFFF) + SQRT_HALF_BITS) - 1.0;
    let p = x.mul_add(0.100_174_06, -0.184_094_44);
    let p = x.mul_add(p, 0.209_382_02);
    let p = x.mul_add(p, -0.249_442_63);
    let p = x.mul_add(p, 0.332_836_4);
    let p = x.mul_add(p, -0.500_002_45);
    let p = x.mul_add(p, 1.000_006_5);
    (exponent as f32).mul_add(std::f32::consts::LN_2, x * p)
}

const SQRT_HALF_BITS: u32 = 0x3F35_04F3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithm_is_accurate_to_4e_7_and_maps_invalid_input_to_zero() {
        for n in 0..=4000 {
            let m = 10f32.powf(n as f32 * 0.0045 - 9.0) - 1e-9;
            let exact = f64::from(m).ln_1p();
            assert!((f64::from(ln_1p(m)) - exact).abs() < 4e-7 + 2e-7 * exact, "{m}: {} {exact}", ln_1p(m));
        }
        assert_eq!([f32::NAN, f32::INFINITY, 2e30].map(ln_1p), [0.0; 3]);
        assert!(ln_1p(0.0).abs() < 4e-7);
    }
}

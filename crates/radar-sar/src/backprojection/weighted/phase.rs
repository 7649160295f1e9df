//! Phases at a brick's centre, and the rotation by them.

use super::super::brick_geometry::Sight;
use super::super::sweep_stack::Group;
use crate::HALF_TURNS_PER_M;
use crate::simd::{LANES, Lanes};

/// What f32 cannot represent of [`HALF_TURNS_PER_M`].
const HALF_TURNS_PER_M_REST: f32 = (HALF_TURNS_PER_M - HALF_TURNS_PER_M as f32 as f64) as f32;

/// Phases at a brick's centre, for each of sixteen sweeps.
pub(super) struct Phase {
    /// In half turns, without whole turns.
    pub center_half_turns: [f32; LANES],
    /// The same at the start of the tables' windows, and per table entry.
    pub window_half_turns: [f32; LANES],
    pub half_turns_per_entry: [f32; LANES],
}

impl Phase {
    #[inline(always)]
    pub fn new<S: Lanes>(s: S, sweeps: &Group, sight: &Sight) -> Self {
        let (distance, per_m) = (s.load(&sight.distance_m), s.splat(HALF_TURNS_PER_M as f32));
        let half_turns = s.mul(distance, per_m);
        // Rounding error of the product: d·k − rounded(d·k) is exact in one operation.
        let lost = s.sub(s.splat(0.0), s.neg_mul_add(distance, per_m, half_turns));
        let lost = s.mul_add(distance, s.splat(HALF_TURNS_PER_M_REST), lost);
        let whole = s.mul(s.floor(s.mul(half_turns, s.splat(0.5))), s.splat(2.0));
        let center = s.add(s.sub(half_turns, whole), lost);
        let per_entry = s.mul(s.load(&sweeps.entry_m), per_m);
        Self {
            center_half_turns: s.store(center),
            window_half_turns: s.store(s.neg_mul_add(per_entry, s.load(&sight.windows.entry), center)),
            half_turns_per_entry: s.store(per_entry),
        }
    }
}

/// Adds A·(re + j·im)·e^(−jφ) to a sum; φ in half turns. Accurate to 6e-4 of the amplitude.
///
/// Polynomials, since tables in registers are slower with AVX2: two lookups among 32 entries take as
/// many instructions as the rest of a voxel.
#[inline(always)]
pub(super) fn add_turned<S: Lanes>(
    s: S,
    [re, im]: [S::F; 2],
    amplitude: S::F,
    half_turns: S::F,
    sums: [S::F; 2],
) -> (S::F, S::F) {
    let (whole, bits) = s.rounded(half_turns);
    let (cos, sin) = s.rough_cos_sin_within_half_turn(s.sub(half_turns, whole));
    // An odd half turn changes both signs.
    let amplitude = s.negate_odd(amplitude, bits);
    let turned_re = s.mul_add(im, sin, s.mul(re, cos));
    let turned_im = s.neg_mul_add(re, sin, s.mul(im, cos));
    (s.mul_add(amplitude, turned_re, sums[0]), s.mul_add(amplitude, turned_im, sums[1]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::Portable;

    #[test]
    fn phases_are_turned_back() {
        for n in -2000..2000 {
            // As many half turns as within a brick 2 cm wide.
            let (half_turns, s) = (n as f32 * 0.0137, Portable);
            let z = [s.splat(0.3), s.splat(-0.4)];
            let (re, im) = add_turned(s, z, s.splat(2.0), s.splat(half_turns), [s.splat(2.0), s.splat(3.0)]);
            let (sin, cos) = (f64::from(half_turns) * std::f64::consts::PI).sin_cos();
            assert!((f64::from(re[0]) - 2.0 - (0.6 * cos - 0.8 * sin)).abs() < 7e-4);
            assert!((f64::from(im[0]) - 3.0 - (-0.8 * cos - 0.6 * sin)).abs() < 7e-4);
        }
    }
}

//! The vector operations that kernels are written with.

use super::dispatch::Part;

/// Number of lanes. Choice: one register of AVX-512, two of AVX2.
pub(crate) const LANES: usize = 16;

/// 1.5 · 2²³. Adding it rounds a number to the nearest integer, whose low bits are then the low
/// bits of the sum.
pub(crate) const ROUNDER: f32 = 12_582_912.0;

/// Bit l in lane l, for masks.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(super) const LANE_BITS: [i32; LANES] = {
    let (mut bits, mut l) = ([0; LANES], 0);
    while l < LANES {
        bits[l] = 1 << l;
        l += 1;
    }
    bits
};

/// Exponent bits of an f32.
const EXPONENT_BITS: i32 = 0x7f80_0000;

/// Vector operations, lane by lane. An implementation is a token without data; values are of its
/// associated types.
pub(crate) trait Lanes: Copy {
    /// Sixteen f32.
    type F: Copy;
    /// Sixteen i32.
    type I: Copy;
    /// Sixteen booleans.
    type M: Copy;
    /// Sixteen f32, where lookups read them fastest: in registers, or in memory.
    type Table: Copy;
    /// Whether [`permute_near`](Self::permute_near) is faster than [`permute`](Self::permute).
    const NEAR_IS_FASTER: bool;
    /// Whether two [`look_up`](Self::look_up)s among 128 are faster than [`gather_pairs`](Self::gather_pairs).
    const WIDE_WINDOWS: bool;

    /// Runs a part of a kernel in a function of its own. Choice: for what is rarer than the rest, which then does not
    /// share its registers and its stack with it.
    fn apart<P: Part<Self>>(self, part: P) -> P::Out;
    fn splat(self, value: f32) -> Self::F;
    /// One value in the first eight lanes, another in the last.
    #[cfg(feature = "rolling")]
    fn splat_two(self, first: f32, last: f32) -> Self::F;
    fn load(self, values: &[f32; LANES]) -> Self::F;
    fn store(self, values: Self::F) -> [f32; LANES];
    /// Eight values, in both halves of the lanes.
    fn load_twice(self, values: &[f32; 8]) -> Self::F;
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    /// a · b + c, rounded once.
    fn mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// c − a · b, rounded once.
    fn neg_mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    fn sqrt(self, a: Self::F) -> Self::F;
    /// The lesser; `b` when either is NaN.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// The greater; `b` when either is NaN.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    fn floor(self, a: Self::F) -> Self::F;
    /// The nearest i32, ties to even; only for values within ±2³⁰.
    fn to_int(self, a: Self::F) -> Self::I;
    /// Without the fraction; only for values within ±2³⁰.
    fn to_int_toward_zero(self, a: Self::F) -> Self::I;
    fn to_float(self, a: Self::I) -> Self::F;
    /// The bits of the floats.
    fn bits_of(self, a: Self::F) -> Self::I;
    /// The floats with these bits.
    fn with_bits(self, a: Self::I) -> Self::F;

    fn splat_int(self, value: i32) -> Self::I;
    fn load_int(self, values: &[i32; LANES]) -> Self::I;
    fn store_int(self, values: Self::I) -> [i32; LANES];
    fn add_int(self, a: Self::I, b: Self::I) -> Self::I;
    fn sub_int(self, a: Self::I, b: Self::I) -> Self::I;
    fn min_int(self, a: Self::I, b: Self::I) -> Self::I;
    fn max_int(self, a: Self::I, b: Self::I) -> Self::I;
    fn and_int(self, a: Self::I, b: Self::I) -> Self::I;
    fn xor_int(self, a: Self::I, b: Self::I) -> Self::I;
    /// Zeros enter; `by` from 0 to 31.
    fn shift_left(self, a: Self::I, by: Self::I) -> Self::I;
    /// Zeros enter; `by` from 0 to 31.
    fn shift_right(self, a: Self::I, by: Self::I) -> Self::I;

    /// Whether a ≤ b.
    fn at_most(self, a: Self::F, b: Self::F) -> Self::M;
    fn and(self, a: Self::M, b: Self::M) -> Self::M;
    fn or(self, a: Self::M, b: Self::M) -> Self::M;
    /// Lane l is bit l.
    fn mask(self, bits: u16) -> Self::M;
    /// Bit l is lane l.
    fn mask_bits(self, mask: Self::M) -> u16;
    fn or_zero(self, mask: Self::M, a: Self::F) -> Self::F;
    fn or_zero_int(self, mask: Self::M, a: Self::I) -> Self::I;

    /// The lanes of `table` that the low four bits of the index select: one instruction, where a
    /// gather from memory takes seventeen.
    fn permute(self, table: Self::F, index: Self::I) -> Self::F;
    /// The same of a table as of [`load_twice`](Self::load_twice): one instruction also where registers have eight lanes.
    fn permute_eight(self, table: Self::F, index: Self::I) -> Self::F;
    /// The table with these entries, and the entries of a table.
    fn table(self, entries: Self::F) -> Self::Table;
    fn entries(self, table: &Self::Table) -> Self::F;
    /// The same as [`permute`](Self::permute) where, in each half of the lanes, every index is one of the eight from the
    /// half's start on, and of the table's sixteen. A register of eight lanes then takes one instruction instead of three.
    fn permute_near(self, table: &Self::Table, starts: [i32; 2], index: Self::I) -> Self::F;
    /// `window[index]`; the index is taken modulo N, which is 8, 16, 32, 64 or 128.
    fn look_up<const N: usize>(self, window: &[f32; N], index: Self::I) -> Self::F;
    /// `table[index]`; an index outside takes the nearest entry.
    fn gather_int(self, table: &[i32], index: Self::I) -> Self::I;
    /// `table[index]` and `table[index + 1]`; an index outside takes the nearest pair. The table
    /// must have at least two entries.
    fn gather_pairs(self, table: &[f32], index: Self::I) -> (Self::F, Self::F);

    /// Sixteen values from `at` on; zeros where there are fewer.
    #[inline(always)]
    fn load_at(self, values: &[f32], at: usize) -> Self::F {
        if let Some(rest) = values.get(at..)
            && let Some(sixteen) = rest.first_chunk()
        {
            return self.load(sixteen);
        }
        self.splat(0.0)
    }

    #[inline(always)]
    fn abs(self, a: Self::F) -> Self::F {
        self.with_bits(self.and_int(self.bits_of(a), self.splat_int(i32::MAX)))
    }

    /// −a in lanes whose `n` is odd.
    #[inline(always)]
    fn negate_odd(self, a: Self::F, n: Self::I) -> Self::F {
        let at_sign = self.shift_left(n, self.splat_int(31));
        let sign = self.and_int(at_sign, self.splat_int(i32::MIN));
        self.with_bits(self.xor_int(self.bits_of(a), sign))
    }

    /// For values from 1 on: the greatest power of two not above the value, and its exponent.
    #[inline(always)]
    fn octave(self, a: Self::F) -> (Self::F, Self::I) {
        let bits = self.bits_of(a);
        let power = self.with_bits(self.and_int(bits, self.splat_int(EXPONENT_BITS)));
        (power, self.sub_int(self.shift_right(bits, self.splat_int(23)), self.splat_int(127)))
    }

    /// The nearest integer as a float, and bits the lower 22 of which are its own; for values
    /// within ±2²¹.
    #[inline(always)]
    fn rounded(self, a: Self::F) -> (Self::F, Self::I) {
        let rounder = self.splat(ROUNDER);
        let sum = self.add(a, rounder);
        (self.sub(sum, rounder), self.bits_of(sum))
    }

    /// cos and sin of π·a, to 1e-4; for values within ±2²¹.
    #[inline(always)]
    fn cos_sin_of_half_turns(self, a: Self::F) -> (Self::F, Self::F) {
        let (whole, bits) = self.rounded(a);
        let (cos, sin) = self.cos_sin_within_half_turn(self.sub(a, whole));
        (self.negate_odd(cos, bits), self.negate_odd(sin, bits))
    }

    /// cos and sin of π·x, to 1e-4; for values within ±½.
    #[inline(always)]
    fn cos_sin_within_half_turn(self, x: Self::F) -> (Self::F, Self::F) {
        let x2 = self.mul(x, x);
        let sin = self.mul_add(x2, self.splat(2.299_547_3), self.splat(-5.136_905));
        let sin = self.mul(self.mul_add(x2, sin, self.splat(3.140_64)), x);
        let cos = self.mul_add(x2, self.splat(-1.222_127_1), self.splat(4.041_283_8));
        let cos = self.mul_add(x2, cos, self.splat(-4.933_938));
        let cos = self.mul_add(x2, cos, self.splat(0.999_993_3));
        (cos, sin)
    }

    /// The same, to 6e-4, with fewer instructions.
    #[inline(always)]
    fn rough_cos_sin_within_half_turn(self, x: Self::F) -> (Self::F, Self::F) {
        let x2 = self.mul(x, x);
        let sin = self.mul_add(x2, self.splat(2.299_547_3), self.splat(-5.136_905));
        let sin = self.mul(self.mul_add(x2, sin, self.splat(3.140_64)), x);
        let cos = self.mul_add(x2, self.splat(3.583_844_4), self.splat(-4.891_187));
        let cos = self.mul_add(x2, cos, self.splat(0.999_403_2));
        (cos, sin)
    }
}

/// Indices limited to 0 to `last`.
#[inline(always)]
pub(super) fn limited<S: Lanes>(s: S, index: S::I, last: usize) -> S::I {
    let last = s.splat_int(last.min(i32::MAX as usize) as i32);
    s.min_int(s.max_int(index, s.splat_int(0)), last)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Kernel, on_each};

    /// Every operation on values of all kinds, as bits.
    #[derive(Clone)]
    struct Trial;

    impl Kernel for Trial {
        type Out = Vec<[i32; LANES]>;

        #[inline(always)]
        fn run<S: Lanes>(self, s: S) -> Self::Out {
            let (mut some, mut rising, mut table) = ([0.0; LANES], [0.0; LANES], [0.0; 128]);
            for l in 0..LANES {
                (some[l], rising[l]) = ((l as f32 - 7.3) * 1.37, 0.3 + l as f32 * 211.7);
            }
            for (n, value) in table.iter_mut().enumerate() {
                *value = 0.7 - n as f32 * 1.9;
            }
            let mut with_nan = some;
            (with_nan[3], with_nan[5], with_nan[9]) = (f32::NAN, -0.0, 0.5);
            let (a, b, c) = (s.load(&some), s.load(&rising), s.load(&with_nan));
            let (m, n) = (s.to_int(a), s.to_int(b));
            let (less, odd) = (s.at_most(a, s.splat(2.5)), s.mask(0xaaaa));
            let (power, exponent) = s.octave(s.add(b, s.splat(0.8)));
            let (whole, bits) = s.rounded(b);
            let (cos, sin) = s.cos_sin_of_half_turns(b);
            let (here, next) = s.gather_pairs(&table, n);
            // Each half reads its own eight of sixteen entries, also where the eight begin before the table or end behind it.
            let of_16 = s.table(a);
            let mut entries = [[0; LANES]; 2];
            for l in 0..LANES as i32 {
                let n = l as usize;
                entries[0][n] = ROUNDER.to_bits() as i32 + if l < 8 { 3 } else { 8 } + l * 5 % 8;
                entries[1][n] = if l < 8 { l * 5 % 6 } else { 11 + l * 3 % 5 };
            }
            let near = s.permute_near(&of_16, [3, 8], s.load_int(&entries[0]));
            let clamped = s.permute_near(&of_16, [-2, 11], s.load_int(&entries[1]));
            let entries = [5, -7, 11, 13, 1 << 30];
            let sum = s.splat_int(i32::from(s.mask_bits(s.or(less, odd))));
            let floats = [
                cos,
                sin,
                s.add(a, b),
                s.sub(a, b),
                s.mul(a, b),
                s.div(a, b),
                s.mul_add(b, a, b),
                s.neg_mul_add(b, a, b),
                s.sqrt(b),
                s.min(c, a),
                s.min(a, c),
                s.max(c, b),
                s.max(b, c),
                s.floor(a),
                s.abs(c),
                s.to_float(n),
                s.or_zero(s.and(less, odd), a),
                s.permute(a, bits),
                s.load_twice(some.first_chunk().unwrap()),
                s.permute_eight(s.load_twice(some.first_chunk().unwrap()), n),
                near,
                clamped,
                s.entries(&of_16),
                s.look_up(table.first_chunk::<8>().unwrap(), n),
                s.look_up(table.first_chunk::<16>().unwrap(), n),
                s.look_up(table.first_chunk::<32>().unwrap(), n),
                s.look_up(table.first_chunk::<64>().unwrap(), n),
                s.look_up(&table, n),
                s.negate_odd(a, n),
                s.load_at(&table, 112),
                s.load_at(&table, 113),
                power,
                whole,
                here,
                next,
            ];
            let ints = [
                m,
                s.to_int_toward_zero(a),
                s.to_int_toward_zero(b),
                bits,
                exponent,
                sum,
                s.add_int(m, n),
                s.sub_int(m, n),
                s.min_int(m, n),
                s.max_int(m, n),
                s.xor_int(m, n),
                s.shift_right(m, s.splat_int(3)),
                s.or_zero_int(less, n),
                s.gather_int(&entries, m),
                s.load_int(&[9; LANES]),
            ];
            let mut found = Vec::new();
            for values in floats {
                found.push(s.store_int(s.bits_of(values)));
            }
            for values in ints {
                found.push(s.store_int(values));
            }
            #[cfg(feature = "rolling")]
            found.push(s.store_int(s.bits_of(s.splat_two(1.5, -2.5))));
            found
        }
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let all = on_each(&Trial);
        for other in &all[1..] {
            for (n, (a, b)) in all[0].iter().zip(other).enumerate() {
                assert_eq!(a, b, "operation {n}");
            }
        }
        // The values are also correct.
        for (l, (cos, sin)) in all[0][0].iter().zip(&all[0][1]).enumerate() {
            let exact = (std::f64::consts::PI * f64::from(0.3 + l as f32 * 211.7)).sin_cos();
            let (cos, sin) = (f32::from_bits(*cos as u32), f32::from_bits(*sin as u32));
            assert!((f64::from(cos) - exact.1).abs() < 1e-4 && (f64::from(sin) - exact.0).abs() < 1e-4);
        }
    }
}

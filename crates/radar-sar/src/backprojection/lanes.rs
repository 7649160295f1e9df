//! Sixteen values in lanes, on the widest vector unit of the processor.
//!
//! Kernels are written once against [`Lanes`] and compiled for AVX-512, for AVX2 with FMA, and for
//! any processor. Every operation is an IEEE one (fused multiply-add included), so all three give
//! the same bits. A value of [`Avx512`] or [`Avx2`] is created only after detecting the processor's
//! features: it is the proof that the instructions may be used.
//!
//! Longer than other files: it is one trait with its three implementations.

/// Number of lanes. Choice: one register of AVX-512, two of AVX2.
pub(crate) const LANES: usize = 16;
/// Number of entries from which [`Lanes::look_up`] selects. Choice: what one permute of AVX-512
/// selects from.
pub(super) const WINDOW: usize = 32;

/// Number of entries from which [`Lanes::look_up_half`] selects. Choice: two permutes.
pub(super) const HALF_WINDOW: usize = 64;

/// Number of entries from which [`Lanes::look_up_wide`] selects. Choice: four permutes; a wider
/// table is gathered.
pub(super) const WIDE_WINDOW: usize = 128;

/// Exponent bits of an f32.
const EXPONENT_BITS: i32 = 0x7f80_0000;

/// Vector operations, lane by lane.
pub(crate) trait Lanes: Copy {
    /// Sixteen f32.
    type F: Copy;
    /// Sixteen i32.
    type I: Copy;
    /// Sixteen booleans.
    type M: Copy;

    fn splat(self, value: f32) -> Self::F;
    fn load(self, values: &[f32; LANES]) -> Self::F;
    /// One value in the first eight lanes, another in the last.
    #[cfg_attr(not(feature = "rolling"), expect(dead_code, reason = "for the rolling image"))]
    fn splat_two(self, first: f32, last: f32) -> Self::F;
    fn store(self, values: Self::F) -> [f32; LANES];
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
    fn abs(self, a: Self::F) -> Self::F;
    fn floor(self, a: Self::F) -> Self::F;
    /// For values from 1 on: the greatest power of two not above the value, and its exponent.
    fn octave(self, a: Self::F) -> (Self::F, Self::I);
    /// −a in lanes whose `n` has bit 5 (32) set.
    fn negate_where_bit_5(self, a: Self::F, n: Self::I) -> Self::F;
    /// Whether a ≤ b.
    fn at_most(self, a: Self::F, b: Self::F) -> Self::M;
    fn and(self, a: Self::M, b: Self::M) -> Self::M;
    fn or(self, a: Self::M, b: Self::M) -> Self::M;
    /// Lane l is bit l.
    fn mask(self, bits: u16) -> Self::M;
    /// Bit l is lane l.
    fn bits(self, mask: Self::M) -> u16;
    fn or_zero(self, mask: Self::M, a: Self::F) -> Self::F;
    fn or_zero_int(self, mask: Self::M, a: Self::I) -> Self::I;
    /// The nearest i32, ties to even; only for values within ±2³⁰.
    fn to_int(self, a: Self::F) -> Self::I;
    fn splat_int(self, value: i32) -> Self::I;
    fn load_int(self, values: &[i32; LANES]) -> Self::I;
    fn store_int(self, values: Self::I) -> [i32; LANES];
    fn add_int(self, a: Self::I, b: Self::I) -> Self::I;
    fn sub_int(self, a: Self::I, b: Self::I) -> Self::I;
    fn to_float(self, a: Self::I) -> Self::F;
    fn max_int(self, a: Self::I, b: Self::I) -> Self::I;
    fn min_int(self, a: Self::I, b: Self::I) -> Self::I;
    /// `window[index]`; the index is taken modulo 32.
    fn look_up(self, window: &[f32; WINDOW], index: Self::I) -> Self::F;
    /// `window[index]`; the index is taken modulo 64.
    fn look_up_half(self, window: &[f32; HALF_WINDOW], index: Self::I) -> Self::F;
    /// `window[index]`; the index is taken modulo 128.
    fn look_up_wide(self, window: &[f32; WIDE_WINDOW], index: Self::I) -> Self::F;
    /// `table[index]`; an index outside takes the nearest entry.
    fn gather_int(self, table: &[i32], index: Self::I) -> Self::I;
    /// `table[index]` and `table[index + 1]`; an index outside takes the nearest pair. The table
    /// must have at least two entries.
    fn gather_pairs(self, table: &[f32], index: Self::I) -> (Self::F, Self::F);
}

/// Portable implementation, lane by lane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plain;

#[inline(always)]
fn each<T: Copy, U>(a: [T; LANES], f: impl Fn(T) -> U) -> [U; LANES] {
    a.map(f)
}

#[inline(always)]
fn pairs<T: Copy, U>(a: [T; LANES], b: [T; LANES], f: impl Fn(T, T) -> U) -> [U; LANES] {
    std::array::from_fn(|l| f(a[l], b[l]))
}

impl Lanes for Plain {
    type F = [f32; LANES];
    type I = [i32; LANES];
    type M = [bool; LANES];

    #[inline(always)]
    fn splat(self, value: f32) -> Self::F {
        [value; LANES]
    }
    #[inline(always)]
    fn load(self, values: &[f32; LANES]) -> Self::F {
        *values
    }
    #[inline(always)]
    fn splat_two(self, first: f32, last: f32) -> Self::F {
        std::array::from_fn(|l| if l < LANES / 2 { first } else { last })
    }
    #[inline(always)]
    fn or_zero_int(self, mask: Self::M, a: Self::I) -> Self::I {
        std::array::from_fn(|l| if mask[l] { a[l] } else { 0 })
    }
    #[inline(always)]
    fn store(self, values: Self::F) -> [f32; LANES] {
        values
    }
    #[inline(always)]
    fn add(self, a: Self::F, b: Self::F) -> Self::F {
        pairs(a, b, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, a: Self::F, b: Self::F) -> Self::F {
        pairs(a, b, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, a: Self::F, b: Self::F) -> Self::F {
        pairs(a, b, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, a: Self::F, b: Self::F) -> Self::F {
        pairs(a, b, |a, b| a / b)
    }
    #[inline(always)]
    fn mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
        std::array::from_fn(|l| a[l].mul_add(b[l], c[l]))
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
        std::array::from_fn(|l| (-a[l]).mul_add(b[l], c[l]))
    }
    #[inline(always)]
    fn sqrt(self, a: Self::F) -> Self::F {
        each(a, f32::sqrt)
    }
    #[inline(always)]
    fn min(self, a: Self::F, b: Self::F) -> Self::F {
        pairs(a, b, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, a: Self::F, b: Self::F) -> Self::F {
        pairs(a, b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn abs(self, a: Self::F) -> Self::F {
        each(a, f32::abs)
    }
    #[inline(always)]
    fn octave(self, a: Self::F) -> (Self::F, Self::I) {
        let power = each(a, |a| f32::from_bits(a.to_bits() & EXPONENT_BITS as u32));
        (power, each(a, |a| (a.to_bits() >> 23) as i32 - 127))
    }
    #[inline(always)]
    fn floor(self, a: Self::F) -> Self::F {
        each(a, f32::floor)
    }
    #[inline(always)]
    fn negate_where_bit_5(self, a: Self::F, n: Self::I) -> Self::F {
        std::array::from_fn(|l| if n[l] & 32 != 0 { -a[l] } else { a[l] })
    }
    #[inline(always)]
    fn at_most(self, a: Self::F, b: Self::F) -> Self::M {
        pairs(a, b, |a, b| a <= b)
    }
    #[inline(always)]
    fn and(self, a: Self::M, b: Self::M) -> Self::M {
        pairs(a, b, |a, b| a & b)
    }
    #[inline(always)]
    fn or(self, a: Self::M, b: Self::M) -> Self::M {
        pairs(a, b, |a, b| a | b)
    }
    #[inline(always)]
    fn mask(self, bits: u16) -> Self::M {
        std::array::from_fn(|l| bits >> l & 1 == 1)
    }
    #[inline(always)]
    fn bits(self, mask: Self::M) -> u16 {
        mask.iter().enumerate().fold(0, |bits, (l, yes)| bits | u16::from(*yes) << l)
    }
    #[inline(always)]
    fn or_zero(self, mask: Self::M, a: Self::F) -> Self::F {
        std::array::from_fn(|l| if mask[l] { a[l] } else { 0.0 })
    }
    #[inline(always)]
    fn to_int(self, a: Self::F) -> Self::I {
        each(a, |a| a.round_ties_even() as i32)
    }
    #[inline(always)]
    fn splat_int(self, value: i32) -> Self::I {
        [value; LANES]
    }
    #[inline(always)]
    fn load_int(self, values: &[i32; LANES]) -> Self::I {
        *values
    }
    #[inline(always)]
    fn store_int(self, values: Self::I) -> [i32; LANES] {
        values
    }
    #[inline(always)]
    fn add_int(self, a: Self::I, b: Self::I) -> Self::I {
        pairs(a, b, i32::wrapping_add)
    }
    #[inline(always)]
    fn sub_int(self, a: Self::I, b: Self::I) -> Self::I {
        pairs(a, b, i32::wrapping_sub)
    }
    #[inline(always)]
    fn to_float(self, a: Self::I) -> Self::F {
        each(a, |a| a as f32)
    }
    #[inline(always)]
    fn max_int(self, a: Self::I, b: Self::I) -> Self::I {
        pairs(a, b, i32::max)
    }
    #[inline(always)]
    fn min_int(self, a: Self::I, b: Self::I) -> Self::I {
        pairs(a, b, i32::min)
    }
    #[inline(always)]
    fn look_up(self, window: &[f32; WINDOW], index: Self::I) -> Self::F {
        each(index, |n| window[(n & 31) as usize])
    }
    #[inline(always)]
    fn look_up_half(self, window: &[f32; HALF_WINDOW], index: Self::I) -> Self::F {
        each(index, |n| window[(n & 63) as usize])
    }
    #[inline(always)]
    fn look_up_wide(self, window: &[f32; WIDE_WINDOW], index: Self::I) -> Self::F {
        each(index, |n| window[(n & 127) as usize])
    }
    #[inline(always)]
    fn gather_int(self, table: &[i32], index: Self::I) -> Self::I {
        each(index, |n| table[(n.max(0) as usize).min(table.len() - 1)])
    }
    #[inline(always)]
    fn gather_pairs(self, table: &[f32], index: Self::I) -> (Self::F, Self::F) {
        let first = each(index, |n| (n.max(0) as usize).min(table.len() - 2));
        (each(first, |n| table[n]), each(first, |n| table[n + 1]))
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) use x86::{Avx2, Avx512};

/// Each instruction in here is sound because the token exists only where the processor supports it.
#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    use super::{EXPONENT_BITS, HALF_WINDOW, LANES, Lanes, WIDE_WINDOW, WINDOW};
    use crate::simd::{InstructionSet, has};

    /// AVX-512 F and VL.
    #[derive(Debug, Clone, Copy)]
    pub(in super::super) struct Avx512(());

    impl Avx512 {
        /// `None` where the processor does not support it.
        pub(in super::super) fn detect() -> Option<Self> {
            has(InstructionSet::Avx512).then_some(Self(()))
        }
    }

    macro_rules! wide {
        ($call:expr) => {
            // SAFETY: `self` is the proof that the processor has AVX-512.
            unsafe { $call }
        };
    }

    impl Lanes for Avx512 {
        type F = __m512;
        type I = __m512i;
        type M = __mmask16;

        #[inline(always)]
        fn splat(self, value: f32) -> Self::F {
            wide!(_mm512_set1_ps(value))
        }
        #[inline(always)]
        fn load(self, values: &[f32; LANES]) -> Self::F {
            // Sixteen values are read from a reference to sixteen.
            wide!(_mm512_loadu_ps(values.as_ptr()))
        }
        #[inline(always)]
        fn splat_two(self, first: f32, last: f32) -> Self::F {
            wide!({
                let first = _mm512_castps_pd(_mm512_set1_ps(first));
                _mm512_castpd_ps(_mm512_insertf64x4::<1>(first, _mm256_castps_pd(_mm256_set1_ps(last))))
            })
        }
        #[inline(always)]
        fn or_zero_int(self, mask: Self::M, a: Self::I) -> Self::I {
            wide!(_mm512_maskz_mov_epi32(mask, a))
        }
        #[inline(always)]
        fn store(self, values: Self::F) -> [f32; LANES] {
            let mut out = [0.0; LANES];
            wide!(_mm512_storeu_ps(out.as_mut_ptr(), values));
            out
        }
        #[inline(always)]
        fn add(self, a: Self::F, b: Self::F) -> Self::F {
            wide!(_mm512_add_ps(a, b))
        }
        #[inline(always)]
        fn sub(self, a: Self::F, b: Self::F) -> Self::F {
            wide!(_mm512_sub_ps(a, b))
        }
        #[inline(always)]
        fn mul(self, a: Self::F, b: Self::F) -> Self::F {
            wide!(_mm512_mul_ps(a, b))
        }
        #[inline(always)]
        fn div(self, a: Self::F, b: Self::F) -> Self::F {
            wide!(_mm512_div_ps(a, b))
        }
        #[inline(always)]
        fn mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
            wide!(_mm512_fmadd_ps(a, b, c))
        }
        #[inline(always)]
        fn neg_mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
            wide!(_mm512_fnmadd_ps(a, b, c))
        }
        #[inline(always)]
        fn sqrt(self, a: Self::F) -> Self::F {
            wide!(_mm512_sqrt_ps(a))
        }
        #[inline(always)]
        fn min(self, a: Self::F, b: Self::F) -> Self::F {
            wide!(_mm512_min_ps(a, b))
        }
        #[inline(always)]
        fn max(self, a: Self::F, b: Self::F) -> Self::F {
            wide!(_mm512_max_ps(a, b))
        }
        #[inline(always)]
        fn abs(self, a: Self::F) -> Self::F {
            wide!(_mm512_abs_ps(a))
        }
        #[inline(always)]
        fn octave(self, a: Self::F) -> (Self::F, Self::I) {
            wide!({
                let bits = _mm512_castps_si512(a);
                let exponent = _mm512_sub_epi32(_mm512_srli_epi32::<23>(bits), _mm512_set1_epi32(127));
                let power = _mm512_and_si512(bits, _mm512_set1_epi32(EXPONENT_BITS));
                (_mm512_castsi512_ps(power), exponent)
            })
        }
        #[inline(always)]
        fn floor(self, a: Self::F) -> Self::F {
            wide!(_mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(a))
        }
        #[inline(always)]
        fn negate_where_bit_5(self, a: Self::F, n: Self::I) -> Self::F {
            // a ^ (n·2²⁶ & sign)
            wide!({
                let (bits, sign) = (_mm512_castps_si512(a), _mm512_set1_epi32(i32::MIN));
                _mm512_castsi512_ps(_mm512_ternarylogic_epi32::<0x78>(bits, _mm512_slli_epi32::<26>(n), sign))
            })
        }
        #[inline(always)]
        fn at_most(self, a: Self::F, b: Self::F) -> Self::M {
            wide!(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b))
        }
        #[inline(always)]
        fn and(self, a: Self::M, b: Self::M) -> Self::M {
            a & b
        }
        #[inline(always)]
        fn or(self, a: Self::M, b: Self::M) -> Self::M {
            a | b
        }
        #[inline(always)]
        fn mask(self, bits: u16) -> Self::M {
            bits
        }
        #[inline(always)]
        fn bits(self, mask: Self::M) -> u16 {
            mask
        }
        #[inline(always)]
        fn or_zero(self, mask: Self::M, a: Self::F) -> Self::F {
            wide!(_mm512_maskz_mov_ps(mask, a))
        }
        #[inline(always)]
        fn to_int(self, a: Self::F) -> Self::I {
            wide!(_mm512_cvtps_epi32(a))
        }
        #[inline(always)]
        fn splat_int(self, value: i32) -> Self::I {
            wide!(_mm512_set1_epi32(value))
        }
        #[inline(always)]
        fn load_int(self, values: &[i32; LANES]) -> Self::I {
            // Sixteen values are read from a reference to sixteen.
            wide!(_mm512_loadu_si512(values.as_ptr().cast()))
        }
        #[inline(always)]
        fn store_int(self, values: Self::I) -> [i32; LANES] {
            let mut out = [0; LANES];
            wide!(_mm512_storeu_si512(out.as_mut_ptr().cast(), values));
            out
        }
        #[inline(always)]
        fn add_int(self, a: Self::I, b: Self::I) -> Self::I {
            wide!(_mm512_add_epi32(a, b))
        }
        #[inline(always)]
        fn sub_int(self, a: Self::I, b: Self::I) -> Self::I {
            wide!(_mm512_sub_epi32(a, b))
        }
        #[inline(always)]
        fn to_float(self, a: Self::I) -> Self::F {
            wide!(_mm512_cvtepi32_ps(a))
        }
        #[inline(always)]
        fn max_int(self, a: Self::I, b: Self::I) -> Self::I {
            wide!(_mm512_max_epi32(a, b))
        }
        #[inline(always)]
        fn min_int(self, a: Self::I, b: Self::I) -> Self::I {
            wide!(_mm512_min_epi32(a, b))
        }
        #[inline(always)]
        fn look_up(self, window: &[f32; WINDOW], index: Self::I) -> Self::F {
            // The window has thirty-two values; the permute takes the index modulo 32.
            wide!({
                let low = _mm512_loadu_ps(window.as_ptr());
                let high = _mm512_loadu_ps(window.as_ptr().add(LANES));
                _mm512_permutex2var_ps(low, index, high)
            })
        }
        #[inline(always)]
        fn look_up_half(self, window: &[f32; HALF_WINDOW], index: Self::I) -> Self::F {
            // Four times sixteen values; bit 5 selects between two permutes.
            wide!({
                let at = window.as_ptr();
                let (a, b) = (_mm512_loadu_ps(at), _mm512_loadu_ps(at.add(LANES)));
                let (c, d) = (_mm512_loadu_ps(at.add(2 * LANES)), _mm512_loadu_ps(at.add(3 * LANES)));
                let bit_5 = _mm512_test_epi32_mask(index, _mm512_set1_epi32(32));
                _mm512_mask_mov_ps(_mm512_permutex2var_ps(a, index, b), bit_5, _mm512_permutex2var_ps(c, index, d))
            })
        }
        #[inline(always)]
        fn look_up_wide(self, window: &[f32; WIDE_WINDOW], index: Self::I) -> Self::F {
            // Eight times sixteen values; each permute takes the index modulo 32, bits 5 and 6
            // select among four.
            wide!({
                let at = window.as_ptr();
                let (a, b) = (_mm512_loadu_ps(at), _mm512_loadu_ps(at.add(LANES)));
                let (c, d) = (_mm512_loadu_ps(at.add(2 * LANES)), _mm512_loadu_ps(at.add(3 * LANES)));
                let (e, f) = (_mm512_loadu_ps(at.add(4 * LANES)), _mm512_loadu_ps(at.add(5 * LANES)));
                let (g, h) = (_mm512_loadu_ps(at.add(6 * LANES)), _mm512_loadu_ps(at.add(7 * LANES)));
                let bit_5 = _mm512_test_epi32_mask(index, _mm512_set1_epi32(32));
                let bit_6 = _mm512_test_epi32_mask(index, _mm512_set1_epi32(64));
                let low =
                    _mm512_mask_mov_ps(_mm512_permutex2var_ps(a, index, b), bit_5, _mm512_permutex2var_ps(c, index, d));
                let high =
                    _mm512_mask_mov_ps(_mm512_permutex2var_ps(e, index, f), bit_5, _mm512_permutex2var_ps(g, index, h));
                _mm512_mask_mov_ps(low, bit_6, high)
            })
        }
        #[inline(always)]
        fn gather_int(self, table: &[i32], index: Self::I) -> Self::I {
            assert!(!table.is_empty());
            let last = self.splat_int((table.len() - 1).min(i32::MAX as usize) as i32);
            let index = self.min_int(self.max_int(index, self.splat_int(0)), last);
            // Every index lies within the table.
            wide!(_mm512_i32gather_epi32::<4>(index, table.as_ptr()))
        }
        #[inline(always)]
        fn gather_pairs(self, table: &[f32], index: Self::I) -> (Self::F, Self::F) {
            assert!(table.len() >= 2);
            let last = self.splat_int((table.len() - 2).min(i32::MAX as usize) as i32);
            let index = self.min_int(self.max_int(index, self.splat_int(0)), last);
            // Every pair lies within the table. Two 64-bit gathers take as long as one of the first
            // values alone.
            wide!({
                let (low, high) = (_mm512_castsi512_si256(index), _mm512_extracti64x4_epi64::<1>(index));
                let low = _mm512_castpd_ps(_mm512_i32gather_pd::<4>(low, table.as_ptr().cast()));
                let high = _mm512_castpd_ps(_mm512_i32gather_pd::<4>(high, table.as_ptr().cast()));
                let first = _mm512_loadu_si512(FIRST_OF_PAIRS.as_ptr().cast());
                let next = _mm512_loadu_si512(NEXT_OF_PAIRS.as_ptr().cast());
                (_mm512_permutex2var_ps(low, first, high), _mm512_permutex2var_ps(low, next, high))
            })
        }
    }

    /// Indices, among thirty-two values, of the first and of the second value of each pair.
    const FIRST_OF_PAIRS: [i32; LANES] = [0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30];
    const NEXT_OF_PAIRS: [i32; LANES] = [1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31];

    /// AVX2 and FMA.
    #[derive(Debug, Clone, Copy)]
    pub(in super::super) struct Avx2(());

    impl Avx2 {
        /// `None` where the processor does not support it.
        pub(in super::super) fn detect() -> Option<Self> {
            has(InstructionSet::Avx2).then_some(Self(()))
        }
    }

    macro_rules! both {
        ($f:expr, $a:expr) => {{
            // SAFETY: `self` is the proof that the processor has AVX2 and FMA.
            unsafe { [$f($a[0]), $f($a[1])] }
        }};
        ($f:expr, $a:expr, $b:expr) => {{
            // SAFETY: as above.
            unsafe { [$f($a[0], $b[0]), $f($a[1], $b[1])] }
        }};
        ($f:expr, $a:expr, $b:expr, $c:expr) => {{
            // SAFETY: as above.
            unsafe { [$f($a[0], $b[0], $c[0]), $f($a[1], $b[1], $c[1])] }
        }};
    }

    macro_rules! halves {
        ($call:expr) => {
            // SAFETY: `self` is the proof that the processor has AVX2 and FMA.
            unsafe { $call }
        };
    }

    /// Bit l in lane l.
    const LANE_BITS: [i32; LANES] = {
        let mut bits = [0; LANES];
        let mut l = 0;
        while l < LANES {
            bits[l] = 1 << l;
            l += 1;
        }
        bits
    };

    /// All bits where the value is above 0.
    ///
    /// # Safety
    /// The processor must support AVX2.
    #[inline(always)]
    unsafe fn as_mask(value: __m256i) -> __m256 {
        // SAFETY: by contract.
        unsafe { _mm256_castsi256_ps(_mm256_cmpgt_epi32(value, _mm256_setzero_si256())) }
    }

    impl Lanes for Avx2 {
        type F = [__m256; 2];
        type I = [__m256i; 2];
        type M = [__m256; 2];

        #[inline(always)]
        fn splat(self, value: f32) -> Self::F {
            halves!([_mm256_set1_ps(value); 2])
        }
        #[inline(always)]
        fn load(self, values: &[f32; LANES]) -> Self::F {
            // Two times eight values are read from a reference to sixteen.
            halves!([_mm256_loadu_ps(values.as_ptr()), _mm256_loadu_ps(values.as_ptr().add(8))])
        }
        #[inline(always)]
        fn splat_two(self, first: f32, last: f32) -> Self::F {
            halves!([_mm256_set1_ps(first), _mm256_set1_ps(last)])
        }
        #[inline(always)]
        fn or_zero_int(self, mask: Self::M, a: Self::I) -> Self::I {
            let mask = both!(_mm256_castps_si256, mask);
            both!(_mm256_and_si256, mask, a)
        }
        #[inline(always)]
        fn store(self, values: Self::F) -> [f32; LANES] {
            let mut out = [0.0; LANES];
            halves!({
                _mm256_storeu_ps(out.as_mut_ptr(), values[0]);
                _mm256_storeu_ps(out.as_mut_ptr().add(8), values[1]);
            });
            out
        }
        #[inline(always)]
        fn add(self, a: Self::F, b: Self::F) -> Self::F {
            both!(_mm256_add_ps, a, b)
        }
        #[inline(always)]
        fn sub(self, a: Self::F, b: Self::F) -> Self::F {
            both!(_mm256_sub_ps, a, b)
        }
        #[inline(always)]
        fn mul(self, a: Self::F, b: Self::F) -> Self::F {
            both!(_mm256_mul_ps, a, b)
        }
        #[inline(always)]
        fn div(self, a: Self::F, b: Self::F) -> Self::F {
            both!(_mm256_div_ps, a, b)
        }
        #[inline(always)]
        fn mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
            both!(_mm256_fmadd_ps, a, b, c)
        }
        #[inline(always)]
        fn neg_mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
            both!(_mm256_fnmadd_ps, a, b, c)
        }
        #[inline(always)]
        fn sqrt(self, a: Self::F) -> Self::F {
            both!(_mm256_sqrt_ps, a)
        }
        #[inline(always)]
        fn min(self, a: Self::F, b: Self::F) -> Self::F {
            both!(_mm256_min_ps, a, b)
        }
        #[inline(always)]
        fn max(self, a: Self::F, b: Self::F) -> Self::F {
            both!(_mm256_max_ps, a, b)
        }
        #[inline(always)]
        fn abs(self, a: Self::F) -> Self::F {
            let sign = self.splat(-0.0);
            both!(_mm256_andnot_ps, sign, a)
        }
        #[inline(always)]
        fn octave(self, a: Self::F) -> (Self::F, Self::I) {
            let bits = both!(_mm256_castps_si256, a);
            let power = both!(_mm256_and_si256, bits, self.splat_int(EXPONENT_BITS));
            let exponent = self.sub_int(both!(_mm256_srli_epi32::<23>, bits), self.splat_int(127));
            (both!(_mm256_castsi256_ps, power), exponent)
        }
        #[inline(always)]
        fn floor(self, a: Self::F) -> Self::F {
            both!(_mm256_floor_ps, a)
        }
        #[inline(always)]
        fn negate_where_bit_5(self, a: Self::F, n: Self::I) -> Self::F {
            let (bit, sign) = (both!(_mm256_slli_epi32::<26>, n), self.splat_int(i32::MIN));
            let sign = both!(_mm256_and_si256, bit, sign);
            let sign = both!(_mm256_castsi256_ps, sign);
            both!(_mm256_xor_ps, a, sign)
        }
        #[inline(always)]
        fn at_most(self, a: Self::F, b: Self::F) -> Self::M {
            both!(_mm256_cmp_ps::<_CMP_LE_OQ>, a, b)
        }
        #[inline(always)]
        fn and(self, a: Self::M, b: Self::M) -> Self::M {
            both!(_mm256_and_ps, a, b)
        }
        #[inline(always)]
        fn or(self, a: Self::M, b: Self::M) -> Self::M {
            both!(_mm256_or_ps, a, b)
        }
        #[inline(always)]
        fn mask(self, bits: u16) -> Self::M {
            let (all, lanes) = (self.splat_int(i32::from(bits)), self.load_int(&LANE_BITS));
            let own = both!(_mm256_and_si256, all, lanes);
            both!(as_mask, own)
        }
        #[inline(always)]
        fn bits(self, mask: Self::M) -> u16 {
            let [low, high] = both!(_mm256_movemask_ps, mask);
            low as u16 | (high as u16) << 8
        }
        #[inline(always)]
        fn or_zero(self, mask: Self::M, a: Self::F) -> Self::F {
            both!(_mm256_and_ps, mask, a)
        }
        #[inline(always)]
        fn to_int(self, a: Self::F) -> Self::I {
            both!(_mm256_cvtps_epi32, a)
        }
        #[inline(always)]
        fn splat_int(self, value: i32) -> Self::I {
            halves!([_mm256_set1_epi32(value); 2])
        }
        #[inline(always)]
        fn load_int(self, values: &[i32; LANES]) -> Self::I {
            // Two times eight values are read from a reference to sixteen.
            let at = values.as_ptr();
            halves!([_mm256_loadu_si256(at.cast()), _mm256_loadu_si256(at.add(8).cast())])
        }
        #[inline(always)]
        fn store_int(self, values: Self::I) -> [i32; LANES] {
            let mut out = [0; LANES];
            halves!({
                _mm256_storeu_si256(out.as_mut_ptr().cast(), values[0]);
                _mm256_storeu_si256(out.as_mut_ptr().add(8).cast(), values[1]);
            });
            out
        }
        #[inline(always)]
        fn add_int(self, a: Self::I, b: Self::I) -> Self::I {
            both!(_mm256_add_epi32, a, b)
        }
        #[inline(always)]
        fn sub_int(self, a: Self::I, b: Self::I) -> Self::I {
            both!(_mm256_sub_epi32, a, b)
        }
        #[inline(always)]
        fn to_float(self, a: Self::I) -> Self::F {
            both!(_mm256_cvtepi32_ps, a)
        }
        #[inline(always)]
        fn max_int(self, a: Self::I, b: Self::I) -> Self::I {
            both!(_mm256_max_epi32, a, b)
        }
        #[inline(always)]
        fn min_int(self, a: Self::I, b: Self::I) -> Self::I {
            both!(_mm256_min_epi32, a, b)
        }
        #[inline(always)]
        fn look_up(self, window: &[f32; WINDOW], index: Self::I) -> Self::F {
            let within = self.splat_int(WINDOW as i32 - 1);
            let index = both!(_mm256_and_si256, index, within);
            // Every index lies within the window.
            halves!([
                _mm256_i32gather_ps::<4>(window.as_ptr(), index[0]),
                _mm256_i32gather_ps::<4>(window.as_ptr(), index[1])
            ])
        }
        #[inline(always)]
        fn look_up_half(self, window: &[f32; HALF_WINDOW], index: Self::I) -> Self::F {
            let within = self.splat_int(HALF_WINDOW as i32 - 1);
            let index = both!(_mm256_and_si256, index, within);
            // Every index lies within the window.
            halves!([
                _mm256_i32gather_ps::<4>(window.as_ptr(), index[0]),
                _mm256_i32gather_ps::<4>(window.as_ptr(), index[1])
            ])
        }
        #[inline(always)]
        fn look_up_wide(self, window: &[f32; WIDE_WINDOW], index: Self::I) -> Self::F {
            let within = self.splat_int(WIDE_WINDOW as i32 - 1);
            let index = both!(_mm256_and_si256, index, within);
            // Every index lies within the window.
            halves!([
                _mm256_i32gather_ps::<4>(window.as_ptr(), index[0]),
                _mm256_i32gather_ps::<4>(window.as_ptr(), index[1])
            ])
        }
        #[inline(always)]
        fn gather_int(self, table: &[i32], index: Self::I) -> Self::I {
            assert!(!table.is_empty());
            let last = self.splat_int((table.len() - 1).min(i32::MAX as usize) as i32);
            let index = self.min_int(self.max_int(index, self.splat_int(0)), last);
            // Every index lies within the table.
            halves!([
                _mm256_i32gather_epi32::<4>(table.as_ptr(), index[0]),
                _mm256_i32gather_epi32::<4>(table.as_ptr(), index[1])
            ])
        }
        #[inline(always)]
        fn gather_pairs(self, table: &[f32], index: Self::I) -> (Self::F, Self::F) {
            assert!(table.len() >= 2);
            let last = self.splat_int((table.len() - 2).min(i32::MAX as usize) as i32);
            let index = self.min_int(self.max_int(index, self.splat_int(0)), last);
            // Within each eight 0, 1, 4, 5, then 2, 3, 6, 7, as the shuffles require.
            let order = self.load_int(&[0, 1, 4, 5, 2, 3, 6, 7, 0, 1, 4, 5, 2, 3, 6, 7]);
            let index = both!(_mm256_permutevar8x32_epi32, index, order);
            // Every pair lies within the table.
            let gathered = halves!([
                four_pairs(table.as_ptr(), _mm256_castsi256_si128(index[0])),
                four_pairs(table.as_ptr(), _mm256_extracti128_si256::<1>(index[0])),
                four_pairs(table.as_ptr(), _mm256_castsi256_si128(index[1])),
                four_pairs(table.as_ptr(), _mm256_extracti128_si256::<1>(index[1]))
            ]);
            let [a, b, c, d] = gathered;
            let (low, high) = ([a, c], [b, d]);
            (both!(_mm256_shuffle_ps::<0x88>, low, high), both!(_mm256_shuffle_ps::<0xdd>, low, high))
        }
    }

    /// Four pairs of values.
    ///
    /// # Safety
    /// The processor must support AVX2, and two values must lie at each index.
    #[inline(always)]
    unsafe fn four_pairs(table: *const f32, index: __m128i) -> __m256 {
        // SAFETY: by contract; gathers do not require alignment.
        unsafe { _mm256_castpd_ps(_mm256_i32gather_pd::<4>(table.cast(), index)) }
    }
}

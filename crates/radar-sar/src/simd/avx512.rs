//! Vector operations with AVX-512.

use std::arch::x86_64::*;

use super::dispatch::{InstructionSet, Part, avx512_apart};
use super::lanes::{LANES, Lanes, limited};

/// Proof that the processor has the instructions of [`InstructionSet::Avx512`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Avx512(());

impl Avx512 {
    /// `None` where the instructions are not in use.
    #[inline(always)]
    pub fn detect() -> Option<Self> {
        (InstructionSet::in_use() >= InstructionSet::Avx512).then_some(Self(()))
    }
}

/// Instructions on registers.
macro_rules! avx512 {
    ($instructions:expr) => {
        // SAFETY: `self`, a parameter of every method, is the proof that the processor has them.
        unsafe { $instructions }
    };
}

macro_rules! apply {
    ($instruction:expr, $($of:ident),+) => {
        avx512!($instruction($($of),+))
    };
}

impl Lanes for Avx512 {
    type F = __m512;
    type I = __m512i;
    type M = __mmask16;
    const WIDE_WINDOWS: bool = true;
    tables_in_registers!();

    lanewise! {
        add(a: F, b: F) -> F = _mm512_add_ps;
        sub(a: F, b: F) -> F = _mm512_sub_ps;
        mul(a: F, b: F) -> F = _mm512_mul_ps;
        div(a: F, b: F) -> F = _mm512_div_ps;
        mul_add(a: F, b: F, c: F) -> F = _mm512_fmadd_ps;
        neg_mul_add(a: F, b: F, c: F) -> F = _mm512_fnmadd_ps;
        sqrt(a: F) -> F = _mm512_sqrt_ps;
        min(a: F, b: F) -> F = _mm512_min_ps;
        max(a: F, b: F) -> F = _mm512_max_ps;
        floor(a: F) -> F = _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>;
        to_int(a: F) -> I = _mm512_cvtps_epi32;
        to_int_toward_zero(a: F) -> I = _mm512_cvttps_epi32;
        to_float(a: I) -> F = _mm512_cvtepi32_ps;
        bits_of(a: F) -> I = _mm512_castps_si512;
        with_bits(a: I) -> F = _mm512_castsi512_ps;
        add_int(a: I, b: I) -> I = _mm512_add_epi32;
        sub_int(a: I, b: I) -> I = _mm512_sub_epi32;
        min_int(a: I, b: I) -> I = _mm512_min_epi32;
        max_int(a: I, b: I) -> I = _mm512_max_epi32;
        and_int(a: I, b: I) -> I = _mm512_and_si512;
        xor_int(a: I, b: I) -> I = _mm512_xor_si512;
        shift_left(a: I, by: I) -> I = _mm512_sllv_epi32;
        shift_right(a: I, by: I) -> I = _mm512_srlv_epi32;
        at_most(a: F, b: F) -> M = _mm512_cmp_ps_mask::<_CMP_LE_OQ>;
        and(a: M, b: M) -> M = _kand_mask16;
        or(a: M, b: M) -> M = _kor_mask16;
        or_zero(mask: M, a: F) -> F = _mm512_maskz_mov_ps;
        or_zero_int(mask: M, a: I) -> I = _mm512_maskz_mov_epi32;
    }

    #[inline(always)]
    fn apart<P: Part<Self>>(self, part: P) -> P::Out {
        // SAFETY: `self` is the proof that the processor has the instructions that it is compiled for.
        unsafe { avx512_apart(self, part) }
    }
    #[inline(always)]
    fn splat(self, value: f32) -> Self::F {
        avx512!(_mm512_set1_ps(value))
    }
    #[cfg(feature = "rolling")]
    #[inline(always)]
    fn splat_two(self, first: f32, last: f32) -> Self::F {
        avx512!({
            let first = _mm512_castps_pd(_mm512_set1_ps(first));
            _mm512_castpd_ps(_mm512_insertf64x4::<1>(first, _mm256_castps_pd(_mm256_set1_ps(last))))
        })
    }
    #[inline(always)]
    fn load(self, values: &[f32; LANES]) -> Self::F {
        // SAFETY: as above; sixteen values are read from a reference to sixteen.
        unsafe { _mm512_loadu_ps(values.as_ptr()) }
    }
    #[inline(always)]
    fn store(self, values: Self::F) -> [f32; LANES] {
        let mut out = [0.0; LANES];
        // SAFETY: as above; sixteen values are written to an array of sixteen.
        unsafe { _mm512_storeu_ps(out.as_mut_ptr(), values) };
        out
    }
    #[inline(always)]
    fn splat_int(self, value: i32) -> Self::I {
        avx512!(_mm512_set1_epi32(value))
    }
    #[inline(always)]
    fn load_int(self, values: &[i32; LANES]) -> Self::I {
        // SAFETY: as in `load`.
        unsafe { _mm512_loadu_epi32(values.as_ptr()) }
    }
    #[inline(always)]
    fn store_int(self, values: Self::I) -> [i32; LANES] {
        let mut out = [0; LANES];
        // SAFETY: as in `store`.
        unsafe { _mm512_storeu_epi32(out.as_mut_ptr(), values) };
        out
    }
    #[inline(always)]
    fn mask(self, bits: u16) -> Self::M {
        bits
    }
    #[inline(always)]
    fn mask_bits(self, mask: Self::M) -> u16 {
        mask
    }
    #[inline(always)]
    fn permute(self, table: Self::F, index: Self::I) -> Self::F {
        avx512!(_mm512_permutexvar_ps(index, table))
    }
    #[inline(always)]
    fn load_twice(self, values: &[f32; 8]) -> Self::F {
        // SAFETY: as above; eight values are read from a reference to eight.
        unsafe { _mm512_broadcast_f32x8(_mm256_loadu_ps(values.as_ptr())) }
    }
    #[inline(always)]
    fn permute_eight(self, table: Self::F, index: Self::I) -> Self::F {
        self.permute(table, index)
    }
    #[inline(always)]
    fn look_up<const N: usize>(self, window: &[f32; N], index: Self::I) -> Self::F {
        const { assert!(N == 8 || N == 16 || N == 32 || N == 64 || N == 128) };
        let at = window.as_ptr();
        // SAFETY: as above; the window has N values.
        unsafe {
            match N {
                8 => _mm512_permutexvar_ps(index, _mm512_broadcast_f32x8(_mm256_loadu_ps(at))),
                16 => _mm512_permutexvar_ps(index, _mm512_loadu_ps(at)),
                32 => among_32(at, index),
                64 => among_64(at, index),
                _ => {
                    let bit_6 = _mm512_test_epi32_mask(index, _mm512_set1_epi32(64));
                    _mm512_mask_mov_ps(among_64(at, index), bit_6, among_64(at.add(64), index))
                }
            }
        }
    }
    #[inline(always)]
    fn gather_int(self, table: &[i32], index: Self::I) -> Self::I {
        assert!(!table.is_empty());
        let index = limited(self, index, table.len() - 1);
        // SAFETY: as above; every index lies within the table.
        unsafe { _mm512_i32gather_epi32::<4>(index, table.as_ptr()) }
    }
    #[inline(always)]
    fn gather_pairs(self, table: &[f32], index: Self::I) -> (Self::F, Self::F) {
        assert!(table.len() >= 2);
        let index = limited(self, index, table.len() - 2);
        let (first, next) = (self.load_int(&FIRST_OF_PAIRS), self.load_int(&NEXT_OF_PAIRS));
        // SAFETY: as above; every pair lies within the table. Two 64-bit gathers take as long as
        // one of the first values alone.
        unsafe {
            let (low, high) = (_mm512_castsi512_si256(index), _mm512_extracti64x4_epi64::<1>(index));
            let low = _mm512_castpd_ps(_mm512_i32gather_pd::<4>(low, table.as_ptr().cast()));
            let high = _mm512_castpd_ps(_mm512_i32gather_pd::<4>(high, table.as_ptr().cast()));
            (_mm512_permutex2var_ps(low, first, high), _mm512_permutex2var_ps(low, next, high))
        }
    }
}

/// Indices, among thirty-two values, of the first and of the second value of each pair.
const FIRST_OF_PAIRS: [i32; LANES] = [0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30];
const NEXT_OF_PAIRS: [i32; LANES] = [1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31];

/// Entries of 32 by the index modulo 32.
///
/// # Safety
/// The processor must support AVX-512, and `at` must point to 32 values.
#[inline(always)]
unsafe fn among_32(at: *const f32, index: __m512i) -> __m512 {
    // SAFETY: by contract.
    unsafe { _mm512_permutex2var_ps(_mm512_loadu_ps(at), index, _mm512_loadu_ps(at.add(LANES))) }
}

/// Entries of 64 by the index modulo 64: bit 5 selects between two permutes.
///
/// # Safety
/// The processor must support AVX-512, and `at` must point to 64 values.
#[inline(always)]
unsafe fn among_64(at: *const f32, index: __m512i) -> __m512 {
    // SAFETY: by contract.
    unsafe {
        let bit_5 = _mm512_test_epi32_mask(index, _mm512_set1_epi32(32));
        _mm512_mask_mov_ps(among_32(at, index), bit_5, among_32(at.add(32), index))
    }
}

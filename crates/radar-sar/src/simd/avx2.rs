//! Vector operations with AVX2 and FMA: two registers of eight lanes.

use std::arch::x86_64::*;

use super::dispatch::{InstructionSet, Part, avx2_apart};
use super::lanes::{LANE_BITS, LANES, Lanes, limited};

/// Proof that the processor has the instructions of [`InstructionSet::Avx2`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Avx2(());

impl Avx2 {
    /// `None` where the instructions are not in use.
    #[inline(always)]
    pub fn detect() -> Option<Self> {
        (InstructionSet::in_use() >= InstructionSet::Avx2).then_some(Self(()))
    }
}

/// One instruction on both halves.
macro_rules! apply {
    ($instruction:expr, $($of:ident),+) => {
        // SAFETY: `self`, a parameter of every method, is the proof that the processor has it.
        unsafe { [$instruction($($of[0]),+), $instruction($($of[1]),+)] }
    };
}

impl Lanes for Avx2 {
    type F = [__m256; 2];
    type I = [__m256i; 2];
    type M = [__m256; 2];
    type Table = [f32; LANES];
    const NEAR_IS_FASTER: bool = true;
    const WIDE_WINDOWS: bool = false;

    lanewise! {
        add(a: F, b: F) -> F = _mm256_add_ps;
        sub(a: F, b: F) -> F = _mm256_sub_ps;
        mul(a: F, b: F) -> F = _mm256_mul_ps;
        div(a: F, b: F) -> F = _mm256_div_ps;
        mul_add(a: F, b: F, c: F) -> F = _mm256_fmadd_ps;
        neg_mul_add(a: F, b: F, c: F) -> F = _mm256_fnmadd_ps;
        sqrt(a: F) -> F = _mm256_sqrt_ps;
        min(a: F, b: F) -> F = _mm256_min_ps;
        max(a: F, b: F) -> F = _mm256_max_ps;
        floor(a: F) -> F = _mm256_floor_ps;
        to_int(a: F) -> I = _mm256_cvtps_epi32;
        to_int_toward_zero(a: F) -> I = _mm256_cvttps_epi32;
        to_float(a: I) -> F = _mm256_cvtepi32_ps;
        bits_of(a: F) -> I = _mm256_castps_si256;
        with_bits(a: I) -> F = _mm256_castsi256_ps;
        add_int(a: I, b: I) -> I = _mm256_add_epi32;
        sub_int(a: I, b: I) -> I = _mm256_sub_epi32;
        min_int(a: I, b: I) -> I = _mm256_min_epi32;
        max_int(a: I, b: I) -> I = _mm256_max_epi32;
        and_int(a: I, b: I) -> I = _mm256_and_si256;
        xor_int(a: I, b: I) -> I = _mm256_xor_si256;
        shift_left(a: I, by: I) -> I = _mm256_sllv_epi32;
        shift_right(a: I, by: I) -> I = _mm256_srlv_epi32;
        at_most(a: F, b: F) -> M = _mm256_cmp_ps::<_CMP_LE_OQ>;
        and(a: M, b: M) -> M = _mm256_and_ps;
        or(a: M, b: M) -> M = _mm256_or_ps;
        or_zero(mask: M, a: F) -> F = _mm256_and_ps;
    }

    #[inline(always)]
    fn apart<P: Part<Self>>(self, part: P) -> P::Out {
        // SAFETY: `self` is the proof that the processor has the instructions that it is compiled for.
        unsafe { avx2_apart(self, part) }
    }
    #[inline(always)]
    fn splat(self, value: f32) -> Self::F {
        let both = [value; 2];
        apply!(_mm256_set1_ps, both)
    }
    #[cfg(feature = "rolling")]
    #[inline(always)]
    fn splat_two(self, first: f32, last: f32) -> Self::F {
        let both = [first, last];
        apply!(_mm256_set1_ps, both)
    }
    #[inline(always)]
    fn load(self, values: &[f32; LANES]) -> Self::F {
        let at = values.as_ptr();
        // SAFETY: as above; two times eight values are read from a reference to sixteen.
        unsafe { [_mm256_loadu_ps(at), _mm256_loadu_ps(at.add(8))] }
    }
    #[inline(always)]
    fn store(self, values: Self::F) -> [f32; LANES] {
        let mut out = [0.0; LANES];
        // SAFETY: as above; two times eight values are written to an array of sixteen.
        unsafe {
            _mm256_storeu_ps(out.as_mut_ptr(), values[0]);
            _mm256_storeu_ps(out.as_mut_ptr().add(8), values[1]);
        }
        out
    }
    #[inline(always)]
    fn splat_int(self, value: i32) -> Self::I {
        let both = [value; 2];
        apply!(_mm256_set1_epi32, both)
    }
    #[inline(always)]
    fn load_int(self, values: &[i32; LANES]) -> Self::I {
        let at = values.as_ptr();
        // SAFETY: as in `load`.
        unsafe { [_mm256_loadu_si256(at.cast()), _mm256_loadu_si256(at.add(8).cast())] }
    }
    #[inline(always)]
    fn store_int(self, values: Self::I) -> [i32; LANES] {
        let mut out = [0; LANES];
        // SAFETY: as in `store`.
        unsafe {
            _mm256_storeu_si256(out.as_mut_ptr().cast(), values[0]);
            _mm256_storeu_si256(out.as_mut_ptr().add(8).cast(), values[1]);
        }
        out
    }
    #[inline(always)]
    fn mask(self, bits: u16) -> Self::M {
        let own = self.and_int(self.splat_int(i32::from(bits)), self.load_int(&LANE_BITS));
        let zero = self.splat_int(0);
        self.with_bits(apply!(_mm256_cmpgt_epi32, own, zero))
    }
    #[inline(always)]
    fn mask_bits(self, mask: Self::M) -> u16 {
        let [low, high] = apply!(_mm256_movemask_ps, mask);
        low as u16 | (high as u16) << 8
    }
    #[inline(always)]
    fn or_zero_int(self, mask: Self::M, a: Self::I) -> Self::I {
        self.and_int(self.bits_of(mask), a)
    }
    #[inline(always)]
    fn permute(self, table: Self::F, index: Self::I) -> Self::F {
        let [low, high] = [[table[0]; 2], [table[1]; 2]];
        let (low, high) = (apply!(_mm256_permutevar8x32_ps, low, index), apply!(_mm256_permutevar8x32_ps, high, index));
        self.select::<3>(index, low, high)
    }
    #[inline(always)]
    fn load_twice(self, values: &[f32; 8]) -> Self::F {
        [self.eight(values, 0); 2]
    }
    #[inline(always)]
    fn permute_eight(self, table: Self::F, index: Self::I) -> Self::F {
        apply!(_mm256_permutevar8x32_ps, table, index)
    }
    #[inline(always)]
    fn table(self, entries: Self::F) -> Self::Table {
        self.store(entries)
    }
    #[inline(always)]
    fn entries(self, table: &Self::Table) -> Self::F {
        self.load(table)
    }
    #[inline(always)]
    fn permute_near(self, table: &Self::Table, starts: [i32; 2], index: Self::I) -> Self::F {
        let from = [starts[0].clamp(0, 8), starts[1].clamp(0, 8)];
        let eight = [self.eight(table, from[0] as usize), self.eight(table, from[1] as usize)];
        let first = apply!(_mm256_set1_epi32, from);
        let index = self.sub_int(index, first);
        // The instruction takes the index modulo eight.
        apply!(_mm256_permutevar8x32_ps, eight, index)
    }
    #[inline(always)]
    fn look_up<const N: usize>(self, window: &[f32; N], index: Self::I) -> Self::F {
        const { assert!(N == 8 || N == 16 || N == 32 || N == 64 || N == 128) };
        match N {
            8 => {
                let table = [self.eight(window, 0); 2];
                self.permute_eight(table, index)
            }
            16 => self.among_16(window, 0, index),
            32 => self.select::<4>(index, self.among_16(window, 0, index), self.among_16(window, 16, index)),
            _ => {
                let at = self.store_int(self.and_int(index, self.splat_int(N as i32 - 1)));
                // SAFETY: as above; every index lies within the window, whose length is a power of
                // two.
                unsafe { [eight_of(window.as_ptr(), &at, 0), eight_of(window.as_ptr(), &at, 8)] }
            }
        }
    }
    #[inline(always)]
    fn gather_int(self, table: &[i32], index: Self::I) -> Self::I {
        assert!(!table.is_empty());
        let at = self.store_int(limited(self, index, table.len() - 1));
        let table = table.as_ptr().cast();
        // SAFETY: as above; every index lies within the table.
        self.bits_of(unsafe { [eight_of(table, &at, 0), eight_of(table, &at, 8)] })
    }
    #[inline(always)]
    fn gather_pairs(self, table: &[f32], index: Self::I) -> (Self::F, Self::F) {
        assert!(table.len() >= 2);
        let at = self.store_int(limited(self, index, table.len() - 2));
        let table = table.as_ptr();
        // SAFETY: as above; every pair lies within the table.
        let (low, high) = unsafe {
            (
                [four_pairs_of(table, &at, [0, 1, 4, 5]), four_pairs_of(table, &at, [8, 9, 12, 13])],
                [four_pairs_of(table, &at, [2, 3, 6, 7]), four_pairs_of(table, &at, [10, 11, 14, 15])],
            )
        };
        (apply!(_mm256_shuffle_ps::<0x88>, low, high), apply!(_mm256_shuffle_ps::<0xdd>, low, high))
    }
}

impl Avx2 {
    /// Of sixteen entries from `from` on, those that the low four bits of the index select.
    #[inline(always)]
    fn among_16(self, window: &[f32], from: usize, index: [__m256i; 2]) -> [__m256; 2] {
        self.permute([self.eight(window, from), self.eight(window, from + 8)], index)
    }

    /// Eight entries from `from` on.
    #[inline(always)]
    fn eight(self, window: &[f32], from: usize) -> __m256 {
        let eight = &window[from..from + 8];
        // SAFETY: `self` is the proof that the processor has it; eight values are read from a slice
        // of eight.
        unsafe { _mm256_loadu_ps(eight.as_ptr()) }
    }

    /// `set` in lanes whose index has that bit set, `clear` in the others.
    #[inline(always)]
    fn select<const BIT: i32>(self, index: [__m256i; 2], clear: [__m256; 2], set: [__m256; 2]) -> [__m256; 2] {
        // The blend tests the sign bit.
        let sign = self.with_bits(self.shift_left(index, self.splat_int(31 - BIT)));
        apply!(_mm256_blendv_ps, clear, set, sign)
    }
}

// Single loads instead of hardware gathers. With gathers here and in windows, dense volumes take two
// to three times as long on Zen 3 (`cargo bench -p radar-sar --bench backprojection`); other
// processors with AVX2 were not measured.

/// Entries at eight of sixteen indices, from index `from` on.
///
/// # Safety
/// The processor must support AVX2, and each index must lie within the table.
#[inline(always)]
unsafe fn eight_of(table: *const f32, at: &[i32; LANES], from: usize) -> __m256 {
    // SAFETY: by contract.
    unsafe {
        _mm256_setr_ps(
            *table.add(at[from] as usize),
            *table.add(at[from + 1] as usize),
            *table.add(at[from + 2] as usize),
            *table.add(at[from + 3] as usize),
            *table.add(at[from + 4] as usize),
            *table.add(at[from + 5] as usize),
            *table.add(at[from + 6] as usize),
            *table.add(at[from + 7] as usize),
        )
    }
}

/// Entries at the indices in these four lanes, each with the next.
///
/// # Safety
/// As [`eight_of`], and a further entry must follow each.
#[inline(always)]
unsafe fn four_pairs_of(table: *const f32, at: &[i32; LANES], lanes: [usize; 4]) -> __m256 {
    let [a, b, c, d] = lanes;
    // SAFETY: by contract; the loads do not require alignment.
    unsafe {
        _mm256_castpd_ps(_mm256_setr_pd(
            table.add(at[a] as usize).cast::<f64>().read_unaligned(),
            table.add(at[b] as usize).cast::<f64>().read_unaligned(),
            table.add(at[c] as usize).cast::<f64>().read_unaligned(),
            table.add(at[d] as usize).cast::<f64>().read_unaligned(),
        ))
    }
}

//! Vector operations with NEON, which every processor of the architecture AArch64 has: four registers of four lanes.

use std::arch::aarch64::*;
use std::array::from_fn;

use super::dispatch::{InstructionSet, Part};
use super::lanes::{LANE_BITS, LANES, Lanes, limited};

/// NEON, where it is in use.
#[derive(Debug, Clone, Copy)]
pub(super) struct Neon(());

impl Neon {
    /// `None` where the instructions are not in use.
    #[inline(always)]
    pub fn detect() -> Option<Self> {
        (InstructionSet::in_use() >= InstructionSet::Neon).then_some(Self(()))
    }
}

/// One instruction on each quarter.
macro_rules! apply {
    ($instruction:expr, $($of:ident),+) => {
        // SAFETY: the architecture has it.
        unsafe {
            [
                $instruction($($of[0]),+),
                $instruction($($of[1]),+),
                $instruction($($of[2]),+),
                $instruction($($of[3]),+),
            ]
        }
    };
}

impl Lanes for Neon {
    type F = [float32x4_t; 4];
    type I = [int32x4_t; 4];
    type M = [uint32x4_t; 4];
    const WIDE_WINDOWS: bool = false;
    tables_in_registers!();

    lanewise! {
        add(a: F, b: F) -> F = vaddq_f32;
        sub(a: F, b: F) -> F = vsubq_f32;
        mul(a: F, b: F) -> F = vmulq_f32;
        div(a: F, b: F) -> F = vdivq_f32;
        mul_add(a: F, b: F, c: F) -> F = mul_add;
        neg_mul_add(a: F, b: F, c: F) -> F = neg_mul_add;
        sqrt(a: F) -> F = vsqrtq_f32;
        min(a: F, b: F) -> F = min;
        max(a: F, b: F) -> F = max;
        floor(a: F) -> F = vrndmq_f32;
        to_int(a: F) -> I = vcvtnq_s32_f32;
        to_int_toward_zero(a: F) -> I = vcvtq_s32_f32;
        to_float(a: I) -> F = vcvtq_f32_s32;
        bits_of(a: F) -> I = vreinterpretq_s32_f32;
        with_bits(a: I) -> F = vreinterpretq_f32_s32;
        add_int(a: I, b: I) -> I = vaddq_s32;
        sub_int(a: I, b: I) -> I = vsubq_s32;
        min_int(a: I, b: I) -> I = vminq_s32;
        max_int(a: I, b: I) -> I = vmaxq_s32;
        and_int(a: I, b: I) -> I = vandq_s32;
        xor_int(a: I, b: I) -> I = veorq_s32;
        shift_left(a: I, by: I) -> I = vshlq_s32;
        shift_right(a: I, by: I) -> I = shift_right;
        at_most(a: F, b: F) -> M = vcleq_f32;
        and(a: M, b: M) -> M = vandq_u32;
        or(a: M, b: M) -> M = vorrq_u32;
        or_zero(mask: M, a: F) -> F = or_zero;
        or_zero_int(mask: M, a: I) -> I = or_zero_int;
    }

    #[inline(never)]
    fn apart<P: Part<Self>>(self, part: P) -> P::Out {
        part.run(self)
    }
    #[inline(always)]
    fn splat(self, value: f32) -> Self::F {
        let each = [value; 4];
        apply!(vdupq_n_f32, each)
    }
    #[cfg(feature = "rolling")]
    #[inline(always)]
    fn splat_two(self, first: f32, last: f32) -> Self::F {
        let each = [first, first, last, last];
        apply!(vdupq_n_f32, each)
    }
    #[inline(always)]
    fn load(self, values: &[f32; LANES]) -> Self::F {
        let at = values.as_ptr();
        // SAFETY: four times four values are read from a reference to sixteen.
        unsafe { [vld1q_f32(at), vld1q_f32(at.add(4)), vld1q_f32(at.add(8)), vld1q_f32(at.add(12))] }
    }
    #[inline(always)]
    fn store(self, values: Self::F) -> [f32; LANES] {
        let mut out = [0.0; LANES];
        let at = out.as_mut_ptr();
        // SAFETY: four times four values are written to an array of sixteen.
        unsafe {
            vst1q_f32(at, values[0]);
            vst1q_f32(at.add(4), values[1]);
            vst1q_f32(at.add(8), values[2]);
            vst1q_f32(at.add(12), values[3]);
        }
        out
    }
    #[inline(always)]
    fn splat_int(self, value: i32) -> Self::I {
        let each = [value; 4];
        apply!(vdupq_n_s32, each)
    }
    #[inline(always)]
    fn load_int(self, values: &[i32; LANES]) -> Self::I {
        let at = values.as_ptr();
        // SAFETY: as in `load`.
        unsafe { [vld1q_s32(at), vld1q_s32(at.add(4)), vld1q_s32(at.add(8)), vld1q_s32(at.add(12))] }
    }
    #[inline(always)]
    fn store_int(self, values: Self::I) -> [i32; LANES] {
        let mut out = [0; LANES];
        let at = out.as_mut_ptr();
        // SAFETY: as in `store`.
        unsafe {
            vst1q_s32(at, values[0]);
            vst1q_s32(at.add(4), values[1]);
            vst1q_s32(at.add(8), values[2]);
            vst1q_s32(at.add(12), values[3]);
        }
        out
    }
    #[inline(always)]
    fn mask(self, bits: u16) -> Self::M {
        let (all, own) = (self.splat_int(i32::from(bits)), self.load_int(&LANE_BITS));
        apply!(vtstq_s32, all, own)
    }
    #[inline(always)]
    fn mask_bits(self, mask: Self::M) -> u16 {
        let own = self.load_int(&LANE_BITS);
        let bits = apply!(or_zero_int, mask, own);
        let [a, b, c, d] = apply!(vaddvq_s32, bits);
        (a | b | c | d) as u16
    }
    #[inline(always)]
    fn permute(self, table: Self::F, index: Self::I) -> Self::F {
        let bytes = self.bytes_of_entries::<16>(index);
        let four = [Self::four_registers(table); 4];
        apply!(among_16, four, bytes)
    }
    #[inline(always)]
    fn load_twice(self, values: &[f32; 8]) -> Self::F {
        let at = values.as_ptr();
        // SAFETY: two times four values are read from a reference to eight.
        let [low, high] = unsafe { [vld1q_f32(at), vld1q_f32(at.add(4))] };
        [low, high, low, high]
    }
    #[inline(always)]
    fn permute_eight(self, table: Self::F, index: Self::I) -> Self::F {
        let bytes = self.bytes_of_entries::<8>(index);
        let uint8x16x4_t(low, high, ..) = Self::four_registers(table);
        let two = [uint8x16x2_t(low, high); 4];
        apply!(among_8, two, bytes)
    }
    #[inline(always)]
    fn look_up<const N: usize>(self, window: &[f32; N], index: Self::I) -> Self::F {
        const { assert!(N == 8 || N == 16 || N == 32 || N == 64 || N == 128) };
        let at = window.as_ptr();
        match N {
            8 => {
                let bytes = self.bytes_of_entries::<8>(index);
                // SAFETY: eight values are read from a window of eight.
                let table = unsafe { uint8x16x2_t(sixteen_bytes(at), sixteen_bytes(at.add(4))) };
                let two = [table; 4];
                apply!(among_8, two, bytes)
            }
            16 => {
                let bytes = self.bytes_of_entries::<16>(index);
                // SAFETY: sixteen values are read from a window of sixteen.
                let four = [unsafe { sixty_four_bytes(at) }; 4];
                apply!(among_16, four, bytes)
            }
            32 => {
                let bytes = self.bytes_of_entries::<32>(index);
                // SAFETY: two times sixteen values are read from a window of thirty-two.
                let (low, high) = unsafe { ([sixty_four_bytes(at); 4], [sixty_four_bytes(at.add(16)); 4]) };
                apply!(among_32, low, high, bytes)
            }
            _ => {
                let at = self.store_int(self.and_int(index, self.splat_int(N as i32 - 1)));
                self.load(&from_fn(|l| window[at[l] as usize]))
            }
        }
    }
    #[inline(always)]
    fn gather_int(self, table: &[i32], index: Self::I) -> Self::I {
        let at = self.store_int(limited(self, index, table.len() - 1));
        self.load_int(&from_fn(|l| table[at[l] as usize]))
    }
    #[inline(always)]
    fn gather_pairs(self, table: &[f32], index: Self::I) -> (Self::F, Self::F) {
        let at = self.store_int(limited(self, index, table.len() - 2));
        (self.load(&from_fn(|l| table[at[l] as usize])), self.load(&from_fn(|l| table[at[l] as usize + 1])))
    }
}

impl Neon {
    /// For each lane the four bytes of entry `index` modulo N in a table of f32.
    #[inline(always)]
    fn bytes_of_entries<const N: i32>(self, index: [int32x4_t; 4]) -> [uint8x16_t; 4] {
        let entry = self.and_int(index, self.splat_int(N - 1));
        let (each, first) = (self.splat_int(0x0404_0404), self.splat_int(0x0302_0100));
        apply!(four_bytes, entry, each, first)
    }

    #[inline(always)]
    fn four_registers(table: [float32x4_t; 4]) -> uint8x16x4_t {
        let [a, b, c, d] = apply!(vreinterpretq_u8_f32, table);
        uint8x16x4_t(a, b, c, d)
    }
}

/// Each: `entry` · 4 in every byte, plus 0, 1, 2, 3.
#[inline(always)]
unsafe fn four_bytes(entry: int32x4_t, each: int32x4_t, first: int32x4_t) -> uint8x16_t {
    // SAFETY: the architecture has it, here and below.
    unsafe { vreinterpretq_u8_s32(vmlaq_s32(first, entry, each)) }
}

#[inline(always)]
unsafe fn among_8(table: uint8x16x2_t, bytes: uint8x16_t) -> float32x4_t {
    // SAFETY: as above.
    unsafe { vreinterpretq_f32_u8(vqtbl2q_u8(table, bytes)) }
}

#[inline(always)]
unsafe fn among_16(table: uint8x16x4_t, bytes: uint8x16_t) -> float32x4_t {
    // SAFETY: as above.
    unsafe { vreinterpretq_f32_u8(vqtbl4q_u8(table, bytes)) }
}

/// Bytes from 64 on are of the second table; the first one gives 0 for them, and the second one leaves the others.
#[inline(always)]
unsafe fn among_32(low: uint8x16x4_t, high: uint8x16x4_t, bytes: uint8x16_t) -> float32x4_t {
    // SAFETY: as above.
    unsafe { vreinterpretq_f32_u8(vqtbx4q_u8(vqtbl4q_u8(low, bytes), high, vsubq_u8(bytes, vdupq_n_u8(64)))) }
}

/// # Safety
/// Four values must follow.
#[inline(always)]
unsafe fn sixteen_bytes(values: *const f32) -> uint8x16_t {
    // SAFETY: by contract.
    unsafe { vld1q_u8(values.cast()) }
}

/// # Safety
/// Sixteen values must follow.
#[inline(always)]
unsafe fn sixty_four_bytes(values: *const f32) -> uint8x16x4_t {
    // SAFETY: by contract.
    unsafe {
        uint8x16x4_t(
            sixteen_bytes(values),
            sixteen_bytes(values.add(4)),
            sixteen_bytes(values.add(8)),
            sixteen_bytes(values.add(12)),
        )
    }
}

#[inline(always)]
unsafe fn mul_add(a: float32x4_t, b: float32x4_t, c: float32x4_t) -> float32x4_t {
    // SAFETY: as above.
    unsafe { vfmaq_f32(c, a, b) }
}

#[inline(always)]
unsafe fn neg_mul_add(a: float32x4_t, b: float32x4_t, c: float32x4_t) -> float32x4_t {
    // SAFETY: as above.
    unsafe { vfmsq_f32(c, a, b) }
}

/// Not `vminq_f32`, which gives NaN when either is.
#[inline(always)]
unsafe fn min(a: float32x4_t, b: float32x4_t) -> float32x4_t {
    // SAFETY: as above.
    unsafe { vbslq_f32(vcltq_f32(a, b), a, b) }
}

#[inline(always)]
unsafe fn max(a: float32x4_t, b: float32x4_t) -> float32x4_t {
    // SAFETY: as above.
    unsafe { vbslq_f32(vcgtq_f32(a, b), a, b) }
}

#[inline(always)]
unsafe fn shift_right(a: int32x4_t, by: int32x4_t) -> int32x4_t {
    // SAFETY: as above. A shift to the left by a negative number is one to the right.
    unsafe { vreinterpretq_s32_u32(vshlq_u32(vreinterpretq_u32_s32(a), vnegq_s32(by))) }
}

#[inline(always)]
unsafe fn or_zero(mask: uint32x4_t, a: float32x4_t) -> float32x4_t {
    // SAFETY: as above.
    unsafe { vreinterpretq_f32_u32(vandq_u32(mask, vreinterpretq_u32_f32(a))) }
}

#[inline(always)]
unsafe fn or_zero_int(mask: uint32x4_t, a: int32x4_t) -> int32x4_t {
    // SAFETY: as above.
    unsafe { vreinterpretq_s32_u32(vandq_u32(mask, vreinterpretq_u32_s32(a))) }
}

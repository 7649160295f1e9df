//! Vector operations for any processor, lane by lane; the reference in tests.

use std::array::from_fn;

use super::dispatch::Part;
use super::lanes::{LANES, Lanes, limited};

/// Plain arrays.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Portable;

#[inline(always)]
fn one<A: Copy, O>(f: impl Fn(A) -> O, a: [A; LANES]) -> [O; LANES] {
    from_fn(|l| f(a[l]))
}

#[inline(always)]
fn two<A: Copy, B: Copy, O>(f: impl Fn(A, B) -> O, a: [A; LANES], b: [B; LANES]) -> [O; LANES] {
    from_fn(|l| f(a[l], b[l]))
}

macro_rules! apply {
    ($function:expr, $a:ident) => {
        one($function, $a)
    };
    ($function:expr, $a:ident, $b:ident) => {
        two($function, $a, $b)
    };
    ($function:expr, $a:ident, $b:ident, $c:ident) => {
        from_fn(|l| $function($a[l], $b[l], $c[l]))
    };
}

impl Lanes for Portable {
    type F = [f32; LANES];
    type I = [i32; LANES];
    type M = [bool; LANES];
    const WIDE_WINDOWS: bool = false;
    tables_in_registers!();

    lanewise! {
        add(a: F, b: F) -> F = |a, b| a + b;
        sub(a: F, b: F) -> F = |a, b| a - b;
        mul(a: F, b: F) -> F = |a, b| a * b;
        div(a: F, b: F) -> F = |a, b| a / b;
        mul_add(a: F, b: F, c: F) -> F = f32::mul_add;
        neg_mul_add(a: F, b: F, c: F) -> F = neg_mul_add;
        sqrt(a: F) -> F = f32::sqrt;
        min(a: F, b: F) -> F = |a, b| if a < b { a } else { b };
        max(a: F, b: F) -> F = |a, b| if a > b { a } else { b };
        floor(a: F) -> F = f32::floor;
        to_int(a: F) -> I = |a: f32| a.round_ties_even() as i32;
        to_int_toward_zero(a: F) -> I = |a: f32| a as i32;
        to_float(a: I) -> F = |a| a as f32;
        bits_of(a: F) -> I = |a: f32| a.to_bits() as i32;
        with_bits(a: I) -> F = |a| f32::from_bits(a as u32);
        add_int(a: I, b: I) -> I = i32::wrapping_add;
        sub_int(a: I, b: I) -> I = i32::wrapping_sub;
        min_int(a: I, b: I) -> I = i32::min;
        max_int(a: I, b: I) -> I = i32::max;
        and_int(a: I, b: I) -> I = |a, b| a & b;
        xor_int(a: I, b: I) -> I = |a, b| a ^ b;
        shift_left(a: I, by: I) -> I = |a: i32, by| a << by;
        shift_right(a: I, by: I) -> I = |a, by| (a as u32 >> by) as i32;
        at_most(a: F, b: F) -> M = |a, b| a <= b;
        and(a: M, b: M) -> M = |a, b| a & b;
        or(a: M, b: M) -> M = |a, b| a | b;
        or_zero(mask: M, a: F) -> F = |yes, a| if yes { a } else { 0.0 };
        or_zero_int(mask: M, a: I) -> I = |yes, a| if yes { a } else { 0 };
    }

    #[inline(never)]
    fn apart<P: Part<Self>>(self, part: P) -> P::Out {
        part.run(self)
    }
    #[inline(always)]
    fn splat(self, value: f32) -> Self::F {
        [value; LANES]
    }
    #[cfg(feature = "rolling")]
    #[inline(always)]
    fn splat_two(self, first: f32, last: f32) -> Self::F {
        from_fn(|l| if l < LANES / 2 { first } else { last })
    }
    #[inline(always)]
    fn load(self, values: &[f32; LANES]) -> Self::F {
        *values
    }
    #[inline(always)]
    fn store(self, values: Self::F) -> [f32; LANES] {
        values
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
    fn mask(self, bits: u16) -> Self::M {
        from_fn(|l| bits >> l & 1 == 1)
    }
    #[inline(always)]
    fn mask_bits(self, mask: Self::M) -> u16 {
        mask.iter().enumerate().fold(0, |bits, (l, yes)| bits | u16::from(*yes) << l)
    }
    #[inline(always)]
    fn permute(self, table: Self::F, index: Self::I) -> Self::F {
        from_fn(|l| table[index[l] as usize % LANES])
    }
    #[inline(always)]
    fn load_twice(self, values: &[f32; 8]) -> Self::F {
        from_fn(|l| values[l % 8])
    }
    #[inline(always)]
    fn permute_eight(self, table: Self::F, index: Self::I) -> Self::F {
        self.permute(table, index)
    }
    #[inline(always)]
    fn look_up<const N: usize>(self, window: &[f32; N], index: Self::I) -> Self::F {
        from_fn(|l| window[index[l] as usize % N])
    }
    #[inline(always)]
    fn gather_int(self, table: &[i32], index: Self::I) -> Self::I {
        let index = limited(self, index, table.len() - 1);
        from_fn(|l| table[index[l] as usize])
    }
    #[inline(always)]
    fn gather_pairs(self, table: &[f32], index: Self::I) -> (Self::F, Self::F) {
        let index = limited(self, index, table.len() - 2);
        (from_fn(|l| table[index[l] as usize]), from_fn(|l| table[index[l] as usize + 1]))
    }
}

#[inline(always)]
fn neg_mul_add(a: f32, b: f32, c: f32) -> f32 {
    (-a).mul_add(b, c)
}

//! The crate's vector kernels: sixteen values in lanes, on the widest unit of the processor.
//!
//! A kernel is a struct with its arguments that implements [`Kernel`]. Its `run` is written once,
//! for any [`Lanes`], and [`on_widest`] compiles and runs it for AVX-512, for AVX2 with FMA, for NEON,
//! or for any processor ([`InstructionSet`]). Loops over plain arrays may also be kernels: the compiler
//! then vectorises them for each instruction set.
//!
//! `run` and everything generic that it calls must be `#[inline(always)]`, and must not contain
//! closures: what is not inlined is compiled for the baseline, not for the kernel's instructions. In loops over sweeps,
//! zipped iterators and copies of slices count as such.
//!
//! Results have the same bits on all instruction sets. Every operation is an IEEE one, fused
//! multiply-add included, or moves bits, or is composed of such ones in [`Lanes`]; all have sixteen
//! lanes, so sums over lanes have one order; and the compiler neither reorders nor contracts
//! floating-point operations.
//!
//! A value of `Avx512` or `Avx2`, the implementations of [`Lanes`], is created only where the
//! processor has the instructions: it is the proof that they may be used.

/// Methods of [`Lanes`] that apply one function lane by lane, by the file's macro `apply`.
macro_rules! lanewise {
    ($($name:ident($($of:ident: $type:ident),+) -> $out:ident = $function:expr;)+) => {$(
        #[inline(always)]
        fn $name(self, $($of: Self::$type),+) -> Self::$out {
            apply!($function, $($of),+)
        }
    )+};
}

/// Tables of [`Lanes`] that stay in registers, where a permute among all sixteen entries is as fast as any.
macro_rules! tables_in_registers {
    () => {
        type Table = Self::F;
        const NEAR_IS_FASTER: bool = false;

        #[inline(always)]
        fn table(self, entries: Self::F) -> Self::Table {
            entries
        }
        #[inline(always)]
        fn entries(self, table: &Self::Table) -> Self::F {
            *table
        }
        #[inline(always)]
        fn permute_near(self, table: &Self::Table, _: [i32; 2], index: Self::I) -> Self::F {
            self.permute(*table, index)
        }
    };
}

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod dispatch;
mod lanes;
#[cfg(target_arch = "aarch64")]
mod neon;
mod portable;
mod vector3;

#[cfg(test)]
pub(crate) use dispatch::on_each;
pub use dispatch::{INSTRUCTIONS_VARIABLE, InstructionSet, UnknownInstructionSet};
pub(crate) use dispatch::{Kernel, Part, on_widest};
pub(crate) use lanes::{LANES, Lanes, ROUNDER};
#[cfg(test)]
pub(crate) use portable::Portable;
pub(crate) use vector3::{add3, dot, lane3, load3, scale3, splat3, store3, sub3};

//! The choice of the instruction set, and running a kernel on it.
//!
//! It is the best that the processor supports, or what `RADAR_CHAPERONE_INSTRUCTIONS` limits it to
//! (`portable`, `neon`, `avx2`, `avx512`), so that each can be tested and timed wherever it exists.

use std::fmt;
use std::str::FromStr;
use std::sync::LazyLock;

#[cfg(target_arch = "aarch64")]
use super::neon::Neon;
#[cfg(target_arch = "x86_64")]
use super::{avx2::Avx2, avx512::Avx512};
use super::{lanes::Lanes, portable::Portable};

/// The environment variable that limits the instructions.
pub const INSTRUCTIONS_VARIABLE: &str = "RADAR_CHAPERONE_INSTRUCTIONS";

/// Vector instructions for which kernels are compiled, in ascending order on each architecture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum InstructionSet {
    /// The architecture's baseline.
    Portable,
    /// NEON of 64-bit ARM processors.
    Neon,
    /// AVX2 and FMA.
    Avx2,
    /// AVX-512 F, VL, BW and DQ, and FMA: supported by every processor with AVX-512 since
    /// Skylake-X.
    Avx512,
}

/// Unknown name of an instruction set.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("\"{0}\" is not an instruction set: use portable, neon, avx2 or avx512")]
pub struct UnknownInstructionSet(String);

impl FromStr for InstructionSet {
    type Err = UnknownInstructionSet;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        match name {
            "portable" => Ok(Self::Portable),
            "neon" => Ok(Self::Neon),
            "avx2" => Ok(Self::Avx2),
            "avx512" => Ok(Self::Avx512),
            other => Err(UnknownInstructionSet(other.into())),
        }
    }
}

impl fmt::Display for InstructionSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Portable => "plain instructions",
            Self::Neon => "NEON",
            Self::Avx2 => "AVX2",
            Self::Avx512 => "AVX-512",
        })
    }
}

impl InstructionSet {
    /// The instructions that kernels use in this process. The environment is read once.
    pub fn in_use() -> Self {
        static IN_USE: LazyLock<InstructionSet> = LazyLock::new(|| {
            let limit = InstructionSet::limit().ok().flatten().unwrap_or(InstructionSet::Avx512);
            limit.min(InstructionSet::of_processor())
        });
        *IN_USE
    }

    /// All that this processor supports, in ascending order.
    pub fn all_of_processor() -> impl Iterator<Item = Self> {
        let vectors = if cfg!(target_arch = "aarch64") { &[Self::Neon][..] } else { &[Self::Avx2, Self::Avx512] };
        let supported = vectors.iter().copied().filter(|set| *set <= Self::of_processor());
        std::iter::once(Self::Portable).chain(supported)
    }

    /// Its name in [`INSTRUCTIONS_VARIABLE`].
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            Self::Neon => "neon",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }

    /// The limit set in the environment; `None` without one.
    ///
    /// # Errors
    /// The variable holds something other than one of the names.
    pub fn limit() -> Result<Option<Self>, UnknownInstructionSet> {
        match std::env::var(INSTRUCTIONS_VARIABLE) {
            Ok(name) if !name.is_empty() => name.parse().map(Some),
            _ => Ok(None),
        }
    }

    /// The best that the processor supports.
    pub fn of_processor() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            let has_fma = is_x86_feature_detected!("fma");
            if has_fma
                && is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
            {
                return Self::Avx512;
            }
            if has_fma && is_x86_feature_detected!("avx2") {
                return Self::Avx2;
            }
        }
        if cfg!(target_arch = "aarch64") { Self::Neon } else { Self::Portable }
    }
}

/// A kernel, written once for every instruction set. `run` must be `#[inline(always)]`, so that it
/// is compiled for the caller's instructions.
pub(crate) trait Kernel {
    /// Result of the kernel.
    type Out;
    fn run<S: Lanes>(self, s: S) -> Self::Out;
}

/// Part of a kernel, compiled as a function of its own; see [`Lanes::apart`].
pub(crate) trait Part<S: Lanes> {
    /// Result of the part.
    type Out;
    /// `#[inline(always)]`, like a kernel's.
    fn run(self, s: S) -> Self::Out;
}

/// Runs a kernel. Every choice gives the same bits.
#[inline]
pub(crate) fn on_widest<K: Kernel>(kernel: K) -> K::Out {
    #[cfg(target_arch = "x86_64")]
    {
        if let Some(s) = Avx512::detect() {
            // SAFETY: `s` exists, so the processor has the instructions that this copy is compiled
            // for.
            return unsafe { avx512(s, kernel) };
        }
        if let Some(s) = Avx2::detect() {
            // SAFETY: as above.
            return unsafe { avx2(s, kernel) };
        }
    }
    // Every compiler for the architecture uses NEON: no copy for other instructions is needed.
    #[cfg(target_arch = "aarch64")]
    if let Some(s) = Neon::detect() {
        return kernel.run(s);
    }
    kernel.run(Portable)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq,fma")]
fn avx512<K: Kernel>(s: Avx512, kernel: K) -> K::Out {
    kernel.run(s)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn avx2<K: Kernel>(s: Avx2, kernel: K) -> K::Out {
    kernel.run(s)
}

#[cfg(target_arch = "x86_64")]
#[inline(never)]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq,fma")]
pub(super) fn avx512_apart<P: Part<Avx512>>(s: Avx512, part: P) -> P::Out {
    part.run(s)
}

#[cfg(target_arch = "x86_64")]
#[inline(never)]
#[target_feature(enable = "avx2,fma")]
pub(super) fn avx2_apart<P: Part<Avx2>>(s: Avx2, part: P) -> P::Out {
    part.run(s)
}

/// The kernel's result on each instruction set in use, widest last.
#[cfg(test)]
pub(crate) fn on_each<K: Kernel + Clone>(kernel: &K) -> Vec<K::Out> {
    let mut all = vec![kernel.clone().run(Portable)];
    #[cfg(target_arch = "x86_64")]
    {
        if let Some(s) = Avx2::detect() {
            // SAFETY: as in `on_widest`.
            all.push(unsafe { avx2(s, kernel.clone()) });
        }
        if let Some(s) = Avx512::detect() {
            // SAFETY: as in `on_widest`.
            all.push(unsafe { avx512(s, kernel.clone()) });
        }
    }
    #[cfg(target_arch = "aarch64")]
    all.extend(Neon::detect().map(|s| kernel.clone().run(s)));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_and_others_are_refused() {
        assert_eq!("avx2".parse(), Ok(InstructionSet::Avx2));
        assert_eq!("sse".parse::<InstructionSet>(), Err(UnknownInstructionSet("sse".into())));
        assert!(InstructionSet::in_use() <= InstructionSet::of_processor());
        assert_eq!(InstructionSet::all_of_processor().last(), Some(InstructionSet::of_processor()));
        for set in InstructionSet::all_of_processor() {
            assert_eq!(set.name().parse(), Ok(set));
        }
    }
}

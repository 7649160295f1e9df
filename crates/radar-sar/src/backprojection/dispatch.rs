//! Runs a kernel on the widest vector instructions of the processor.

use super::lanes::{Lanes, Plain};

/// A kernel, written once for any width. `run` must be `#[inline(always)]`, so that it is compiled
/// for the caller's instructions.
pub(crate) trait Kernel {
    /// Result of the kernel.
    type Out;
    fn run<S: Lanes>(self, s: S) -> Self::Out;
}

/// Runs a kernel. Every choice gives the same bits.
pub(crate) fn on_widest<K: Kernel>(kernel: K) -> K::Out {
    #[cfg(target_arch = "x86_64")]
    {
        use super::lanes::{Avx2, Avx512};
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
    kernel.run(Plain)
}

/// Name of the vector instructions that backprojection uses on this machine.
pub fn instruction_set() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    {
        use super::lanes::{Avx2, Avx512};
        if Avx512::detect().is_some() {
            return "AVX-512";
        }
        if Avx2::detect().is_some() {
            return "AVX2";
        }
    }
    "plain instructions"
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,fma")]
fn avx512<K: Kernel>(s: super::lanes::Avx512, kernel: K) -> K::Out {
    kernel.run(s)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn avx2<K: Kernel>(s: super::lanes::Avx2, kernel: K) -> K::Out {
    kernel.run(s)
}

#[cfg(all(test, target_arch = "x86_64"))]
pub(super) mod tests {
    use super::*;
    use crate::backprojection::lanes::{Avx2, Avx512};

    /// The kernel's result on each instruction set of this processor, widest last.
    pub(in crate::backprojection) fn on_each<K: Kernel + Clone>(kernel: &K) -> Vec<K::Out> {
        let mut all = vec![kernel.clone().run(Plain)];
        if let Some(s) = Avx2::detect() {
            // SAFETY: as in `on_widest`.
            all.push(unsafe { avx2(s, kernel.clone()) });
        }
        if let Some(s) = Avx512::detect() {
            // SAFETY: as in `on_widest`.
            all.push(unsafe { avx512(s, kernel.clone()) });
        }
        all
    }
}

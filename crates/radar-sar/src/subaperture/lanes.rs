//! Vectors of sixteen f32 for AVX-512, AVX2 with FMA, and any processor.
//!
//! Every operation is rounded as IEEE 754 requires, or only moves bits, so all three give the same
//! bits. The portable one is the reference in tests. There is one table lookup: sixteen entries
//! stay in a register and sixteen lanes select among them, which costs one instruction where a
//! gather from memory costs seventeen.

/// Lanes of a vector. Choice: one register of AVX-512, two of AVX2.
pub(super) const LANES: usize = 16;
pub(super) type Lanes = [f32; LANES];

/// 1.5 · 2²³. Adding it rounds a number to the nearest integer, whose low bits are then the low
/// bits of the sum.
pub(super) const ROUNDER: f32 = 12_582_912.0;

/// Sixteen lanes.
pub(super) trait Vector: Copy {
    fn splat(value: f32) -> Self;
    fn load(lanes: &Lanes) -> Self;
    fn store(self, lanes: &mut Lanes);
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn div(self, other: Self) -> Self;
    fn sqrt(self) -> Self;
    /// self · factor + plus, rounded once.
    fn mul_add(self, factor: Self, plus: Self) -> Self;
    /// minus − self · factor, rounded once.
    fn neg_mul_add(self, factor: Self, minus: Self) -> Self;
    /// The entry of `self` selected by the low four bits of each lane of `at`.
    fn look_up(self, at: Self) -> Self;
    /// Flips the sign where the lowest bit of `odd` is set.
    fn negate_where_odd(self, odd: Self) -> Self;

    /// The nearest integer, as a float and as low bits; for values below 2²².
    #[inline(always)]
    fn rounded(self) -> (Self, Self) {
        let bits = self.add(Self::splat(ROUNDER));
        (bits.sub(Self::splat(ROUNDER)), bits)
    }

    /// cos and sin of π times the lanes (each below 2²²), to 1e-4.
    #[inline(always)]
    fn cos_sin_of_half_turns(self) -> (Self, Self) {
        let (whole, bits) = self.rounded();
        let x = self.sub(whole);
        let x2 = x.mul(x);
        let sin = x2.mul_add(Self::splat(2.299_547_3), Self::splat(-5.136_905));
        let sin = x2.mul_add(sin, Self::splat(3.140_64)).mul(x);
        let cos = x2.mul_add(Self::splat(-1.222_127_1), Self::splat(4.041_283_8));
        let cos = x2.mul_add(cos, Self::splat(-4.933_938));
        let cos = x2.mul_add(cos, Self::splat(0.999_993_3));
        (cos.negate_where_odd(bits), sin.negate_where_odd(bits))
    }
}

/// Lane by lane, for any processor.
#[derive(Clone, Copy)]
pub(super) struct Portable(Lanes);

impl Portable {
    #[inline(always)]
    fn each(f: impl Fn(usize) -> f32) -> Self {
        Self(std::array::from_fn(f))
    }
}

impl Vector for Portable {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; LANES])
    }
    #[inline(always)]
    fn load(lanes: &Lanes) -> Self {
        Self(*lanes)
    }
    #[inline(always)]
    fn store(self, lanes: &mut Lanes) {
        *lanes = self.0;
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self::each(|l| self.0[l] + other.0[l])
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self::each(|l| self.0[l] - other.0[l])
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self::each(|l| self.0[l] * other.0[l])
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self::each(|l| self.0[l] / other.0[l])
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self::each(|l| self.0[l].sqrt())
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, plus: Self) -> Self {
        Self::each(|l| self.0[l].mul_add(factor.0[l], plus.0[l]))
    }
    #[inline(always)]
    fn neg_mul_add(self, factor: Self, minus: Self) -> Self {
        Self::each(|l| (-self.0[l]).mul_add(factor.0[l], minus.0[l]))
    }
    #[inline(always)]
    fn look_up(self, at: Self) -> Self {
        Self::each(|l| self.0[(at.0[l].to_bits() % LANES as u32) as usize])
    }
    #[inline(always)]
    fn negate_where_odd(self, odd: Self) -> Self {
        Self::each(|l| f32::from_bits(self.0[l].to_bits() ^ (odd.0[l].to_bits() << 31)))
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) use x86::{Avx2, Avx512};

/// Methods below may run only on processors with the instructions. Kernels select by the detected
/// features and run in functions compiled for these instructions, into which everything here is
/// inlined.
#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    use super::{LANES, Lanes, Vector};

    /// One 512-bit register.
    #[derive(Clone, Copy)]
    pub(crate) struct Avx512(__m512);

    // SAFETY, for every block below: called only where AVX-512F is available (see above); loads and
    // stores stay within the array.
    impl Vector for Avx512 {
        #[inline(always)]
        fn splat(value: f32) -> Self {
            Self(unsafe { _mm512_set1_ps(value) })
        }
        #[inline(always)]
        fn load(lanes: &Lanes) -> Self {
            Self(unsafe { _mm512_loadu_ps(lanes.as_ptr()) })
        }
        #[inline(always)]
        fn store(self, lanes: &mut Lanes) {
            unsafe { _mm512_storeu_ps(lanes.as_mut_ptr(), self.0) }
        }
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            Self(unsafe { _mm512_add_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            Self(unsafe { _mm512_sub_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            Self(unsafe { _mm512_mul_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn div(self, other: Self) -> Self {
            Self(unsafe { _mm512_div_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            Self(unsafe { _mm512_sqrt_ps(self.0) })
        }
        #[inline(always)]
        fn mul_add(self, factor: Self, plus: Self) -> Self {
            Self(unsafe { _mm512_fmadd_ps(self.0, factor.0, plus.0) })
        }
        #[inline(always)]
        fn neg_mul_add(self, factor: Self, minus: Self) -> Self {
            Self(unsafe { _mm512_fnmadd_ps(self.0, factor.0, minus.0) })
        }
        #[inline(always)]
        fn look_up(self, at: Self) -> Self {
            Self(unsafe { _mm512_permutexvar_ps(_mm512_castps_si512(at.0), self.0) })
        }
        #[inline(always)]
        fn negate_where_odd(self, odd: Self) -> Self {
            Self(unsafe {
                let sign = _mm512_slli_epi32::<31>(_mm512_castps_si512(odd.0));
                _mm512_castsi512_ps(_mm512_xor_si512(_mm512_castps_si512(self.0), sign))
            })
        }
    }

    /// Two 256-bit registers.
    #[derive(Clone, Copy)]
    pub(crate) struct Avx2(__m256, __m256);

    // SAFETY, for every block below: called only where AVX2 and FMA are available (see above);
    // loads and stores stay within the array.
    impl Vector for Avx2 {
        #[inline(always)]
        fn splat(value: f32) -> Self {
            let half = unsafe { _mm256_set1_ps(value) };
            Self(half, half)
        }
        #[inline(always)]
        fn load(lanes: &Lanes) -> Self {
            unsafe { Self(_mm256_loadu_ps(lanes.as_ptr()), _mm256_loadu_ps(lanes[LANES / 2..].as_ptr())) }
        }
        #[inline(always)]
        fn store(self, lanes: &mut Lanes) {
            unsafe {
                _mm256_storeu_ps(lanes.as_mut_ptr(), self.0);
                _mm256_storeu_ps(lanes[LANES / 2..].as_mut_ptr(), self.1);
            }
        }
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            unsafe { Self(_mm256_add_ps(self.0, other.0), _mm256_add_ps(self.1, other.1)) }
        }
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            unsafe { Self(_mm256_sub_ps(self.0, other.0), _mm256_sub_ps(self.1, other.1)) }
        }
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            unsafe { Self(_mm256_mul_ps(self.0, other.0), _mm256_mul_ps(self.1, other.1)) }
        }
        #[inline(always)]
        fn div(self, other: Self) -> Self {
            unsafe { Self(_mm256_div_ps(self.0, other.0), _mm256_div_ps(self.1, other.1)) }
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            unsafe { Self(_mm256_sqrt_ps(self.0), _mm256_sqrt_ps(self.1)) }
        }
        #[inline(always)]
        fn mul_add(self, factor: Self, plus: Self) -> Self {
            unsafe { Self(_mm256_fmadd_ps(self.0, factor.0, plus.0), _mm256_fmadd_ps(self.1, factor.1, plus.1)) }
        }
        #[inline(always)]
        fn neg_mul_add(self, factor: Self, minus: Self) -> Self {
            unsafe { Self(_mm256_fnmadd_ps(self.0, factor.0, minus.0), _mm256_fnmadd_ps(self.1, factor.1, minus.1)) }
        }
        #[inline(always)]
        fn look_up(self, at: Self) -> Self {
            unsafe { Self(half_look_up(self, at.0), half_look_up(self, at.1)) }
        }
        #[inline(always)]
        fn negate_where_odd(self, odd: Self) -> Self {
            unsafe { Self(half_negate(self.0, odd.0), half_negate(self.1, odd.1)) }
        }
    }

    #[inline(always)]
    unsafe fn half_look_up(table: Avx2, at: __m256) -> __m256 {
        // SAFETY: as above.
        unsafe {
            let index = _mm256_castps_si256(at);
            let (low, high) = (_mm256_permutevar8x32_ps(table.0, index), _mm256_permutevar8x32_ps(table.1, index));
            // Bit 3 selects the half; the blend tests the sign bit.
            _mm256_blendv_ps(low, high, _mm256_castsi256_ps(_mm256_slli_epi32::<28>(index)))
        }
    }

    #[inline(always)]
    unsafe fn half_negate(value: __m256, odd: __m256) -> __m256 {
        // SAFETY: as above.
        unsafe {
            let sign = _mm256_slli_epi32::<31>(_mm256_castps_si256(odd));
            _mm256_castsi256_ps(_mm256_xor_si256(_mm256_castps_si256(value), sign))
        }
    }
}

/// ln(1 + m) to 4e-7, for m ≥ 0; 0 for NaN and for values of 1e30 and above, so that they never
/// reach a sum.
#[inline(always)]
pub(super) fn ln_1p(m: f32) -> f32 {
    let y = 1.0 + if m < 1e30 { m } else { 0.0 };
    // y = 2^e · (1 + x), x within √½ − 1 to √2 − 1.
    let bits = y.to_bits().wrapping_sub(SQRT_HALF_BITS);
    let exponent = (bits as i32) >> 23;
    let x = f32::from_bits((bits & 0x007F_FFFF) + SQRT_HALF_BITS) - 1.0;
    let p = x.mul_add(0.100_174_06, -0.184_094_44);
    let p = x.mul_add(p, 0.209_382_02);
    let p = x.mul_add(p, -0.249_442_63);
    let p = x.mul_add(p, 0.332_836_4);
    let p = x.mul_add(p, -0.500_002_45);
    let p = x.mul_add(p, 1.000_006_5);
    (exponent as f32).mul_add(std::f32::consts::LN_2, x * p)
}

const SQRT_HALF_BITS: u32 = 0x3F35_04F3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithm_is_accurate_to_4e_7_and_maps_invalid_input_to_zero() {
        for n in 0..=4000 {
            let m = 10f32.powf(n as f32 * 0.0045 - 9.0) - 1e-9;
            let exact = f64::from(m).ln_1p();
            assert!((f64::from(ln_1p(m)) - exact).abs() < 4e-7 + 2e-7 * exact, "{m}: {} {exact}", ln_1p(m));
        }
        assert_eq!([f32::NAN, f32::INFINITY, 2e30].map(ln_1p), [0.0; 3]);
        assert!(ln_1p(0.0).abs() < 4e-7);
    }

    /// Every operation on values of all kinds, as bits.
    #[inline(always)]
    fn trial<V: Vector>() -> Vec<Lanes> {
        let a: Lanes = std::array::from_fn(|l| (l as f32 - 7.3) * 1.37);
        let b: Lanes = std::array::from_fn(|l| 0.3 + l as f32 * 211.7);
        let (a, b) = (V::load(&a), V::load(&b));
        let (whole, bits) = b.rounded();
        let (cos, sin) = b.cos_sin_of_half_turns();
        let all = [
            a.add(b),
            a.sub(b),
            a.mul(b),
            a.div(b),
            b.sqrt(),
            a.mul_add(b, a),
            a.neg_mul_add(b, a),
            whole,
            a.look_up(bits),
            a.negate_where_odd(bits),
            cos,
            sin,
            V::splat(2.5),
        ];
        let mut found = vec![[0.0; LANES]; all.len()];
        all.iter().zip(&mut found).for_each(|(vector, lanes)| vector.store(lanes));
        found
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let portable = trial::<Portable>();
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx512f")]
            fn avx512() -> Vec<Lanes> {
                trial::<Avx512>()
            }
            #[target_feature(enable = "avx2,fma")]
            fn avx2() -> Vec<Lanes> {
                trial::<Avx2>()
            }
            if is_x86_feature_detected!("avx512f") {
                // SAFETY: the processor has the instructions.
                assert_eq!(unsafe { avx512() }, portable);
            }
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                // SAFETY: as above.
                assert_eq!(unsafe { avx2() }, portable);
            }
        }
        // The values are also correct.
        for (l, (cos, sin)) in portable[10].iter().zip(&portable[11]).enumerate() {
            let exact = (std::f64::consts::PI * f64::from(0.3 + l as f32 * 211.7)).sin_cos();
            assert!((f64::from(*cos) - exact.1).abs() < 1e-4 && (f64::from(*sin) - exact.0).abs() < 1e-4);
        }
    }
}

//! Elementary functions with the same bits on every system.
//!
//! Rust's own `exp`, `ln`, `sin` and the like call the C library, whose last bits differ between
//! systems (glibc against Windows: 2e-10 in a scene). These functions call the crate `libm`, a port
//! of musl's, compiled into the program. Square roots, rounding and fused multiply-adds are exact
//! by IEEE 754 and need no replacement, but for the fused multiply-adds of mingw-w64. `clippy.toml`
//! forbids the others.

use std::ops::Mul;

use num_complex::Complex;

/// Where the processor has no instruction for them, `f32::mul_add` and `f64::mul_add` call these functions of the C library, and
/// mingw-w64's round twice, so kernels differed between instruction sets. These are linked in their place.
#[cfg(all(windows, target_env = "gnu"))]
mod fused {
    // SAFETY: name and signature are those of C's function, which has no other effect than its result.
    #[unsafe(no_mangle)]
    extern "C" fn fma(x: f64, y: f64, z: f64) -> f64 {
        libm::fma(x, y, z)
    }

    // SAFETY: as above.
    #[unsafe(no_mangle)]
    extern "C" fn fmaf(x: f32, y: f32, z: f32) -> f32 {
        libm::fmaf(x, y, z)
    }
}

macro_rules! functions {
    ($($(#[$doc:meta])* $name:ident($($x:ident),+) -> $($out:tt)|+, $double:path, $single:path;)*) => {
        /// `f32` and `f64`, the argument types of this module's functions.
        pub trait Real: Copy + Mul<Output = Self> {
            $($(#[$doc])* fn $name($($x: Self),+) -> functions!(@type $($out)|+);)*
        }

        impl Real for f64 {
            $(#[inline] fn $name($($x: Self),+) -> functions!(@type $($out)|+) { $double($($x),+) })*
        }

        impl Real for f32 {
            $(#[inline] fn $name($($x: Self),+) -> functions!(@type $($out)|+) { $single($($x),+) })*
        }

        $($(#[$doc])* #[inline] pub fn $name<T: Real>($($x: T),+) -> functions!(@of T, $($out)|+) { T::$name($($x),+) })*
    };
    (@type one) => { Self };
    (@type two) => { (Self, Self) };
    (@of $t:ident, one) => { $t };
    (@of $t:ident, two) => { ($t, $t) };
}

functions! {
    /// e^x.
    exp(x) -> one, libm::exp, libm::expf;
    /// 2^x.
    exp2(x) -> one, libm::exp2, libm::exp2f;
    /// e^x − 1, accurate near 0.
    exp_m1(x) -> one, libm::expm1, libm::expm1f;
    /// Natural logarithm.
    ln(x) -> one, libm::log, libm::logf;
    /// Natural logarithm of 1 + x, accurate near 0.
    ln_1p(x) -> one, libm::log1p, libm::log1pf;
    /// Logarithm to base 2.
    log2(x) -> one, libm::log2, libm::log2f;
    /// Logarithm to base 10.
    log10(x) -> one, libm::log10, libm::log10f;
    /// x^y.
    powf(x, y) -> one, libm::pow, libm::powf;
    /// Cube root.
    cbrt(x) -> one, libm::cbrt, libm::cbrtf;
    /// √(x² + y²) without overflow.
    hypot(x, y) -> one, libm::hypot, libm::hypotf;
    /// Sine of radians.
    sin(x) -> one, libm::sin, libm::sinf;
    /// Cosine of radians.
    cos(x) -> one, libm::cos, libm::cosf;
    /// Sine and cosine of radians.
    sin_cos(x) -> two, libm::sincos, libm::sincosf;
    /// Tangent of radians.
    tan(x) -> one, libm::tan, libm::tanf;
    /// Arc sine, radians.
    asin(x) -> one, libm::asin, libm::asinf;
    /// Arc cosine, radians.
    acos(x) -> one, libm::acos, libm::acosf;
    /// Arc tangent, radians.
    atan(x) -> one, libm::atan, libm::atanf;
    /// Angle of the vector (x, y) from the x axis, radians.
    atan2(y, x) -> one, libm::atan2, libm::atan2f;
    /// Hyperbolic tangent.
    tanh(x) -> one, libm::tanh, libm::tanhf;
}

/// e^(cx²), e^(c(x + s)²), e^(c(x + 2s)²) and so on. Each is the one before times a ratio, which itself changes by `ratio_step`:
/// [`gaussian_ratio_step`]`(c, s)`. Exact to rounding while e^(cx²) of the first is no less than 1e-300.
pub fn gaussians(exponent: f64, first: f64, step: f64, ratio_step: f64) -> impl Iterator<Item = f64> {
    let ratio: f64 = exp(exponent * step * (2.0 * first + step));
    let next = move |&(value, ratio): &(f64, f64)| Some((value * ratio, ratio * ratio_step));
    std::iter::successors(Some((exp(exponent * first * first), ratio)), next).map(|(value, _)| value)
}

/// See [`gaussians`].
pub fn gaussian_ratio_step(exponent: f64, step: f64) -> f64 {
    exp(2.0 * exponent * step * step)
}

/// Complex number of the given modulus and argument in radians.
#[inline]
pub fn from_polar<T: Real>(modulus: T, argument_rad: T) -> Complex<T> {
    let (sin, cos) = sin_cos(argument_rad);
    Complex::new(modulus * cos, modulus * sin)
}

/// Argument of a complex number, radians.
#[inline]
pub fn arg<T: Real>(z: Complex<T>) -> T {
    atan2(z.im, z.re)
}

/// Modulus of a complex number, without overflow.
#[inline]
pub fn norm<T: Real>(z: Complex<T>) -> T {
    hypot(z.re, z.im)
}

/// e^z.
#[inline]
pub(crate) fn exp_complex<T: Real>(z: Complex<T>) -> Complex<T> {
    from_polar(exp(z.re), z.im)
}

#[cfg(test)]
mod tests {
    use num_complex::Complex64;

    use super::*;

    /// Values over many magnitudes, both signs.
    fn places() -> impl Iterator<Item = f64> {
        (1..=2000).flat_map(|n| {
            let x = f64::from(n) * 0.0171 * 10f64.powi(n % 7 - 4);
            [x, -x]
        })
    }

    #[test]
    fn functions_agree_with_the_c_library() {
        type Pair = (&'static str, fn(f64) -> f64, fn(f64) -> f64);
        let pairs: [Pair; 16] = [
            ("exp", exp, f64::exp),
            ("exp2", exp2, f64::exp2),
            ("exp_m1", exp_m1, f64::exp_m1),
            ("ln", |x| ln(x.abs()), |x| x.abs().ln()),
            ("ln_1p", |x| ln_1p(x.abs()), |x| x.abs().ln_1p()),
            ("log2", |x| log2(x.abs()), |x| x.abs().log2()),
            ("log10", |x| log10(x.abs()), |x| x.abs().log10()),
            ("cbrt", cbrt, f64::cbrt),
            ("sin", sin, f64::sin),
            ("cos", cos, f64::cos),
            ("tan", tan, f64::tan),
            ("asin", |x| asin(sin(x)), |x| x.sin().asin()),
            ("acos", |x| acos(cos(x)), |x| x.cos().acos()),
            ("atan", atan, f64::atan),
            ("tanh", tanh, f64::tanh),
            ("powf", |x| powf(x.abs(), 0.37), |x| x.abs().powf(0.37)),
        ];
        for (name, ours, theirs) in pairs {
            for x in places() {
                let (a, b) = (ours(x), theirs(x));
                assert!(a == b || (a - b).abs() <= 1e-14 * a.abs().max(1e-7), "{name}({x}): {a} {b}");
            }
        }
    }

    #[test]
    fn complex_numbers_go_to_polar_form_and_back() {
        for (x, y) in places().zip(places().skip(77)) {
            let z = Complex64::new(x, y);
            let back = from_polar(norm(z), arg(z));
            assert!((back - z).norm_sqr().sqrt() <= 1e-14 * norm(z), "{z} {back}");
        }
        let turned = exp_complex(Complex64::new(0.5, std::f64::consts::FRAC_PI_2));
        assert!((turned.im - 0.5f64.exp()).abs() < 1e-14 && turned.re.abs() < 1e-15);
    }
}

//! Vectors of three, in lanes; written out, because closures would not be compiled for the
//! kernel's instructions.

use super::lanes::{LANES, Lanes};

#[inline(always)]
pub(crate) fn load3<S: Lanes>(s: S, v: &[[f32; LANES]; 3]) -> [S::F; 3] {
    [s.load(&v[0]), s.load(&v[1]), s.load(&v[2])]
}

#[inline(always)]
pub(crate) fn store3<S: Lanes>(s: S, v: [S::F; 3]) -> [[f32; LANES]; 3] {
    [s.store(v[0]), s.store(v[1]), s.store(v[2])]
}

/// Three values, the same in every lane.
#[inline(always)]
pub(crate) fn splat3<S: Lanes>(s: S, v: [f32; 3]) -> [S::F; 3] {
    [s.splat(v[0]), s.splat(v[1]), s.splat(v[2])]
}

/// One lane's vector in every lane.
#[inline(always)]
pub(crate) fn lane3<S: Lanes>(s: S, v: &[[f32; LANES]; 3], l: usize) -> [S::F; 3] {
    splat3(s, [v[0][l], v[1][l], v[2][l]])
}

#[inline(always)]
pub(crate) fn add3<S: Lanes>(s: S, a: [S::F; 3], b: [S::F; 3]) -> [S::F; 3] {
    [s.add(a[0], b[0]), s.add(a[1], b[1]), s.add(a[2], b[2])]
}

#[inline(always)]
pub(crate) fn sub3<S: Lanes>(s: S, a: [S::F; 3], b: [S::F; 3]) -> [S::F; 3] {
    [s.sub(a[0], b[0]), s.sub(a[1], b[1]), s.sub(a[2], b[2])]
}

#[inline(always)]
pub(crate) fn scale3<S: Lanes>(s: S, v: [S::F; 3], by: S::F) -> [S::F; 3] {
    [s.mul(v[0], by), s.mul(v[1], by), s.mul(v[2], by)]
}

#[inline(always)]
pub(crate) fn dot<S: Lanes>(s: S, a: [S::F; 3], b: [S::F; 3]) -> S::F {
    s.mul_add(a[0], b[0], s.mul_add(a[1], b[1], s.mul(a[2], b[2])))
}

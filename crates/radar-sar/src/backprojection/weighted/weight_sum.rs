//! Σ w² over a brick, accumulated as a polynomial in a voxel's offset from its centre.

use super::super::brick_geometry::{Offsets, Sight};
use super::beam_expansion::BeamExpansion;
use crate::simd::{Lanes, dot, load3, scale3};

/// Coefficients of 1, x, y, z, x², y², z², xy, xz, yz.
pub(super) const TERMS: usize = 10;

/// Σ w² of the sweeps that see the whole brick, to second order in a voxel's offset from its
/// centre. Lanes are sweeps.
pub(super) struct WeightSum<S: Lanes> {
    terms: [S::F; TERMS],
}

impl<S: Lanes> WeightSum<S> {
    #[inline(always)]
    pub fn none(s: S) -> Self {
        Self { terms: [s.splat(0.0); TERMS] }
    }

    /// w² = A²/d⁴ with A from its expansion, 1/d⁴ ≈ (1 − 4e + 12e² − 2|δ|²/d²)/d₀⁴ and e = q/d₀.
    #[inline(always)]
    pub fn add(&mut self, s: S, inside: u16, sight: &Sight, beam: &BeamExpansion) {
        let mask = s.mask(inside);
        let [a0, a1, a2] = load3(s, &beam.terms);
        let per_m = s.mul(s.load(&sight.half_per_m), s.splat(2.0));
        let per_m2 = s.mul(per_m, per_m);
        let per_m4 = s.mul(per_m2, per_m2);
        let ([gx, gy, gz], u) = (load3(s, &beam.gradient_per_m), load3(s, &sight.toward));
        let [ux, uy, uz] = scale3(s, u, per_m);
        let (a00, a01) = (s.mul(s.mul(a0, a0), per_m4), s.mul(s.mul(a0, a1), per_m4));
        let bent = s.mul(a01, s.load(&beam.cos));
        let gg = s.mul(s.mul_add(s.add(a0, a0), a2, s.mul(a1, a1)), per_m4);
        let gu = s.mul(a01, s.splat(-10.0));
        let uu = s.mul_add(a00, s.splat(12.0), bent);
        let dd = s.mul(s.mul_add(a00, s.splat(-2.0), s.sub(s.splat(0.0), bent)), per_m2);
        let (g1, u1) = (s.add(a01, a01), s.mul(a00, s.splat(-4.0)));
        let square = Products { gg, gu, uu };
        let terms = [
            a00,
            s.mul_add(g1, gx, s.mul(u1, ux)),
            s.mul_add(g1, gy, s.mul(u1, uy)),
            s.mul_add(g1, gz, s.mul(u1, uz)),
            s.add(dd, square.of(s, [gx, ux], [gx, ux])),
            s.add(dd, square.of(s, [gy, uy], [gy, uy])),
            s.add(dd, square.of(s, [gz, uz], [gz, uz])),
            s.mul(s.splat(2.0), square.of(s, [gx, ux], [gy, uy])),
            s.mul(s.splat(2.0), square.of(s, [gx, ux], [gz, uz])),
            s.mul(s.splat(2.0), square.of(s, [gy, uy], [gz, uz])),
        ];
        for (sum, term) in self.terms.iter_mut().zip(terms) {
            *sum = s.add(*sum, s.or_zero(mask, term));
        }
    }

    /// The sum over the lanes.
    #[inline(always)]
    pub fn total(&self, s: S) -> [f32; TERMS] {
        let mut total = [0.0; TERMS];
        for (total, terms) in total.iter_mut().zip(self.terms) {
            *total = s.store(terms).iter().sum();
        }
        total
    }
}

/// A quadratic form of the gradients g and u: gg·g² + gu·g·u + uu·u².
struct Products<S: Lanes> {
    gg: S::F,
    gu: S::F,
    uu: S::F,
}

impl<S: Lanes> Products<S> {
    /// Its coefficient for two axes, symmetric.
    #[inline(always)]
    fn of(&self, s: S, [ga, ua]: [S::F; 2], [gb, ub]: [S::F; 2]) -> S::F {
        let mixed = s.mul(s.mul(self.gu, s.splat(0.5)), s.mul_add(ga, ub, s.mul(gb, ua)));
        s.mul_add(s.mul(self.gg, ga), gb, s.mul_add(s.mul(self.uu, ua), ub, mixed))
    }
}

/// The expansion at a layer's voxels.
#[inline(always)]
pub(super) fn at<S: Lanes>(s: S, terms: &[f32; TERMS], offsets: &Offsets<S>, layer: usize) -> S::F {
    let [one, x, y, z, xx, yy, zz, xy, xz, yz] = *terms;
    let [dx, dy, dz] = offsets.layer(layer);
    let along_x = s.mul_add(dx, s.splat(xx), s.mul_add(dy, s.splat(xy), s.mul_add(dz, s.splat(xz), s.splat(x))));
    let along_y = s.mul_add(dy, s.splat(yy), s.mul_add(dz, s.splat(yz), s.splat(y)));
    let along_z = s.mul_add(dz, s.splat(zz), s.splat(z));
    s.add(s.splat(one), dot(s, [dx, dy, dz], [along_x, along_y, along_z]))
}

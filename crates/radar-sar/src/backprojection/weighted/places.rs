//! Places of a brick's voxels in the tables' windows.

use super::super::brick_geometry::{BrickShape, EDGE, Offsets, Sight};
use super::super::sweep_stack::Group;
use crate::simd::{LANES, Lanes, lane3, load3, scale3};

/// Distances to second order, in table entries, for each of sixteen sweeps: entry + q + (|δ|² −
/// q²)/2r.
pub(super) struct SecondOrder {
    /// What q grows by along x and y, a metre each, and from the centre to the inner and the outer
    /// layers.
    along_per_m: [[f32; LANES]; 2],
    up: [[f32; LANES]; 2],
    /// 1/2r in entries, and in entries per m².
    bend: [f32; LANES],
    bend_per_m2: [f32; LANES],
}

impl SecondOrder {
    #[inline(always)]
    pub fn new<S: Lanes>(s: S, sweeps: &Group, sight: &Sight, shape: &BrickShape) -> Self {
        let per_m = s.load(&sight.entries_per_m);
        let [x, y, z] = scale3(s, load3(s, &sight.toward), per_m);
        let [.., inner, outer] = shape.heights();
        let half_per_m = s.load(&sight.half_per_m);
        Self {
            along_per_m: [s.store(x), s.store(y)],
            up: [s.store(s.mul(z, s.splat(inner))), s.store(s.mul(z, s.splat(outer)))],
            // Without the sensor's movement, which is a small part of a small part.
            bend: s.store(s.mul(half_per_m, s.load(&sweeps.entry_m))),
            bend_per_m2: s.store(s.mul(half_per_m, per_m)),
        }
    }

    /// Of sweep `l`.
    #[inline(always)]
    pub fn places<S: Lanes>(&self, s: S, sight: &Sight, l: usize, offsets: &Offsets<S>) -> [S::F; EDGE] {
        let [x, y] = [s.splat(self.along_per_m[0][l]), s.splat(self.along_per_m[1][l])];
        let flat = s.mul_add(offsets.x, x, s.mul(offsets.y, y));
        let [inner, outer] = [s.splat(self.up[0][l]), s.splat(self.up[1][l])];
        let (entry, bend_per_m2) = (s.splat(sight.entry[l]), s.splat(self.bend_per_m2[l]));
        let of_outer = s.mul_add(offsets.squared[0], bend_per_m2, entry);
        let of_inner = s.mul_add(offsets.squared[1], bend_per_m2, entry);
        let (bend, one) = (s.splat(self.bend[l]), s.splat(1.0));
        let mut places = [s.sub(flat, outer), s.sub(flat, inner), s.add(flat, inner), s.add(flat, outer)];
        for (place, even) in places.iter_mut().zip([of_outer, of_inner, of_inner, of_outer]) {
            *place = s.mul_add(*place, s.neg_mul_add(*place, bend, one), even);
        }
        places
    }
}

/// The same to third order.
#[inline(always)]
pub(super) fn third_order<S: Lanes>(s: S, sight: &Sight, l: usize, offsets: &Offsets<S>, flat: S::F) -> [S::F; EDGE] {
    let [_, _, up] = lane3(s, &sight.toward, l);
    let (half, half2) = (s.splat(sight.half_per_m[l]), s.splat(sight.half_per_m2[l]));
    let (per_m, entry) = (s.splat(sight.entries_per_m[l]), s.splat(sight.entry[l]));
    let mut places = [flat; EDGE];
    for (layer, place) in places.iter_mut().enumerate() {
        let q = s.mul_add(offsets.z[layer], up, flat);
        let across = s.neg_mul_add(q, q, offsets.squared[layer]);
        let deviation = s.mul_add(across, s.neg_mul_add(q, half2, half), q);
        *place = s.mul_add(deviation, per_m, entry);
    }
    places
}

//! Places of a brick's voxels in the window of a sweep's table, for sweeps that see the whole brick:
//! entry + q + (|δ|² − q²)/2r − …, with q = u·δ along the direction u to the brick's centre.

use super::brick_geometry::{BrickShape, EDGE, Offsets, Sight};
use crate::simd::{LANES, Lanes, lane3, load3, store3};

/// Windows of table entries, for each of sixteen sweeps.
#[derive(Debug, Clone)]
pub(super) struct Windows {
    pub first: [i32; LANES],
    /// The centre's entry, relative to the window's first.
    pub entry: [f32; LANES],
    pub entries_per_m: [f32; LANES],
}

impl Windows {
    /// The same in coarse entries.
    #[inline(always)]
    pub fn coarse<S: Lanes>(&self, s: S, per_entry: S::F) -> Self {
        let start = s.mul(s.to_float(s.load_int(&self.first)), per_entry);
        let first = s.floor(start);
        Self {
            first: s.store_int(s.to_int(first)),
            entry: s.store(s.mul_add(s.load(&self.entry), per_entry, s.sub(start, first))),
            entries_per_m: s.store(s.mul(s.load(&self.entries_per_m), per_entry)),
        }
    }
}

/// Places to second or third order, for each of sixteen sweeps. To second order they are parabolas of
/// the height above the brick's centre.
#[derive(Debug, Clone)]
pub(super) struct Expansion {
    pub windows: Windows,
    /// u, and half of the inverse and of the inverse square of the distance.
    pub toward: [[f32; LANES]; 3],
    half_per_m: [f32; LANES],
    half_per_m2: [f32; LANES],
    /// Lanes whose distances are accurate enough to second order.
    second_order: u16,
    /// Factor of q, and of |δ|² − q².
    along: [f32; LANES],
    bend: [f32; LANES],
    /// Change with the height, at the centre and by how much less per metre of q there.
    up: [f32; LANES],
    up_bend: [f32; LANES],
    /// What is added at the inner and at the outer layers, above and below.
    inner: [f32; LANES],
    outer: [f32; LANES],
}

impl Expansion {
    /// Before it is computed.
    pub const NONE: Self = Self {
        windows: Windows { first: [0; LANES], entry: [0.0; LANES], entries_per_m: [0.0; LANES] },
        toward: [[0.0; LANES]; 3],
        half_per_m: [0.0; LANES],
        half_per_m2: [0.0; LANES],
        second_order: 0,
        along: [0.0; LANES],
        bend: [0.0; LANES],
        up: [0.0; LANES],
        up_bend: [0.0; LANES],
        inner: [0.0; LANES],
        outer: [0.0; LANES],
    };

    /// Computes it. In place: moving it would cost as much.
    #[inline(always)]
    pub fn set<S: Lanes>(&mut self, s: S, sight: &Sight, windows: Windows, shape: &BrickShape) {
        let per_m = s.load(&windows.entries_per_m);
        let (half_per_m, half_per_m2) = (s.load(&sight.half_per_m), s.load(&sight.half_per_m2));
        // The terms of third order, −q(|δ|² − q²)/2r², are on average like −q·ρ²/8r².
        let share = s.neg_mul_add(half_per_m2, s.splat(shape.third_order_m2), s.splat(1.0));
        let (along, bend) = (s.mul(per_m, share), s.mul(per_m, half_per_m));
        let [x, y, up] = load3(s, &sight.toward);
        let up_bend = s.mul(bend, up);
        let of_square = s.neg_mul_add(up, up_bend, bend);
        let [.., inner, outer] = shape.heights();
        (self.windows, self.second_order) = (windows, sight.second_order);
        self.toward = store3(s, [x, y, up]);
        self.half_per_m = s.store(half_per_m);
        self.half_per_m2 = s.store(half_per_m2);
        self.along = s.store(along);
        self.bend = s.store(bend);
        self.up = s.store(s.mul(along, up));
        self.up_bend = s.store(s.add(up_bend, up_bend));
        self.inner = s.store(s.mul(of_square, s.splat(inner * inner)));
        self.outer = s.store(s.mul(of_square, s.splat(outer * outer)));
    }

    /// q of sweep `l` without its height.
    #[inline(always)]
    pub fn flat<S: Lanes>(&self, s: S, l: usize, offsets: &Offsets<S>) -> S::F {
        let [x, y, _] = lane3(s, &self.toward, l);
        s.mul_add(offsets.x, x, s.mul(offsets.y, y))
    }

    /// Places of sweep `l`.
    #[inline(always)]
    pub fn places<S: Lanes>(&self, s: S, l: usize, offsets: &Offsets<S>) -> [S::F; EDGE] {
        if self.second_order >> l & 1 == 1 {
            self.to_second_order(s, l, offsets)
        } else {
            self.to_third_order(s, l, offsets)
        }
    }

    #[inline(always)]
    fn to_second_order<S: Lanes>(&self, s: S, l: usize, offsets: &Offsets<S>) -> [S::F; EDGE] {
        let flat = self.flat(s, l, offsets);
        let (along, bend) = (s.splat(self.along[l]), s.splat(self.bend[l]));
        let straight = s.mul_add(offsets.flat_squared, bend, s.splat(self.windows.entry[l]));
        let middle = s.mul_add(flat, s.neg_mul_add(flat, bend, along), straight);
        let slope = s.neg_mul_add(flat, s.splat(self.up_bend[l]), s.splat(self.up[l]));
        let inner = s.add(middle, s.splat(self.inner[l]));
        let outer = s.add(middle, s.splat(self.outer[l]));
        let [.., up_inner, up_outer] = offsets.z;
        [
            s.neg_mul_add(slope, up_outer, outer),
            s.neg_mul_add(slope, up_inner, inner),
            s.mul_add(slope, up_inner, inner),
            s.mul_add(slope, up_outer, outer),
        ]
    }

    #[inline(always)]
    fn to_third_order<S: Lanes>(&self, s: S, l: usize, offsets: &Offsets<S>) -> [S::F; EDGE] {
        let flat = self.flat(s, l, offsets);
        let (up, half, half2) = (self.toward[2][l], self.half_per_m[l], self.half_per_m2[l]);
        let (up, half, half2) = (s.splat(up), s.splat(half), s.splat(half2));
        let (per_m, entry) = (s.splat(self.windows.entries_per_m[l]), s.splat(self.windows.entry[l]));
        let mut places = [flat; EDGE];
        for (layer, place) in places.iter_mut().enumerate() {
            let q = s.mul_add(offsets.z[layer], up, flat);
            let across = s.neg_mul_add(q, q, offsets.squared[layer]);
            let deviation = s.mul_add(across, s.neg_mul_add(q, half2, half), q);
            *place = s.mul_add(deviation, per_m, entry);
        }
        places
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::simd::Portable;

    /// Voxels at this distance in this direction, with places in metres from the centre's distance.
    fn expansion(shape: &BrickShape, toward: DVec3, distance_m: f64) -> Expansion {
        let one = |value: f64| [value as f32; LANES];
        let sight = Sight {
            inside: 1,
            edge: 0,
            wide: 0,
            within_8: 0,
            within_16: 0,
            within_8_coarse: 0,
            second_order: u16::from(distance_m >= f64::from(shape.nearest_second_order_m)),
            toward: toward.to_array().map(one),
            distance_m: one(distance_m),
            half_per_m: one(0.5 / distance_m),
            half_per_m2: one(0.5 / distance_m / distance_m),
            stretch: one(1.0),
            windows: Windows { first: [0; LANES], entry: one(0.0), entries_per_m: one(1.0) },
        };
        let mut expansion = Expansion::NONE;
        expansion.set(Portable, &sight, sight.windows.clone(), shape);
        expansion
    }

    #[test]
    fn distances_are_as_accurate_as_permitted() {
        for (voxel_m, error_m) in [(0.003, 4e-6), (0.027, 4e-6), (0.006, 1e-4), (0.027, 1e-4), (0.1, 1e-4)] {
            let shape = BrickShape::new(voxel_m, error_m);
            let offsets = Offsets::new(Portable, &shape);
            for distance_m in [shape.nearest_m, shape.nearest_second_order_m].map(|m| f64::from(m) * 1.0001) {
                let mut worst = 0.0f64;
                for n in 0..2000 {
                    // Directions on a spiral around the sphere.
                    let (up, turn) = (1.0 - (n as f64 + 0.5) / 1000.0, n as f64 * 2.399_963);
                    let toward = DVec3::new(turn.cos(), turn.sin(), 0.0) * (1.0 - up * up).sqrt() + DVec3::Z * up;
                    let places = expansion(&shape, toward, distance_m).places(Portable, 0, &offsets);
                    for (layer, places) in places.iter().enumerate() {
                        for (l, place) in places.iter().enumerate() {
                            let [x, y, z] = offsets.layer(layer).map(|axis| f64::from(axis[l]));
                            let exact = (toward * distance_m + DVec3::new(x, y, z)).length() - distance_m;
                            worst = worst.max((f64::from(*place) - exact).abs());
                        }
                    }
                }
                // Not far below either: a larger least distance would cost time.
                assert!(worst < error_m + 1e-7, "{voxel_m} m at {distance_m} m: {worst}");
                assert!(worst > 0.2 * error_m || distance_m < 4.0 * voxel_m * 3f64.sqrt(), "{voxel_m} m: {worst}");
            }
        }
    }
}

//! Geometry between sixteen sweeps and a brick of 4 × 4 × 4 voxels: out of range or beam, entirely
//! inside, or crossed by an edge.
//!
//! Inside, distances are expanded to third order about the brick's centre, d ≈ r + q + (|δ|² −
//! q²)(1 − q/r)/2r with q = u·δ, whose error is at most ρ⁴/(8 r³ (1 − ρ/r)³). This avoids a square
//! root per voxel. A brick counts as inside only where that error is small and all its ranges fit
//! the window of table entries held in registers. Where an edge of range or beam crosses the brick,
//! or the sensor is near or within it, each voxel is computed separately, with a square root and a
//! test.

use super::places::Windows;
use super::sweep_stack::{Group, SweepStack, WIDE_WINDOW, WINDOW};
use crate::math;
use crate::simd::{LANES, Lanes, dot, load3, splat3, store3, sub3};

/// Voxels along a brick's edge. Choice: a layer fills the lanes of a vector, and a brick is small
/// enough for an expansion to third order.
pub const EDGE: usize = 4;
/// Voxels in a brick.
pub const VOXELS: usize = EDGE * EDGE * EDGE;

/// By how much less than a window's entries a brick may span. The window begins up to one entry
/// before the nearest voxel, which costs one; the rest covers rounding.
const SPARE_ENTRIES: f32 = 1.25;

/// Voxels of one size, and derived lengths.
#[derive(Debug, Clone, Copy)]
pub(super) struct BrickShape {
    pub voxel_m: f32,
    /// Distances from the brick's centre to its outermost voxel centres, along an axis and to the
    /// corner.
    pub half_m: f32,
    pub radius_m: f32,
    /// Least distance at which the expansion is accurate enough, and without its terms of third order.
    pub nearest_m: f32,
    pub nearest_second_order_m: f32,
    /// What terms of second order leave out: on average −q/2r² times this.
    pub third_order_m2: f32,
    /// Greatest error of a distance.
    error_m: f32,
}

impl BrickShape {
    /// `error_m`: greatest permitted error of a distance.
    pub(super) fn new(voxel_m: f64, error_m: f64) -> Self {
        let half_m = voxel_m * (EDGE as f64 - 1.0) * 0.5;
        let radius_m = half_m * 3f64.sqrt();
        let nearest = |error_m: f64| radius_m + math::cbrt(radius_m.powi(4) / (8.0 * error_m));
        // (|δ|² − q²)·q lies within ρ³/4 of q·ρ²/4. Choice: of the error, 85 % for this, the rest for the
        // fourth order, which makes the least distance about as small as it can be.
        let third_order = (radius_m.powi(3) / 8.0 / (0.85 * error_m)).sqrt();
        Self {
            voxel_m: voxel_m as f32,
            half_m: half_m as f32,
            radius_m: radius_m as f32,
            nearest_m: nearest(error_m).max(2.0 * radius_m) as f32,
            nearest_second_order_m: nearest(0.15 * error_m).max(2.0 * radius_m).max(third_order) as f32,
            third_order_m2: (radius_m * radius_m / 4.0) as f32,
            error_m: error_m as f32,
        }
    }

    /// Positions of voxel centres along an axis, relative to the brick's centre, metres.
    #[inline(always)]
    pub(super) fn heights(&self) -> [f32; EDGE] {
        let v = self.voxel_m;
        [-1.5 * v, -0.5 * v, 0.5 * v, 1.5 * v]
    }
}

/// Sweeps in lanes: sixteen, or one in all of them.
pub(super) struct Sweeps<S: Lanes> {
    pub position: [S::F; 3],
    pub velocity: [S::F; 3],
    pub forward: [S::F; 3],
    pub first: S::F,
    pub last: S::F,
    pub per_m: S::F,
    /// Coarse entries per entry.
    pub coarse_per_entry: S::F,
    pub time_per_m: S::F,
    pub time_at_zero: S::F,
    pub start: [S::F; 3],
    pub drift: [S::F; 3],
    pub drift_squared: S::F,
    pub speed: S::F,
}

impl<S: Lanes> Sweeps<S> {
    /// The sixteen sweeps of a group.
    #[inline(always)]
    pub(super) fn sixteen(s: S, group: &Group) -> Self {
        Self {
            position: load3(s, &group.position_m),
            velocity: load3(s, &group.velocity_m_per_s),
            forward: load3(s, &group.forward),
            first: s.load(&group.first_m),
            last: s.load(&group.last_m),
            per_m: s.load(&group.entries_per_m),
            coarse_per_entry: s.load(&group.coarse_per_entry),
            time_per_m: s.load(&group.time_s_per_m),
            time_at_zero: s.load(&group.time_at_zero_s),
            start: load3(s, &group.start_m),
            drift: load3(s, &group.drift),
            drift_squared: s.load(&group.drift_squared),
            speed: s.load(&group.speed_m_per_s),
        }
    }

    /// Sweep `l` of a group in every lane.
    #[cfg(feature = "rolling")]
    #[inline(always)]
    pub(super) fn one(s: S, group: &Group, l: usize) -> Self {
        use crate::simd::lane3;
        Self {
            position: lane3(s, &group.position_m, l),
            velocity: lane3(s, &group.velocity_m_per_s, l),
            forward: lane3(s, &group.forward, l),
            first: s.splat(group.first_m[l]),
            last: s.splat(group.last_m[l]),
            per_m: s.splat(group.entries_per_m[l]),
            coarse_per_entry: s.splat(group.coarse_per_entry[l]),
            time_per_m: s.splat(group.time_s_per_m[l]),
            time_at_zero: s.splat(group.time_at_zero_s[l]),
            start: lane3(s, &group.start_m, l),
            drift: lane3(s, &group.drift, l),
            drift_squared: s.splat(group.drift_squared[l]),
            speed: s.splat(group.speed_m_per_s[l]),
        }
    }

    /// Distances of points and their inverses.
    #[inline(always)]
    fn distances(&self, s: S, point: [S::F; 3]) -> [S::F; 2] {
        // The distance d solves |p − drift·d| = d, with p from where the sensor samples range zero.
        let (from_start, drift) = (sub3(s, point, self.start), self.drift);
        let along = dot(s, from_start, drift);
        let square = dot(s, from_start, from_start);
        let root = s.sqrt(s.neg_mul_add(square, self.drift_squared, s.mul_add(along, along, square)));
        let distance = s.sub(root, along);
        let distance = s.mul_add(distance, self.drift_squared, distance);
        [distance, s.div(s.splat(1.0), s.max(distance, s.splat(1e-6)))]
    }
}

/// Distances between sixteen sweeps and a brick's centre, from the sensor when it sampled points at the
/// brick's range, and their inverses. Apart from the rest because a square root and a division take
/// long: those of some groups are computed at once.
pub(super) struct Distances {
    distance_m: [f32; LANES],
    per_m: [f32; LANES],
}

impl Distances {
    pub(super) const NONE: Self = Self { distance_m: [0.0; LANES], per_m: [0.0; LANES] };

    /// In place: moving it would cost as much.
    #[inline(always)]
    pub(super) fn set<S: Lanes>(&mut self, s: S, group: &Group, center: [f32; 3]) {
        let [distance, per_m] = Sweeps::sixteen(s, group).distances(s, splat3(s, center));
        (self.distance_m, self.per_m) = (s.store(distance), s.store(per_m));
    }
}

/// Geometry between sweeps and bricks, lane by lane: sixteen sweeps and one brick, or one sweep and
/// sixteen bricks.
pub(super) struct Sight {
    /// Lanes that see every voxel, and lanes of which an edge may cross the brick.
    pub inside: u16,
    pub edge: u16,
    /// Lanes whose table entries over the brick fit a wide window.
    pub wide: u16,
    /// Lanes whose window needs only its first eight entries, or sixteen.
    pub within_8: u16,
    pub within_16: u16,
    /// Lanes whose voxels lie within eight coarse entries.
    pub within_8_coarse: u16,
    /// Lanes whose distances are accurate enough without terms of third order.
    pub second_order: u16,
    /// Unit vector from the sensor, when it sampled points at the brick's range, to the brick's
    /// centre.
    pub toward: [[f32; LANES]; 3],
    /// Distance of the centre, half of its inverse and half of its inverse square.
    pub distance_m: [f32; LANES],
    pub half_per_m: [f32; LANES],
    pub half_per_m2: [f32; LANES],
    /// Factor of a deviation from the centre's distance, because the sensor moves while it samples.
    pub stretch: [f32; LANES],
    /// In table entries.
    pub windows: Windows,
}

impl Sight {
    /// Sixteen sweeps and one brick with its centre relative to the stack's origin.
    #[inline(always)]
    pub(super) fn new<S: Lanes>(s: S, stack: &SweepStack, group: &Group, center: [f32; 3], shape: &BrickShape) -> Self {
        Self::between(s, stack, &Sweeps::sixteen(s, group), splat3(s, center), shape)
    }

    /// The same with known distances.
    #[inline(always)]
    pub(super) fn at<S: Lanes>(
        s: S,
        stack: &SweepStack,
        group: &Group,
        distances: &Distances,
        center: [f32; 3],
        shape: &BrickShape,
    ) -> Self {
        let distances = [s.load(&distances.distance_m), s.load(&distances.per_m)];
        Self::with(s, stack, &Sweeps::sixteen(s, group), distances, splat3(s, center), shape)
    }

    /// Lane by lane.
    #[inline(always)]
    pub(super) fn between<S: Lanes>(
        s: S,
        stack: &SweepStack,
        sweeps: &Sweeps<S>,
        center: [S::F; 3],
        shape: &BrickShape,
    ) -> Self {
        Self::with(s, stack, sweeps, sweeps.distances(s, center), center, shape)
    }

    #[inline(always)]
    fn with<S: Lanes>(
        s: S,
        stack: &SweepStack,
        sweeps: &Sweeps<S>,
        [distance, per_m]: [S::F; 2],
        center: [S::F; 3],
        shape: &BrickShape,
    ) -> Self {
        let radius = s.splat(shape.radius_m);
        let (mut toward, drift) = (sub3(s, center, sweeps.start), sweeps.drift);
        for (toward, drift) in toward.iter_mut().zip(drift) {
            *toward = s.mul(s.neg_mul_add(drift, distance, *toward), per_m);
        }
        let stretch = s.sub(s.splat(1.0), dot(s, toward, drift));

        // Ranges of the voxels: at least the tangent plane's, at most that plus the curvature.
        let half = s.splat(shape.half_m);
        let reach = s.mul(s.add(s.abs(toward[0]), s.add(s.abs(toward[1]), s.abs(toward[2]))), half);
        let slack = s.mul_add(s.abs(s.sub(stretch, s.splat(1.0))), radius, s.splat(shape.error_m.max(1e-5)));
        let least = s.sub(s.sub(distance, reach), slack);
        let bend = s.mul(s.mul(radius, radius), s.mul(per_m, s.splat(0.5)));
        let most = s.add(s.add(distance, reach), s.add(bend, slack));
        let (range_first, range_last, per_entry) = (sweeps.first, sweeps.last, sweeps.per_m);
        let span = s.mul(s.sub(most, least), per_entry);
        let fits = s.at_most(span, s.splat(WINDOW as f32 - 3.0));
        // 120 entries are thirty coarse ones of four, and a window of those is 32.
        let fits_wide = s.at_most(span, s.splat(WIDE_WINDOW as f32 - 8.0));
        let mut inside = s.and(s.at_most(range_first, least), s.at_most(most, range_last));
        inside = s.and(inside, s.and(fits, s.at_most(s.splat(shape.nearest_m), distance)));

        // Whether some voxel may count, from the brick's bounding sphere, which is valid near and
        // far.
        let wide = s.add(radius, slack);
        let mut some =
            s.and(s.at_most(range_first, s.add(distance, wide)), s.at_most(s.sub(distance, wide), range_last));
        if stack.beam.cut_cos > -1.0 {
            // The direction from the sweep's pose to a voxel differs from the centre's from the sensor by at
            // most 2ρ/(2d − ρ), with ρ enlarged by the distance between the two.
            let time = s.mul_add(distance, sweeps.time_per_m, sweeps.time_at_zero);
            let radius = s.mul_add(s.abs(time), sweeps.speed, radius);
            let twice = s.add(radius, radius);
            let room = s.max(s.sub(s.add(distance, distance), radius), s.splat(1e-6));
            let turn = s.mul_add(room, s.splat(1e-6), twice);
            let outside = s.mul(s.sub(s.splat(stack.beam.cut_cos), dot(s, toward, sweeps.forward)), room);
            let near = s.at_most(distance, twice);
            some = s.and(some, s.or(near, s.at_most(outside, turn)));
            inside = s.and(inside, s.at_most(turn, s.sub(s.splat(0.0), outside)));
        }
        let inside = if stack.beam.solid { s.mask_bits(inside) } else { 0 };

        let start = s.max(s.floor(s.mul(s.sub(least, range_first), per_entry)), s.splat(0.0));
        let start = s.min(start, s.splat(1e6));
        let half_per_m = s.mul(per_m, s.splat(0.5));
        Self {
            inside,
            edge: s.mask_bits(some) & !inside,
            wide: s.mask_bits(fits_wide),
            within_8: s.mask_bits(s.at_most(span, s.splat(8.0 - SPARE_ENTRIES))),
            within_8_coarse: s.mask_bits(s.at_most(s.mul(span, sweeps.coarse_per_entry), s.splat(8.0 - SPARE_ENTRIES))),
            second_order: s.mask_bits(s.at_most(s.splat(shape.nearest_second_order_m), distance)),
            within_16: s.mask_bits(s.at_most(span, s.splat(16.0 - SPARE_ENTRIES))),
            toward: store3(s, toward),
            distance_m: s.store(distance),
            half_per_m: s.store(half_per_m),
            half_per_m2: s.store(s.mul(half_per_m, per_m)),
            stretch: s.store(stretch),
            windows: Windows {
                first: s.store_int(s.to_int(start)),
                entry: s.store(s.sub(s.mul(s.sub(distance, range_first), per_entry), start)),
                entries_per_m: s.store(s.mul(stretch, per_entry)),
            },
        }
    }
}

/// Positions of a brick's voxels relative to its centre. Lanes are x and y, x fastest; the four
/// layers are z.
pub(super) struct Offsets<S: Lanes> {
    pub x: S::F,
    pub y: S::F,
    pub z: [S::F; EDGE],
    /// |δ|² of each layer, and without its z.
    pub squared: [S::F; EDGE],
    pub flat_squared: S::F,
}

impl<S: Lanes> Offsets<S> {
    #[inline(always)]
    pub(super) fn new(s: S, shape: &BrickShape) -> Self {
        let along = shape.heights();
        let (mut x, mut y) = ([0.0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            (x[l], y[l]) = (along[l % EDGE], along[l / EDGE]);
        }
        let (x, y) = (s.load(&x), s.load(&y));
        let flat = s.mul_add(x, x, s.mul(y, y));
        let mut offsets = Self { x, y, z: [flat; EDGE], squared: [flat; EDGE], flat_squared: flat };
        for (layer, height) in along.into_iter().enumerate() {
            let z = s.splat(height);
            offsets.z[layer] = z;
            offsets.squared[layer] = s.mul_add(z, z, flat);
        }
        offsets
    }

    /// Voxels of a layer relative to the brick's centre.
    #[inline(always)]
    pub(super) fn layer(&self, layer: usize) -> [S::F; 3] {
        [self.x, self.y, self.z[layer]]
    }
}

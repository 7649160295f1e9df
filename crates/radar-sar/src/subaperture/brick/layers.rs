//! Adds a leaf's sums to the layers of a box's voxels.
//!
//! Bound: with AVX2, sixteen voxels take 66 multiply-adds of eight lanes, two roots and two divisions, on
//! the two ports of Zen 4 that multiply 43 cycles. Measured there (`cargo bench -p radar-sar --bench field`,
//! profiled): 60. The tables of a leaf take 34 for each sweep and 280 for each table (`tables.rs`).

use super::super::Subaperture;
use super::super::kernel::HALF_TURNS_PER_M;
use super::super::leaf::{Leaf, dot, minus};
use super::tables::Tables;
use super::{ENTRIES, MIDDLE, Sums, VoxelBox};
use crate::simd::{self, LANES, Lanes, ROUNDER, load3};

/// Position of a lane in a layer of 4 × 4.
pub(super) const COLUMN: [f32; LANES] =
    [0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0];
pub(super) const ROW: [f32; LANES] = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0];

/// Table entries of a layer's voxels: the nearest entry, how far beyond it, and where each half of the lanes starts. With
/// `NEAR`, each half has its voxels within eight entries from there on.
struct Places<S: Lanes, const NEAR: bool> {
    at: S::I,
    u: S::F,
    starts: [i32; 2],
}

impl<S: Lanes, const NEAR: bool> Places<S, NEAR> {
    #[inline(always)]
    fn look_up(&self, s: S, table: &S::Table) -> S::F {
        if NEAR { s.permute_near(table, self.starts, self.at) } else { s.permute(s.entries(table), self.at) }
    }

    #[inline(always)]
    fn quadratic(&self, s: S, table: &[S::Table; 3]) -> S::F {
        let slope = s.mul_add(self.look_up(s, &table[2]), self.u, self.look_up(s, &table[1]));
        s.mul_add(slope, self.u, self.look_up(s, &table[0]))
    }

    #[inline(always)]
    fn line(&self, s: S, table: &[S::Table; 2]) -> S::F {
        s.mul_add(self.look_up(s, &table[1]), self.u, self.look_up(s, &table[0]))
    }
}

/// Layers whose halves are examined at once.
pub(super) const LAYERS_AT_ONCE: usize = LANES / 2;

/// Middles of the halves of eight layers relative to the box's middle, metres: lane l is half l mod 2 of layer l / 2.
#[derive(Debug, Clone, Copy)]
pub(super) struct Halves([[f32; LANES]; 3]);

impl Halves {
    /// Where no lookup reads them.
    pub const UNUSED: Self = Self([[0.0; LANES]; 3]);

    #[inline(always)]
    pub fn of(layers_m: &[[f32; 3]], voxel_m: f32) -> Self {
        let mut middles = [[0.0; LANES]; 3];
        for (l, corner) in layers_m.iter().enumerate() {
            for (half, y) in [0.5, 2.5].into_iter().enumerate() {
                let at = [corner[0] + 1.5 * voxel_m, corner[1] + y * voxel_m, corner[2]];
                for (axis, middles) in middles.iter_mut().enumerate() {
                    middles[2 * l + half] = at[axis];
                }
            }
        }
        Self(middles)
    }

    /// The entry at which the window of each half starts, and the halves whose voxels lie within the eight entries from there
    /// on, all of the table. A distance over a plane is convex: it lies between that on its tangent, and that plus the square of
    /// how far from the half's middle, over twice the distance.
    #[inline(always)]
    pub fn starts<S: Lanes>(&self, s: S, leaf: &LeafSight, voxel_m: f32) -> ([i32; LANES], u16) {
        let [x, y, z] = load3(s, &self.0);
        let from = [s.add(x, s.splat(leaf.away[0])), s.add(y, s.splat(leaf.away[1])), s.add(z, s.splat(leaf.away[2]))];
        let distance = s.max(s.sqrt(simd::dot(s, from, from)), s.splat(1e-6));
        let per_m = s.div(s.splat(voxel_m * leaf.entries_per_m), distance);
        let across = s.mul_add(s.abs(from[0]), s.splat(1.5), s.mul(s.abs(from[1]), s.splat(0.5)));
        let reach = s.mul_add(across, per_m, s.splat(ROUNDING_ENTRIES));
        let bend = s.mul(per_m, s.splat(1.25 * voxel_m));
        let middle = s.mul_add(distance, s.splat(leaf.entries_per_m), s.splat(leaf.entry_at_zero));
        let (first, bits) = s.rounded(s.sub(middle, reach));
        let (last, _) = s.rounded(s.add(middle, s.add(reach, bend)));
        let starts = s.store_int(s.sub_int(bits, s.splat_int(ROUNDER.to_bits() as i32)));
        let in_table = s.and(s.at_most(s.splat(0.0), first), s.at_most(last, s.splat((ENTRIES - 1) as f32)));
        (starts, s.mask_bits(s.and(in_table, s.at_most(s.sub(last, first), s.splat(7.0)))))
    }
}

/// Upper bound of an entry's rounding error. Choice: ten times that of distances of 5 m, in entries 8 mm apart.
const ROUNDING_ENTRIES: f32 = 2e-3;

/// What a leaf's voxels share.
pub(super) struct LeafSight {
    /// From the leaf's middle, when the box's middle was sampled, to the box's middle, metres.
    pub away: [f32; 3],
    along: [f32; 3],
    middle_m: f32,
    /// Table entry = distance · entries_per_m + entry_at_zero.
    pub entries_per_m: f32,
    pub entry_at_zero: f32,
    half_turns_per_m: f32,
    middle_cosine: f32,
    share: f32,
}

impl LeafSight {
    #[inline(always)]
    pub fn new(block: &Subaperture, voxels: &VoxelBox, run: &Leaf) -> Self {
        let resting = minus(voxels.middle_m, run.position_m);
        let time_s = dot(resting, resting).sqrt() * block.point_time.s_per_m + block.point_time.at_zero_s;
        let [vx, vy, vz] = run.velocity_m_per_s;
        let away = minus(resting, [vx * time_s, vy * time_s, vz * time_s]);
        let middle2 = dot(away, away);
        let middle_m = middle2.sqrt().max(1e-6);
        // Points beyond the middle are sampled later, when the sensor has moved on.
        let lag = 1.0 - dot(away, run.velocity_m_per_s) / middle_m * block.point_time.s_per_m;
        let entries_per_m = lag / block.rows.box_step_m;
        Self {
            away,
            along: run.along,
            middle_m,
            entries_per_m,
            entry_at_zero: MIDDLE - middle_m * entries_per_m,
            half_turns_per_m: HALF_TURNS_PER_M * lag,
            middle_cosine: dot(run.along, away) / middle_m,
            share: run.share(),
        }
    }
}

#[inline(always)]
pub(super) fn add_leaf<S: Lanes, const ORDER: usize>(
    s: S,
    block: &Subaperture,
    voxels: &VoxelBox,
    halves: &[Halves],
    run: &Leaf,
    tables: &Tables<S>,
    sums: &mut [Sums],
) {
    let leaf = LeafSight::new(block, voxels, run);
    let voxel_m = s.splat(voxels.voxel_m);
    let in_layer = InLayer::new(s, voxel_m);
    let parts = voxels.layers_m.chunks(LAYERS_AT_ONCE).zip(sums.chunks_mut(LAYERS_AT_ONCE));
    for ((layers_m, sums), halves) in parts.zip(halves) {
        let (starts, near) = if S::NEAR_IS_FASTER { halves.starts(s, &leaf, voxels.voxel_m) } else { ([0; LANES], 0) };
        for (l, (corner, sums)) in layers_m.iter().zip(sums).enumerate() {
            if S::NEAR_IS_FASTER && near >> (2 * l) & 3 == 3 {
                let starts = [starts[2 * l], starts[2 * l + 1]];
                add_layer::<S, ORDER, true>(s, &leaf, &in_layer, corner, starts, tables, sums);
            } else {
                add_layer::<S, ORDER, false>(s, &leaf, &in_layer, corner, [0; 2], tables, sums);
            }
        }
    }
}

/// Voxels of a layer relative to lane 0.
struct InLayer<S: Lanes> {
    column: S::F,
    row: S::F,
    distance2: S::F,
}

impl<S: Lanes> InLayer<S> {
    #[inline(always)]
    fn new(s: S, voxel_m: S::F) -> Self {
        let (column, row) = (s.mul(s.load(&COLUMN), voxel_m), s.mul(s.load(&ROW), voxel_m));
        Self { column, row, distance2: s.add(s.mul(column, column), s.mul(row, row)) }
    }
}

#[inline(always)]
fn add_layer<S: Lanes, const ORDER: usize, const NEAR: bool>(
    s: S,
    leaf: &LeafSight,
    in_layer: &InLayer<S>,
    corner: &[f32; 3],
    starts: [i32; 2],
    tables: &Tables<S>,
    sums: &mut Sums,
) {
    let (away, &InLayer { column, row, distance2 }) = (leaf.away, in_layer);
    // |away + corner + in-layer|², split into lane 0's part and the rest.
    let from = [away[0] + corner[0], away[1] + corner[1], away[2] + corner[2]];
    let cross = s.mul_add(column, s.splat(2.0 * from[0]), s.mul(row, s.splat(2.0 * from[1])));
    let distance = s.sqrt(s.add(s.add(distance2, cross), s.splat(dot(from, from))));
    let entry = s.mul_add(distance, s.splat(leaf.entries_per_m), s.splat(leaf.entry_at_zero));
    let (whole, at) = s.rounded(entry);
    let places = Places::<S, NEAR> { at, u: s.sub(entry, whole), starts };
    let (mut re, mut im) = (places.quadratic(s, &tables.re), places.quadratic(s, &tables.im));
    let coherent = s.mul_add(re, re, s.mul(im, im));
    let energy = s.mul_add(coherent, s.splat(leaf.share), places.quadratic(s, &tables.incoherent));
    if ORDER >= 1 {
        let along = s.mul_add(column, s.splat(leaf.along[0]), s.mul(row, s.splat(leaf.along[1])));
        let cosine = s.div(s.add(along, s.splat(dot(leaf.along, from))), distance);
        let x = s.sub(cosine, s.splat(leaf.middle_cosine));
        let (mut slope_re, mut slope_im) = (places.line(s, &tables.first[0]), places.line(s, &tables.first[1]));
        if ORDER >= 2 {
            slope_re = s.mul_add(places.line(s, &tables.second[0]), x, slope_re);
            slope_im = s.mul_add(places.line(s, &tables.second[1]), x, slope_im);
        }
        re = s.mul_add(slope_re, x, re);
        im = s.mul_add(slope_im, x, im);
    }
    let half_turns = s.mul(s.sub(distance, s.splat(leaf.middle_m)), s.splat(leaf.half_turns_per_m));
    let (cos, sin) = s.cos_sin_of_half_turns(half_turns);
    let [sum_re, sum_im, sum_energy] = sums;
    *sum_re = s.store(s.mul_add(re, cos, s.mul_add(im, sin, s.load(sum_re))));
    *sum_im = s.store(s.mul_add(im, cos, s.neg_mul_add(re, sin, s.load(sum_im))));
    *sum_energy = s.store(s.add(energy, s.load(sum_energy)));
}

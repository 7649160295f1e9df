//! Fast inner loop: m of one sub-aperture over a small box of voxels, many sweeps at a time.
//!
//! Factorised backprojection (Yegulalp 1999, Ulander 2003) with the box as the last stage. For each
//! box and each leaf (`subapertures`) the leaf's sum is tabulated once over distance, as seen from
//! the box's middle: every sweep's z, shifted by its own exact distance from there and demodulated
//! by that distance's phase. A voxel then needs one distance, one phase and one lookup per leaf,
//! where the exact kernel needs them per sweep. Away from the box's middle, the sweeps of a leaf
//! differ in phase by κ·s·x: s is how far along the leaf's motion a sweep lies, x is how much the
//! cosine to that motion differs from its value at the middle. This phase is expanded to second
//! order by tables of the first and second moment in s, with Chebyshev-economised coefficients. The
//! leaves are short enough that κ·s·x stays within [`MAX_PHASE_RAD`].
//!
//! Each table has sixteen entries, one register. Lanes are voxels, 4 × 4 of a layer, and select
//! their entries within it. m agrees with the exact kernel to 1 % of itself plus 0.02, as that
//! kernel does with the oracle.

use super::Subaperture;
use super::lanes::{LANES, Lanes, Portable, ROUNDER, Vector};
use super::leaf::{Leaf, dot, minus};
#[cfg(target_arch = "x86_64")]
use crate::simd::{InstructionSet, has};
use crate::{PHASE_RAD_PER_M, WAVELENGTH_M};

/// Entries of a box's tables.
const ENTRIES: usize = LANES;
/// Table position of the box's middle, entries.
const MIDDLE: f32 = (ENTRIES - 1) as f32 * 0.5;
/// Greatest distance of a voxel from the box's middle, in table entries. The outermost entries have
/// no neighbour for interpolation.
const REACH_ENTRIES: f32 = MIDDLE - 0.5;
/// Distance between table entries, in pulse widths. Choice: quadratic interpolation is then
/// accurate to 1e-3, and sixteen entries reach over 4³ voxels of 5 cm.
const ENTRY_WIDTHS: f64 = 0.15;
/// Greatest κ·s·x, rad. Choice: the second-order expansion is then accurate to 1 %; shorter leaves
/// cost more.
const MAX_PHASE_RAD: f32 = 0.5;
/// Below the first, the second-order term is omitted; below the second, the first-order term as
/// well. Choice: what is omitted is below 0.5 %.
const SECOND_ORDER_FROM_RAD: f32 = 0.1;
const FIRST_ORDER_FROM_RAD: f32 = 0.004;

/// z of all sweeps, arranged so that every `stride`-th entry is contiguous.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    /// `[sweep][phase][re, im][entry / stride]`, zero-padded on either side.
    values: Vec<f32>,
    sweep_len: usize,
    row_len: usize,
    /// `[entry]`: index, within a sweep's values, of the row that begins with that entry.
    starts: Vec<u32>,
    /// Fractional entry = range · entries_per_m + entry_at_zero.
    entries_per_m: f32,
    entry_at_zero: f32,
    /// Distance between the entries of a box's tables, metres.
    box_step_m: f32,
}

impl Rows {
    /// Allocates for the sweeps of a sub-aperture; `entries` at `step_m` from `first_m` on.
    pub fn new(sweeps: usize, entries: usize, first_m: f64, step_m: f64, pulse_m: f64) -> Self {
        let stride = ((ENTRY_WIDTHS * pulse_m / step_m) as usize).max(1);
        let zeros = (ENTRIES + 1) * stride;
        let row_len = (entries + 2 * zeros).div_ceil(stride);
        let starts = (0..entries + zeros + stride).map(|n| (n % stride * 2 * row_len + n / stride) as u32).collect();
        let sweep_len = 2 * row_len * stride;
        let box_step_m = stride as f64 * step_m;
        Self {
            values: vec![0.0; sweep_len * sweeps],
            sweep_len,
            row_len,
            starts,
            entries_per_m: (1.0 / step_m) as f32,
            // The first entry of a box's table lies before its middle.
            entry_at_zero: (zeros as f64 - (first_m + f64::from(MIDDLE) * box_step_m) / step_m) as f32,
            box_step_m: box_step_m as f32,
        }
    }

    /// Without memory, for sub-apertures that evaluate single points only.
    pub fn none() -> Self {
        let (values, starts, none) = (Vec::new(), Vec::new(), 0.0);
        Self { values, sweep_len: 0, row_len: 0, starts, entries_per_m: none, entry_at_zero: none, box_step_m: none }
    }

    /// Sets a sweep's entries.
    pub fn set(&mut self, sweep: usize, re: &[f32], im: &[f32]) {
        let (stride, len) = (self.sweep_len / (2 * self.row_len), self.row_len);
        let rows = self.values[sweep * self.sweep_len..][..self.sweep_len].chunks_exact_mut(2 * len);
        for (phase, row) in rows.enumerate() {
            let (row_re, row_im) = row.split_at_mut(len);
            for (row, values) in [(row_re, re), (row_im, im)] {
                let places = row[ENTRIES + 1..].iter_mut();
                places.zip(values.iter().skip(phase).step_by(stride)).for_each(|(to, value)| *to = *value);
            }
        }
    }
}

/// A box of voxels in layers of 4 × 4; lane l is at (l mod 4, l / 4).
pub(super) struct VoxelBox<'a> {
    /// Middle of the box relative to the sub-aperture's middle, metres.
    pub middle_m: [f32; 3],
    /// Edge of a voxel, metres.
    pub voxel_m: f32,
    /// Greatest distance of a voxel from the box's middle, metres.
    pub radius_m: f32,
    /// Position of lane 0 of each layer, relative to the box's middle, metres.
    pub layers_m: &'a [[f32; 3]],
}

/// Per-sweep values for one box, and the box's sums; reused between boxes for its memory.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// `[sweep]`: index of its table for the box among all values, and of the table one entry
    /// farther.
    starts: Vec<[u32; 2]>,
    /// `[sweep]`: fraction of the way from the first to the second of these tables.
    share: Vec<f32>,
    /// Phasor that removes the sweep's phase at the box's middle.
    cos: Vec<f32>,
    sin: Vec<f32>,
    sums: Vec<Sums>,
}

impl Subaperture {
    /// Greatest permitted distance of a voxel from its box's middle, metres.
    pub(super) fn box_reach_m(&self) -> f32 {
        REACH_ENTRIES * self.rows.box_step_m
    }

    /// Whether points between these distances from the sub-aperture's middle lie within the range
    /// axes of all its sweeps.
    pub(super) fn covers(&self, nearest_m: f32, farthest_m: f32) -> bool {
        nearest_m - self.reach_m >= self.first_m && farthest_m + self.reach_m <= self.last_m
    }

    /// m of the layers' voxels. The box's radius must be at most [`Subaperture::box_reach_m`]. Values of
    /// voxels outside the range axes ([`Subaperture::covers`]) are meaningless.
    pub(super) fn coherence_in_box(&self, voxels: &VoxelBox, scratch: &mut Scratch, m: &mut [Lanes]) {
        let mut sums = std::mem::take(&mut scratch.sums);
        sums.resize(voxels.layers_m.len(), [[0.0; LANES]; 3]);
        self.sums_in_box(voxels, scratch, &mut sums);
        coherences(&sums, self.sweep_count as f32, m);
        scratch.sums = sums;
    }

    /// The sums themselves, Σ w z e^(−jκd) and Σ w² abs(z)², under the same conditions.
    pub(super) fn sums_in_box(&self, voxels: &VoxelBox, scratch: &mut Scratch, sums: &mut [Sums]) {
        #[cfg(target_arch = "x86_64")]
        {
            use super::lanes::{Avx2, Avx512};
            #[target_feature(enable = "avx512f")]
            fn avx512(block: &Subaperture, voxels: &VoxelBox, scratch: &mut Scratch, sums: &mut [Sums]) {
                all::<Avx512>(block, voxels, scratch, sums);
            }
            #[target_feature(enable = "avx2,fma")]
            fn avx2(block: &Subaperture, voxels: &VoxelBox, scratch: &mut Scratch, sums: &mut [Sums]) {
                all::<Avx2>(block, voxels, scratch, sums);
            }
            if has(InstructionSet::Avx512) {
                // SAFETY: the processor has the instructions that this copy of the code is compiled
                // for.
                return unsafe { avx512(self, voxels, scratch, sums) };
            }
            if has(InstructionSet::Avx2) {
                // SAFETY: as above.
                return unsafe { avx2(self, voxels, scratch, sums) };
            }
        }
        all::<Portable>(self, voxels, scratch, sums);
    }
}

/// Real part, imaginary part and energy of sixteen voxels.
pub(super) type Sums = [Lanes; 3];

/// m from the sums of `count` sweeps, compiled for the processor's instructions.
fn coherences(sums: &[Sums], count: f32, m: &mut [Lanes]) {
    #[inline(always)]
    fn each(sums: &[Sums], count: f32, m: &mut [Lanes]) {
        let (share, rest_share) = (1.0 / count, 1.0 / (count - 1.0));
        for ([re, im, energy], m) in sums.iter().zip(m) {
            for l in 0..LANES {
                let power = (re[l] * re[l] + im[l] * im[l]) * share;
                let rest = (energy[l] - power) * rest_share;
                m[l] = power / if rest > 1.0 { rest } else { 1.0 };
            }
        }
    }
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx512f,avx512vl")]
        fn avx512(sums: &[Sums], count: f32, m: &mut [Lanes]) {
            each(sums, count, m);
        }
        #[target_feature(enable = "avx2")]
        fn avx2(sums: &[Sums], count: f32, m: &mut [Lanes]) {
            each(sums, count, m);
        }
        if has(InstructionSet::Avx512) {
            // SAFETY: the processor has the instructions that this copy of the code is compiled
            // for.
            return unsafe { avx512(sums, count, m) };
        }
        if has(InstructionSet::Avx2) {
            // SAFETY: as above.
            return unsafe { avx2(sums, count, m) };
        }
    }
    each(sums, count, m);
}

#[inline(always)]
fn all<V: Vector>(block: &Subaperture, voxels: &VoxelBox, scratch: &mut Scratch, sums: &mut [Sums]) {
    sums.fill([[0.0; LANES]; 3]);
    demodulate_sweeps::<V>(block, voxels.middle_m, scratch);
    let cosine_spread = block.cosine_spread(voxels);
    let partition = block.partition(MAX_PHASE_RAD / (PHASE_RAD_PER_M as f32 * cosine_spread));
    for run in &partition.runs {
        let phase_rad = PHASE_RAD_PER_M as f32 * run.half_length_m * cosine_spread;
        let offset_m = &partition.offset_m;
        if phase_rad >= SECOND_ORDER_FROM_RAD {
            add_leaf::<V, 2>(block, voxels, scratch, run, offset_m, cosine_spread, sums);
        } else if phase_rad >= FIRST_ORDER_FROM_RAD {
            add_leaf::<V, 1>(block, voxels, scratch, run, offset_m, cosine_spread, sums);
        } else {
            add_leaf::<V, 0>(block, voxels, scratch, run, offset_m, cosine_spread, sums);
        }
    }
}

impl Subaperture {
    /// Upper bound of how much the cosine between a line of sight and any fixed direction varies
    /// over a box: the chord of the angle that the box's bounding sphere subtends.
    #[inline(always)]
    fn cosine_spread(&self, voxels: &VoxelBox) -> f32 {
        let distance_m = dot(voxels.middle_m, voxels.middle_m).sqrt() - self.reach_m;
        let sine = voxels.radius_m / distance_m.max(1e-6);
        if sine < 0.95 { (2.0 - 2.0 * (1.0 - sine * sine).sqrt()).sqrt() } else { 2.0 }
    }
}

/// For each sweep, from its exact distance to the box's middle: the start of its table there, and
/// the phasor that removes its phase.
#[inline(always)]
fn demodulate_sweeps<V: Vector>(block: &Subaperture, middle_m: [f32; 3], scratch: &mut Scratch) {
    let rows = &block.rows;
    let room = block.groups.len() * LANES;
    scratch.starts.resize(room, [0; 2]);
    for values in [&mut scratch.share, &mut scratch.cos, &mut scratch.sin] {
        values.resize(room, 0.0);
    }
    let last = rows.starts.len() - 2;
    for (g, group) in block.groups.iter().enumerate() {
        // No closures here: they would not be compiled for the wider instructions.
        let mut axes = [(V::splat(0.0), V::splat(0.0)); 3];
        for axis in 0..3 {
            let position = V::load(&group.position_m[axis]);
            axes[axis] = (V::splat(middle_m[axis]).sub(position), V::load(&group.velocity_m_per_s[axis]));
        }
        let [(x, vx), (y, vy), (z, vz)] = axes;
        let resting = length([x, y, z]);
        let time = resting.mul_add(V::splat(block.time_s_per_m), V::splat(block.time_at_zero_s));
        let distance = length([vx.neg_mul_add(time, x), vy.neg_mul_add(time, y), vz.neg_mul_add(time, z)]);
        let half_turns = distance.mul(V::splat(HALF_TURNS_PER_M));
        let (cos, sin) = half_turns.cos_sin_of_half_turns();
        let at = distance.mul_add(V::splat(rows.entries_per_m), V::splat(rows.entry_at_zero));
        let (whole, bits) = at.sub(V::splat(0.5)).rounded();
        let first = g * LANES;
        store(at.sub(whole), &mut scratch.share[first..]);
        store(cos, &mut scratch.cos[first..]);
        store(sin, &mut scratch.sin[first..]);
        let mut lanes = [0.0; LANES];
        bits.store(&mut lanes);
        for (l, starts) in scratch.starts[first..first + LANES].iter_mut().enumerate() {
            let entry = (lanes[l].to_bits().wrapping_sub(ROUNDER.to_bits()) as i32).clamp(0, last as i32) as usize;
            // Lanes of the last group beyond the last sweep have no values; they are never read.
            let sweep = ((first + l) * rows.sweep_len) as u32;
            *starts = [rows.starts[entry] + sweep, rows.starts[entry + 1] + sweep];
        }
    }
}

/// Stores into the first sixteen values.
#[inline(always)]
fn store<V: Vector>(vector: V, values: &mut [f32]) {
    if let Some(lanes) = values.first_chunk_mut() {
        vector.store(lanes);
    }
}

#[inline(always)]
fn length<V: Vector>([x, y, z]: [V; 3]) -> V {
    x.mul_add(x, y.mul_add(y, z.mul(z))).sqrt()
}

/// Position of a lane in a layer of 4 × 4.
const COLUMN: Lanes = [0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0];
const ROW: Lanes = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0];

const HALF_TURNS_PER_M: f32 = (4.0 / WAVELENGTH_M) as f32;

/// Tables of one leaf over one box: value, slope and half the second difference at each entry; for
/// the moments, value and slope.
struct Tables<V> {
    energy: [V; 3],
    re: [V; 3],
    im: [V; 3],
    first: [[V; 2]; 2],
    second: [[V; 2]; 2],
}

#[inline(always)]
fn tabulate<V: Vector, const ORDER: usize>(
    block: &Subaperture,
    scratch: &Scratch,
    run: &Leaf,
    offset_m: &[f32],
    cosine_spread: f32,
) -> Tables<V> {
    let rows = &block.rows;
    let zero = V::splat(0.0);
    let (mut energy, mut sum) = (zero, [zero; 2]);
    let (mut first, mut second) = ([zero; 2], [zero; 2]);
    let sweeps = run.first..run.end;
    let turns = scratch.cos[sweeps.clone()].iter().zip(&scratch.sin[sweeps.clone()]);
    let tables = scratch.starts[sweeps.clone()].iter().zip(&scratch.share[sweeps.clone()]);
    for (((&[here, next], &share), (&cos, &sin)), &offset_m) in tables.zip(turns).zip(&offset_m[sweeps]) {
        let (here, next) = (here as usize, next as usize);
        let share = V::splat(share);
        let (from, to) = (load_or_zero::<V>(&rows.values, here), load_or_zero::<V>(&rows.values, next));
        let re = share.mul_add(to.sub(from), from);
        let (from, to) = (
            load_or_zero::<V>(&rows.values, here + rows.row_len),
            load_or_zero::<V>(&rows.values, next + rows.row_len),
        );
        let im = share.mul_add(to.sub(from), from);
        energy = re.mul_add(re, im.mul_add(im, energy));
        let (cos, sin) = (V::splat(cos), V::splat(sin));
        // z · e^(−jκd)
        let (re, im) = (re.mul_add(cos, im.mul(sin)), re.neg_mul_add(sin, im.mul(cos)));
        sum = [sum[0].add(re), sum[1].add(im)];
        if ORDER >= 1 {
            // e^(jφ) ≈ 1 + jφ(1 − φm²/8) − ½φ²(1 − φm²/12) for φ within ±φm.
            let phase = PHASE_RAD_PER_M as f32 * offset_m;
            let greatest = phase * cosine_spread;
            let greatest2 = greatest * greatest;
            let linear = V::splat(phase * (1.0 - greatest2 * (1.0 / 8.0)));
            first = [linear.neg_mul_add(im, first[0]), linear.mul_add(re, first[1])];
            if ORDER >= 2 {
                let square = V::splat(0.5 * phase * phase * (1.0 - greatest2 * (1.0 / 12.0)));
                second = [square.neg_mul_add(re, second[0]), square.neg_mul_add(im, second[1])];
            }
        }
    }
    Tables {
        energy: quadratics(energy),
        re: quadratics(sum[0]),
        im: quadratics(sum[1]),
        first: [lines(first[0]), lines(first[1])],
        second: [lines(second[0]), lines(second[1])],
    }
}

/// Sixteen values from `at` on; zeros where the row is too short.
#[inline(always)]
fn load_or_zero<V: Vector>(row: &[f32], at: usize) -> V {
    match row.get(at..at + LANES) {
        Some(lanes) => match lanes.first_chunk() {
            Some(lanes) => V::load(lanes),
            None => V::splat(0.0),
        },
        None => V::splat(0.0),
    }
}

/// The entries before and after each entry.
#[inline(always)]
fn neighbors<V: Vector>(table: V) -> (V, V) {
    (table.look_up(V::load(&LANE_BEFORE)), table.look_up(V::load(&LANE_AFTER)))
}

/// Index of each lane's neighbour, wrapping at the ends, in the encoding of lookups.
const LANE_BEFORE: Lanes = lane_plus(LANES - 1);
const LANE_AFTER: Lanes = lane_plus(1);

const fn lane_plus(shift: usize) -> Lanes {
    let (mut lanes, mut l) = ([0.0; LANES], 0);
    while l < LANES {
        lanes[l] = ROUNDER + ((l + shift) % LANES) as f32;
        l += 1;
    }
    lanes
}

/// Value, slope and curvature at each entry: the quartic through five entries, economised to a
/// quadratic within half an entry of the middle one. Next to the tables' ends, where the fifth
/// entry is missing, the cubic through four.
#[inline(always)]
fn quadratics<V: Vector>(table: V) -> [V; 3] {
    let (before, after) = neighbors(table);
    let half = V::splat(0.5);
    let (slope, bend) = (after.sub(before).mul(half), after.add(before).mul(half).sub(table));
    let (bend_before, bend_after) = neighbors(bend);
    let (rise, fall) = (bend_after.sub(bend), bend.sub(bend_before));
    let third = rise.mul(V::load(&AFTER)).add(fall.mul(V::load(&BEFORE)));
    let fourth = rise.sub(fall).mul(V::load(&INNER));
    [
        fourth.neg_mul_add(V::splat(1.0 / 1536.0), table),
        third.neg_mul_add(V::splat(13.0 / 96.0), slope),
        fourth.neg_mul_add(V::splat(1.0 / 16.0), bend),
    ]
}

/// Weights of the change of curvature after an entry, before it, and of their difference. Both
/// sides count where an entry has two neighbours on each; otherwise the inner side alone.
const AFTER: Lanes = [0.0, 2.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0];
const BEFORE: Lanes = [0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 0.0];
const INNER: Lanes = [0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0];

#[inline(always)]
fn lines<V: Vector>(table: V) -> [V; 2] {
    let (before, after) = neighbors(table);
    [table, after.sub(before).mul(V::splat(0.5))]
}

#[inline(always)]
fn quadratic<V: Vector>(table: &[V; 3], at: V, u: V) -> V {
    let slope = table[2].look_up(at).mul_add(u, table[1].look_up(at));
    slope.mul_add(u, table[0].look_up(at))
}

#[inline(always)]
fn line<V: Vector>(table: &[V; 2], at: V, u: V) -> V {
    table[1].look_up(at).mul_add(u, table[0].look_up(at))
}

#[inline(always)]
fn add_leaf<V: Vector, const ORDER: usize>(
    block: &Subaperture,
    voxels: &VoxelBox,
    scratch: &Scratch,
    run: &Leaf,
    offset_m: &[f32],
    cosine_spread: f32,
    sums: &mut [Sums],
) {
    let tables = tabulate::<V, ORDER>(block, scratch, run, offset_m, cosine_spread);
    // Vector from the leaf's middle, when the box's middle was sampled, to the box's middle.
    let resting = minus(voxels.middle_m, run.position_m);
    let time_s = dot(resting, resting).sqrt() * block.time_s_per_m + block.time_at_zero_s;
    let [vx, vy, vz] = run.velocity_m_per_s;
    let away = minus(resting, [vx * time_s, vy * time_s, vz * time_s]);
    let middle2 = dot(away, away);
    let middle_m = middle2.sqrt().max(1e-6);
    // Points beyond the middle are sampled later, when the sensor has moved on.
    let lag = 1.0 - dot(away, run.velocity_m_per_s) / middle_m * block.time_s_per_m;
    let entries_per_m = lag / block.rows.box_step_m;
    let entry_at_zero = MIDDLE - middle_m * entries_per_m;
    let half_turns_per_m = HALF_TURNS_PER_M * lag;
    let along_middle_m = dot(run.along, away);
    let middle_cosine = V::splat(along_middle_m / middle_m);

    let voxel_m = V::splat(voxels.voxel_m);
    let (column, row) = (V::load(&COLUMN).mul(voxel_m), V::load(&ROW).mul(voxel_m));
    let distance2_in_layer = column.mul(column).add(row.mul(row));
    for (corner, sums) in voxels.layers_m.iter().zip(sums) {
        // |away + corner + in-layer|², split into lane 0's part and the rest.
        let from = [away[0] + corner[0], away[1] + corner[1], away[2] + corner[2]];
        let cross = column.mul_add(V::splat(2.0 * from[0]), row.mul(V::splat(2.0 * from[1])));
        let distance = distance2_in_layer.add(cross).add(V::splat(dot(from, from))).sqrt();
        let entry = distance.mul_add(V::splat(entries_per_m), V::splat(entry_at_zero));
        let (whole, at) = entry.rounded();
        let u = entry.sub(whole);
        let (mut re, mut im) = (quadratic(&tables.re, at, u), quadratic(&tables.im, at, u));
        if ORDER >= 1 {
            let along = column.mul_add(V::splat(run.along[0]), row.mul(V::splat(run.along[1])));
            let cosine = along.add(V::splat(dot(run.along, from))).div(distance);
            let x = cosine.sub(middle_cosine);
            let (mut slope_re, mut slope_im) = (line(&tables.first[0], at, u), line(&tables.first[1], at, u));
            if ORDER >= 2 {
                slope_re = line(&tables.second[0], at, u).mul_add(x, slope_re);
                slope_im = line(&tables.second[1], at, u).mul_add(x, slope_im);
            }
            re = slope_re.mul_add(x, re);
            im = slope_im.mul_add(x, im);
        }
        let half_turns = distance.sub(V::splat(middle_m)).mul(V::splat(half_turns_per_m));
        let (cos, sin) = half_turns.cos_sin_of_half_turns();
        let [sum_re, sum_im, sum_energy] = sums;
        re.mul_add(cos, im.mul_add(sin, V::load(sum_re))).store(sum_re);
        im.mul_add(cos, re.neg_mul_add(sin, V::load(sum_im))).store(sum_im);
        quadratic(&tables.energy, at, u).add(V::load(sum_energy)).store(sum_energy);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::subaperture::{MEAN_LOG_OF_NOISE, SubapertureBuilder, SubapertureSettings};
    use crate::test_data::{Echo, sweeps, winding};
    use crate::{Beam, Observation};
    use crate::{Oracle, Statistic};
    use glam::DVec3;

    const AT: DVec3 = DVec3::new(0.1, -0.2, -1.1);
    const NEAR: DVec3 = DVec3::new(-0.1, 0.1, -0.55);

    fn block(observations: &[Observation]) -> Subaperture {
        let mut builder = SubapertureBuilder::new(SubapertureSettings::default());
        observations.iter().for_each(|o| assert!(builder.push(o.clone()).is_none()));
        builder.close().unwrap()
    }

    /// Layers of a cube of 4 × 4 × 4 voxels around its middle, and the greatest distance of a
    /// voxel.
    fn cube(voxel_m: f32) -> (Vec<[f32; 3]>, f32) {
        let low = -1.5 * voxel_m;
        ((0..4).map(|z| [low, low, low + z as f32 * voxel_m]).collect(), 1.5 * voxel_m * 3f32.sqrt())
    }

    fn places(middle_m: [f32; 3], voxel_m: f32, layers_m: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let lane = |l: usize| [(l % 4) as f32 * voxel_m, (l / 4) as f32 * voxel_m, 0.0];
        let of = |corner: &[f32; 3]| {
            let corner = *corner;
            (0..LANES).map(move |l| std::array::from_fn(|axis| middle_m[axis] + corner[axis] + lane(l)[axis]))
        };
        layers_m.iter().flat_map(of).collect()
    }

    fn in_box(block: &Subaperture, middle_m: [f32; 3], voxel_m: f32) -> (Vec<[f32; 3]>, Vec<f32>) {
        let (layers_m, radius_m) = cube(voxel_m);
        assert!(radius_m <= block.box_reach_m());
        let mut m = vec![[0.0; LANES]; layers_m.len()];
        let voxels = VoxelBox { middle_m, voxel_m, radius_m, layers_m: &layers_m };
        block.coherence_in_box(&voxels, &mut Scratch::default(), &mut m);
        (places(middle_m, voxel_m, &layers_m), m.concat())
    }

    /// Middles of boxes near and far, on and off the axis.
    fn middles() -> impl Iterator<Item = [f32; 3]> {
        (0..60).map(|n| {
            let range = 0.45 + 0.03 * n as f32;
            let (across, turn) = (0.6 * (n as f32 * 0.37).sin(), n as f32 * 2.4);
            [range * across * turn.cos(), range * across * turn.sin(), -range * (1.0 - across * across).sqrt()]
        })
    }

    type Path<'a> = &'a dyn Fn(f64) -> DVec3;

    /// Greatest and rms difference between boxes and the exact kernel, in units of 1 % + 0.02.
    fn differences(path: impl Fn(f64) -> DVec3, snr: f64) -> (f32, f32) {
        let block = block(&sweeps(0.089, path, &[(Echo::Point(AT), snr), (Echo::Point(NEAR), snr)], 7));
        let (mut worst, mut squares, mut count) = (0.0f32, 0.0, 0);
        for voxel_m in [0.05, 0.025, 0.01] {
            let near = [AT, NEAR].map(|p| (p - block.middle.translation).as_vec3().to_array());
            for middle in middles().chain(near) {
                let (places, fast) = in_box(&block, middle, voxel_m);
                for (found, exact) in fast.iter().zip(block.coherence_at_points(&places)) {
                    let off = (found - exact.m).abs() / (0.01 * exact.m + 0.02);
                    assert!(off.is_finite(), "{found} {exact:?}");
                    (worst, squares, count) = (worst.max(off), squares + off * off, count + 1);
                }
            }
        }
        (worst, (squares / count as f32).sqrt())
    }

    #[test]
    fn boxes_agree_with_the_exact_kernel() {
        let fast = |t: f64| winding(2.5 * t);
        let straight = |t: f64| DVec3::new(1.2 * t, 0.0, 0.0);
        let still = |_: f64| DVec3::ZERO;
        // 72 m/s²: more than a head can do.
        let whirling = |t: f64| DVec3::new(0.02 * (60.0 * t).cos(), 0.02 * (60.0 * t).sin(), 0.3 * t);
        let paths: [(&str, Path, f32); 5] = [
            ("natural", &winding, 1.0),
            ("fast", &fast, 1.0),
            ("straight", &straight, 1.0),
            ("still", &still, 1.2),
            ("whirling", &whirling, 3.0),
        ];
        for (name, path, most) in paths {
            for snr in [0.5, 3.0] {
                let (worst, rms) = differences(path, snr);
                assert!(worst <= most && rms <= 0.35, "{name}, {snr}: {worst} {rms}");
            }
            // In the sidelobes of an echo 30 dB above the noise, the incoherent part is a
            // difference of large numbers.
            let (worst, rms) = differences(path, 30.0);
            assert!(worst <= 6.0 && rms <= 0.8, "{name}, strong: {worst} {rms}");
        }
    }

    #[test]
    fn boxes_agree_with_the_oracle() {
        let fast = |t: f64| winding(2.5 * t);
        let observations = sweeps(0.089, fast, &[(Echo::Point(AT), 2.0)], 7);
        let oracle = Oracle::new(&observations, &Beam::Lensless, &SubapertureSettings::default());
        let block = block(&observations);
        for middle in middles().step_by(6).chain([(AT - block.middle.translation).as_vec3().to_array()]) {
            let (places, found) = in_box(&block, middle, 0.05);
            for (place, found) in places.iter().zip(found).step_by(5) {
                let place = block.middle.translation + DVec3::from_array(place.map(f64::from));
                let score = oracle.value(Statistic::Subaperture, place);
                if score != 0.0 {
                    // The score of a single sub-aperture is ln(1 + m) minus its mean under noise.
                    let exact = (score + MEAN_LOG_OF_NOISE).exp() - 1.0;
                    assert!((f64::from(found) - exact).abs() < 0.01 * exact + 0.02, "{place}: {found} {exact}");
                }
            }
        }
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let block = block(&sweeps(0.089, |t| winding(2.0 * t), &[(Echo::Point(AT), 2.0)], 8));
        let (layers_m, radius_m) = cube(0.05);
        for middle_m in middles().chain([[0.0; 3], [0.01, 0.0, -0.1]]) {
            let voxels = VoxelBox { middle_m, voxel_m: 0.05, radius_m, layers_m: &layers_m };
            let (mut dispatched, mut portable) = ([[[0.0; LANES]; 3]; 4], [[[0.0; LANES]; 3]; 4]);
            block.sums_in_box(&voxels, &mut Scratch::default(), &mut dispatched);
            all::<Portable>(&block, &voxels, &mut Scratch::default(), &mut portable);
            let bits = |sums: [Sums; 4]| sums.map(|of| of.map(|lanes| lanes.map(f32::to_bits)));
            assert_eq!(bits(dispatched), bits(portable));
        }
    }
}

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
//! Each table has sixteen entries, as many as there are lanes. Lanes are voxels, 4 × 4 of a layer, and select
//! their entries within it; where a register has eight lanes, mostly among eight entries. m agrees
//! with the exact kernel to 1 % of itself plus 0.02, as that kernel does with the oracle.

mod layers;
mod tables;

use layers::{Halves, LAYERS_AT_ONCE, add_leaf};
use tables::tabulate;

use super::Subaperture;
use super::kernel::HALF_TURNS_PER_M;
use super::leaf::dot;
use crate::PHASE_RAD_PER_M;
use crate::simd::{self, Kernel, LANES, Lanes, ROUNDER, load3, on_widest, splat3, sub3};

/// Entries of a box's tables.
const ENTRIES: usize = LANES;
/// Table position of the box's middle, entries.
const MIDDLE: f32 = (ENTRIES - 1) as f32 * 0.5;
/// Greatest distance of a voxel from the box's middle, in table entries. The outermost entries have
/// no neighbour for interpolation.
const REACH_ENTRIES: f32 = MIDDLE - 0.5;
/// Distance between table entries, in pulse widths, and the greatest, which larger voxels need.
/// Choice: at 0.15 quadratic interpolation is accurate to 1e-3, and sixteen entries reach over 4³
/// voxels of 5 cm for a pulse of 14 cm; with 0.2, over such of 6.5 cm, m still agrees as stated above.
const ENTRY_WIDTHS: f64 = 0.15;
const MAX_ENTRY_WIDTHS: f64 = 0.2;
/// Greatest κ·s·x, rad. Choice: the second-order expansion is then accurate to 1 %; shorter leaves
/// cost more.
const MAX_PHASE_RAD: f32 = 0.5;
/// Below the first, the second-order term is omitted; below the second, the first-order term as
/// well. Choice: what is omitted is below 0.5 %.
const SECOND_ORDER_FROM_RAD: f32 = 0.1;
const FIRST_ORDER_FROM_RAD: f32 = 0.004;

/// Greatest distance of a voxel from the middle of a tile of 4³ of them, metres, rounded up.
pub(super) fn tile_radius_m(voxel_m: f64) -> f64 {
    1.5 * 3f64.sqrt() * voxel_m * 1.000_01
}

/// Starts of a box's tables in a part of the rows. Choice: twice as many as a table has entries; a part of 70 sweeps is then
/// 80 kB, and the rows of presets for rooms take 1.6 times the memory that they would without parts.
const STARTS: usize = 2 * ENTRIES;
/// Number of values of a row in a part.
pub(super) const ROW_LEN: usize = STARTS + ENTRIES;

/// z of all sweeps, arranged so that every `stride`-th entry is contiguous.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    /// `[part][sweep][phase][re, im][entry / stride]`, zero-padded on either side: a part holds [`STARTS`] starts of a
    /// box's tables, and the entries that the last of them needs. What a box reads of all sweeps lies in one part or two,
    /// on few pages, which a processor's first level of address translation covers.
    values: Vec<f32>,
    /// Number of values of a sweep in a part.
    sweep_len: usize,
    /// Entries from a value of a row to the next.
    stride: usize,
    sweeps: usize,
    /// `[entry]`: index, in the first sweep's values, of the row that begins with that entry.
    starts: Vec<u32>,
    /// Fractional entry = range · entries_per_m + entry_at_zero.
    entries_per_m: f32,
    entry_at_zero: f32,
    /// Distance between the entries of a box's tables, metres.
    box_step_m: f32,
}

impl Rows {
    /// Allocates for the sweeps of a sub-aperture; `entries` at `step_m` from `first_m` on. The boxes' tables reach over a
    /// tile of voxels of `voxel_m` if [`MAX_ENTRY_WIDTHS`] allows it.
    pub fn new(sweeps: usize, [first_m, step_m]: [f64; 2], entries: usize, pulse_m: f64, voxel_m: f64) -> Self {
        let for_tile = (tile_radius_m(voxel_m) / f64::from(REACH_ENTRIES) / step_m).ceil() as usize;
        let [fine, coarse] = [ENTRY_WIDTHS, MAX_ENTRY_WIDTHS].map(|widths| (widths * pulse_m / step_m) as usize);
        let stride = for_tile.clamp(fine, coarse).max(1);
        let zeros = (ENTRIES + 1) * stride;
        let starts = entries + zeros + stride;
        let (sweep_len, parts) = (2 * ROW_LEN * stride, ((starts - 1) / stride / STARTS) + 1);
        let start = |n: usize| {
            let (row, phase) = (n / stride, n % stride);
            row / STARTS * sweeps * sweep_len + phase * 2 * ROW_LEN + row % STARTS
        };
        let box_step_m = stride as f64 * step_m;
        Self {
            values: vec![0.0; parts * sweeps * sweep_len],
            sweep_len,
            stride,
            sweeps,
            starts: (0..starts).map(|n| start(n) as u32).collect(),
            entries_per_m: (1.0 / step_m) as f32,
            // The first entry of a box's table lies before its middle.
            entry_at_zero: (zeros as f64 - (first_m + f64::from(MIDDLE) * box_step_m) / step_m) as f32,
            box_step_m: box_step_m as f32,
        }
    }

    /// Without memory, for sub-apertures that evaluate single points only.
    pub fn none() -> Self {
        let (values, starts, none) = (Vec::new(), Vec::new(), 0.0);
        Self {
            values,
            sweep_len: 0,
            stride: 0,
            sweeps: 0,
            starts,
            entries_per_m: none,
            entry_at_zero: none,
            box_step_m: none,
        }
    }

    /// Sets a sweep's entries.
    pub fn set(&mut self, sweep: usize, re: &[f32], im: &[f32]) {
        let (stride, len) = (self.stride, self.sweep_len);
        let sweeps = self.values.chunks_exact_mut(len).skip(sweep);
        for (part, values) in sweeps.step_by(self.sweeps).enumerate() {
            for (phase, rows) in values.chunks_exact_mut(2 * ROW_LEN).enumerate() {
                let (row_re, row_im) = rows.split_at_mut(ROW_LEN);
                // The first ENTRIES + 1 entries of a row are zeros.
                let first = part * STARTS;
                let (zeros, skipped) = ((ENTRIES + 1).saturating_sub(first), first.saturating_sub(ENTRIES + 1));
                for (row, values) in [(row_re, re), (row_im, im)] {
                    let entries = values.iter().skip(skipped * stride + phase).step_by(stride);
                    row[zeros..].iter_mut().zip(entries).for_each(|(to, value)| *to = *value);
                }
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
    halves: Vec<Halves>,
}

impl Subaperture {
    /// Greatest permitted distance of a voxel from its box's middle, metres.
    pub(super) fn box_reach_m(&self) -> f32 {
        REACH_ENTRIES * self.rows.box_step_m
    }

    /// Whether points between these distances from the sub-aperture's middle lie within the range
    /// axes of all its sweeps.
    pub(super) fn covers(&self, nearest_m: f32, farthest_m: f32) -> bool {
        nearest_m - self.path.reach_m >= self.axis.first_m && farthest_m + self.path.reach_m <= self.axis.last_m
    }

    /// m of the layers' voxels. The box's radius must be at most [`Subaperture::box_reach_m`]. Values of
    /// voxels outside the range axes ([`Subaperture::covers`]) are meaningless.
    pub(super) fn coherence_in_box(&self, voxels: &VoxelBox, scratch: &mut Scratch, m: &mut [[f32; LANES]]) {
        let mut sums = std::mem::take(&mut scratch.sums);
        sums.resize(voxels.layers_m.len(), [[0.0; LANES]; 3]);
        self.sums_in_box(voxels, scratch, &mut sums);
        on_widest(Coherences { sums: &sums, count: self.path.sweep_count as f32, m });
        scratch.sums = sums;
    }

    /// The sums themselves, Σ w z e^(−jκd) and Σ w² abs(z)², under the same conditions.
    pub(super) fn sums_in_box(&self, voxels: &VoxelBox, scratch: &mut Scratch, sums: &mut [Sums]) {
        on_widest(SumInBox { block: self, voxels, scratch, sums });
    }
}

/// Real part, imaginary part and energy of sixteen voxels.
pub(super) type Sums = [[f32; LANES]; 3];

/// m from the sums of `count` sweeps.
struct Coherences<'a> {
    sums: &'a [Sums],
    count: f32,
    m: &'a mut [[f32; LANES]],
}

impl Kernel for Coherences<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) {
        let (share, rest_share) = (1.0 / self.count, 1.0 / (self.count - 1.0));
        for ([re, im, energy], m) in self.sums.iter().zip(self.m) {
            for l in 0..LANES {
                let power = (re[l] * re[l] + im[l] * im[l]) * share;
                let rest = (energy[l] - power) * rest_share;
                m[l] = power / if rest > 1.0 { rest } else { 1.0 };
            }
        }
    }
}

struct SumInBox<'a> {
    block: &'a Subaperture,
    voxels: &'a VoxelBox<'a>,
    scratch: &'a mut Scratch,
    sums: &'a mut [Sums],
}

impl Kernel for SumInBox<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) {
        let Self { block, voxels, scratch, sums } = self;
        sums.fill([[0.0; LANES]; 3]);
        demodulate_sweeps(s, block, voxels.middle_m, scratch);
        let cosine_spread = block.cosine_spread(voxels);
        let partition = block.partition(MAX_PHASE_RAD / (PHASE_RAD_PER_M as f32 * cosine_spread));
        scratch.halves.clear();
        for layers_m in voxels.layers_m.chunks(LAYERS_AT_ONCE) {
            let halves = if S::NEAR_IS_FASTER { Halves::of(layers_m, voxels.voxel_m) } else { Halves::UNUSED };
            scratch.halves.push(halves);
        }
        for run in &partition.runs {
            let phase_rad = PHASE_RAD_PER_M as f32 * run.half_length_m * cosine_spread;
            let offset_m = &partition.offset_m;
            if phase_rad >= SECOND_ORDER_FROM_RAD {
                let tables = tabulate::<S, 2>(s, block, scratch, run, offset_m, cosine_spread);
                add_leaf::<S, 2>(s, block, voxels, &scratch.halves, run, &tables, sums);
            } else if phase_rad >= FIRST_ORDER_FROM_RAD {
                let tables = tabulate::<S, 1>(s, block, scratch, run, offset_m, cosine_spread);
                add_leaf::<S, 1>(s, block, voxels, &scratch.halves, run, &tables, sums);
            } else {
                let tables = tabulate::<S, 0>(s, block, scratch, run, offset_m, cosine_spread);
                add_leaf::<S, 0>(s, block, voxels, &scratch.halves, run, &tables, sums);
            }
        }
    }
}

impl Subaperture {
    /// Upper bound of how much the cosine between a line of sight and any fixed direction varies
    /// over a box: the chord of the angle that the box's bounding sphere subtends.
    #[inline(always)]
    fn cosine_spread(&self, voxels: &VoxelBox) -> f32 {
        let distance_m = dot(voxels.middle_m, voxels.middle_m).sqrt() - self.path.reach_m;
        let sine = voxels.radius_m / distance_m.max(1e-6);
        if sine < 0.95 { (2.0 - 2.0 * (1.0 - sine * sine).sqrt()).sqrt() } else { 2.0 }
    }
}

/// For each sweep, from its exact distance to the box's middle: the start of its table there, and
/// the phasor that removes its phase.
#[inline(always)]
fn demodulate_sweeps<S: Lanes>(s: S, block: &Subaperture, middle_m: [f32; 3], scratch: &mut Scratch) {
    let rows = &block.rows;
    let room = block.path.groups.len() * LANES;
    scratch.starts.resize(room, [0; 2]);
    for values in [&mut scratch.share, &mut scratch.cos, &mut scratch.sin] {
        values.resize(room, 0.0);
    }
    let last = rows.starts.len() - 2;
    for (g, group) in block.path.groups.iter().enumerate() {
        let [x, y, z] = sub3(s, splat3(s, middle_m), load3(s, &group.position_m));
        let [vx, vy, vz] = load3(s, &group.velocity_m_per_s);
        let resting = length(s, [x, y, z]);
        let time = s.mul_add(resting, s.splat(block.point_time.s_per_m), s.splat(block.point_time.at_zero_s));
        let moved = [s.neg_mul_add(vx, time, x), s.neg_mul_add(vy, time, y), s.neg_mul_add(vz, time, z)];
        let distance = length(s, moved);
        let (cos, sin) = s.cos_sin_of_half_turns(s.mul(distance, s.splat(HALF_TURNS_PER_M)));
        let at = s.mul_add(distance, s.splat(rows.entries_per_m), s.splat(rows.entry_at_zero));
        let (whole, bits) = s.rounded(s.sub(at, s.splat(0.5)));
        let first = g * LANES;
        store_at(s, s.sub(at, whole), &mut scratch.share, first);
        store_at(s, cos, &mut scratch.cos, first);
        store_at(s, sin, &mut scratch.sin, first);
        let bits = s.store_int(bits);
        for (l, starts) in scratch.starts[first..first + LANES].iter_mut().enumerate() {
            let entry = bits[l].wrapping_sub(ROUNDER.to_bits() as i32).clamp(0, last as i32) as usize;
            // Lanes of the last group beyond the last sweep have no values; they are never read.
            let sweep = ((first + l) * rows.sweep_len) as u32;
            *starts = [rows.starts[entry] + sweep, rows.starts[entry + 1] + sweep];
        }
    }
}

/// Stores into sixteen values from `at` on.
#[inline(always)]
fn store_at<S: Lanes>(s: S, lanes: S::F, values: &mut [f32], at: usize) {
    if let Some(values) = values[at..].first_chunk_mut() {
        *values = s.store(lanes);
    }
}

#[inline(always)]
fn length<S: Lanes>(s: S, v: [S::F; 3]) -> S::F {
    s.sqrt(simd::dot(s, v, v))
}
#[cfg(test)]
mod tests {
    use super::layers::{COLUMN, LeafSight, ROW};
    use super::*;
    use crate::simd::{Portable, on_each};
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

    #[test]
    fn rows_hold_the_entries_from_every_start_on() {
        let (sweeps, step_m) = (3, 0.008);
        for entries in [4, 130, 350] {
            let mut rows = Rows::new(sweeps, [0.2, step_m], entries, 0.14, 0.065);
            let value = |sweep: usize, entry: usize| (1000 * sweep + entry + 1) as f32;
            for sweep in 0..sweeps {
                let re: Vec<f32> = (0..entries).map(|entry| value(sweep, entry)).collect();
                let im: Vec<f32> = re.iter().map(|re| -re).collect();
                rows.set(sweep, &re, &im);
            }
            // The first start is that many zeros before the first entry.
            let zeros = (ENTRIES + 1) * rows.stride;
            for (n, start) in rows.starts.iter().enumerate() {
                for (sweep, k) in (0..sweeps).flat_map(|sweep| (0..ENTRIES).map(move |k| (sweep, k))) {
                    let entry = (n + k * rows.stride).checked_sub(zeros).filter(|entry| *entry < entries);
                    let at = *start as usize + sweep * rows.sweep_len + k;
                    let expected = entry.map_or(0.0, |entry| value(sweep, entry));
                    assert_eq!([rows.values[at], -rows.values[at + ROW_LEN]], [expected; 2], "{entries} {n} {k}");
                }
            }
        }
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
    /// The greatest difference allowed, by the voxels' edge, metres.
    type Limit = fn(f32) -> f32;

    /// Difference between boxes and the exact kernel in units of 1 % + 0.02: the greatest in shares of what `most` allows for the
    /// voxels' edge, and the rms.
    fn differences(path: impl Fn(f64) -> DVec3, snr: f64, most: Limit) -> (f32, f32) {
        let block = block(&sweeps(0.089, path, &[(Echo::Point(AT), snr), (Echo::Point(NEAR), snr)], 7));
        let (mut worst, mut squares, mut count) = (0.0f32, 0.0, 0);
        for voxel_m in [0.065, 0.05, 0.025, 0.01] {
            let near = [AT, NEAR].map(|p| (p - block.middle.translation).as_vec3().to_array());
            for middle in middles().chain(near) {
                let (places, fast) = in_box(&block, middle, voxel_m);
                for (found, exact) in fast.iter().zip(block.coherence_at_points(&places)) {
                    let off = (found - exact.m).abs() / (0.01 * exact.m + 0.02);
                    assert!(off.is_finite(), "{found} {exact:?}");
                    (worst, squares, count) = (worst.max(off / most(voxel_m)), squares + off * off, count + 1);
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
        // The error grows with the box: where a voxel's echo is sampled, the velocity is another than at the middle's.
        let of_whirling = |voxel_m: f32| 3.0 * (voxel_m / 0.05).max(1.0);
        let paths: [(&str, Path, Limit); 5] = [
            ("natural", &winding, |_| 1.0),
            ("fast", &fast, |_| 1.0),
            ("straight", &straight, |_| 1.0),
            ("still", &still, |_| 1.0),
            ("whirling", &whirling, of_whirling),
        ];
        for (name, path, most) in paths {
            for snr in [0.5, 3.0] {
                let (worst, rms) = differences(path, snr, most);
                assert!(worst <= 1.0 && rms <= 0.35, "{name}, {snr}: {worst} {rms}");
            }
            let (worst, rms) = differences(path, 30.0, most);
            assert!(worst <= 2.0 && rms <= 0.35, "{name}, strong: {worst} {rms}");
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

    #[derive(Clone)]
    struct Trial<'a> {
        block: &'a Subaperture,
        voxels: &'a VoxelBox<'a>,
    }

    impl Kernel for Trial<'_> {
        type Out = Vec<[[i32; LANES]; 3]>;

        #[inline(always)]
        fn run<S: Lanes>(self, s: S) -> Self::Out {
            let Self { block, voxels } = self;
            let mut sums = vec![[[0.0; LANES]; 3]; voxels.layers_m.len()];
            SumInBox { block, voxels, scratch: &mut Scratch::default(), sums: &mut sums }.run(s);
            sums.iter().map(|sums| sums.map(|lanes| lanes.map(|value| value.to_bits() as i32))).collect()
        }
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let block = block(&sweeps(0.089, |t| winding(2.0 * t), &[(Echo::Point(AT), 2.0)], 8));
        for voxel_m in [0.065, 0.05, 0.01] {
            let (mut layers_m, radius_m) = cube(voxel_m);
            // More layers than are examined at once.
            layers_m.extend(layers_m.clone());
            layers_m.extend_from_within(..3);
            for middle_m in middles().chain([[0.0; 3], [0.01, 0.0, -0.1]]) {
                let voxels = VoxelBox { middle_m, voxel_m, radius_m, layers_m: &layers_m };
                let all = on_each(&Trial { block: &block, voxels: &voxels });
                assert!(all.iter().all(|one| *one == all[0]));
            }
        }
    }

    #[test]
    fn halves_of_layers_need_eight_entries_or_are_known_to_need_more() {
        let s = Portable;
        let block = block(&sweeps(0.089, |t| winding(2.0 * t), &[], 8));
        let (mut near_halves, mut all_halves) = (0, 0);
        for voxel_m in [0.065, 0.03] {
            let (layers_m, radius_m) = cube(voxel_m);
            for middle_m in middles().chain([[0.01, 0.0, -0.1], [0.1, 0.02, 0.0]]) {
                let voxels = VoxelBox { middle_m, voxel_m, radius_m, layers_m: &layers_m };
                let leaf = LeafSight::new(&block, &voxels, &block.partition(0.01).runs[0]);
                let (starts, near) = Halves::of(&layers_m, voxel_m).starts(s, &leaf, voxel_m);
                for (half, start) in starts[..2 * layers_m.len()].iter().enumerate() {
                    let from = |axis: usize| leaf.away[axis] + layers_m[half / 2][axis];
                    let entry = |l: usize| {
                        let (x, y) = (from(0) + COLUMN[l] * voxel_m, from(1) + ROW[l] * voxel_m);
                        (x * x + y * y + from(2) * from(2)).sqrt() * leaf.entries_per_m + leaf.entry_at_zero
                    };
                    let entries = (half % 2 * 8..half % 2 * 8 + 8).map(|l| entry(l).round() as i32);
                    let is_near = entries.clone().all(|at| (*start..start + 8).contains(&at));
                    all_halves += 1;
                    if near >> half & 1 == 1 {
                        near_halves += 1;
                        assert!(is_near, "{start}: {:?}", entries.collect::<Vec<_>>());
                    }
                }
            }
        }
        assert!(near_halves * 2 > all_halves && near_halves < all_halves, "{near_halves} of {all_halves}");
    }
}

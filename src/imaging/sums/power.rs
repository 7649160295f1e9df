//! Sums of whole numbers over a brick: `ls` and `log`.
//!
//! Each sweep adds to each voxel the value of its table at the voxel's distance, rounded to whole steps, so the sum depends
//! neither on the order of the sweeps nor on what was added and taken out again in between: rolling, adaptive and dense images
//! are equal bit for bit. Sums of 32 bit are moved to 64 bit before they could overflow.

use super::dispatch::{Kernel, on_widest};
use super::lanes::{LANES, Lanes, WIDE_WINDOW, WINDOW};
use super::sight::{BrickShape, EDGE, Offsets, Sight, VOXELS, add3, dot, lane3, scale3, splat3, sub3};
use super::stack::SweepStack;

/// Largest error of a distance, metres: a ten-thousandth of a table step's worth of slope.
const DISTANCE_ERROR_M: f64 = 5e-5;

/// A shape that is good enough for these sums.
pub(super) fn power_shape(voxel_m: f64) -> BrickShape {
    BrickShape::new(voxel_m, DISTANCE_ERROR_M)
}

/// Adds (or takes out) sweeps of a stack to the voxels of one brick.
#[derive(Clone)]
pub(super) struct AddPower<'a> {
    pub stack: &'a SweepStack,
    pub shape: BrickShape,
    /// Relative to the stack's origin, metres.
    pub center: [f32; 3],
    /// Slots, as a group and a mask of its lanes.
    pub slots: &'a [(usize, u16)],
}

/// Sums in steps, x fastest, and the (voxel, sweep) pairs that were worked on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct PowerSums {
    pub sums: [i64; VOXELS],
    pub updates: u64,
}

impl AddPower<'_> {
    /// On the widest instructions.
    pub(super) fn sums(self) -> PowerSums {
        on_widest(self)
    }
}

impl Kernel for AddPower<'_> {
    type Out = PowerSums;

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) -> PowerSums {
        let offsets = Offsets::new(s, &self.shape);
        let mut out = PowerSums { sums: [0; VOXELS], updates: 0 };
        // Sums of the two paths by themselves: those of the inside stay in registers.
        let (mut sums, mut greatest) = ([s.splat_int(0); EDGE], 0i64);
        let (mut edge_sums, mut edge_greatest) = ([s.splat_int(0); EDGE], 0i64);
        for &(group, lanes) in self.slots {
            let sight = Sight::new(s, self.stack, &self.stack.groups[group], self.center, &self.shape);
            let (mut inside, mut edge) = (sight.inside & lanes, sight.edge & lanes);
            out.updates += u64::from(inside.count_ones() + edge.count_ones()) * VOXELS as u64;
            while inside != 0 {
                let l = inside.trailing_zeros() as usize;
                inside &= inside - 1;
                let slot = group * LANES + l;
                greatest += self.stack.greatest(slot);
                if greatest > i64::from(i32::MAX) {
                    widen(s, &mut sums, &mut out.sums);
                    greatest = self.stack.greatest(slot);
                }
                add_inside(s, &sight, l, self.stack.table(slot, 0), self.stack.stride, &offsets, &mut sums);
            }
            while edge != 0 {
                let l = edge.trailing_zeros() as usize;
                edge &= edge - 1;
                let slot = group * LANES + l;
                edge_greatest += self.stack.greatest(slot);
                if edge_greatest > i64::from(i32::MAX) {
                    widen(s, &mut edge_sums, &mut out.sums);
                    edge_greatest = self.stack.greatest(slot);
                }
                add_edge(s, self.stack, group, &sight, l, &offsets, &mut edge_sums);
            }
        }
        widen(s, &mut sums, &mut out.sums);
        widen(s, &mut edge_sums, &mut out.sums);
        out
    }
}

/// Moves what was summed in 32 bit to 64 bit.
#[inline(always)]
fn widen<S: Lanes>(s: S, sums: &mut [S::I; EDGE], into: &mut [i64; VOXELS]) {
    for (layer, sum) in sums.iter_mut().enumerate() {
        let values = s.store_int(*sum);
        for (l, value) in values.iter().enumerate() {
            into[layer * LANES + l] += i64::from(*value);
        }
        *sum = s.splat_int(0);
    }
}

/// All voxels within range and beam: the window of the table in registers.
#[inline(always)]
pub(super) fn add_inside<S: Lanes>(
    s: S,
    sight: &Sight,
    l: usize,
    table: &[f32],
    stride: usize,
    offsets: &Offsets<S>,
    sums: &mut [S::I; EDGE],
) {
    let first = sight.window[l] as usize;
    let (Some(values), Some(slopes)) = (window(table, first), window(table, stride + first)) else { return };
    let [ux, uy, uz] = lane3(s, &sight.toward, l);
    let flat = s.mul_add(offsets.x, ux, s.mul(offsets.y, uy));
    let (half, half2) = (s.splat(sight.half_per_m[l]), s.splat(sight.half_per_m2[l]));
    let (per_m, entry) = (s.splat(sight.entries_per_m[l]), s.splat(sight.entry[l]));
    for (layer, sum) in sums.iter_mut().enumerate() {
        let q = s.mul_add(offsets.z[layer], uz, flat);
        let deviation = s.mul_add(s.neg_mul_add(q, q, offsets.squared[layer]), s.neg_mul_add(q, half2, half), q);
        let at = s.mul_add(deviation, per_m, entry);
        let whole = s.floor(at);
        let n = s.to_int(whole);
        let value = s.mul_add(s.sub(at, whole), s.look_up(slopes, n), s.look_up(values, n));
        *sum = s.add_int(*sum, s.to_int(value));
    }
}

#[inline(always)]
pub(super) fn window(table: &[f32], first: usize) -> Option<&[f32; WINDOW]> {
    table.get(first..)?.first_chunk()
}

/// One layer's voxels as a sweep saw them, each by itself.
pub(super) struct AtEdge<S: Lanes> {
    /// Distance from where the sensor was when it sampled points at about this range.
    pub distance: S::F,
    /// Distance from the sweep's pose, and its part along the boresight.
    pub pose_distance: S::F,
    pub along: S::F,
    /// Which voxels lie within range and beam.
    pub counts: S::M,
}

impl<S: Lanes> AtEdge<S> {
    #[inline(always)]
    pub(super) fn new(
        s: S,
        stack: &SweepStack,
        group: usize,
        sight: &Sight,
        l: usize,
        offsets: &Offsets<S>,
        layer: usize,
    ) -> Self {
        let sweeps = &stack.groups[group];
        let from_pose = add3(s, offsets.layer(layer), lane3(s, &sight.offset_from_pose_m, l));
        let pose_distance = s.sqrt(dot(s, from_pose, from_pose));
        let [vx, vy, vz] = &sweeps.velocity_m_per_s;
        let mut distance = pose_distance;
        if [vx[l], vy[l], vz[l]] != [0.0; 3] {
            // When points at about this range were sampled, and how far the sensor had moved by then.
            let time = s.mul_add(pose_distance, s.splat(sweeps.time_s_per_m[l]), s.splat(sweeps.time_at_zero_s[l]));
            let from = sub3(s, from_pose, scale3(s, splat3(s, [vx[l], vy[l], vz[l]]), time));
            distance = s.sqrt(dot(s, from, from));
        }
        // A place at the sensor itself has no direction and does not count.
        let first = s.splat(sweeps.first_m[l].max(f32::MIN_POSITIVE));
        let mut counts = s.and(s.at_most(first, distance), s.at_most(distance, s.splat(sweeps.last_m[l])));
        let mut along = pose_distance;
        if !stack.beam.uniform {
            along = dot(s, from_pose, lane3(s, &sweeps.forward, l));
            if stack.beam.cut_cos > -1.0 {
                counts = s.and(counts, s.at_most(s.mul(pose_distance, s.splat(stack.beam.cut_cos)), along));
            }
        }
        Self { distance, pose_distance, along, counts }
    }

    /// Cosine to the boresight.
    #[inline(always)]
    pub(super) fn cos(&self, s: S) -> S::F {
        let cos = s.div(self.along, s.max(self.pose_distance, s.splat(1e-9)));
        s.min(s.max(cos, s.splat(-1.0)), s.splat(1.0))
    }
}

/// Windows of two tables that hold all the entries that a brick needs.
pub(super) struct WidePairs<'a> {
    first: i32,
    windows: [&'a [f32; WIDE_WINDOW]; 2],
}

impl<'a> WidePairs<'a> {
    /// `None` where the brick spans too many entries.
    #[inline(always)]
    pub(super) fn new(sight: &Sight, l: usize, one: &'a [f32], other: &'a [f32]) -> Option<Self> {
        if sight.wide >> l & 1 == 0 {
            return None;
        }
        // Moved down where the tables end.
        let first = (sight.window[l] as usize).min(one.len().min(other.len()).checked_sub(WIDE_WINDOW)?);
        let windows = [one.get(first..)?.first_chunk()?, other.get(first..)?.first_chunk()?];
        Some(Self { first: first as i32, windows })
    }

    #[inline(always)]
    pub(super) fn at<S: Lanes>(&self, s: S, n: S::I) -> (S::F, S::F) {
        let n = s.add_int(n, s.splat_int(-self.first));
        (s.look_up_wide(self.windows[0], n), s.look_up_wide(self.windows[1], n))
    }
}

/// Some voxels may be out of range or beam: each by itself.
#[inline(always)]
fn add_edge<S: Lanes>(
    s: S,
    stack: &SweepStack,
    group: usize,
    sight: &Sight,
    l: usize,
    offsets: &Offsets<S>,
    sums: &mut [S::I; EDGE],
) {
    let values = &stack.table(group * LANES + l, 0)[..stack.stride];
    let sweeps = &stack.groups[group];
    // First where each layer's values lie, then the values: the processor waits for no single one.
    let mut places = [(s.splat_int(0), s.splat(0.0), s.mask(0)); EDGE];
    for (layer, place) in places.iter_mut().enumerate() {
        let seen = AtEdge::new(s, stack, group, sight, l, offsets, layer);
        let mut counts = seen.counts;
        if !stack.beam.whole {
            let amplitude = super::weighted::amplitude(s, &stack.beam, seen.cos(s));
            counts = s.and(counts, s.at_most(s.splat(f32::MIN_POSITIVE), amplitude));
        }
        let at = s.mul(s.sub(seen.distance, s.splat(sweeps.first_m[l])), s.splat(sweeps.entries_per_m[l]));
        let whole = s.floor(at);
        *place = (s.to_int(s.or_zero(counts, whole)), s.sub(at, whole), counts);
    }
    let wide = WidePairs::new(sight, l, values, values.get(1..).unwrap_or_default());
    for (sum, (n, rest, counts)) in sums.iter_mut().zip(places) {
        let (here, next) = match &wide {
            Some(wide) => wide.at(s, n),
            None => s.gather_pairs(values, n),
        };
        let value = s.mul_add(rest, s.sub(next, here), here);
        *sum = s.add_int(*sum, s.to_int(s.or_zero(counts, value)));
    }
}

//! Sums of whole numbers over a brick: `ls` and `log`.
//!
//! Each sweep adds to each voxel the value of its table at the voxel's distance, rounded to whole steps, so the sum depends
//! neither on the order of the sweeps nor on what was added and taken out again in between: rolling, adaptive and dense images
//! are equal bit for bit. Sums of 32 bit are moved to 64 bit before they could overflow.

use super::dispatch::{Kernel, on_widest};
use super::lanes::{LANES, Lanes, WINDOW};
use super::sight::{BrickShape, EDGE, Offsets, Sight, VOXELS, add3, dot, lane3, scale3, sub3};
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
        let mut sums = [s.splat_int(0); EDGE];
        let mut greatest = 0i64;
        for &(group, lanes) in self.slots {
            let sight = Sight::new(s, self.stack, &self.stack.groups[group], self.center, &self.shape);
            let (inside, mut left) = (sight.inside & lanes, (sight.inside | sight.edge) & lanes);
            out.updates += u64::from(left.count_ones()) * VOXELS as u64;
            while left != 0 {
                let l = left.trailing_zeros() as usize;
                left &= left - 1;
                let slot = group * LANES + l;
                greatest += self.stack.greatest(slot);
                if greatest > i64::from(i32::MAX) {
                    widen(s, &mut sums, &mut out.sums);
                    greatest = self.stack.greatest(slot);
                }
                let table = self.stack.table(slot, 0);
                if inside >> l & 1 == 1 {
                    add_inside(s, &sight, l, table, self.stack.stride, &offsets, &mut sums);
                } else {
                    add_edge(s, self.stack, group, &sight, l, &offsets, &mut sums);
                }
            }
        }
        widen(s, &mut sums, &mut out.sums);
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
    for layer in 0..EDGE {
        let q = s.mul_add(offsets.z[layer], uz, flat);
        let bend = s.mul(s.neg_mul_add(q, q, offsets.squared[layer]), s.neg_mul_add(q, half2, half));
        let at = s.mul_add(s.add(q, bend), per_m, entry);
        let whole = s.floor(at);
        let n = s.to_int(whole);
        let value = s.mul_add(s.sub(at, whole), s.look_up(slopes, n), s.look_up(values, n));
        sums[layer] = s.add_int(sums[layer], s.to_int(value));
    }
}

#[inline(always)]
pub(super) fn window(table: &[f32], first: usize) -> Option<&[f32; WINDOW]> {
    table.get(first..)?.first_chunk()
}

/// Distances of one layer's voxels as their points measured them, and which of them count.
#[inline(always)]
pub(super) fn at_edge<S: Lanes>(
    s: S,
    stack: &SweepStack,
    group: usize,
    sight: &Sight,
    l: usize,
    offsets: &Offsets<S>,
    layer: usize,
) -> (S::F, S::M, S::F) {
    let sweeps = &stack.groups[group];
    let from_pose = add3(s, offsets.layer(layer), lane3(s, &sight.offset_from_pose_m, l));
    let pose_distance = s.sqrt(dot(s, from_pose, from_pose));
    // When points at about this range were sampled, and how far the sensor had moved by then.
    let time = s.mul_add(pose_distance, s.splat(sweeps.time_s_per_m[l]), s.splat(sweeps.time_at_zero_s[l]));
    let from = sub3(s, from_pose, scale3(s, lane3(s, &sweeps.velocity_m_per_s, l), time));
    let distance = s.sqrt(dot(s, from, from));
    let within = s.and(s.at_most(s.splat(sweeps.first_m[l]), distance), s.at_most(distance, s.splat(sweeps.last_m[l])));
    // A place at the sensor itself has no direction and does not count.
    let mut counts = s.and(within, s.at_most(s.splat(f32::MIN_POSITIVE), distance));
    if stack.beam.uniform {
        return (distance, counts, s.splat(1.0));
    }
    let along = dot(s, from_pose, lane3(s, &sweeps.forward, l));
    let cos = s.div(along, s.max(pose_distance, s.splat(1e-9)));
    let cos = s.min(s.max(cos, s.splat(-1.0)), s.splat(1.0));
    counts = s.and(counts, s.at_most(s.splat(stack.beam.cut_cos), cos));
    (distance, counts, cos)
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
    let table = stack.table(group * LANES + l, 0);
    let (values, slopes) = table.split_at(stack.stride);
    let sweeps = &stack.groups[group];
    for layer in 0..EDGE {
        let (distance, mut counts, cos) = at_edge(s, stack, group, sight, l, offsets, layer);
        if !stack.beam.whole {
            let amplitude = super::weighted::amplitude(s, &stack.beam, cos);
            counts = s.and(counts, s.at_most(s.splat(f32::MIN_POSITIVE), amplitude));
        }
        let at = s.mul(s.sub(distance, s.splat(sweeps.first_m[l])), s.splat(sweeps.entries_per_m[l]));
        let whole = s.floor(at);
        let n = s.to_int(s.or_zero(counts, whole));
        let value = s.mul_add(s.sub(at, whole), s.gather(slopes, n), s.gather(values, n));
        sums[layer] = s.add_int(sums[layer], s.to_int(s.or_zero(counts, value)));
    }
}

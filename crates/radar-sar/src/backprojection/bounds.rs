//! Upper bound of a sweep's contribution anywhere in a box, which lets a search skip empty space
//! without missing a voxel.
//!
//! The box's distances from the sensor lie between those of its nearest point and its farthest
//! corner, widened by the error of the kernels' distances. The greatest table value over that
//! interval comes from a sparse table of range maxima (two overlapping intervals of 2^n entries),
//! times the beam's greatest amplitude over the box where the statistic is weighted by it. Bounds
//! are integers, rounded up, so their sums are exact and can roll. `glrt` and `coherent` are
//! bounded through Σ |z|² (Cauchy–Schwarz): each is at most its square root.

use glam::DVec3;

use super::brick_geometry::Sweeps;
use super::grid::BrickGrid;
use super::sweep_stack::{Group, SweepStack, rounding_of_lookup};
use crate::Statistic;
use crate::math;
use crate::simd::{LANES, Lanes, dot, scale3, splat3, sub3};

/// Twice the greatest error of a kernel's distance, metres.
const DISTANCE_ERROR_M: f32 = 2.0 * super::edge_geometry::DISTANCE_ERROR_M as f32;
/// Greatest bound of one sweep where the unit can be chosen, in units. Choice: within f32's
/// mantissa, so that a bound is exact, and fine enough that rounding up by a unit costs nothing.
const FINE_STEPS: f64 = (1 << 22) as f64;

/// Range maxima of every sweep of a stack.
#[derive(Debug, Clone)]
pub(super) struct RangeMaxima {
    levels: usize,
    stride: usize,
    /// `[slot][level][entry]`: greatest integer over 2^level intervals from the entry on.
    maxima: Vec<i32>,
    /// Value of one unit of a bound.
    unit: f64,
    /// Factor that covers the rounding of f32 sums of so many sweeps.
    slack: f64,
    /// The beam's amplitude grows with the cosine, so its greatest value over a box is at the
    /// greatest cosine.
    monotone: bool,
    weighs_beam: bool,
}

impl RangeMaxima {
    /// For all sweeps of a stack.
    pub(super) fn of(stack: &SweepStack) -> Self {
        let stride = stack.stride;
        let levels = stride.ilog2() as usize + 1;
        let amplitudes = &stack.beam.amplitudes;
        let mut all = Self {
            levels,
            stride,
            maxima: vec![0; stack.slots() * levels * stride],
            unit: 1.0,
            slack: 1.001 + 1e-7 * math::powf(stack.sweeps() as f64, 1.5),
            monotone: amplitudes.windows(2).all(|two| two[0] <= two[1]),
            weighs_beam: matches!(stack.statistic(), Statistic::Thesis | Statistic::ThesisFull),
        };
        if !stack.sums_whole_numbers() {
            let greatest = (0..stack.slots()).filter(|&slot| stack.is_filled(slot));
            let greatest = greatest.flat_map(|slot| interval_maxima(stack, slot)).fold(0.0f64, f64::max);
            all.unit = (greatest / FINE_STEPS).max(1e-30);
        }
        (0..stack.slots()).filter(|&slot| stack.is_filled(slot)).for_each(|slot| all.fill(stack, slot));
        all
    }

    /// Computes a slot's maxima from its tables.
    pub(super) fn fill(&mut self, stack: &SweepStack, slot: usize) {
        let (stride, unit) = (self.stride, self.unit);
        let rows = &mut self.maxima[slot * self.levels * stride..][..self.levels * stride];
        for (to, value) in rows.iter_mut().zip(interval_maxima(stack, slot)) {
            *to = (value / unit).ceil() as i32 + 1;
        }
        for level in 1..self.levels {
            let (below, row) = rows[(level - 1) * stride..].split_at_mut(stride);
            let half = 1 << (level - 1);
            for n in 0..stride {
                row[n] = below[n].max(below[(n + half).min(stride - 1)]);
            }
        }
    }

    /// A value that the statistic cannot exceed when its bounds have this sum.
    pub(super) fn value_of(&self, stack: &SweepStack, bound: i64) -> f32 {
        if stack.sums_whole_numbers() {
            return stack.value_of(bound);
        }
        let bound = bound as f64 * self.unit;
        let value = if self.weighs_beam { bound } else { bound.sqrt() };
        (value * self.slack) as f32
    }
}

/// Upper bound of each table interval's contribution to the bounded sum: steps for `ls` and `log`,
/// |z|² for `glrt` and `coherent`, |x|·D for the thesis's statistics.
fn interval_maxima(stack: &SweepStack, slot: usize) -> impl Iterator<Item = f64> {
    let plane = move |plane: usize| stack.table(slot, plane.min(stack.planes - 1)).split_at(stack.stride);
    let ((a, slopes), (b, _), (c, _)) = (plane(0), plane(1), plane(2));
    let statistic = stack.statistic();
    // Entries beyond the axis are zero, so D² is zero there.
    let power = move |n: usize| match statistic {
        Statistic::Glrt if b[n] > 0.0 => f64::from(a[n]).powi(2) / f64::from(b[n]),
        Statistic::Coherent if c[n] > 0.0 => (f64::from(a[n]).powi(2) + f64::from(b[n]).powi(2)) / f64::from(c[n]),
        _ => 0.0,
    };
    let linear = move |n: usize| f64::from(a[n].max(a[n] + slopes[n])).max(0.0);
    (0..stack.stride).map(move |n| match statistic {
        Statistic::Glrt | Statistic::Coherent => power(n).max(power((n + 1).min(stack.stride - 1))),
        // At the last entry the parabola is extrapolated.
        Statistic::Ls | Statistic::Log => {
            let lines = linear(n) + rounding_of_lookup([f64::from(a[n]), f64::from(slopes[n]), 0.0]);
            lines.max(stack.parabolas(slot).greatest_between(n)).min(stack.greatest(slot) as f64)
        }
        _ => linear(n),
    })
}

/// A box of voxel centres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct VoxelBox {
    /// Centre, from the stack's origin, metres.
    pub center_m: [f32; 3],
    /// Half of its edges, metres; rounded up slightly.
    pub half_m: [f32; 3],
}

impl VoxelBox {
    /// The voxels of a cube of 2^level bricks within the grid; `None` when there are none.
    pub(super) fn of(grid: &BrickGrid, origin_m: DVec3, level: u32, cube: [usize; 3]) -> Option<Self> {
        let (mut center_m, mut half_m) = ([0.0; 3], [0.0; 3]);
        let base = (grid.origin_m - origin_m).to_array();
        for axis in 0..3 {
            let edge = super::brick_geometry::EDGE << level;
            let first = cube[axis] * edge;
            let last = (first + edge).min(grid.size[axis]);
            if first >= last {
                return None;
            }
            center_m[axis] = (base[axis] + (first + last) as f64 * 0.5 * grid.voxel_m) as f32;
            half_m[axis] = ((last - first - 1) as f64 * 0.5 * grid.voxel_m) as f32 + 1e-6;
        }
        Some(Self { center_m, half_m })
    }
}

/// Sweeps in lanes with their range maxima.
pub(super) struct SweepLanes<'a, S: Lanes> {
    sweeps: Sweeps<S>,
    /// The sensor's movement while range increases by a metre.
    drift: S::F,
    /// Range maxima of these sweeps only, so that indices stay small for any number of sweeps.
    rows: &'a [i32],
    /// Start of each sweep's maxima.
    maxima: S::I,
}

impl<'a, S: Lanes> SweepLanes<'a, S> {
    /// The sixteen sweeps of a group.
    #[inline(always)]
    pub(super) fn group(s: S, group: &Group, index: usize, maxima: &'a RangeMaxima) -> Self {
        let of_sweep = maxima.levels * maxima.stride;
        let mut begin = [0i32; LANES];
        for (l, begin) in begin.iter_mut().enumerate() {
            *begin = (l * of_sweep) as i32;
        }
        let rows = &maxima.maxima[index * LANES * of_sweep..][..LANES * of_sweep];
        Self::new(s, Sweeps::sixteen(s, group), rows, s.load_int(&begin))
    }

    /// One sweep in every lane.
    #[cfg(feature = "rolling")]
    #[inline(always)]
    pub(super) fn one(s: S, group: &Group, slot: usize, maxima: &'a RangeMaxima) -> Self {
        let of_sweep = maxima.levels * maxima.stride;
        let rows = &maxima.maxima[slot * of_sweep..][..of_sweep];
        Self::new(s, Sweeps::one(s, group, slot % LANES), rows, s.splat_int(0))
    }

    #[inline(always)]
    fn new(s: S, sweeps: Sweeps<S>, rows: &'a [i32], maxima: S::I) -> Self {
        let drift = s.mul(sweeps.speed, s.abs(sweeps.time_per_m));
        Self { sweeps, drift, rows, maxima }
    }
}

/// Upper bounds of the sweeps' contributions in boxes, lane by lane; 0 where a box is entirely out
/// of range or beam.
#[inline(always)]
pub(super) fn bounds<S: Lanes>(
    s: S,
    stack: &SweepStack,
    maxima: &RangeMaxima,
    lanes: &SweepLanes<'_, S>,
    boxes: &BoxLanes<S>,
) -> S::I {
    let sweep = &lanes.sweeps;
    let zero = s.splat(0.0);
    let (half, radius) = (&boxes.half, boxes.radius);
    let from_pose = sub3(s, boxes.center, sweep.position);
    let pose_distance = s.sqrt(dot(s, from_pose, from_pose));
    let time = s.mul_add(pose_distance, sweep.time_per_m, sweep.time_at_zero);
    let offset = sub3(s, from_pose, scale3(s, sweep.velocity, time));
    // Points at other ranges are sampled from other positions. The difference is limited by the
    // speed, the time between them, and the error of the first estimate of the time.
    let late = s.mul(sweep.speed, s.abs(time));
    let wide = s.mul(s.add(s.add(radius, late), s.add(radius, late)), lanes.drift);
    let slack = s.add(wide, s.mul_add(pose_distance, s.splat(1e-6), s.splat(DISTANCE_ERROR_M)));

    let (mut near, mut far) = ([zero; 3], [zero; 3]);
    for axis in 0..3 {
        let off = s.abs(offset[axis]);
        near[axis] = s.max(s.sub(off, half[axis]), zero);
        far[axis] = s.add(off, half[axis]);
    }
    let least = s.max(s.sub(s.sqrt(dot(s, near, near)), slack), sweep.first);
    let most = s.min(s.add(s.sqrt(dot(s, far, far)), slack), sweep.last);
    let mut some = s.at_most(least, most);
    let along = dot(s, from_pose, sweep.forward);
    // The direction to a voxel differs from the centre's by at most 2ρ/(2d − ρ), which is at most
    // 4ρ/3d for d ≥ 2ρ.
    let across = s.mul_add(radius, s.splat(4.0 / 3.0), s.mul(pose_distance, s.splat(1e-5)));
    if stack.beam.cut_cos > -1.0 {
        let near = s.at_most(pose_distance, s.add(radius, radius));
        let within = s.at_most(s.mul(pose_distance, s.splat(stack.beam.cut_cos)), s.add(along, across));
        some = s.and(some, s.or(near, within));
    }
    if s.mask_bits(some) == 0 {
        return s.splat_int(0);
    }

    let entry = s.splat(maxima.stride as f32 - 1.0);
    let low = s.min(s.max(s.floor(s.mul(s.sub(least, sweep.first), sweep.per_m)), zero), entry);
    let high = s.min(s.max(s.floor(s.mul(s.sub(most, sweep.first), sweep.per_m)), low), entry);
    // The two intervals of 2^n entries that cover the range.
    let (span, level) = s.octave(s.add(s.sub(high, low), s.splat(1.0)));
    let row = s.mul(s.to_float(level), s.splat(maxima.stride as f32));
    let from_low = s.add_int(lanes.maxima, s.to_int(s.add(row, low)));
    let to_high = s.add_int(lanes.maxima, s.to_int(s.add(row, s.sub(s.add(high, s.splat(1.0)), span))));
    let mut greatest = s.max_int(s.gather_int(lanes.rows, from_low), s.gather_int(lanes.rows, to_high));
    if maxima.weighs_beam && maxima.monotone && !stack.beam.uniform {
        let room = s.sub(s.add(pose_distance, pose_distance), radius);
        let turn = s.add(s.div(s.add(radius, radius), s.max(room, s.splat(1e-6))), s.splat(1e-5));
        let cos = s.div(along, s.max(pose_distance, s.splat(1e-6)));
        let best = s.min(s.max(s.add(cos, turn), s.splat(-1.0)), s.splat(1.0));
        let amplitude = s.mul(super::beam_table::amplitude(s, &stack.beam, best), s.splat(1.001));
        greatest = s.to_int(s.mul_add(s.to_float(greatest), amplitude, s.splat(1.0)));
    }
    s.or_zero_int(some, greatest)
}

/// Boxes of voxel centres in lanes, metres from the stack's origin.
pub(super) struct BoxLanes<S: Lanes> {
    pub center: [S::F; 3],
    /// Half of their edges; rounded up slightly.
    pub half: [S::F; 3],
    /// Distance from the centre to the corners.
    pub radius: S::F,
}

impl<S: Lanes> BoxLanes<S> {
    /// One box in every lane.
    #[inline(always)]
    pub(super) fn one(s: S, of: &VoxelBox) -> Self {
        let half = splat3(s, of.half_m);
        Self { center: splat3(s, of.center_m), half, radius: s.sqrt(dot(s, half, half)) }
    }
}

//! Adaptive search: the voxels above a threshold, with exactly the values of the dense computation,
//! at a small part of its cost.
//!
//! Branch and bound over an octree whose leaves are bricks. The cube with the greatest bound is
//! opened first; cubes that cannot reach the threshold any more are never opened. A child's bound
//! is summed group by group of sweeps, and abandoned as soon as the parent's bound for the
//! remaining groups cannot reach the threshold.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use rayon::prelude::*;

use super::bounds::{BoxLanes, RangeMaxima, SweepLanes, VoxelBox, bounds};
use super::brick_geometry::VOXELS;
use super::dense::Bricks;
use super::grid::BrickGrid;
use super::sweep_stack::SweepStack;
use crate::Volume;
use crate::simd::{Kernel, LANES, Lanes, on_widest};

/// Least value of the voxels wanted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Threshold {
    /// This value.
    Value(f32),
    /// A share of the greatest value (above 0, at most 1).
    ShareOfPeak(f32),
}

/// Work of a search, in (point, sweep) pairs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SearchWork {
    /// Voxel updates.
    pub updates: u64,
    /// Cube bounds.
    pub bounds: u64,
    /// Bricks summed.
    pub bricks: u64,
    /// Updates of a dense volume.
    pub dense_updates: u64,
}

impl SearchWork {
    /// Updates and bounds as a share of the dense updates.
    pub fn share(&self) -> f64 {
        (self.updates + self.bounds) as f64 / self.dense_updates.max(1) as f64
    }
}

/// The voxels at or above the threshold.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Index into a volume's values, and value, by rising index.
    pub voxels: Vec<(usize, f32)>,
    /// The threshold as a value.
    pub threshold: f32,
    /// Work of the search.
    pub work: SearchWork,
}

impl Found {
    /// The greatest value, the first of equals; `None` when nothing reaches the threshold.
    pub fn peak(&self) -> Option<(usize, f32)> {
        self.voxels.iter().copied().reduce(|best, v| if v.1 > best.1 { v } else { best })
    }

    /// As a volume, 0 below the threshold. `grid`: the one that was searched.
    ///
    /// # Panics
    /// `self.voxels.iter().any(|voxel| voxel.0 >= grid.voxels())`.
    pub fn volume(&self, grid: &BrickGrid) -> Volume {
        let mut volume = grid.volume();
        self.voxels.iter().for_each(|&(index, value)| volume.values[index] = value);
        volume
    }
}

/// Cubes opened in parallel; a constant, so that the work does not depend on the number of threads.
/// Choice: several for each core of a desktop, and few enough that the best cubes stay ahead.
const BATCH: usize = 64;

/// A cube of 2^level bricks, ordered by bound; of equals, lower levels and positions come first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Cube {
    bound: i64,
    at: Reverse<(u32, [usize; 3])>,
}

/// All voxels of a grid with at least the threshold's value: the same set and values as
/// [`super::dense_volume`].
pub fn search(stack: &SweepStack, grid: &BrickGrid, threshold: Threshold) -> Found {
    let maxima = RangeMaxima::of(stack);
    let searcher = Searcher { stack, grid, maxima: &maxima, bricks: Bricks::new(stack, grid) };
    let mut work = SearchWork { dense_updates: (grid.voxels() * stack.sweeps()) as u64, ..Default::default() };
    let mut voxels: Vec<(usize, f32)> = Vec::new();
    let (mut best, mut limit) = (f32::MIN, limit_of(threshold, 0.0));
    let mut heap = BinaryHeap::from_iter(searcher.root(limit, &mut work));
    while let Some(most) = heap.peek() {
        if maxima.value_of(stack, most.bound) < limit {
            break;
        }
        let batch: Vec<Cube> = std::iter::from_fn(|| heap.pop()).take(BATCH).collect();
        let opened: Vec<Opened> = batch.par_iter().map(|cube| searcher.open(cube, limit)).collect();
        for Opened { children, values, worked } in opened {
            heap.extend(children);
            work.updates += worked.updates;
            work.bounds += worked.bounds;
            work.bricks += worked.bricks;
            best = values.iter().fold(best, |best, v| best.max(v.1));
            voxels.extend(values);
        }
        limit = limit_of(threshold, best);
    }
    voxels.retain(|v| v.1 >= limit);
    voxels.sort_unstable_by_key(|v| v.0);
    Found { voxels, threshold: limit, work }
}

/// At least the smallest positive value: a voxel that no sweep sees is never wanted.
fn limit_of(threshold: Threshold, best: f32) -> f32 {
    let limit = match threshold {
        Threshold::Value(value) => value,
        Threshold::ShareOfPeak(share) => share * best,
    };
    limit.max(f32::MIN_POSITIVE)
}

struct Searcher<'a> {
    stack: &'a SweepStack,
    grid: &'a BrickGrid,
    maxima: &'a RangeMaxima,
    bricks: Bricks<'a>,
}

/// Result of opening a cube.
#[derive(Default)]
struct Opened {
    children: Vec<Cube>,
    values: Vec<(usize, f32)>,
    worked: SearchWork,
}

impl Searcher<'_> {
    /// The cube around the whole grid.
    fn root(&self, limit: f32, work: &mut SearchWork) -> Option<Cube> {
        let most = self.grid.bricks().into_iter().max().unwrap_or(1);
        let level = most.next_power_of_two().ilog2();
        self.bounded(level, [0; 3], limit, None, &mut work.bounds)
    }

    fn open(&self, cube: &Cube, limit: f32) -> Opened {
        let Reverse((level, at)) = cube.at;
        let mut opened = Opened::default();
        let rest = self.remaining_bounds(level, at, &mut opened.worked.bounds);
        if level == 0 {
            let (values, updates) = self.brick(at, limit, &rest);
            opened.worked.updates = updates;
            opened.worked.bricks = 1;
            let wanted = |values: [f32; VOXELS]| self.grid.voxels_of(at).map(move |(n, index)| (index, values[n]));
            opened.values.extend(values.into_iter().flat_map(wanted).filter(|v| v.1 >= limit));
            return opened;
        }
        for child in 0..8 {
            let at = [at[0] * 2 + child % 2, at[1] * 2 + child / 2 % 2, at[2] * 2 + child / 4];
            opened.children.extend(self.bounded(level - 1, at, limit, Some(&rest), &mut opened.worked.bounds));
        }
        opened
    }

    /// A brick's values, unless none can reach the limit, and the updates. Integers are summed
    /// group by group and abandoned as soon as the remaining bounds do not suffice for any voxel.
    fn brick(&self, at: [usize; 3], limit: f32, rest: &[i64]) -> (Option<[f32; VOXELS]>, u64) {
        if !self.stack.sums_whole_numbers() {
            let found = self.bricks.weighted(at);
            return (Some(found.values), found.updates);
        }
        let (mut sums, mut updates) = ([0i64; VOXELS], 0);
        for (group, rest) in rest[1..].iter().enumerate() {
            updates += self.bricks.add_group(at, group, &mut sums);
            let most = sums.iter().copied().fold(0, i64::max) + rest;
            if self.stack.value_of(most) < limit {
                return (None, updates);
            }
        }
        (Some(sums.map(|sum| self.stack.value_of(sum))), updates)
    }

    /// A cube with its bound, unless it lies beyond the grid or cannot reach the limit.
    fn bounded(&self, level: u32, at: [usize; 3], limit: f32, rest: Option<&[i64]>, bounds: &mut u64) -> Option<Cube> {
        let of = VoxelBox::of(self.grid, self.stack.origin_m(), level, at)?;
        let job = BoundBox { stack: self.stack, maxima: self.maxima, of, rest, limit };
        let (bound, groups) = on_widest(job);
        *bounds += (groups * LANES).min(self.stack.sweeps()) as u64;
        Some(Cube { bound: bound?, at: Reverse((level, at)) })
    }

    /// `[group]`: upper bound of what the sweeps from that group on can add within a cube.
    fn remaining_bounds(&self, level: u32, at: [usize; 3], bounds: &mut u64) -> Vec<i64> {
        let Some(of) = VoxelBox::of(self.grid, self.stack.origin_m(), level, at) else { return Vec::new() };
        *bounds += self.stack.sweeps() as u64;
        let mut rest = on_widest(BoundGroups { stack: self.stack, maxima: self.maxima, of });
        for n in (1..rest.len()).rev() {
            rest[n - 1] += rest[n];
        }
        rest.push(0);
        rest
    }
}

/// Sum of all sweeps' bounds for a box; abandoned when it cannot reach the limit.
#[derive(Clone)]
struct BoundBox<'a> {
    stack: &'a SweepStack,
    maxima: &'a RangeMaxima,
    of: VoxelBox,
    /// `[group]`: upper bound of what the groups from there on can add.
    rest: Option<&'a [i64]>,
    limit: f32,
}

impl Kernel for BoundBox<'_> {
    /// The bound, and the number of groups processed.
    type Out = (Option<i64>, usize);

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) -> (Option<i64>, usize) {
        let boxes = BoxLanes::one(s, &self.of);
        let mut bound = 0i64;
        for (index, group) in self.stack.groups.iter().enumerate() {
            let sweeps = SweepLanes::group(s, group, index, self.maxima);
            for of_sweep in s.store_int(bounds(s, self.stack, self.maxima, &sweeps, &boxes)) {
                bound += i64::from(of_sweep);
            }
            let last = index + 1 == self.stack.groups.len();
            let left = if last { Some(0) } else { self.rest.map(|rest| rest[index + 1]) };
            let Some(most) = left.map(|left| bound + left) else { continue };
            if self.maxima.value_of(self.stack, most) < self.limit {
                return (None, index + 1);
            }
        }
        (Some(bound), self.stack.groups.len())
    }
}

/// Each group's bound for a box.
#[derive(Clone)]
struct BoundGroups<'a> {
    stack: &'a SweepStack,
    maxima: &'a RangeMaxima,
    of: VoxelBox,
}

impl Kernel for BoundGroups<'_> {
    type Out = Vec<i64>;

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) -> Vec<i64> {
        let boxes = BoxLanes::one(s, &self.of);
        let mut sums = Vec::with_capacity(self.stack.groups.len() + 1);
        for (index, group) in self.stack.groups.iter().enumerate() {
            let sweeps = SweepLanes::group(s, group, index, self.maxima);
            let mut sum = 0i64;
            for of_sweep in s.store_int(bounds(s, self.stack, self.maxima, &sweeps, &boxes)) {
                sum += i64::from(of_sweep);
            }
            sums.push(sum);
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::Statistic;
    use crate::backprojection::dense_volume;
    use crate::geometry::Aabb;
    use crate::test_data::{Echo, on_one_thread, sweeps, winding};
    use crate::{Beam, Observation};

    const AT: DVec3 = DVec3::new(0.1, 0.0, -1.2);

    fn observations(snr: f64, seed: u64) -> Vec<Observation> {
        let echoes = [(Echo::Point(AT), snr), (Echo::Point(AT + DVec3::new(0.5, 0.2, -0.3)), snr * 0.8)];
        sweeps(2.0, |t| winding(2.0 * t) * 1.5, &echoes, seed).into_iter().step_by(33).collect()
    }

    /// The search finds the dense volume's voxels and values; returns the share of work.
    fn check(statistic: Statistic, beam: &Beam, region: &Aabb, voxel_m: f64, threshold: Threshold, snr: f64) -> f64 {
        let observations = observations(snr, 5);
        let grid = BrickGrid::covering(region, voxel_m);
        let (stack, _) = SweepStack::of(statistic, beam, &observations, grid.middle_m());
        let found = search(&stack, &grid, threshold);
        let dense = dense_volume(&stack, &grid).volume;
        let limit = match threshold {
            Threshold::Value(value) => value,
            Threshold::ShareOfPeak(share) => share * dense.peak().unwrap().1,
        };
        let all = dense.values.iter().copied().enumerate();
        let wanted: Vec<_> = all.filter(|v| v.1 >= limit && v.1 > 0.0).collect();
        assert_eq!(found.voxels, wanted, "{} {beam:?}", statistic.name());
        assert_eq!(found.peak(), dense.peak());
        assert_eq!(on_one_thread(|| search(&stack, &grid, threshold)), found);
        found.work.share()
    }

    #[test]
    fn voxels_and_values_equal_the_dense_ones() {
        let region = Aabb { min: DVec3::new(-1.1, -0.9, -2.3), max: DVec3::new(1.0, 1.0, -0.1) };
        let statistics = Statistic::ALL.into_iter().filter(|s| *s != Statistic::Subaperture);
        for (n, statistic) in statistics.enumerate() {
            for beam in [Beam::Uniform, Beam::Thesis] {
                let share = [0.5, 0.7, 0.9][n % 3];
                let work = check(statistic, &beam, &region, 0.04, Threshold::ShareOfPeak(share), 20.0);
                assert!(work < 0.9, "{} {beam:?} {work}", statistic.name());
            }
        }
    }

    #[test]
    fn beam_edges_and_the_sensor_inside_a_cell_lose_nothing() {
        // The sensor's path runs through the box; ranges begin at 0.2 m and end beyond it.
        let region = Aabb { min: DVec3::splat(-0.5), max: DVec3::new(0.5, 0.5, 0.4) };
        for statistic in [Statistic::Ls, Statistic::Log, Statistic::Thesis, Statistic::Glrt, Statistic::Coherent] {
            for beam in [Beam::Lensless, Beam::Thesis, Beam::Fresnel] {
                check(statistic, &beam, &region, 0.035, Threshold::ShareOfPeak(0.6), 0.0);
            }
        }
    }

    #[test]
    fn noise_alone_and_no_sweeps_are_handled() {
        let region = Aabb { min: DVec3::new(-0.8, -0.8, -2.0), max: DVec3::new(0.8, 0.8, -0.4) };
        check(Statistic::Log, &Beam::Lensless, &region, 0.05, Threshold::ShareOfPeak(0.95), 0.0);
        let grid = BrickGrid::covering(&region, 0.05);
        let (stack, _) = SweepStack::of(Statistic::Ls, &Beam::Lensless, &[], grid.middle_m());
        assert_eq!(search(&stack, &grid, Threshold::Value(1.0)).voxels, []);
    }

    #[test]
    fn a_strong_reflector_takes_a_small_part_of_the_work() {
        let region = Aabb { min: DVec3::new(-1.0, -1.0, -2.2), max: DVec3::new(1.0, 1.0, -0.2) };
        let work = check(Statistic::Ls, &Beam::Lensless, &region, 0.02, Threshold::ShareOfPeak(0.8), 30.0);
        assert!(work < 0.1, "{work}");
    }
}

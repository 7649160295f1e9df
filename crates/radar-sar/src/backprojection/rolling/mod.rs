//! Rolling image: a fine grid of the newest sweeps in a window, stored only where there is signal.
//!
//! Each new sweep is added and the oldest one subtracted, on the bricks of voxels that may reach
//! the threshold. Everything else is an octree of closed cubes and idle bricks, each with an upper
//! bound below the threshold. When a bound reaches the threshold, an idle brick is caught up, or a
//! cube is bounded afresh and, if it may still contain such a voxel, opened. Sums and bounds are
//! integers, so after any number of sweeps a sum equals a fresh one over the window, bit for bit.
//! The work per sweep is bounded, with the greatest bounds first; the remainder is carried over and
//! counted. The image is exact after every sweep: from some value on, its voxels are those of the
//! dense image of the window. That value is the threshold while nothing is deferred, else the
//! greatest deferred bound plus one step.
//!
//! Longer than other files: adding, removing and opening keep one invariant between bricks, cubes and
//! queue, which is private to this file.

mod bricks;
mod octree_bounds;
mod priority_buckets;

use std::ops::Range;
use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use super::bounds::RangeMaxima;
use super::brick_geometry::{BrickShape, VOXELS};
use super::grid::BrickGrid;
use super::power::{AddPower, power_shape};
use super::sweep_stack::{SweepRefusal, SweepStack, ls_step};
use crate::Statistic;
use crate::simd::{LANES, on_widest};
use crate::subaperture::MEAN_LOG_OF_NOISE;
use crate::{Beam, Observation, SweepGeometry};
use bricks::{Brick, RollBricks, Sums};
use octree_bounds::{Bounds, CLOSED, Octet, RollCubes};
use priority_buckets::{Candidate, PriorityBuckets, candidates_of};

/// Parameters of a rolling image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RollingSettings {
    /// `ls` or `log`.
    pub statistic: Statistic,
    /// Sweeps in the window.
    pub window: usize,
    /// Least number of sweeps before the image is evaluated.
    pub min_sweeps: usize,
    /// Voxels of at least this share of the peak are kept,
    pub share_of_peak: f64,
    /// and at least this many standard deviations above the mean sum of noise.
    pub min_sigma: f64,
    /// A brick becomes idle, and opened cubes are closed, below this share of the threshold.
    pub drop_share: f64,
    /// Limit per sweep of (voxel, sweep) pairs for catching up and opening; a (cube, sweep) pair
    /// counts as four.
    pub max_opening: u64,
    /// Greatest number of bricks in memory, rolling and idle: 300 bytes each.
    pub max_bricks: usize,
    /// Noise of a sample, rms, LSB.
    pub noise_rms_lsb: f64,
}

impl Default for RollingSettings {
    fn default() -> Self {
        Self {
            statistic: Statistic::Ls,
            window: 200,
            min_sweeps: 100,
            share_of_peak: 0.5,
            min_sigma: 7.0,
            drop_share: 0.85,
            max_opening: 1_200_000,
            max_bricks: 250_000,
            noise_rms_lsb: 20.0,
        }
    }
}

/// Why a rolling image cannot be created.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RollingError {
    /// A statistic that is not a sum of integers.
    #[error("statistic {} is not available for rolling images: use ls or log", .0.name())]
    Statistic(Statistic),
    /// An empty window, or one too large for the memory.
    #[error("a rolling window of {0} sweeps is not possible: use 1 to {MAX_WINDOW}")]
    Window(usize),
}

/// Greatest window. Choice: tables and range maxima take 40 kB per sweep.
const MAX_WINDOW: usize = 4096;

/// Work done so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RollingWork {
    /// Sweeps added.
    pub sweeps: u64,
    /// Sweeps refused: not finite, or of unknown geometry.
    pub refused: u64,
    /// (voxel, sweep) pairs added or subtracted.
    pub updates: u64,
    /// (cube, sweep) pairs bounded.
    pub bounds: u64,
    /// Bricks opened.
    pub opened: u64,
    /// Idle bricks caught up.
    pub caught_up: u64,
    /// Bricks dropped.
    pub dropped: u64,
    /// Deferred cubes and bricks, summed over sweeps.
    pub carried_over: u64,
}

/// Octets of cubes, and bricks, per parallel task. Choice: enough work for a task to pay; results
/// do not depend on it.
const OCTETS_PER_TASK: usize = 512;
const BRICKS_PER_TASK: usize = 512;
/// Least number of bricks that one task sums. Choice: enough work for a task to pay.
const MIN_BRICKS_PER_SUM_TASK: usize = 16;
/// Cost of one bound, in updates. Choice: a bound looks up range maxima and the beam's extreme,
/// some four times the work of a voxel; it only shares out the work of a sweep.
const UPDATES_PER_BOUND: u64 = 4;
/// One in so many idle bricks is checked with each sweep, whether it has been idle too long to be
/// caught up. Choice: a scan costs little, and a brick that is dropped late only takes memory.
const IDLE_SCAN_SWEEPS: usize = 32;

/// The image.
#[derive(Debug)]
pub struct RollingImage {
    settings: RollingSettings,
    grid: BrickGrid,
    shape: BrickShape,
    /// The window's sweeps: sweep n in slot n modulo the number of slots.
    stack: SweepStack,
    maxima: RangeMaxima,
    /// Sweeps removed last, for bricks that still include them: the n-th removed one in slot n
    /// modulo the number of slots.
    departed: SweepStack,
    /// All groups of the window with all their lanes.
    every_slot: Vec<(usize, u16)>,
    /// The first contains only the root; the order of the others is irrelevant.
    octets: Vec<Octet>,
    bounds: Vec<Bounds>,
    /// Unused octets.
    free_octets: Vec<u32>,
    /// The first `rolling` include all sweeps of the window, the others those up to when they
    /// became idle.
    bricks: Vec<Brick>,
    sums: Vec<Sums>,
    rolling: usize,
    /// The next idle brick to be checked.
    idle_cursor: usize,
    threshold: i64,
    /// No voxel with at least this sum is missing.
    exact_from: i64,
    queue: PriorityBuckets,
    work: RollingWork,
}

impl RollingImage {
    /// An empty window. `geometries`: those of all sweeps to come.
    ///
    /// # Errors
    /// A statistic that cannot roll, or a window outside 1 to 4096.
    pub fn new(
        settings: RollingSettings,
        beam: &Beam,
        geometries: &[Arc<SweepGeometry>],
        grid: &BrickGrid,
    ) -> Result<Self, RollingError> {
        if !matches!(settings.statistic, Statistic::Ls | Statistic::Log) {
            return Err(RollingError::Statistic(settings.statistic));
        }
        if !(1..=MAX_WINDOW).contains(&settings.window) {
            return Err(RollingError::Window(settings.window));
        }
        let step = ls_step(settings.noise_rms_lsb, 0.0);
        // One slot more than the window: the new sweep is added before the old one is removed.
        let slots = settings.window + 1;
        let stack_of = |slots| SweepStack::new(settings.statistic, beam, geometries, grid.middle_m(), slots, step);
        let mut stack = stack_of(slots);
        // Sums of rounded-up bounds then still fit 32 bits.
        stack.limit_steps((f64::from(i32::MAX / slots as i32) * 0.9999) as i32 - 4);
        let departed = stack_of(max_missed_sweeps(&settings) as usize);
        Ok(Self {
            settings,
            grid: *grid,
            shape: power_shape(grid.voxel_m),
            maxima: RangeMaxima::of(&stack),
            departed,
            every_slot: (0..stack.groups.len()).map(|group| (group, u16::MAX)).collect(),
            stack,
            octets: Vec::new(),
            bounds: Vec::new(),
            free_octets: Vec::new(),
            bricks: Vec::new(),
            sums: Vec::new(),
            rolling: 0,
            idle_cursor: 0,
            threshold: 0,
            exact_from: i64::MAX,
            queue: PriorityBuckets::new(),
            work: RollingWork::default(),
        })
    }

    /// Adds a sweep, and removes the oldest one when the window is full.
    ///
    /// # Errors
    /// An unusable sweep; it is counted and changes nothing.
    pub fn push(&mut self, observation: &Observation) -> Result<(), SweepRefusal> {
        let number = self.work.sweeps + 1;
        let new = slot(number, self.settings.window + 1);
        if let Err(refusal) = self.stack.fill(new, observation) {
            self.work.refused += 1;
            return Err(refusal);
        }
        self.maxima.fill(&self.stack, new);
        self.work.sweeps = number;
        let old =
            (self.departed_count(number) > 0).then(|| slot(self.departed_count(number), self.settings.window + 1));
        let greatest = self.roll(new, old);
        self.threshold = self.threshold_for(greatest);
        self.move_low_bricks_to_idle();
        let promising = self.roll_cubes(new, old);
        if let Some(old) = old {
            let in_past = slot(self.departed_count(number), max_missed_sweeps(&self.settings) as usize);
            self.departed.copy_slot(in_past, &self.stack, old);
            self.stack.empty(old);
        }
        self.drop_stale_idle_bricks();
        if self.in_window() >= self.settings.min_sweeps.min(self.settings.window) {
            self.refine_candidates(promising);
        }
        Ok(())
    }

    /// Number of sweeps removed by the time sweep `number` was added.
    fn departed_count(&self, number: u64) -> u64 {
        number.saturating_sub(self.settings.window as u64)
    }

    fn in_window(&self) -> usize {
        (self.work.sweeps - self.departed_count(self.work.sweeps)) as usize
    }

    /// Adds one sweep to every rolling brick and subtracts another; returns the greatest sum.
    fn roll(&mut self, new: usize, old: Option<usize>) -> i32 {
        let (stack, shape, number) = (&self.stack, self.shape, self.work.sweeps);
        let bricks = self.bricks[..self.rolling].par_chunks_mut(BRICKS_PER_TASK);
        let parts = bricks.zip(self.sums[..self.rolling].par_chunks_mut(BRICKS_PER_TASK));
        let each = parts.map(|(bricks, sums)| on_widest(RollBricks { stack, shape, bricks, sums, new, old, number }));
        let (updates, greatest) = each.reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1.max(b.1)));
        self.work.updates += updates;
        greatest
    }

    /// The share of the peak, at least the level that noise may reach.
    fn threshold_for(&self, greatest: i32) -> i64 {
        let sweeps = self.in_window() as f64;
        // Mean and standard deviation of one sweep's term under noise: |z|²/σ² is exponential.
        let (mean, spread) = match self.settings.statistic {
            Statistic::Log => (MEAN_LOG_OF_NOISE, 0.5),
            _ => (self.settings.noise_rms_lsb.powi(2), self.settings.noise_rms_lsb.powi(2)),
        };
        let floor = (mean * sweeps + self.settings.min_sigma * spread * sweeps.sqrt()) / self.stack.step();
        let share = (f64::from(greatest) * self.settings.share_of_peak).ceil();
        floor.max(share).max(1.0) as i64
    }

    /// Sums below this need no rolling.
    fn drop_below(&self) -> i64 {
        (self.threshold as f64 * self.settings.drop_share) as i64
    }

    /// Makes rolling bricks idle that are too low now.
    fn move_low_bricks_to_idle(&mut self) {
        let limit = self.drop_below();
        for brick in (0..self.rolling).rev() {
            if i64::from(self.bricks[brick].greatest) < limit {
                self.rolling -= 1;
                self.swap_bricks(brick, self.rolling);
                self.watch_idle(self.rolling);
            }
        }
    }

    fn watch_idle(&mut self, brick: usize) {
        let Brick { cube, greatest, .. } = self.bricks[brick];
        self.bounds[cube as usize / 8].watch(cube as usize % 8, Some(greatest));
    }

    fn swap_bricks(&mut self, a: usize, b: usize) {
        self.bricks.swap(a, b);
        self.sums.swap(a, b);
        for at in [a, b] {
            let cube = self.bricks[at].cube as usize;
            self.octets[cube / 8].children[cube % 8] = at as u32;
        }
    }

    /// Checks some idle bricks in turn and drops those that would cost more to catch up than to sum
    /// afresh. Their bounds remain.
    fn drop_stale_idle_bricks(&mut self) {
        for _ in 0..(self.bricks.len() - self.rolling).div_ceil(IDLE_SCAN_SWEEPS) {
            let at = self.next_idle();
            if self.work.sweeps - self.bricks[at].sweep > max_missed_sweeps(&self.settings) {
                self.drop_brick(at);
            } else {
                self.idle_cursor += 1;
            }
        }
    }

    /// The idle brick to be checked next.
    fn next_idle(&mut self) -> usize {
        if !(self.rolling..self.bricks.len()).contains(&self.idle_cursor) {
            self.idle_cursor = self.rolling;
        }
        self.idle_cursor
    }

    /// Drops an idle brick, but not its bound.
    fn drop_brick(&mut self, brick: usize) {
        let cube = self.bricks[brick].cube as usize;
        self.swap_bricks(brick, self.bricks.len() - 1);
        self.octets[cube / 8].children[cube % 8] = CLOSED;
        self.bricks.pop();
        self.sums.pop();
        self.work.dropped += 1;
    }

    /// Adds one sweep's bounds to every cube and subtracts another's, and closes cubes far below
    /// the threshold; returns those that may contain a voxel at the threshold.
    fn roll_cubes(&mut self, new: usize, old: Option<usize>) -> Vec<Candidate> {
        let (stack, maxima, threshold, limit) = (&self.stack, &self.maxima, self.threshold, self.drop_below());
        let octets = &self.octets;
        let roll = |(part, of_eights): (usize, &mut [Bounds])| {
            let pairs = on_widest(RollCubes { stack, maxima, octets: &mut *of_eights, new: &[new], old });
            let (mut bare, mut promising) = (Vec::new(), Vec::new());
            for (e, of_eight) in of_eights.iter().enumerate() {
                let (e, greatest) = (part * OCTETS_PER_TASK + e, i64::from(of_eight.greatest));
                if greatest >= threshold {
                    promising.extend(candidates_of(e as u32, of_eight, threshold));
                } else if greatest < limit && octets[e].has_no_children() && octets[e].parent != CLOSED {
                    bare.push(e);
                }
            }
            (pairs, bare, promising)
        };
        let parts: Vec<_> = self.bounds.par_chunks_mut(OCTETS_PER_TASK).enumerate().map(roll).collect();
        let mut promising = Vec::new();
        for (pairs, bare, of_part) in parts {
            self.work.bounds += pairs;
            bare.into_iter().for_each(|eight| self.close(eight));
            promising.extend(of_part);
        }
        promising
    }

    /// Replaces eight cubes by the larger one that they fill.
    fn close(&mut self, eight: usize) {
        let parent = std::mem::replace(&mut self.octets[eight].parent, CLOSED) as usize;
        self.bounds[eight].retire();
        self.free_octets.push(eight as u32);
        self.octets[parent / 8].children[parent % 8] = CLOSED;
        self.bounds[parent / 8].watch(parent % 8, None);
    }

    /// Examines candidates for voxels at the threshold, greatest bounds first, within the work
    /// limit.
    fn refine_candidates(&mut self, promising: Vec<Candidate>) {
        // Taken out while the rest is modified.
        let mut queue = std::mem::replace(&mut self.queue, PriorityBuckets::new());
        queue.clear(self.threshold);
        promising.into_iter().for_each(|promise| queue.put(promise));
        if self.octets.is_empty() {
            self.insert_root();
            candidates_of(0, &self.bounds[0], self.threshold).for_each(|root| queue.put(root));
        }
        let mut left = self.settings.max_opening;
        let a_brick = (self.in_window() * VOXELS) as u64;
        while left > 0 && self.rolling < self.settings.max_bricks {
            let batch = queue.pop_best(self.threshold, (left / a_brick) as usize + 1);
            if batch.is_empty() {
                break;
            }
            let (bricks, cubes): (Vec<_>, Vec<_>) =
                batch.into_iter().map(|promise| promise.cube()).partition(|cube| self.octets[cube.0].level() == 0);
            let sums: Vec<_> =
                bricks.par_iter().with_min_len(MIN_BRICKS_PER_SUM_TASK).map(|&cube| self.sums_of(cube)).collect();
            let octets: Vec<_> =
                cubes.par_chunks(cubes_per_task(cubes.len())).map(|cubes| self.open_cubes(cubes)).collect();
            for (cube, (sums, updates)) in bricks.into_iter().zip(sums) {
                left = left.saturating_sub(updates);
                self.work.updates += updates;
                self.store_sums(cube, sums);
            }
            for (octets, bounds, pairs) in octets {
                left = left.saturating_sub(pairs * UPDATES_PER_BOUND);
                self.work.bounds += pairs;
                let both = octets.into_iter().zip(bounds);
                both.for_each(|(eight, bounds)| self.insert_octet(eight, bounds, &mut queue));
            }
        }
        let (left, greatest) = queue.remaining(self.threshold);
        self.exact_from = greatest.map_or(self.threshold, |greatest| greatest + 1);
        self.work.carried_over += left as u64;
        self.queue = queue;
    }

    /// A brick's sums over the window, updated from its old sums if it is idle, and the updates
    /// that took.
    fn sums_of(&self, (e, n): (usize, usize)) -> (Sums, u64) {
        let sum = |stack, center, slots: &[_]| AddPower { stack, shape: self.shape, center, slots }.sums();
        let at_rest = (self.octets[e].children[n] != CLOSED).then(|| self.octets[e].children[n] as usize);
        let now = self.work.sweeps;
        match at_rest.map(|brick| (&self.bricks[brick], &self.sums[brick])) {
            Some((&Brick { center, sweep, .. }, sums)) if now - sweep <= max_missed_sweeps(&self.settings) => {
                let came = lanes_of(sweep + 1..now + 1, self.settings.window + 1);
                let went = lanes_of(
                    self.departed_count(sweep) + 1..self.departed_count(now) + 1,
                    max_missed_sweeps(&self.settings) as usize,
                );
                let (came, went) = (sum(&self.stack, center, &came), sum(&self.departed, center, &went));
                (sums.caught_up(&came.sums, &went.sums), came.updates + went.updates)
            }
            _ => {
                let place = self.octets[e].cube_index(n).brick();
                let center = self.grid.brick_center(place, self.stack.origin_m());
                let all = sum(&self.stack, center, &self.every_slot);
                (Sums::of(&all.sums), all.updates)
            }
        }
    }

    /// The eight cubes within each of some cubes, their bounds over the window, and the (cube,
    /// sweep) pairs that took.
    fn open_cubes(&self, cubes: &[(usize, usize)]) -> (Vec<Octet>, Vec<Bounds>, u64) {
        let open = |&(e, n): &(usize, usize)| {
            let place = self.octets[e].cube_index(n);
            Octet::new(place.level - 1, place.at, (e * 8 + n) as u32)
        };
        let octets: Vec<Octet> = cubes.iter().map(open).collect();
        let (bounds, pairs) = self.bounded(&octets);
        (octets, bounds, pairs)
    }

    /// Bounds of cubes, summed afresh over the window.
    fn bounded(&self, octets: &[Octet]) -> (Vec<Bounds>, u64) {
        let numbers = self.departed_count(self.work.sweeps) + 1..self.work.sweeps + 1;
        let all: Vec<usize> = numbers.map(|number| slot(number, self.settings.window + 1)).collect();
        let mut bounds: Vec<_> = octets.iter().map(|eight| Bounds::new(eight, &self.grid, &self.stack)).collect();
        let (stack, maxima) = (&self.stack, &self.maxima);
        let pairs = on_widest(RollCubes { stack, maxima, octets: &mut bounds, new: &all, old: None });
        (bounds, pairs)
    }

    fn insert_octet(&mut self, eight: Octet, bounds: Bounds, queue: &mut PriorityBuckets) {
        let at = self.free_octets.pop().unwrap_or(self.octets.len() as u32);
        let parent = eight.parent as usize;
        self.octets[parent / 8].children[parent % 8] = at;
        self.bounds[parent / 8].unwatch(parent % 8);
        candidates_of(at, &bounds, self.threshold).for_each(|promise| queue.put(promise));
        if at as usize == self.octets.len() {
            self.octets.push(eight);
            self.bounds.push(bounds);
        } else {
            (self.octets[at as usize], self.bounds[at as usize]) = (eight, bounds);
        }
    }

    fn store_sums(&mut self, (e, n): (usize, usize), sums: Sums) {
        let at = match self.octets[e].children[n] {
            CLOSED => self.new_brick((e, n)),
            at => {
                self.work.caught_up += 1;
                at as usize
            }
        };
        let greatest = sums.greatest(self.bricks[at].within);
        self.sums[at] = sums;
        (self.bricks[at].sweep, self.bricks[at].greatest) = (self.work.sweeps, greatest);
        self.threshold = self.threshold.max(self.threshold_for(greatest));
        if i64::from(greatest) < self.drop_below() {
            self.watch_idle(at);
            return;
        }
        self.bounds[e].unwatch(n);
        self.swap_bricks(at, self.rolling);
        self.rolling += 1;
    }

    /// Allocates an idle brick.
    fn new_brick(&mut self, (e, n): (usize, usize)) -> usize {
        if self.bricks.len() >= self.settings.max_bricks && self.bricks.len() > self.rolling {
            let oldest = self.next_idle();
            self.drop_brick(oldest);
        }
        let place = self.octets[e].cube_index(n).brick();
        let within = self.grid.voxels_of(place).fold(0u64, |bits, (n, _)| bits | 1 << n);
        let center = self.grid.brick_center(place, self.stack.origin_m());
        self.bricks.push(Brick { center, cube: (e * 8 + n) as u32, within, sweep: self.work.sweeps, greatest: 0 });
        self.sums.push(Sums::of(&[0; VOXELS]));
        self.work.opened += 1;
        let at = self.bricks.len() - 1;
        self.octets[e].children[n] = at as u32;
        at
    }

    fn insert_root(&mut self) {
        let most = self.grid.bricks().into_iter().max().unwrap_or(1);
        let root = Octet::new(most.next_power_of_two().ilog2(), [0; 3], CLOSED);
        let (mut bounds, _) = self.bounded(std::slice::from_ref(&root));
        bounds[0].watch_first_only();
        self.octets.push(root);
        self.bounds.append(&mut bounds);
    }

    /// The voxels of rolling bricks: index into a volume's values, and sum.
    fn rolling_voxels(&self, least: i64) -> impl Iterator<Item = (usize, i64)> {
        let rolling = self.bricks[..self.rolling].iter().zip(&self.sums);
        let high = rolling.filter(move |(brick, _)| i64::from(brick.greatest) >= least);
        high.flat_map(move |(brick, sums)| {
            let (e, n) = (brick.cube as usize / 8, brick.cube as usize % 8);
            let of_brick = self.grid.voxels_of(self.octets[e].cube_index(n).brick());
            let with_sum = of_brick.map(|(n, index)| (index, i64::from(sums.0[n / LANES][n % LANES])));
            with_sum.filter(move |v| v.1 >= least)
        })
    }

    /// The voxels that are [exact](Self::exact_from): index into a volume's values, and value, by
    /// rising index.
    pub fn voxels(&self) -> Vec<(usize, f32)> {
        let above = self.rolling_voxels(self.exact_from).map(|(index, sum)| (index, self.stack.value_of(sum)));
        let mut voxels: Vec<(usize, f32)> = above.collect();
        voxels.sort_unstable_by_key(|v| v.0);
        voxels
    }

    /// Centre and value of the greatest voxel, the first of equals; `None` when nothing known
    /// reaches the threshold. While work is deferred, a greater one may not be found yet: this is
    /// the case when the value is below [`exact_from`](Self::exact_from).
    pub fn peak(&self) -> Option<(DVec3, f32)> {
        let greatest = self.bricks[..self.rolling].iter().map(|brick| i64::from(brick.greatest)).max()?;
        let (index, sum) = self.rolling_voxels(greatest.max(self.threshold)).min()?;
        let [nx, ny, _] = self.grid.size;
        let voxel = [index % nx, index / nx % ny, index / (nx * ny)].map(|n| n as f64 + 0.5);
        Some((self.grid.origin_m + DVec3::from_array(voxel) * self.grid.voxel_m, self.stack.value_of(sum)))
    }

    /// Least value of the statistic at which voxels are to be kept.
    pub fn threshold(&self) -> f32 {
        self.stack.value_of(self.threshold)
    }

    /// Value from which on the voxels are those of the dense image, without exception: the
    /// threshold, or more while work is deferred. Infinite before the least number of sweeps.
    pub fn exact_from(&self) -> f32 {
        if self.exact_from == i64::MAX { f32::INFINITY } else { self.stack.value_of(self.exact_from) }
    }

    /// Whether no work is deferred.
    pub fn is_complete(&self) -> bool {
        self.exact_from == self.threshold
    }

    /// Work done so far.
    pub fn work(&self) -> RollingWork {
        self.work
    }

    /// Number of cubes and bricks.
    pub fn kept(&self) -> RollingSize {
        RollingSize {
            cubes: (self.octets.len() - self.free_octets.len()) * 8,
            rolling_bricks: self.rolling,
            idle_bricks: self.bricks.len() - self.rolling,
        }
    }

    /// The window's sweeps, for a dense image of the same.
    pub fn stack(&self) -> &SweepStack {
        &self.stack
    }
}

/// Size of a rolling image.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RollingSize {
    /// Cubes of the octree.
    pub cubes: usize,
    /// Bricks updated with every sweep.
    pub rolling_bricks: usize,
    /// Idle bricks, caught up when they may reach the threshold again.
    pub idle_bricks: usize,
}

/// Greatest number of sweeps that a brick may have missed to be caught up; beyond it, catching up
/// costs as much as the whole window.
fn max_missed_sweeps(settings: &RollingSettings) -> u64 {
    (settings.window as u64 / 2).max(1)
}

/// Cubes per parallel task: more per task fetch each sweep's range maxima less often, fewer keep
/// all threads busy.
fn cubes_per_task(cubes: usize) -> usize {
    (cubes / 16).clamp(8, 64)
}

/// Slot of a sweep, by its number.
fn slot(number: u64, slots: usize) -> usize {
    (number % slots as u64) as usize
}

/// Slots of the sweeps with these numbers, as groups with masks of their lanes.
fn lanes_of(numbers: Range<u64>, slots: usize) -> Vec<(usize, u16)> {
    let mut groups: Vec<(usize, u16)> = Vec::new();
    for slot in numbers.map(|number| slot(number, slots)) {
        match groups.last_mut() {
            Some((group, lanes)) if *group == slot / LANES => *lanes |= 1 << (slot % LANES),
            _ => groups.push((slot / LANES, 1 << (slot % LANES))),
        }
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::super::brick_geometry::EDGE;
    use super::octree_bounds::CubeIndex;
    use super::*;
    use crate::Volume;
    use crate::backprojection::dense_volume;
    use crate::geometry::Aabb;
    use crate::test_data::{Echo, on_one_thread, sweeps, winding};

    const AT: DVec3 = DVec3::new(0.1, 0.0, -1.2);

    fn settings(statistic: Statistic) -> RollingSettings {
        RollingSettings { statistic, window: 40, min_sweeps: 20, ..Default::default() }
    }

    /// A moving sensor in front of a reflector that jumps halfway, with bursts of 10⁴ times the
    /// amplitude.
    fn observations(seed: u64) -> Vec<Observation> {
        let path = |t: f64| winding(3.0 * t) * 1.5;
        let mut all = sweeps(3.0, path, &[(Echo::Point(AT), 12.0)], seed);
        let beside = sweeps(3.0, path, &[(Echo::Point(AT + DVec3::new(-0.4, 0.3, 0.2)), 12.0)], seed);
        all.splice(1500.., beside.into_iter().skip(1500));
        let mut some: Vec<_> = all.into_iter().step_by(20).collect();
        for n in [31, 77, 78, 110] {
            some[n].samples.iter_mut().for_each(|x| *x *= 1e4);
        }
        some
    }

    fn image(observations: &[Observation], settings: RollingSettings) -> RollingImage {
        let grid =
            BrickGrid::covering(&Aabb { min: DVec3::new(-0.9, -0.7, -2.0), max: DVec3::new(0.8, 0.8, -0.3) }, 0.03);
        RollingImage::new(settings, &Beam::Lensless, &[Arc::clone(&observations[0].geometry)], &grid).unwrap()
    }

    /// The greatest value of a cube's voxels.
    fn greatest_in(dense: &Volume, grid: &BrickGrid, place: CubeIndex) -> f32 {
        let edge = EDGE << place.level;
        let range = |axis: usize| {
            let first = place.at[axis] as usize * edge;
            first..(first + edge).min(grid.size[axis])
        };
        let mut most = 0.0f32;
        for z in range(2) {
            for y in range(1) {
                for x in range(0) {
                    most = most.max(dense.values[(z * grid.size[1] + y) * grid.size[0] + x]);
                }
            }
        }
        most
    }

    #[test]
    fn rolling_image_equals_the_dense_image_bit_for_bit() {
        for statistic in [Statistic::Ls, Statistic::Log] {
            let observations = observations(1);
            let mut image = image(&observations, settings(statistic));
            for (n, observation) in observations.iter().enumerate() {
                image.push(observation).unwrap();
                if n < 20 || n % 13 != 0 {
                    assert!(n >= 19 || !image.is_complete());
                    continue;
                }
                assert!(image.is_complete());
                let dense = dense_volume(image.stack(), &image.grid).volume;
                let all = dense.values.iter().copied().enumerate();
                let wanted: Vec<_> = all.filter(|v| v.1 >= image.threshold()).collect();
                assert_eq!(image.voxels(), wanted, "{n}");
                // No bound is below any voxel of its cube.
                for (eight, bounds) in image.octets.iter().zip(&image.bounds) {
                    for n in (0..8).filter(|&n| bounds.is_watched(n)) {
                        let most = greatest_in(&dense, &image.grid, eight.cube_index(n));
                        let bound = image.stack.value_of(i64::from(bounds.bound(n)));
                        assert!(bound >= most, "{:?}: {bound} {most}", eight.cube_index(n));
                    }
                }
            }
            let work = image.work();
            assert!(work.caught_up > 0, "{work:?}");
        }
    }

    #[test]
    fn no_voxel_above_exact_from_is_missing_with_little_opening() {
        let observations = observations(6);
        let mut image = image(&observations, RollingSettings { max_opening: 20_000, ..settings(Statistic::Ls) });
        let (mut lagged, mut shown) = (0, 0);
        for (n, observation) in observations.iter().enumerate() {
            image.push(observation).unwrap();
            assert_eq!(image.exact_from().is_finite(), n >= 19);
            let dense = dense_volume(image.stack(), &image.grid).volume;
            let all = dense.values.iter().copied().enumerate();
            let wanted: Vec<_> = all.filter(|v| v.1 >= image.exact_from()).collect();
            assert_eq!(image.voxels(), wanted, "{n}");
            lagged += usize::from(n >= 19 && image.exact_from() > image.threshold());
            shown += usize::from(!wanted.is_empty());
        }
        assert!(lagged > 20 && shown > 20, "{lagged} {shown}");
    }

    #[test]
    fn bounded_opening_catches_up_with_unbounded_opening() {
        let observations = observations(2);
        let mut free = image(&observations, settings(Statistic::Ls));
        let mut tight = image(&observations, RollingSettings { max_opening: 40_000, ..settings(Statistic::Ls) });
        for observation in &observations {
            free.push(observation).unwrap();
            tight.push(observation).unwrap();
        }
        assert!(tight.work().carried_over > 2 * free.work().carried_over, "{:?} {:?}", tight.work(), free.work());
        assert!(free.is_complete());
        let wanted: Vec<_> = free.voxels().into_iter().filter(|v| v.1 >= tight.exact_from()).collect();
        assert_eq!(tight.voxels(), wanted);
        assert!(!wanted.is_empty());
    }

    #[test]
    fn threads_do_not_matter_and_noise_opens_nothing() {
        let run = || {
            let observations = observations(3);
            let mut image = image(&observations, settings(Statistic::Log));
            observations.iter().for_each(|o| image.push(o).unwrap());
            (image.voxels(), image.work(), image.kept())
        };
        assert_eq!(on_one_thread(run), run());
        let noise: Vec<_> = sweeps(3.0, |t| winding(3.0 * t), &[], 4).into_iter().step_by(20).collect();
        let mut image = image(&noise, settings(Statistic::Ls));
        noise.iter().for_each(|o| image.push(o).unwrap());
        assert_eq!(image.voxels(), []);
        let bricks = image.grid.bricks().into_iter().product::<usize>();
        let kept = image.kept();
        assert!(kept.rolling_bricks + kept.idle_bricks < bricks / 4, "{kept:?} of {bricks}");
    }

    #[test]
    fn bad_sweeps_and_settings_are_refused() {
        let mut observations = observations(5);
        let mut image = image(&observations, settings(Statistic::Ls));
        observations[0].samples[3].im = f32::INFINITY;
        assert_eq!(image.push(&observations[0]), Err(SweepRefusal::NotFinite));
        assert_eq!((image.work().refused, image.work().sweeps), (1, 0));
        let geometry = [Arc::clone(&observations[0].geometry)];
        let new = |settings| RollingImage::new(settings, &Beam::Uniform, &geometry, &image.grid).map(|_| ());
        let coherent = RollingSettings { statistic: Statistic::Coherent, ..Default::default() };
        assert_eq!(new(coherent), Err(RollingError::Statistic(Statistic::Coherent)));
        assert_eq!(new(RollingSettings { window: 0, ..Default::default() }), Err(RollingError::Window(0)));
    }
}

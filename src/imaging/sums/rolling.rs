//! A rolling image: the newest sweeps of a window over a fine grid, kept only where something is.
//!
//! Each new sweep is added and the one that leaves is taken out, on what is alive: an octree in which every cube carries the
//! sum of its sweeps' bounds, and bricks of voxels where that sum reaches the threshold. All are whole numbers, so after any
//! number of sweeps they equal a fresh sum over the window, bit for bit. A cube that may reach the threshold is opened, one
//! that cannot any more is dropped. Opening is bounded for each sweep; what is not opened yet is carried over and counted.
//! While nothing waits, the voxels at or above the threshold are exactly those of the dense image of the window.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use super::alive::{Brick, CLOSED, Eight, Place, RollBricks, RollCubes, SumBounds, Sums};
use super::bounds::{RangeMaxima, VoxelBox};
use super::dispatch::on_widest;
use super::grid::BrickGrid;
use super::lanes::LANES;
use super::power::{AddPower, power_shape};
use super::sight::{BrickShape, EDGE};
use super::stack::{SweepRefusal, SweepStack, ls_step};
use crate::imaging::Statistic;
use crate::imaging::blocks::MEAN_LOG_OF_NOISE;
use crate::radar::{Beam, Observation, SweepGeometry};

/// How an image rolls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RollingSettings {
    /// `ls` or `log`.
    pub statistic: Statistic,
    /// Sweeps in the window.
    pub window: usize,
    /// Sweeps that it takes before anything is looked at.
    pub min_sweeps: usize,
    /// Voxels from this share of the greatest value on are kept,
    pub share_of_peak: f64,
    /// and at least this many standard deviations above what noise sums to.
    pub min_sigma: f64,
    /// A cube is dropped when its bound falls below this share of the threshold.
    pub drop_share: f64,
    /// (place, sweep) pairs at most for opening cubes, each sweep.
    pub max_opening: u64,
    /// Bricks alive at most.
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
            max_opening: 6_000_000,
            max_bricks: 200_000,
            noise_rms_lsb: 20.0,
        }
    }
}

/// What a rolling image cannot be made of.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RollingError {
    /// A statistic whose sum is no sum of whole numbers.
    #[error("{} cannot roll: use ls or log", .0.name())]
    Statistic(Statistic),
    /// An empty window, or one that no memory holds.
    #[error("a window of {0} sweeps cannot roll: use 1 to {MAX_WINDOW}")]
    Window(usize),
}

/// Sweeps in a window at most: their tables and range maxima take 40 kB each.
const MAX_WINDOW: usize = 4096;

/// What was done so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RollingWork {
    /// Sweeps taken in.
    pub sweeps: u64,
    /// Sweeps refused: numbers that are none, unknown geometry.
    pub refused: u64,
    /// (voxel, sweep) pairs added or taken out.
    pub updates: u64,
    /// (cube, sweep) pairs bounded.
    pub bounds: u64,
    /// Bricks opened.
    pub opened: u64,
    /// Bricks dropped again.
    pub dropped: u64,
    /// Cubes that waited to be opened, summed over sweeps.
    pub carried_over: u64,
}

/// Eights of cubes, or bricks, that one thread works on at a time.
const EIGHTS: usize = 512;
const BRICKS: usize = 1024;
/// Cubes opened side by side; a number, so that nothing depends on the number of threads.
const BATCH: usize = 256;

/// The image.
#[derive(Debug)]
pub struct RollingImage {
    settings: RollingSettings,
    grid: BrickGrid,
    shape: BrickShape,
    stack: SweepStack,
    maxima: RangeMaxima,
    /// Slots in use, oldest first, and free ones.
    slots: VecDeque<usize>,
    free: Vec<usize>,
    /// All groups with all their lanes.
    every_slot: Vec<(usize, u16)>,
    /// The root alone in the first, then in no order that matters.
    eights: Vec<Eight>,
    /// Eights that wait to be used again.
    free_eights: Vec<u32>,
    bricks: Vec<Brick>,
    sums: Vec<Sums>,
    threshold: i64,
    waiting: usize,
    work: RollingWork,
}

impl RollingImage {
    /// Nothing in the window yet. `geometries`: of all sweeps that will come.
    ///
    /// # Errors
    /// A statistic that cannot roll, a window that is none.
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
        // One slot more than the window: the new sweep comes before the old one goes.
        let slots = settings.window + 1;
        let mut stack = SweepStack::new(settings.statistic, beam, geometries, grid.middle_m(), slots, step);
        stack.hold_to(i32::MAX / slots as i32 - 1);
        Ok(Self {
            settings,
            grid: *grid,
            shape: power_shape(grid.voxel_m),
            maxima: RangeMaxima::of(&stack),
            every_slot: (0..stack.groups.len()).map(|group| (group, u16::MAX)).collect(),
            stack,
            slots: VecDeque::new(),
            free: (0..slots).rev().collect(),
            eights: Vec::new(),
            free_eights: Vec::new(),
            bricks: Vec::new(),
            sums: Vec::new(),
            threshold: 0,
            waiting: 0,
            work: RollingWork::default(),
        })
    }

    /// Takes a sweep in, and the oldest one out when the window is full.
    ///
    /// # Errors
    /// A sweep that cannot be used; it is counted and changes nothing.
    pub fn push(&mut self, observation: &Observation) -> Result<(), SweepRefusal> {
        let Some(&new) = self.free.last() else { return Ok(()) };
        if let Err(refusal) = self.stack.fill(new, observation) {
            self.work.refused += 1;
            return Err(refusal);
        }
        self.free.pop();
        self.maxima.fill(&self.stack, new);
        self.slots.push_back(new);
        self.work.sweeps += 1;
        let old = if self.slots.len() > self.settings.window { self.slots.pop_front() } else { None };
        let greatest = self.roll_bricks(new, old);
        self.threshold = self.threshold_for(greatest);
        let (low, promising) = self.roll_cubes(new, old);
        if let Some(old) = old {
            self.stack.empty(old);
            self.free.push(old);
        }
        if self.slots.len() >= self.settings.min_sweeps.min(self.settings.window) {
            low.into_iter().for_each(|cube| self.close(cube));
            let alive = |cube: u32| self.eights[cube as usize / 8].alive >> (cube % 8) & 1 == 1;
            self.open(promising.into_iter().filter(|promise| alive(promise.2)).collect());
        }
        Ok(())
    }

    /// Adds one sweep to every brick and takes another out; returns the greatest sum.
    fn roll_bricks(&mut self, new: usize, old: Option<usize>) -> i32 {
        let (stack, shape) = (&self.stack, self.shape);
        let parts = self.bricks.par_chunks(BRICKS).zip(self.sums.par_chunks_mut(BRICKS));
        let each = parts.map(|(bricks, sums)| on_widest(RollBricks { stack, shape, bricks, sums, new, old }));
        let (updates, greatest) = each.reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1.max(b.1)));
        self.work.updates += updates;
        greatest
    }

    /// Adds one sweep's bounds to every cube and takes another's out; returns the open cubes that are too low now and the
    /// closed ones that may hold a voxel at the threshold.
    fn roll_cubes(&mut self, new: usize, old: Option<usize>) -> (Vec<u32>, Vec<Promise>) {
        let (stack, maxima, threshold) = (&self.stack, &self.maxima, self.threshold);
        let limit = (threshold as f64 * self.settings.drop_share) as i64;
        let roll = |(part, eights): (usize, &mut [Eight])| {
            let cubes = on_widest(RollCubes { stack, maxima, eights: &mut *eights, new, old });
            let (mut low, mut promising) = (Vec::new(), Vec::new());
            for (e, eight) in eights.iter().enumerate().filter(|(_, eight)| eight.alive != 0) {
                for n in (0..8).filter(|n| eight.alive >> n & 1 == 1) {
                    let cube = ((part * EIGHTS + e) * 8 + n) as u32;
                    if eight.opened[n] == CLOSED && eight.bound[n] >= threshold {
                        promising.push((eight.bound[n], Reverse(eight.place(n)), cube));
                    } else if eight.opened[n] != CLOSED && eight.bound[n] < limit {
                        low.push(cube);
                    }
                }
            }
            (cubes, low, promising)
        };
        let parts: Vec<_> = self.eights.par_chunks_mut(EIGHTS).enumerate().map(roll).collect();
        let (mut low, mut promising) = (Vec::new(), Vec::new());
        for (cubes, of_part, promising_of_part) in parts {
            self.work.bounds += cubes * (1 + u64::from(old.is_some()));
            low.extend(of_part);
            promising.extend(promising_of_part);
        }
        (low, promising)
    }

    /// The share of the peak, but no lower than what noise may reach.
    fn threshold_for(&self, greatest: i32) -> i64 {
        let sweeps = self.slots.len() as f64;
        // Mean and spread of one sweep's term under noise: |z|²/σ² is exponential.
        let (mean, spread) = match self.settings.statistic {
            Statistic::Log => (MEAN_LOG_OF_NOISE, 0.5),
            _ => (self.settings.noise_rms_lsb.powi(2), self.settings.noise_rms_lsb.powi(2)),
        };
        let floor = (mean * sweeps + self.settings.min_sigma * spread * sweeps.sqrt()) / self.stack.step();
        let share = (f64::from(greatest) * self.settings.share_of_peak).ceil();
        floor.max(share).max(1.0) as i64
    }

    /// Forgets what lies within a cube, but not the cube.
    fn close(&mut self, cube: u32) {
        let (e, n) = (cube as usize / 8, cube as usize % 8);
        let level = self.eights[e].level;
        let within = std::mem::replace(&mut self.eights[e].opened[n], CLOSED);
        if within == CLOSED {
            return;
        }
        if level > 0 {
            (0..8).for_each(|n| self.close(within * 8 + n));
            self.eights[within as usize].alive = 0;
            self.free_eights.push(within);
            return;
        }
        self.work.dropped += 1;
        self.bricks.swap_remove(within as usize);
        self.sums.swap_remove(within as usize);
        if let Some(moved) = self.bricks.get(within as usize) {
            self.eights[moved.cube as usize / 8].opened[moved.cube as usize % 8] = within;
        }
    }

    /// Opens cubes that may hold a voxel at the threshold, the most promising first, as far as the work allows.
    fn open(&mut self, promising: Vec<Promise>) {
        let mut heap = BinaryHeap::from(promising);
        if self.eights.is_empty() {
            self.insert_root(&mut heap);
        }
        let mut left = self.settings.max_opening;
        while !heap.is_empty() && left > 0 && self.bricks.len() < self.settings.max_bricks {
            let batch: Vec<Promise> = std::iter::from_fn(|| heap.pop()).take(BATCH).collect();
            let opened: Vec<Inside> = batch.par_iter().map(|(_, place, _)| self.inside(place.0)).collect();
            let mut greatest = 0;
            for ((_, _, cube), inside) in batch.into_iter().zip(opened) {
                left = left.saturating_sub(inside.updates + inside.bounds);
                self.work.updates += inside.updates;
                self.work.bounds += inside.bounds;
                greatest = greatest.max(inside.brick.as_ref().map_or(0, |(brick, sums)| sums.greatest(brick.within)));
                self.put_inside(cube, inside, &mut heap);
            }
            // A new peak may leave the rest of the heap below the threshold.
            self.threshold = self.threshold.max(self.threshold_for(greatest));
            while heap.peek().is_some_and(|most| most.0 < self.threshold) {
                heap.pop();
            }
        }
        self.waiting = heap.len();
        self.work.carried_over += heap.len() as u64;
    }

    fn put_inside(&mut self, cube: u32, inside: Inside, heap: &mut BinaryHeap<Promise>) {
        let (e, n) = (cube as usize / 8, cube as usize % 8);
        if let Some((brick, sums)) = inside.brick {
            self.eights[e].opened[n] = self.bricks.len() as u32;
            self.bricks.push(Brick { cube, ..brick });
            self.sums.push(sums);
            self.work.opened += 1;
        }
        if let Some(eight) = inside.eight {
            let at = self.free_eights.pop().unwrap_or(self.eights.len() as u32);
            self.eights[e].opened[n] = at;
            let promises = (0..8).filter(|&n| eight.alive >> n & 1 == 1 && eight.bound[n] >= self.threshold);
            heap.extend(promises.map(|n| (eight.bound[n], Reverse(eight.place(n)), at * 8 + n as u32)));
            match self.eights.get_mut(at as usize) {
                Some(free) => *free = eight,
                None => self.eights.push(eight),
            }
        }
    }

    fn insert_root(&mut self, heap: &mut BinaryHeap<Promise>) {
        let most = self.grid.bricks().into_iter().max().unwrap_or(1);
        let mut root = Eight::new(most.next_power_of_two().ilog2(), [0; 3]);
        if let Some((of, bound)) = self.bounded(root.place(0)) {
            root.put(0, &of, bound);
            heap.push((bound, Reverse(root.place(0)), 0));
            self.eights.push(root);
        }
    }

    /// A cube's box and its bound over the window; `None` beyond the grid.
    fn bounded(&self, place: Place) -> Option<(VoxelBox, i64)> {
        let of = VoxelBox::of(&self.grid, self.stack.origin_m(), place.level, place.brick())?;
        Some((of, on_widest(SumBounds { stack: &self.stack, maxima: &self.maxima, of })))
    }

    /// What lies within a cube, summed afresh over the window.
    fn inside(&self, place: Place) -> Inside {
        if place.level > 0 {
            let mut eight = Eight::new(place.level - 1, place.at);
            for n in 0..8 {
                if let Some((of, bound)) = self.bounded(eight.place(n)) {
                    eight.put(n, &of, bound);
                }
            }
            let bounds = u64::from(eight.alive.count_ones()) * self.slots.len() as u64;
            return Inside { eight: Some(eight), brick: None, updates: 0, bounds };
        }
        let center = self.grid.brick_center(place.brick(), self.stack.origin_m());
        let found = AddPower { stack: &self.stack, shape: self.shape, center, slots: &self.every_slot }.sums();
        let within = self.grid.voxels_of(place.brick()).fold(0u64, |bits, (n, _)| bits | 1 << n);
        let mut sums = Sums([[0; LANES]; EDGE]);
        // Each sweep is held to its part of what 32 bit can hold.
        sums.0.as_flattened_mut().iter_mut().zip(found.sums).for_each(|(to, sum)| *to = sum as i32);
        let brick = Brick { place, cube: 0, center, within };
        Inside { eight: None, brick: Some((brick, sums)), updates: found.updates, bounds: 0 }
    }

    /// The voxels at or above the threshold: index into a volume's values and value, by rising index.
    pub fn voxels(&self) -> Vec<(usize, f32)> {
        let mut voxels: Vec<(usize, f32)> = Vec::new();
        for (brick, sums) in self.bricks.iter().zip(&self.sums) {
            let of_brick = self.grid.voxels_of(brick.place.brick());
            let with_sum = of_brick.map(|(n, index)| (index, i64::from(sums.0[n / LANES][n % LANES])));
            let above = with_sum.filter(|v| v.1 >= self.threshold);
            voxels.extend(above.map(|(index, sum)| (index, self.stack.value_of(sum))));
        }
        voxels.sort_unstable_by_key(|v| v.0);
        voxels
    }

    /// The greatest voxel's centre and value, the first of equals; `None` when nothing reaches the threshold.
    pub fn peak(&self) -> Option<(DVec3, f32)> {
        let best = self.voxels().into_iter().reduce(|best, v| if v.1 > best.1 { v } else { best })?;
        let [nx, ny, _] = self.grid.size;
        let voxel = [best.0 % nx, best.0 / nx % ny, best.0 / (nx * ny)].map(|n| n as f64 + 0.5);
        Some((self.grid.origin_m + DVec3::from_array(voxel) * self.grid.voxel_m, best.1))
    }

    /// The threshold as a value of the statistic.
    pub fn threshold(&self) -> f32 {
        self.stack.value_of(self.threshold)
    }

    /// Whether nothing waits to be opened: the voxels are then those of the dense image.
    pub fn is_complete(&self) -> bool {
        self.waiting == 0
    }

    /// What was done so far.
    pub fn work(&self) -> RollingWork {
        self.work
    }

    /// Cubes and bricks alive.
    pub fn alive(&self) -> (usize, usize) {
        let cubes = self.eights.iter().map(|eight| eight.alive.count_ones() as usize).sum();
        (cubes, self.bricks.len())
    }

    /// The window's sweeps, for a dense image of the same.
    pub fn stack(&self) -> &SweepStack {
        &self.stack
    }
}

/// What opening a cube brings.
struct Inside {
    eight: Option<Eight>,
    brick: Option<(Brick, Sums)>,
    updates: u64,
    bounds: u64,
}

/// A cube that may hold a voxel at the threshold: bound, place, index.
type Promise = (i64, Reverse<Place>, u32);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Aabb;
    use crate::imaging::sums::dense_volume;
    use crate::imaging::test_data::{Echo, on_one_thread, sweeps, winding};

    const AT: DVec3 = DVec3::new(0.1, 0.0, -1.2);

    fn settings(statistic: Statistic) -> RollingSettings {
        RollingSettings { statistic, window: 40, min_sweeps: 20, ..Default::default() }
    }

    /// A moving sensor before a reflector that jumps halfway, with bursts of 10⁴ times the amplitude.
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

    #[test]
    fn the_rolling_image_is_the_dense_image_of_its_window_bit_for_bit() {
        for statistic in [Statistic::Ls, Statistic::Log] {
            let observations = observations(1);
            let mut image = image(&observations, settings(statistic));
            for (n, observation) in observations.iter().enumerate() {
                image.push(observation).unwrap();
                if n < 20 || n % 13 != 0 {
                    continue;
                }
                assert!(image.is_complete());
                let dense = dense_volume(image.stack(), &image.grid).volume;
                let all = dense.values.iter().copied().enumerate();
                let wanted: Vec<_> = all.filter(|v| v.1 >= image.threshold()).collect();
                assert_eq!(image.voxels(), wanted, "{n}");
                // Every cube alive carries the bound that a fresh one has.
                for eight in &image.eights {
                    for n in (0..8).filter(|n| eight.alive >> n & 1 == 1) {
                        assert_eq!(Some(eight.bound[n]), image.bounded(eight.place(n)).map(|fresh| fresh.1));
                    }
                }
            }
            assert!(image.work().dropped > 0, "{:?}", image.work());
        }
    }

    #[test]
    fn bounded_opening_is_carried_over_and_comes_to_the_same() {
        let observations = observations(2);
        let mut free = image(&observations, settings(Statistic::Ls));
        let mut tight = image(&observations, RollingSettings { max_opening: 40_000, ..settings(Statistic::Ls) });
        for observation in &observations {
            free.push(observation).unwrap();
            tight.push(observation).unwrap();
        }
        assert!(tight.work().carried_over > 2 * free.work().carried_over, "{:?} {:?}", tight.work(), free.work());
        assert!(tight.is_complete());
        assert_eq!(tight.voxels(), free.voxels());
    }

    #[test]
    fn threads_do_not_matter_and_noise_opens_nothing() {
        let run = || {
            let observations = observations(3);
            let mut image = image(&observations, settings(Statistic::Log));
            observations.iter().for_each(|o| image.push(o).unwrap());
            (image.voxels(), image.work(), image.alive())
        };
        assert_eq!(on_one_thread(run), run());
        let noise: Vec<_> = sweeps(3.0, |t| winding(3.0 * t), &[], 4).into_iter().step_by(20).collect();
        let mut image = image(&noise, settings(Statistic::Ls));
        noise.iter().for_each(|o| image.push(o).unwrap());
        assert_eq!(image.voxels(), []);
        let bricks = image.grid.bricks().into_iter().product::<usize>();
        assert!(image.alive().1 < bricks / 4, "{:?} of {bricks}", image.alive());
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

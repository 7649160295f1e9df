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
//! Sweeps, bricks and octree are parts of their own. What moves between them happens here: when a
//! sum or a bound crosses the threshold.

mod brick_store;
mod bricks;
mod octree;
mod octree_bounds;
mod priority_buckets;
mod settings;
mod window;

use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use super::brick_geometry::BrickShape;
use super::grid::BrickGrid;
use super::power::power_shape;
use super::sweep_stack::{SweepRefusal, SweepStack};
use crate::Statistic;
use crate::simd::LANES;
use crate::subaperture::MEAN_LOG_OF_NOISE;
use crate::{Beam, Observation, SweepGeometry};
use brick_store::BrickStore;
use bricks::{Brick, Sums};
use octree::Octree;
use priority_buckets::{Candidate, PriorityBuckets};
use settings::MAX_WINDOW;
pub use settings::{RollingError, RollingSettings, RollingSize, RollingWork};
use window::SweepWindow;

/// Least number of bricks that one task sums. Choice: enough work for a task to pay.
const MIN_BRICKS_PER_SUM_TASK: usize = 16;
/// Cost of one bound, in updates. Choice: a bound looks up range maxima and the beam's extreme,
/// some four times the work of a voxel; it only shares out the work of a sweep.
const UPDATES_PER_BOUND: u64 = 4;

/// The image.
#[derive(Debug)]
pub struct RollingImage {
    settings: RollingSettings,
    grid: BrickGrid,
    shape: BrickShape,
    window: SweepWindow,
    octree: Octree,
    bricks: BrickStore,
    queue: PriorityBuckets,
    threshold: i64,
    /// No voxel with at least this sum is missing.
    exact_from: i64,
    /// The window counts the sweeps.
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
        Ok(Self {
            settings,
            grid: *grid,
            shape: power_shape(grid.voxel_m),
            window: SweepWindow::new(&settings, beam, geometries, grid),
            octree: Octree::default(),
            bricks: BrickStore::default(),
            queue: PriorityBuckets::new(),
            threshold: 0,
            exact_from: i64::MAX,
            work: RollingWork::default(),
        })
    }

    /// Adds a sweep, and removes the oldest one when the window is full.
    ///
    /// # Errors
    /// An unusable sweep; it is counted and changes nothing.
    pub fn push(&mut self, observation: &Observation) -> Result<(), SweepRefusal> {
        let change = self.window.add(observation).inspect_err(|_| self.work.refused += 1)?;
        let (updates, greatest) = self.bricks.roll(&self.window, self.shape, change);
        self.work.updates += updates;
        self.threshold = self.threshold_for(greatest);
        let limit = self.drop_below();
        self.bricks.make_idle_below(limit, &mut self.octree);
        let (promising, pairs) = self.octree.roll(&self.window, change, self.threshold, limit);
        self.work.bounds += pairs;
        if let Some(old) = change.old {
            self.window.remove(old);
        }
        self.work.dropped += self.bricks.drop_stale_idle(&self.window, &mut self.octree);
        if self.window.len() >= self.settings.min_sweeps.min(self.settings.window) {
            self.refine_candidates(promising);
        }
        Ok(())
    }

    /// The share of the peak, at least the level that noise may reach.
    fn threshold_for(&self, greatest: i32) -> i64 {
        let sweeps = self.window.len() as f64;
        // Mean and standard deviation of one sweep's term under noise: |z|²/σ² is exponential.
        let (mean, spread) = match self.settings.statistic {
            Statistic::Log => (MEAN_LOG_OF_NOISE, 0.5),
            _ => (self.settings.noise_rms_lsb.powi(2), self.settings.noise_rms_lsb.powi(2)),
        };
        let floor = (mean * sweeps + self.settings.min_sigma * spread * sweeps.sqrt()) / self.window.stack().step();
        let share = (f64::from(greatest) * self.settings.share_of_peak).ceil();
        floor.max(share).max(1.0) as i64
    }

    /// Sums below this need no rolling.
    fn drop_below(&self) -> i64 {
        (self.threshold as f64 * self.settings.drop_share) as i64
    }

    /// Examines candidates for voxels at the threshold, greatest bounds first, within the work
    /// limit.
    fn refine_candidates(&mut self, promising: Vec<Candidate>) {
        // Taken out while the rest is modified.
        let mut queue = std::mem::replace(&mut self.queue, PriorityBuckets::new());
        queue.clear(self.threshold);
        promising.into_iter().for_each(|promise| queue.put(promise));
        if self.octree.is_empty() {
            self.octree.insert_root(&self.grid, &self.window);
            self.octree.candidates(0, self.threshold).for_each(|root| queue.put(root));
        }
        let mut left = self.settings.max_opening;
        let a_brick = self.window.updates_per_brick();
        while left > 0 && self.bricks.rolling_count() < self.settings.max_bricks {
            let batch = queue.pop_best(self.threshold, (left / a_brick) as usize + 1);
            if batch.is_empty() {
                break;
            }
            let (bricks, cubes): (Vec<_>, Vec<_>) =
                batch.into_iter().map(|promise| promise.cube()).partition(|&cube| self.octree.is_brick(cube));
            let sums: Vec<_> =
                bricks.par_iter().with_min_len(MIN_BRICKS_PER_SUM_TASK).map(|&cube| self.sums_of(cube)).collect();
            let open = |cubes: &[usize]| self.octree.opened(cubes, &self.grid, &self.window);
            let octets: Vec<_> = cubes.par_chunks(cubes_per_task(cubes.len())).map(open).collect();
            for (cube, (sums, updates)) in bricks.into_iter().zip(sums) {
                left = left.saturating_sub(updates);
                self.work.updates += updates;
                self.store_sums(cube, sums);
            }
            for (octets, bounds, pairs) in octets {
                left = left.saturating_sub(pairs * UPDATES_PER_BOUND);
                self.work.bounds += pairs;
                for (eight, bounds) in octets.into_iter().zip(bounds) {
                    let at = self.octree.insert(eight, bounds);
                    self.octree.candidates(at, self.threshold).for_each(|promise| queue.put(promise));
                }
            }
        }
        let (left, greatest) = queue.remaining(self.threshold);
        self.exact_from = greatest.map_or(self.threshold, |greatest| greatest + 1);
        self.work.carried_over += left as u64;
        self.queue = queue;
    }

    /// A brick's sums over the window, updated from its old sums if it is idle, and the updates
    /// that took.
    fn sums_of(&self, cube: usize) -> (Sums, u64) {
        match self.octree.child(cube).map(|at| self.bricks.get(at)) {
            Some((brick, sums)) if self.window.can_catch_up(brick.sweep) => {
                let [came, went] = self.window.sums_since(brick.sweep, brick.center, self.shape);
                (sums.caught_up(&came.sums, &went.sums), came.updates + went.updates)
            }
            _ => {
                let place = self.octree.cube_index(cube).brick();
                let center = self.grid.brick_center(place, self.window.stack().origin_m());
                let all = self.window.sums(center, self.shape);
                (Sums::of(&all.sums), all.updates)
            }
        }
    }

    fn store_sums(&mut self, cube: usize, sums: Sums) {
        let at = match self.octree.child(cube) {
            None => self.new_brick(cube),
            Some(at) => {
                self.work.caught_up += 1;
                at
            }
        };
        let greatest = self.bricks.store(at, sums, self.window.newest());
        self.threshold = self.threshold.max(self.threshold_for(greatest));
        if i64::from(greatest) < self.drop_below() {
            self.bricks.watch_idle(at, &mut self.octree);
        } else {
            self.bricks.start_rolling(at, &mut self.octree);
        }
    }

    /// Allocates an idle brick.
    fn new_brick(&mut self, cube: usize) -> usize {
        if self.bricks.len() >= self.settings.max_bricks && self.bricks.idle_count() > 0 {
            self.bricks.drop_next_idle(&mut self.octree);
            self.work.dropped += 1;
        }
        let place = self.octree.cube_index(cube).brick();
        let within = self.grid.voxels_of(place).fold(0u64, |bits, (n, _)| bits | 1 << n);
        let center = self.grid.brick_center(place, self.window.stack().origin_m());
        self.work.opened += 1;
        let sweep = self.window.newest();
        self.bricks.add(Brick { center, cube: cube as u32, within, sweep, greatest: 0 }, &mut self.octree)
    }

    /// The voxels of rolling bricks: index into a volume's values, and sum.
    fn rolling_voxels(&self, least: i64) -> impl Iterator<Item = (usize, i64)> {
        let high = self.bricks.rolling().filter(move |(brick, _)| i64::from(brick.greatest) >= least);
        high.flat_map(move |(brick, sums)| {
            let of_brick = self.grid.voxels_of(self.octree.cube_index(brick.cube as usize).brick());
            let with_sum = of_brick.map(|(n, index)| (index, i64::from(sums.0[n / LANES][n % LANES])));
            with_sum.filter(move |v| v.1 >= least)
        })
    }

    /// The voxels that are [exact](Self::exact_from): index into a volume's values, and value, by
    /// rising index.
    pub fn voxels(&self) -> Vec<(usize, f32)> {
        let above = self.rolling_voxels(self.exact_from).map(|(index, sum)| (index, self.window.stack().value_of(sum)));
        let mut voxels: Vec<(usize, f32)> = above.collect();
        voxels.sort_unstable_by_key(|v| v.0);
        voxels
    }

    /// Centre and value of the greatest voxel, the first of equals; `None` when nothing known
    /// reaches the threshold. While work is deferred, a greater one may not be found yet: this is
    /// the case when the value is below [`exact_from`](Self::exact_from).
    pub fn peak(&self) -> Option<(DVec3, f32)> {
        let greatest = self.bricks.rolling().map(|(brick, _)| i64::from(brick.greatest)).max()?;
        let (index, sum) = self.rolling_voxels(greatest.max(self.threshold)).min()?;
        let [nx, ny, _] = self.grid.size;
        let voxel = [index % nx, index / nx % ny, index / (nx * ny)].map(|n| n as f64 + 0.5);
        Some((self.grid.origin_m + DVec3::from_array(voxel) * self.grid.voxel_m, self.window.stack().value_of(sum)))
    }

    /// Least value of the statistic at which voxels are to be kept.
    pub fn threshold(&self) -> f32 {
        self.window.stack().value_of(self.threshold)
    }

    /// Value from which on the voxels are those of the dense image, without exception: the
    /// threshold, or more while work is deferred. Infinite before the least number of sweeps.
    pub fn exact_from(&self) -> f32 {
        if self.exact_from == i64::MAX { f32::INFINITY } else { self.window.stack().value_of(self.exact_from) }
    }

    /// Whether no work is deferred.
    pub fn is_complete(&self) -> bool {
        self.exact_from == self.threshold
    }

    /// Work done so far.
    pub fn work(&self) -> RollingWork {
        RollingWork { sweeps: self.window.newest(), ..self.work }
    }

    /// Number of cubes and bricks.
    pub fn kept(&self) -> RollingSize {
        RollingSize {
            cubes: self.octree.cubes(),
            rolling_bricks: self.bricks.rolling_count(),
            idle_bricks: self.bricks.idle_count(),
        }
    }

    /// The window's sweeps, for a dense image of the same.
    pub fn stack(&self) -> &SweepStack {
        self.window.stack()
    }
}

/// Cubes per parallel task: more per task fetch each sweep's range maxima less often, fewer keep
/// all threads busy.
fn cubes_per_task(cubes: usize) -> usize {
    (cubes / 16).clamp(8, 64)
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
                for (eight, bounds) in image.octree.iter() {
                    for n in (0..8).filter(|&n| bounds.is_watched(n)) {
                        let most = greatest_in(&dense, &image.grid, eight.cube_index(n));
                        let bound = image.stack().value_of(i64::from(bounds.bound(n)));
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

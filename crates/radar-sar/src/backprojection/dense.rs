//! Dense volumes, brick by brick, on all cores.

use rayon::prelude::*;

use super::brick_geometry::{BrickShape, EDGE, VOXELS};
use super::grid::BrickGrid;
use super::power::{AddPower, FillRow, power_shape};
use super::sweep_stack::SweepStack;
use super::weighted::{AddWeighted, WeightedValues, weighted_shape};
use crate::simd::on_widest;
use crate::{Statistic, Volume};

/// A volume and the work it took.
#[derive(Debug, Clone, PartialEq)]
pub struct DenseVolume {
    /// The statistic's value at every voxel.
    pub volume: Volume,
    /// (voxel, sweep) pairs processed; sweeps that do not see a brick are skipped.
    pub updates: u64,
}

/// The statistic of all of a stack's sweeps at every voxel. The same bits on any number of threads
/// and any processor.
///
/// Agrees with the oracle to 0.5 % of the volume's peak, plus, for `ls` and `log`, the rounding of
/// each sweep to whole steps. Two exceptions: voxels within 0.1 mm of an edge of range or beam may
/// count differently from the oracle's. For voxels near a sensor, D is held constant within one
/// table step (at most 5 mm), and at distance d a value may be off by ¾·(step/d)² of itself; for
/// `glrt` and `coherent`, which divide by D², by 1¼·(step/d)².
///
/// # Panics
/// `grid.size[0] * grid.size[1] == 0`.
pub fn dense_volume(stack: &SweepStack, grid: &BrickGrid) -> DenseVolume {
    let bricks = Bricks::new(stack, grid);
    let mut volume = grid.volume();
    let [nx, ny, _] = grid.size;
    let slab = EDGE * ny * nx;
    let fill = |(z, out): (usize, &mut [f32])| (0..grid.bricks()[1]).map(|y| bricks.fill_row(y, z, out)).sum::<u64>();
    let updates = volume.values.par_chunks_mut(slab).enumerate().map(fill).sum();
    DenseVolume { volume, updates }
}

/// Computes bricks of a grid from a stack.
#[derive(Debug)]
pub(super) struct Bricks<'a> {
    stack: &'a SweepStack,
    grid: BrickGrid,
    /// Of the bricks along each axis, relative to the stack's origin.
    centers_m: [Vec<f32>; 3],
    shape: BrickShape,
    /// All sweeps, for the integer sums.
    slots: Vec<(usize, u16)>,
}

impl<'a> Bricks<'a> {
    pub(super) fn new(stack: &'a SweepStack, grid: &BrickGrid) -> Self {
        let phases = stack.statistic() == Statistic::Coherent;
        let shape = if phases { weighted_shape(grid.voxel_m) } else { power_shape(grid.voxel_m) };
        let slots = (0..stack.groups.len()).map(|group| (group, u16::MAX)).collect();
        Self { stack, grid: *grid, centers_m: grid.brick_centers(stack.origin_m()), shape, slots }
    }

    /// Writes the statistic at a row of bricks into their slab of four layers; returns the updates.
    fn fill_row(&self, y: usize, z: usize, slab: &mut [f32]) -> u64 {
        let row = self.row(y, z);
        let (stack, shape) = (self.stack, self.shape);
        if stack.sums_whole_numbers() {
            return on_widest(FillRow { stack, shape, slots: &self.slots, row, slab });
        }
        let mut updates = 0;
        for x in 0..row.bricks() {
            let found = AddWeighted { stack, shape, center: row.center(x) }.values();
            row.put(x, &found.values, slab);
            updates += found.updates;
        }
        updates
    }

    /// A statistic that is not summed in integers at the voxels of a brick, and the updates.
    pub(super) fn weighted(&self, brick: [usize; 3]) -> WeightedValues {
        AddWeighted { stack: self.stack, shape: self.shape, center: self.center(brick) }.values()
    }

    fn row(&self, y: usize, z: usize) -> BrickRow<'_> {
        BrickRow { grid: &self.grid, centers_m: &self.centers_m, y, z }
    }

    fn center(&self, [x, y, z]: [usize; 3]) -> [f32; 3] {
        self.row(y, z).center(x)
    }

    /// Adds one group of sweeps to a brick's integer sums; returns the updates.
    pub(super) fn add_group(&self, brick: [usize; 3], group: usize, sums: &mut [i64; VOXELS]) -> u64 {
        let center = self.center(brick);
        let slots = &self.slots[group..=group];
        let found = AddPower { stack: self.stack, shape: self.shape, center, slots }.sums();
        sums.iter_mut().zip(found.sums).for_each(|(sum, more)| *sum += more);
        found.updates
    }
}

/// A row of bricks along x in a slab of four layers of voxels.
#[derive(Debug, Clone, Copy)]
pub(super) struct BrickRow<'a> {
    grid: &'a BrickGrid,
    /// Along each axis, relative to the stack's origin.
    centers_m: &'a [Vec<f32>; 3],
    y: usize,
    z: usize,
}

impl BrickRow<'_> {
    #[inline(always)]
    pub(super) fn bricks(&self) -> usize {
        self.centers_m[0].len()
    }

    #[inline(always)]
    pub(super) fn center(&self, x: usize) -> [f32; 3] {
        [self.centers_m[0][x], self.centers_m[1][self.y], self.centers_m[2][self.z]]
    }

    /// Writes a brick's values into the slab; voxels beyond the box are left out. Not inlined: in a kernel,
    /// it would take registers from the sums.
    #[inline(never)]
    pub(super) fn put(&self, x: usize, values: &[f32; VOXELS], slab: &mut [f32]) {
        let [nx, ny, nz] = self.grid.size;
        let (x, y, layers) = (x * EDGE, self.y * EDGE, (nz - self.z * EDGE).min(EDGE));
        let (rows, columns) = ((ny - y).min(EDGE), (nx - x).min(EDGE));
        let from = values.as_chunks::<EDGE>().0;
        for layer in 0..layers {
            for row in 0..rows {
                let to = &mut slab[(layer * ny + y + row) * nx + x..][..columns];
                let four = &from[layer * EDGE + row];
                match to.first_chunk_mut() {
                    Some(to) => *to = *four,
                    None => to.copy_from_slice(&four[..columns]),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DQuat, DVec3};
    use num_complex::Complex32;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::Oracle;
    use crate::geometry::{Aabb, Pose};
    use crate::simd::{Kernel, Lanes, on_each};
    use crate::subaperture::SubapertureSettings;
    use crate::test_data::{Echo, on_one_thread, sweeps, winding};
    use crate::{Beam, Observation, RangeAxis, SweepGeometry};

    const AT: DVec3 = DVec3::new(0.1, 0.0, -1.2);

    /// Sweeps of a moving, rotating sensor.
    fn observations(seed: u64) -> Vec<Observation> {
        let mut all: Vec<_> = sweeps(1.2, |t| winding(3.0 * t), &[(Echo::Point(AT), 8.0)], seed);
        for (n, o) in all.iter_mut().enumerate() {
            let turn = DQuat::from_scaled_axis(winding(0.02 * n as f64) * 3.0);
            o.tracking_from_sensor = Pose::new(o.tracking_from_sensor.translation, turn);
        }
        all.into_iter().step_by(40).collect()
    }

    fn volume(statistic: Statistic, beam: &Beam, observations: &[Observation], grid: &BrickGrid) -> DenseVolume {
        dense_volume(&SweepStack::of(statistic, beam, observations, grid.middle_m()).0, grid)
    }

    /// Whether a point lies within 0.1 mm of an edge of some sweep's range (or, for `thesis`, of
    /// where the nearest point changes) or within 0.05° of its beam's edge.
    fn at_an_edge(place: DVec3, observations: &[Observation], beam: &Beam, statistic: Statistic) -> bool {
        observations.iter().any(|o| {
            let (d, axis) = (o.distance_m(place), &o.geometry.axis);
            let edge = |d: f64, border: f64| (d - border).abs() < 1e-4;
            let cos = o.cos_off_boresight(place);
            // The hole in a hollow beam is only as sharp as the beam's table.
            let hollow = beam.amplitude(1.0) == 0.0;
            let turned =
                |deg: f64| beam.amplitude((cos.acos() + deg.to_radians()).min(std::f64::consts::PI - 1e-4).cos()) > 0.0;
            let jump = (axis.point_at(d) - 0.5).round() + 0.5;
            let jumps = statistic == Statistic::Thesis && edge(d, axis.first_m + jump * axis.step_m);
            jumps
                || edge(d, axis.first_m)
                || edge(d, axis.last_m())
                || d < 2e-3
                || if hollow { turned(-0.5) != turned(0.5) } else { turned(-0.05) != turned(0.05) }
        })
    }

    /// Compares every statistic but the sub-aperture one with the oracle over a box; tolerance
    /// `share` of the peak.
    fn check(beam: &Beam, region: Aabb, voxel_m: f64, share: f64) {
        let observations = observations(1);
        let oracle = Oracle::new(&observations, beam, &SubapertureSettings::default());
        let grid = BrickGrid::covering(&region, voxel_m);
        for statistic in Statistic::ALL.into_iter().filter(|s| *s != Statistic::Subaperture) {
            let (stack, _) = SweepStack::of(statistic, beam, &observations, grid.middle_m());
            let fast = dense_volume(&stack, &grid).volume;
            let rounding =
                if stack.sums_whole_numbers() { stack.step() * (observations.len() as f64).sqrt() } else { 0.0 };
            let mut peak = 0.0f64;
            let mut worst = (0.0f64, DVec3::ZERO, 0.0, 0.0);
            for (index, value) in fast.values.iter().enumerate() {
                let place = fast.center(fast.voxel(index));
                if at_an_edge(place, &observations, beam, statistic) {
                    continue;
                }
                let exact = oracle.value(statistic, place);
                peak = peak.max(exact);
                let off = (f64::from(*value) - exact).abs();
                if off > worst.0 {
                    worst = (off, place, f64::from(*value), exact);
                }
                assert!(value.is_finite());
            }
            assert!(worst.0 <= share * peak + 2.0 * rounding, "{} {beam:?}: {worst:?}, peak {peak}", statistic.name());
        }
    }

    #[test]
    fn fine_voxels_agree_with_the_oracle() {
        let region = Aabb { min: AT - 0.1, max: AT + DVec3::new(0.11, 0.07, 0.09) };
        for beam in [Beam::Uniform, Beam::Lensless, Beam::Fresnel] {
            check(&beam, region, 0.012, 5e-3);
        }
    }

    #[test]
    fn single_sweeps_with_the_narrowest_pulse_agree_with_the_oracle() {
        // One sweep of noise, of which no other averages the errors; from the least distance to second order on.
        let (first, voxel_m) = (observations(1).swap_remove(0), 0.025);
        let axis = RangeAxis { first_m: 0.2, step_m: 0.01, points: 160 };
        let geometry = SweepGeometry { axis, pulse_fwhm_m: 0.04, ..*first.geometry };
        let geometry = Arc::new(geometry);
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        for _ in 0..4 {
            let samples =
                (0..axis.points).map(|_| Complex32::new(rng.random_range(-9.0..9.0), rng.random_range(-9.0..9.0)));
            let sweep = [Observation { geometry: Arc::clone(&geometry), samples: samples.collect(), ..first.clone() }];
            let region = Aabb { min: AT - 0.6, max: AT + DVec3::new(0.6, 0.6, 0.6) };
            let grid = BrickGrid::covering(&region, voxel_m);
            let oracle = Oracle::new(&sweep, &Beam::Uniform, &SubapertureSettings::default());
            let (stack, _) = SweepStack::of(Statistic::Ls, &Beam::Uniform, &sweep, grid.middle_m());
            let fast = dense_volume(&stack, &grid).volume;
            let places = (0..fast.values.len()).map(|index| fast.center(fast.voxel(index)));
            let exact: Vec<f64> = places.map(|place| oracle.value(Statistic::Ls, place)).collect();
            let peak = exact.iter().copied().fold(0.0, f64::max);
            for (index, (value, exact)) in fast.values.iter().zip(&exact).enumerate() {
                let place = fast.center(fast.voxel(index));
                if !at_an_edge(place, &sweep, &Beam::Uniform, Statistic::Ls) {
                    let off = (f64::from(*value) - exact).abs();
                    assert!(off <= 5e-3 * peak + stack.step(), "{place}: {value} {exact}, peak {peak}");
                }
            }
        }
    }

    #[test]
    fn coarse_voxels_agree_with_the_oracle() {
        let region = Aabb { min: AT - 0.6, max: AT + 0.55 };
        check(&Beam::Lensless, region, 0.1, 5e-3);
    }

    #[test]
    fn edges_of_range_and_beam_and_the_sensor_itself_are_handled() {
        // Around the sensor's path, ranges from 0 to far beyond the axis.
        let near = Aabb { min: DVec3::new(-0.4, -0.35, -0.45), max: DVec3::new(0.4, 0.35, 0.3) };
        let far = Aabb { min: DVec3::new(-1.0, -1.0, -3.5), max: DVec3::new(1.0, 1.0, -2.7) };
        let hollow = Beam::from_table(vec![[0.0, 0.0], [5.0, 0.0], [20.0, 1.0], [30.0, 0.5]]).unwrap();
        for beam in [Beam::Uniform, Beam::Thesis, Beam::Lensless, hollow] {
            check(&beam, near, 0.05, 1e-2);
            check(&beam, far, 0.08, 1e-2);
        }
    }

    /// The values of a row of integer sums, and the updates.
    #[derive(Clone)]
    struct RowOf<'a>(&'a Bricks<'a>, [usize; 2]);

    impl Kernel for RowOf<'_> {
        type Out = (Vec<u32>, u64);

        #[inline(always)]
        fn run<S: Lanes>(self, s: S) -> Self::Out {
            let Self(bricks, [y, z]) = self;
            let Bricks { stack, shape, slots, grid, .. } = bricks;
            let mut slab = vec![0.0; EDGE * grid.size[1] * grid.size[0]];
            let updates = FillRow { stack, shape: *shape, slots, row: bricks.row(y, z), slab: &mut slab }.run(s);
            (slab.into_iter().map(f32::to_bits).collect(), updates)
        }
    }

    #[test]
    fn result_is_independent_of_threads_and_instruction_set() {
        let observations = observations(2);
        let grid = BrickGrid::covering(&Aabb { min: AT - 0.5, max: AT + 0.5 }, 0.04);
        for statistic in [Statistic::Ls, Statistic::Glrt, Statistic::Coherent] {
            let many = volume(statistic, &Beam::Thesis, &observations, &grid);
            assert_eq!(on_one_thread(|| volume(statistic, &Beam::Thesis, &observations, &grid)), many);
            let (stack, _) = SweepStack::of(statistic, &Beam::Thesis, &observations, grid.middle_m());
            let bricks = Bricks::new(&stack, &grid);
            if stack.sums_whole_numbers() {
                for row in [[0, 0], [2, 4], [6, 6]] {
                    let all = on_each(&RowOf(&bricks, row));
                    assert!(all.windows(2).all(|two| two[0] == two[1]));
                }
            }
            for brick in [[0, 0, 0], [3, 2, 4], [6, 6, 6]] {
                let center = grid.brick_center(brick, stack.origin_m());
                let (stack, shape) = (&stack, bricks.shape);
                if stack.sums_whole_numbers() {
                    let all = on_each(&AddPower { stack, shape, center, slots: &bricks.slots });
                    assert!(all.windows(2).all(|two| two[0] == two[1]));
                } else {
                    let all = on_each(&AddWeighted { stack, shape, center });
                    assert!(all.windows(2).all(|two| two[0] == two[1]));
                }
            }
        }
    }

    #[test]
    fn refilled_stack_equals_a_new_one() {
        let grid = BrickGrid::covering(&Aabb { min: AT - 0.5, max: AT + 0.5 }, 0.08);
        for statistic in Statistic::ALL.into_iter().filter(|s| *s != Statistic::Subaperture) {
            let (before, mut after) = (observations(4), observations(5));
            let (mut kept, _) = SweepStack::of(statistic, &Beam::Lensless, &before, DVec3::ZERO);
            after[3].samples[2].im = f32::INFINITY;
            for sweeps in [&after[..], &after[..3], &before] {
                let sweeps: Vec<_> =
                    sweeps.iter().map(|o| Observation { geometry: before[0].geometry.clone(), ..o.clone() }).collect();
                let (new, refused) = SweepStack::of(statistic, &Beam::Lensless, &sweeps, grid.middle_m());
                assert_eq!(kept.refill(&sweeps, grid.middle_m()), refused);
                assert_eq!(dense_volume(&kept, &grid), dense_volume(&new, &grid), "{}", statistic.name());
            }
        }
    }

    #[test]
    fn non_finite_sweeps_are_refused() {
        let mut observations = observations(3);
        let sound = observations.len() - 3;
        observations[1].samples[7].re = f32::NAN;
        observations[4].tracking_from_sensor.translation.x = f64::INFINITY;
        observations[6].samples.pop();
        let (stack, refused) = SweepStack::of(Statistic::Ls, &Beam::Uniform, &observations, DVec3::ZERO);
        assert_eq!((refused, stack.sweeps()), (3, sound));
        let grid = BrickGrid::covering(&Aabb { min: AT - 0.2, max: AT + 0.2 }, 0.05);
        assert!(dense_volume(&stack, &grid).volume.values.iter().all(|v| v.is_finite()));
    }
}

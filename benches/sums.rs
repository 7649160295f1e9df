//! Dense sums, updates (voxel, sweep) per second: the workload of tuned near-field backprojection.
//!
//!     cargo bench --bench sums
//!
//! A box of 0.8 m in front of the sensor, sweeps of 321 points 5 mm apart from 0.2 m on, from a winding path, looking about.
//! Minimum over repetitions of about a second; tables are made beforehand and timed by themselves.

use std::sync::Arc;
use std::time::Instant;

use glam::{DQuat, DVec3};
use num_complex::Complex32;
use radar_chaperone::geometry::{Aabb, Pose};
use radar_chaperone::imaging::Statistic;
use radar_chaperone::imaging::sums::{BrickGrid, SweepStack, dense_volume};
use radar_chaperone::radar::{Beam, Observation, Profile, RangeAxis, SweepGeometry};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn sweeps(count: usize) -> Vec<Observation> {
    let axis = RangeAxis { first_m: 0.2, step_m: 0.005, points: 321 };
    let geometry = Arc::new(SweepGeometry { subsweep: 0, axis, profile: Profile::P3, point_period_s: 0.0 });
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let sweep = |i: usize| {
        let t = i as f64 / (count - 1).max(1) as f64;
        let place = DVec3::new(0.1 * (5.0 * t).sin(), 0.2 * (3.0 * t).cos() - 0.2, 0.15 * (9.0 * t).sin());
        let look = DVec3::new(1.0, 0.3 * (4.0 * t).sin(), 0.2 * (6.0 * t).cos()).normalize();
        Observation {
            mid_time_ns: i as i64,
            tracking_from_sensor: Pose::new(place, DQuat::from_rotation_arc(DVec3::NEG_Z, look)),
            velocity_m_per_s: DVec3::ZERO,
            geometry: Arc::clone(&geometry),
            samples: (0..321)
                .map(|_| Complex32::new(rng.random_range(-0.5..0.5), rng.random_range(-0.5..0.5)))
                .collect(),
        }
    };
    (0..count).map(sweep).collect()
}

fn main() {
    let region = Aabb { min: DVec3::new(0.5, -0.4, -0.4), max: DVec3::new(1.3, 0.4, 0.4) };
    for (voxels, count) in [(128, 100), (30, 50)] {
        let observations = sweeps(count);
        let grid = BrickGrid::covering(&region, 0.8 / f64::from(voxels));
        for statistic in [
            Statistic::Ls,
            Statistic::Log,
            Statistic::Thesis,
            Statistic::ThesisFull,
            Statistic::Glrt,
            Statistic::Coherent,
        ] {
            let make = || SweepStack::of(statistic, &Beam::Lensless, &observations, grid.middle_m()).0;
            let tables_s = least(&mut || drop(make()));
            let stack = make();
            let updates = dense_volume(&stack, &grid).updates;
            let least_s = least(&mut || drop(dense_volume(&stack, &grid)));
            println!(
                "sums/dense/{}/{voxels}^3x{count}: {:.3} ms, {:.0} M updates/s, tables {:.3} ms",
                statistic.name(),
                least_s * 1e3,
                updates as f64 / least_s * 1e-6,
                tables_s * 1e3,
            );
        }
    }
}

fn least(work: &mut dyn FnMut()) -> f64 {
    work();
    let begin = Instant::now();
    let mut least = f64::INFINITY;
    while begin.elapsed().as_secs_f64() < 1.0 {
        let start = Instant::now();
        work();
        least = least.min(start.elapsed().as_secs_f64());
    }
    least
}

//! Dense backprojection, (voxel, sweep) updates per second: the workload of optimised near-field
//! backprojection.
//!
//!     cargo bench -p radar-sar --bench backprojection [-- <part of a name>]
//!
//! `box/…`: a box of 0.8 m in front of the sensor, sweeps of 321 points 5 mm apart from 0.2 m on,
//! from a winding path with changing directions. `room/…`: the thesis's workload, a cube of 3 m in
//! voxels of 10 cm, with 300 points 10 mm apart as well. Minimum over repetitions of about a
//! second: wall time, and on Linux the mean processor time, which other load on the machine
//! disturbs less. `tables` is from observations to a stack, `in all` from observations to the
//! volume, once with a new stack each time and once with a refilled one.

use std::sync::Arc;
use std::time::Instant;

use glam::{DQuat, DVec3};
use num_complex::Complex32;
use radar_sar::Statistic;
use radar_sar::backprojection::{BrickGrid, SweepStack, dense_volume};
use radar_sar::geometry::{Aabb, Pose};
use radar_sar::{Beam, Observation, RangeAxis, SweepGeometry};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SHORT_STEPS: RangeAxis = RangeAxis { first_m: 0.2, step_m: 0.005, points: 321 };
const FINE_PRESET: RangeAxis = RangeAxis { first_m: 0.2, step_m: 0.010, points: 300 };

const STATISTICS: [Statistic; 6] =
    [Statistic::Ls, Statistic::Log, Statistic::Thesis, Statistic::ThesisFull, Statistic::Glrt, Statistic::Coherent];

fn sweeps(axis: RangeAxis, count: usize) -> Vec<Observation> {
    let geometry = Arc::new(SweepGeometry { subsweep: 0, axis, pulse_fwhm_m: 0.14, point_period_s: 0.0 });
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
            samples: (0..axis.points)
                .map(|_| Complex32::new(rng.random_range(-0.5..0.5), rng.random_range(-0.5..0.5)))
                .collect(),
        }
    };
    (0..count).map(sweep).collect()
}

fn main() {
    // On a thread of the pool: from outside it, each parallel loop would wait for a pool thread to
    // wake up.
    rayon::scope(|_| jobs());
}

fn jobs() {
    let part = std::env::args().skip(1).find(|a| !a.starts_with('-')).unwrap_or_default();
    let near = Aabb { min: DVec3::new(0.5, -0.4, -0.4), max: DVec3::new(1.3, 0.4, 0.4) };
    let room = Aabb { min: DVec3::new(0.2, -1.5, -1.5), max: DVec3::new(3.2, 1.5, 1.5) };
    job("box", &near, 128, &sweeps(SHORT_STEPS, 100), &part);
    job("box", &near, 30, &sweeps(SHORT_STEPS, 50), &part);
    job("room/fine-preset", &room, 30, &sweeps(FINE_PRESET, 50), &part);
    job("room/321-points", &room, 30, &sweeps(SHORT_STEPS, 50), &part);
}

fn job(place: &str, region: &Aabb, voxels: u32, observations: &[Observation], part: &str) {
    let grid = BrickGrid::covering(region, region.size().x / f64::from(voxels));
    for statistic in STATISTICS {
        let name = format!("sums/dense/{}/{place}/{voxels}^3x{}", statistic.name(), observations.len());
        if !name.contains(part) {
            continue;
        }
        let make = || SweepStack::of(statistic, &Beam::Lensless, observations, grid.middle_m()).0;
        let stack = make();
        let updates = dense_volume(&stack, &grid).updates;
        let sums = least(&mut || drop(dense_volume(&stack, &grid)));
        let rate = |seconds: f64| updates as f64 / seconds * 1e-6;
        println!("{name}: {sums}, {:.0} ({:.0}) M updates/s", rate(sums.wall_s), rate(sums.processor_s));
        let tables = least(&mut || drop(make()));
        let all = least(&mut || drop(dense_volume(&make(), &grid)));
        println!("    new stack: tables {tables}, in all {all}");
        let (mut kept, middle) = (make(), grid.middle_m());
        let tables = least(&mut || assert_eq!(kept.refill(observations, middle), 0));
        let all = least(&mut || {
            kept.refill(observations, middle);
            drop(dense_volume(&kept, &grid));
        });
        println!("    refilled stack: tables {tables}, in all {all}");
    }
}

/// The minimum over many repetitions.
struct Least {
    wall_s: f64,
    /// Mean: the system counts it in ticks. NaN where it is not reported.
    processor_s: f64,
}

impl std::fmt::Display for Least {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.3} ms (CPU {:.3})", self.wall_s * 1e3, self.processor_s * 1e3)
    }
}

fn least(work: &mut dyn FnMut()) -> Least {
    work();
    let begin = Instant::now();
    let (mut wall_s, mut count, processor_start_s) = (f64::INFINITY, 0.0, processor_s());
    while begin.elapsed().as_secs_f64() < 0.7 {
        let start = Instant::now();
        work();
        wall_s = wall_s.min(start.elapsed().as_secs_f64());
        count += 1.0;
    }
    Least { wall_s, processor_s: (processor_s() - processor_start_s) / count }
}

/// Time that all threads of this process have run, seconds; NaN where the system does not report
/// it.
fn processor_s() -> f64 {
    let Ok(threads) = std::fs::read_dir("/proc/self/task") else { return f64::NAN };
    let of_thread = |path: std::path::PathBuf| {
        let text = std::fs::read_to_string(path.join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<f64>().ok()
    };
    threads.flatten().filter_map(|thread| of_thread(thread.path())).sum::<f64>() * 1e-9
}

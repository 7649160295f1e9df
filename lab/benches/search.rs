//! Adaptive search: work and time for the voxels above half of the peak, compared with a dense
//! volume.
//!
//!     cargo bench -p lab --bench search
//!
//! A corner reflector at 1 m depth in a 3 m cube, 200 sweeps of 10 s from a 50 cm sphere, preset
//! `fine`, 20 dB, default tracking error. Seed 1; `ls` at 1.2 cm voxels on seeds 1 to 5.

use std::time::Instant;

use a121::preset;
use glam::DVec3;
use radar_mapping::{ObserverSettings, observe_all};
use radar_sar::HistorySettings;
use radar_sar::backprojection::{BrickGrid, SweepStack, Threshold, dense_volume, search};
use radar_sar::geometry::Aabb;
use radar_sar::{Beam, Observation};
use radar_sar::{Statistic, farthest_points};
use radar_simulation::Scenario;

fn sweeps(count: usize, seed: u64) -> Vec<Observation> {
    let mut scenario = Scenario::new("corner-reflector", "sphere-50cm", preset("fine").expect("a preset"), 10.0, seed);
    scenario.snr_db = Some(20.0);
    let simulated = scenario.run().expect("a known scene and motion");
    let observer = ObserverSettings {
        history: HistorySettings::default(),
        head_from_sensor: scenario.head_from_sensor,
        time_offset_s: 0.0,
        range_bias_m: None,
    };
    let (all, _) = observe_all(&scenario.config, observer, &simulated.frames, &simulated.poses);
    let positions: Vec<_> = all.iter().map(|o| o.tracking_from_sensor.translation).collect();
    farthest_points(&positions, count).into_iter().map(|n| all[n].clone()).collect()
}

fn main() {
    for seed in 1..=5 {
        job(&sweeps(200, seed), Statistic::Ls, 0.012, seed);
    }
    let observations = sweeps(200, 1);
    for statistic in [Statistic::Ls, Statistic::Log, Statistic::Thesis, Statistic::Glrt, Statistic::Coherent] {
        for voxel_m in [0.1, 0.024, 0.012, 0.006] {
            job(&observations, statistic, voxel_m, 1);
        }
    }
}

fn job(observations: &[Observation], statistic: Statistic, voxel_m: f64, seed: u64) {
    let middle = DVec3::new(0.0, 1.5, -1.5);
    let grid = BrickGrid::covering(&Aabb { min: middle - 1.5, max: middle + 1.5 }, voxel_m);
    let (stack, _) = SweepStack::of(statistic, &Beam::Lensless, observations, grid.middle_m());
    let start = Instant::now();
    let found = search(&stack, &grid, Threshold::ShareOfPeak(0.5));
    let adaptive_s = start.elapsed().as_secs_f64();
    print!(
        "sums/search/{}/3m cube/{voxel_m} m x200/seed {seed}: {:.1} ms, {:.2} % of dense ({:.2} M updates, {:.2} M bounds), {} voxels",
        statistic.name(),
        adaptive_s * 1e3,
        found.work.share() * 100.0,
        found.work.updates as f64 * 1e-6,
        found.work.bounds as f64 * 1e-6,
        found.voxels.len(),
    );
    if voxel_m > 0.01 {
        let start = Instant::now();
        let dense = dense_volume(&stack, &grid).volume;
        let dense_s = start.elapsed().as_secs_f64();
        let peak = dense.peak().map_or(0.0, |p| p.1);
        let wanted = dense.values.iter().copied().enumerate().filter(|v| v.1 >= 0.5 * peak);
        let same = wanted.eq(found.voxels.iter().copied());
        print!("; dense {:.1} ms, identical: {same}", dense_s * 1e3);
    }
    println!();
}

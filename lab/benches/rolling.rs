//! Rolling image of 600³ voxels of 5 mm at 120 sweeps a second: time per sweep.
//!
//!     cargo bench -p lab --bench rolling
//!
//! A corner reflector at 1 m depth in a 3 m cube, preset `fine`, 20 dB, a 50 cm sphere, window of
//! 200 sweeps, 30 s. At the end the image is compared with a fresh search over the window: same
//! voxels, same values. Each row gives the share of the peak above which voxels are kept, and the
//! permitted opening work per sweep; then the share above which no voxel was missing.

use std::time::Instant;

use a121::preset;
use glam::DVec3;
use radar_mapping::{ObserverSettings, observe_all};
use radar_sar::HistorySettings;
use radar_sar::backprojection::{BrickGrid, RollingImage, RollingSettings, RollingSize, Threshold, search};
use radar_sar::geometry::Aabb;
use radar_sar::{Beam, Observation};
use radar_simulation::Scenario;

/// Share of the peak; (voxel, sweep) pairs of opening work per sweep.
const TRIALS: [(f64, u64); 4] = [(0.5, 1_200_000), (0.5, 6_000_000), (0.7, 1_200_000), (0.7, 6_000_000)];

fn main() {
    let mut scenario = Scenario::new("corner-reflector", "sphere-50cm", preset("fine").expect("a preset"), 30.0, 1);
    scenario.snr_db = Some(20.0);
    let simulated = scenario.run().expect("a known scene and motion");
    let observer = ObserverSettings {
        history: HistorySettings::default(),
        head_from_sensor: scenario.head_from_sensor,
        time_offset_s: 0.0,
        range_bias_m: None,
    };
    let (all, _) = observe_all(&scenario.config, observer, &simulated.frames, &simulated.poses);
    for (share_of_peak, max_opening) in TRIALS {
        roll(&all, RollingSettings { share_of_peak, max_opening, ..Default::default() });
    }
    println!("peak memory {} MB", peak_memory_mb());
}

fn roll(all: &[Observation], settings: RollingSettings) {
    let middle = DVec3::new(0.0, 1.5, -1.5);
    let grid = BrickGrid::covering(&Aabb { min: middle - 1.5, max: middle + 1.5 }, 0.005);
    let mut image =
        RollingImage::new(settings, &Beam::Lensless, &[all[0].geometry.clone()], &grid).expect("sound settings");
    let (mut times_ms, mut exact_from) = (Vec::new(), Vec::new());
    let (mut complete, mut rolled, mut most) = (0, 0, RollingSize::default());
    let cpu_before_s = cpu_s();
    for observation in all {
        let start = Instant::now();
        image.push(observation).expect("sound sweeps");
        times_ms.push(start.elapsed().as_secs_f64() * 1e3);
        complete += usize::from(image.is_complete());
        if times_ms.len() >= settings.min_sweeps {
            exact_from.push(f64::from(image.exact_from() / image.threshold()) * settings.share_of_peak);
        }
        let kept = image.kept();
        rolled += kept.rolling_bricks;
        most.cubes = most.cubes.max(kept.cubes);
        most.rolling_bricks = most.rolling_bricks.max(kept.rolling_bricks);
        most.idle_bricks = most.idle_bricks.max(kept.idle_bricks);
    }
    let cpu_ms = (cpu_s() - cpu_before_s) * 1e3 / all.len() as f64;
    let work = image.work();
    let rate = work.updates as f64 / times_ms.iter().sum::<f64>() * 1e-3;
    times_ms.sort_by(f64::total_cmp);
    exact_from.sort_by(f64::total_cmp);
    let at = |share: f64| times_ms[(times_ms.len() as f64 * share) as usize];
    let exact = |share: f64| exact_from[(exact_from.len() as f64 * share) as usize];
    let fresh = search(image.stack(), &grid, Threshold::Value(image.threshold()));
    let wanted: Vec<_> = fresh.voxels.into_iter().filter(|v| v.1 >= image.exact_from()).collect();
    let equal = image.voxels() == wanted;
    println!(
        "sums/rolling/ls/{}^3x{}/from {} of the peak/at most {:.1} M opened: median {:.2} ms, p99 {:.2} ms, greatest {:.2} ms, \
         {cpu_ms:.2} ms of CPU per sweep; complete after {complete} of {} sweeps; exact from {:.2} of the peak on (median), \
         {:.2} (p90), {:.2} (p99); equal to a fresh search at the end: {equal}; {} bricks \
         rolling on average, at most {}, {} idle, {} cubes; per sweep {:.0} bricks opened, {:.0} caught up, {:.2} M updates, \
         {:.2} M bounds; {rate:.0} M updates/s",
        grid.size[0],
        settings.window,
        settings.share_of_peak,
        settings.max_opening as f64 * 1e-6,
        at(0.5),
        at(0.99),
        times_ms[times_ms.len() - 1],
        all.len(),
        exact(0.5),
        exact(0.9),
        exact(0.99),
        rolled / all.len(),
        most.rolling_bricks,
        most.idle_bricks,
        most.cubes,
        work.opened as f64 / all.len() as f64,
        work.caught_up as f64 / all.len() as f64,
        work.updates as f64 / all.len() as f64 * 1e-6,
        work.bounds as f64 / all.len() as f64 * 1e-6,
    );
}

/// Processor time of the whole process, seconds; 0 where the system does not report it.
fn cpu_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    let ticks = after_name.split_whitespace().skip(11).take(2).filter_map(|n| n.parse::<f64>().ok());
    ticks.sum::<f64>() / 100.0
}

/// Peak memory of the whole process, MB; 0 where the system does not report it.
fn peak_memory_mb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with("VmHWM:")).unwrap_or_default();
    line.split_whitespace().nth(1).and_then(|kb| kb.parse::<u64>().ok()).unwrap_or(0) / 1024
}

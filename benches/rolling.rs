//! A rolling image of 600³ voxels of 5 mm at 120 sweeps a second: time for each sweep.
//!
//!     cargo bench --bench rolling
//!
//! A corner reflector 1 m deep in a 3 m cube, preset `fine`, 20 dB, a 50 cm sphere, window of 200 sweeps, 30 s. At the end
//! the image is compared with a fresh search over the window: same voxels, same values.

use std::time::Instant;

use glam::DVec3;
use radar_chaperone::geometry::Aabb;
use radar_chaperone::imaging::Statistic;
use radar_chaperone::imaging::sums::{BrickGrid, RollingImage, RollingSettings, Threshold, search};
use radar_chaperone::radar::{Beam, preset};
use radar_chaperone::simulation::Scenario;
use radar_chaperone::tracking::{HistorySettings, ObserverSettings, observe_all};

fn main() {
    for (statistic, voxel_m) in [(Statistic::Ls, 0.005)] {
        let mut scenario = Scenario::new("corner-reflector", "sphere-50cm", preset("fine").expect("a preset"), 30.0, 1);
        scenario.snr_db = Some(20.0);
        let simulated = scenario.run().expect("a known scene and motion");
        let observer = ObserverSettings {
            history: HistorySettings::default(),
            head_from_sensor: scenario.head_from_sensor,
            time_offset_s: 0.0,
        };
        let (all, _) = observe_all(&scenario.config, observer, &simulated.frames, &simulated.poses);
        let middle = DVec3::new(0.0, 1.5, -1.5);
        let grid = BrickGrid::covering(&Aabb { min: middle - 1.5, max: middle + 1.5 }, voxel_m);
        let settings = RollingSettings { statistic, ..Default::default() };
        let mut image =
            RollingImage::new(settings, &Beam::Lensless, &[all[0].geometry.clone()], &grid).expect("sound settings");
        let (mut times_ms, mut complete) = (Vec::new(), 0);
        let (mut cubes, mut bricks) = (0, 0);
        let cpu_before_s = cpu_s();
        for observation in &all {
            let start = Instant::now();
            image.push(observation).expect("sound sweeps");
            times_ms.push(start.elapsed().as_secs_f64() * 1e3);
            complete += usize::from(image.is_complete());
            (cubes, bricks) = (cubes.max(image.alive().0), bricks.max(image.alive().1));
        }
        let work = image.work();
        let cpu_ms = (cpu_s() - cpu_before_s) * 1e3 / all.len() as f64;
        let rate = work.updates as f64 / times_ms.iter().sum::<f64>() * 1e-3;
        times_ms.sort_by(f64::total_cmp);
        let at = |share: f64| times_ms[(times_ms.len() as f64 * share) as usize];
        let fresh = search(image.stack(), &grid, Threshold::Value(image.threshold()));
        println!(
            "sums/rolling/{}/{}^3x200: median {:.2} ms, p99 {:.2} ms, greatest {:.2} ms, {cpu_ms:.2} ms of one core a sweep; at most {cubes} cubes, {bricks} \
             bricks; {:.0} M updates/s; carried over {}; complete after {complete} of {} sweeps and at the end {}, equal to fresh {}; peak memory {} MB",
            statistic.name(),
            grid.size[0],
            at(0.5),
            at(0.99),
            times_ms[times_ms.len() - 1],
            rate,
            work.carried_over,
            all.len(),
            image.is_complete(),
            fresh.voxels == image.voxels(),
            peak_memory_mb(),
        );
    }
}

/// Processor time of the whole process, seconds; 0 where the system does not tell.
fn cpu_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    let ticks = after_name.split_whitespace().skip(11).take(2).filter_map(|n| n.parse::<f64>().ok());
    ticks.sum::<f64>() / 100.0
}

/// Of the whole process, as the system tells; 0 where it does not.
fn peak_memory_mb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with("VmHWM:")).unwrap_or_default();
    line.split_whitespace().nth(1).and_then(|kb| kb.parse::<u64>().ok()).unwrap_or(0) / 1024
}

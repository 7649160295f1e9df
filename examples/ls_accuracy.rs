//! How well a single reflector is placed from range alone: the thesis' motions, 20 dB at 1 m, 20 seeds each.
//!
//!     cargo run --release --example ls_accuracy -- [without=jitter|wander|rotation|mount|all]
//!
//! For each motion and number of sweeps: median and 95th percentile of the distance to the truth, reflectors reported
//! beyond the one there is, and the normalised squared error dᵀ C⁻¹ d, whose mean is 3 when the covariance is honest.
//! `without` takes one kind of tracking error out, to see what it costs.

use std::time::Instant;

use glam::DVec3;
use radar_chaperone::geometry::Aabb;
use radar_chaperone::imaging::PositionErrors;
use radar_chaperone::obstacles::{Obstacle, ReflectorSettings, find_reflectors};
use radar_chaperone::radar::{Beam, preset};
use radar_chaperone::simulation::{Scenario, TrackingErrors};
use radar_chaperone::tracking::{HistorySettings, ObserverSettings, observe_all};

/// Motions and sweeps used; 0: all.
const TRIALS: [(&str, usize); 7] = [
    ("sphere-50cm", 50),
    ("sphere-10cm", 50),
    ("sphere-50cm", 0),
    ("sphere-10cm", 0),
    ("stationary", 50),
    ("x-50cm", 50),
    ("approach-1.0", 50),
];
const SEEDS: u64 = 20;

fn main() {
    let without = std::env::args().nth(1).unwrap_or_default();
    for (motion, sweeps) in TRIALS {
        let start = Instant::now();
        let (mut errors_mm, mut normalised, mut extra) = (Vec::new(), Vec::new(), 0);
        for seed in 0..SEEDS {
            let (found, truth) = trial(motion, sweeps, seed, &without);
            extra += found.len().saturating_sub(1);
            if let Some(best) = found.first() {
                let off = best.position_m - truth;
                errors_mm.push(off.length() * 1e3);
                normalised.push(off.dot(best.covariance_m2.inverse() * off));
            }
        }
        errors_mm.sort_by(f64::total_cmp);
        let quantile = |share: f64| {
            let at = (errors_mm.len() as f64 * share) as usize;
            errors_mm.get(at.min(errors_mm.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
        };
        println!(
            "{motion}, {sweeps} sweeps: {}/{SEEDS} found, median {:.1} mm, 95 % {:.1} mm, {extra} extra, normalised squared error {:.1}, {:.1} s",
            errors_mm.len(),
            quantile(0.5),
            quantile(0.95),
            normalised.iter().sum::<f64>() / normalised.len() as f64,
            start.elapsed().as_secs_f64()
        );
    }
}

/// What is found, strongest first, and where the reflector is.
fn trial(motion: &str, max_sweeps: usize, seed: u64, without: &str) -> (Vec<Obstacle>, DVec3) {
    let config = preset("fine").expect("a preset");
    let mut scenario = Scenario::new("corner-reflector", motion, config, 10.0, seed);
    scenario.snr_db = Some(20.0);
    match without.strip_prefix("without=") {
        Some("all") => scenario.errors = TrackingErrors::none(),
        Some("mount") => scenario.errors.mount_m = 0.0,
        Some("wander") => scenario.errors.wander_m = 0.0,
        Some("rotation") => scenario.errors.rotation_deg = 0.0,
        Some("jitter") => scenario.errors.jitter_m = 0.0,
        _ => {}
    }
    let simulated = scenario.run().expect("a known scene and motion");
    let observer = ObserverSettings {
        history: HistorySettings::default(),
        head_from_sensor: scenario.head_from_sensor,
        time_offset_s: 0.0,
    };
    let (observations, _) = observe_all(&scenario.config, observer, &simulated.frames, &simulated.poses);
    let middle = DVec3::new(0.0, 1.5, -1.5);
    let region = Aabb { min: middle - 1.5, max: middle + 1.5 };
    let settings = ReflectorSettings { max_sweeps, ..Default::default() };
    let found = find_reflectors(&observations, &Beam::Lensless, &region, &settings, &PositionErrors::default());
    (found, simulated.truth.obstacles[0].points_m[0])
}

//! Two reflectors 20 cm apart across range, and a single one that must not be split.
//!
//!     cargo run --release -p lab --example pairs -- calibrate|verify|split [seeds=FIRST..END]
//!
//! `calibrate` (seeds 0..20): for one corner reflector, over motions, numbers of sweeps and SNR,
//! the largest gain of a second one as a share of the first one's power and in standard deviations
//! of noise; for the pair, the smallest. The threshold in `radar-sar`'s `refine/pair.rs` lies
//! between.
//!
//! `split` (seeds 100..300): how often one reflector is reported as more than one by the whole
//! search.
//!
//! `verify` (seeds 100..140): the pair through the whole search: how often two are found, median
//! and 95th percentile of each one's distance to its truth, and the normalised squared error (3
//! when covariances are consistent).

use std::ops::Range;

use a121::preset;
use glam::DVec3;
use radar_mapping::{ObserverSettings, observe_all};
use radar_mapping::{Obstacle, ReflectorSettings, find_reflectors};
use radar_sar::HistorySettings;
use radar_sar::geometry::Aabb;
use radar_sar::{Beam, Observation};
use radar_sar::{PositionErrors, RangePower, best_pair, farthest_points, refine};
use radar_simulation::Scenario;

const MOTIONS: [&str; 4] = ["sphere-50cm", "sphere-10cm", "x-50cm", "approach-1.0"];

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let seeds = |first: u64, end: u64| -> Range<u64> {
        let given = arguments.iter().find_map(|a| a.strip_prefix("seeds=")?.split_once(".."));
        given.map_or(first..end, |(a, b)| a.parse().expect("a seed")..b.parse().expect("a seed"))
    };
    match arguments.first().map(String::as_str) {
        Some("calibrate") => calibrate(&seeds(0, 20)),
        Some("split") => split(&seeds(100, 300)),
        Some("verify") => verify(&seeds(100, 140)),
        _ => eprintln!("calibrate, split or verify: see the head of this file"),
    }
}

/// Observations of a scene and its true positions.
fn recorded(scene: &str, motion: &str, snr_db: f64, seed: u64) -> (Vec<Observation>, Vec<DVec3>) {
    let config = preset("fine").expect("a preset");
    let mut scenario = Scenario::new(scene, motion, config, 10.0, seed);
    scenario.snr_db = Some(snr_db);
    let simulated = scenario.run().expect("a known scene and motion");
    let observer = ObserverSettings {
        history: HistorySettings::default(),
        head_from_sensor: scenario.head_from_sensor,
        time_offset_s: 0.0,
    };
    let (observations, _) = observe_all(&scenario.config, observer, &simulated.frames, &simulated.poses);
    (observations, simulated.truth.obstacles.iter().map(|o| o.points_m[0]).collect())
}

fn chosen(observations: &[Observation], count: usize) -> Vec<Observation> {
    let positions: Vec<DVec3> = observations.iter().map(|o| o.tracking_from_sensor.translation).collect();
    let count = if count == 0 { positions.len() } else { count };
    farthest_points(&positions, count).into_iter().map(|n| observations[n].clone()).collect()
}

fn calibrate(seeds: &Range<u64>) {
    println!(
        "scene             motion        sweeps  dB   gain / power: median, extreme    gain in sigmas: median, extreme"
    );
    for (scene, largest) in [("corner-reflector", true), ("pair", false)] {
        for motion in MOTIONS {
            for sweeps in [50, 200, 0] {
                for snr_db in [10.0, 20.0, 30.0, 40.0] {
                    let (mut shares, mut sigmas) = (Vec::new(), Vec::new());
                    for seed in seeds.clone() {
                        let (observations, truth) = recorded(scene, motion, snr_db, seed);
                        let used = chosen(&observations, sweeps);
                        let power = RangePower::new(&used, &Beam::Lensless, 0.15);
                        let Some(one) = refine(&power, truth[0], None, &PositionErrors::default()) else { continue };
                        let Some(fit) = best_pair(&power, &one) else { continue };
                        shares.push(fit.gain / fit.single);
                        sigmas.push(fit.gain / (2.0 * fit.sweeps as f64).sqrt());
                    }
                    let said = |mut values: Vec<f64>| {
                        values.sort_by(f64::total_cmp);
                        let extreme = if largest { values.last() } else { values.first() };
                        (
                            values.get(values.len() / 2).copied().unwrap_or(f64::NAN),
                            extreme.copied().unwrap_or(f64::NAN),
                        )
                    };
                    let ((share, share_extreme), (sigma, sigma_extreme)) = (said(shares), said(sigmas));
                    println!(
                        "{scene:17} {motion:13} {sweeps:>6} {snr_db:>3.0} {share:>20.4} {share_extreme:>8.4} {sigma:>24.1} {sigma_extreme:>8.1}"
                    );
                }
            }
        }
    }
}

fn found(observations: &[Observation], truth: DVec3, max_sweeps: usize) -> Vec<Obstacle> {
    let region = Aabb { min: truth - 0.5, max: truth + 0.5 };
    let settings = ReflectorSettings { max_sweeps, ..Default::default() };
    find_reflectors(observations, &Beam::Lensless, &region, &settings, &PositionErrors::default())
}

fn split(seeds: &Range<u64>) {
    println!("motion        sweeps  dB   more than one / seeds");
    for motion in MOTIONS {
        for (sweeps, snr_db) in [(50, 20.0), (200, 20.0), (200, 30.0), (200, 40.0), (0, 20.0)] {
            let more = |seed: &u64| {
                let (observations, truth) = recorded("corner-reflector", motion, snr_db, *seed);
                found(&observations, truth[0], sweeps).len() > 1
            };
            let count = seeds.clone().filter(more).count();
            println!("{motion:13} {sweeps:>6} {snr_db:>3.0}   {count}/{}", seeds.end - seeds.start);
        }
    }
}

fn verify(seeds: &Range<u64>) {
    println!("motion        sweeps  dB   two found   median mm    95 %   NEES");
    for (motion, sweeps, snr_db) in [
        ("sphere-50cm", 50, 20.0),
        ("sphere-50cm", 200, 20.0),
        ("sphere-50cm", 50, 30.0),
        ("sphere-50cm", 200, 30.0),
        ("sphere-50cm", 0, 20.0),
        ("sphere-10cm", 200, 20.0),
        ("sphere-10cm", 200, 30.0),
    ] {
        let (mut errors_mm, mut normalised, mut two) = (Vec::new(), Vec::new(), 0);
        for seed in seeds.clone() {
            let (observations, truth) = recorded("pair", motion, snr_db, seed);
            let found = found(&observations, (truth[0] + truth[1]) * 0.5, sweeps);
            two += usize::from(found.len() == 2);
            for at in &truth {
                let nearest =
                    |a: &&Obstacle, b: &&Obstacle| a.position_m.distance(*at).total_cmp(&b.position_m.distance(*at));
                let Some(obstacle) = found.iter().min_by(nearest) else { continue };
                let off = obstacle.position_m - *at;
                errors_mm.push(off.length() * 1e3);
                normalised.push(off.dot(obstacle.covariance_m2.inverse() * off));
            }
        }
        errors_mm.sort_by(f64::total_cmp);
        let quantile =
            |share: f64| errors_mm.get((errors_mm.len() as f64 * share) as usize).copied().unwrap_or(f64::NAN);
        println!(
            "{motion:13} {sweeps:>6} {snr_db:>3.0}   {two:>4}/{:<4} {:>10.1} {:>8.1} {:>6.2}",
            seeds.end - seeds.start,
            quantile(0.5),
            quantile(0.95),
            normalised.iter().sum::<f64>() / normalised.len().max(1) as f64
        );
    }
}

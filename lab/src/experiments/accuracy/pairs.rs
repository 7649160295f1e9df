//! Two reflectors 20 cm apart across range, and a single one that must not be split.

use std::ops::Range;

use a121::preset;
use glam::DVec3;
use rayon::prelude::*;

use super::{mean, quantile};
use radar_chaperone::report::Table;
use radar_mapping::{ObserverSettings, observe_all};
use radar_mapping::{Obstacle, ReflectorSettings, find_reflectors};
use radar_sar::HistorySettings;
use radar_sar::geometry::Aabb;
use radar_sar::{Beam, Observation};
use radar_sar::{PositionErrors, RangePower, best_pair, farthest_points, refine};
use radar_simulation::Scenario;

const MOTIONS: [&str; 4] = ["sphere-50cm", "sphere-10cm", "x-50cm", "approach-1.0"];

/// For one corner reflector the largest gain of a second one, for the pair the smallest: the
/// threshold in `radar-sar`'s `refine/pair.rs` lies between.
pub fn pair_calibration(seeds: &Range<u64>) -> Table {
    let mut rows = Vec::new();
    for (scene, is_largest) in [("corner-reflector", true), ("pair", false)] {
        for motion in MOTIONS {
            for sweeps in [50, 200, 0] {
                for snr_db in [10.0, 20.0, 30.0, 40.0] {
                    let seeds: Vec<u64> = seeds.clone().collect();
                    let gains = seeds.par_iter().filter_map(|seed| gain(scene, motion, sweeps, snr_db, *seed));
                    let (mut shares, mut sigmas): (Vec<f64>, Vec<f64>) = gains.collect::<Vec<_>>().into_iter().unzip();
                    let extreme = if is_largest { 1.0 } else { 0.0 };
                    rows.push(vec![
                        scene.to_owned(),
                        motion.to_owned(),
                        counted(sweeps),
                        format!("{snr_db:.0}"),
                        format!("{:.4}", quantile(&mut shares, 0.5)),
                        format!("{:.4}", quantile(&mut shares, extreme)),
                        format!("{:.1}", quantile(&mut sigmas, 0.5)),
                        format!("{:.1}", quantile(&mut sigmas, extreme)),
                    ]);
                }
            }
        }
    }
    let head = ["scene", "motion", "sweeps", "SNR (dB)", "gain / power", "extreme", "gain (σ)", "extreme"];
    let caption = "gain: what a second reflector adds, over the first one's power and in standard deviations of \
        noise; median, and the largest of one reflector, the smallest of a pair.";
    Table { head: head.map(str::to_owned).to_vec(), rows, caption: caption.into() }
}

/// Gain of a second reflector as a share of the first one's power and in standard deviations of
/// noise.
fn gain(scene: &str, motion: &str, sweeps: usize, snr_db: f64, seed: u64) -> Option<(f64, f64)> {
    let (observations, truth) = recorded(scene, motion, snr_db, seed);
    let used = chosen(&observations, sweeps);
    let power = RangePower::new(&used, &Beam::Lensless, 0.15);
    let one = refine(&power, truth[0], None, &PositionErrors::default())?;
    let fit = best_pair(&power, &one)?;
    Some((fit.gain / fit.single, fit.gain / (2.0 * fit.sweeps as f64).sqrt()))
}

/// How often one reflector is reported as more than one by the whole search.
pub fn split_table(seeds: &Range<u64>) -> Table {
    let mut rows = Vec::new();
    for motion in MOTIONS {
        for (sweeps, snr_db) in [(50, 20.0), (200, 20.0), (200, 30.0), (200, 40.0), (0, 20.0)] {
            let is_split = |seed: &u64| {
                let (observations, truth) = recorded("corner-reflector", motion, snr_db, *seed);
                found(&observations, truth[0], sweeps).len() > 1
            };
            let seeds: Vec<u64> = seeds.clone().collect();
            let count = seeds.par_iter().filter(|seed| is_split(seed)).count();
            rows.push(vec![
                motion.to_owned(),
                counted(sweeps),
                format!("{snr_db:.0}"),
                format!("{count} of {}", seeds.len()),
            ]);
        }
    }
    let head = ["motion", "sweeps", "SNR (dB)", "reported as more than one"];
    Table { head: head.map(str::to_owned).to_vec(), rows, caption: String::new() }
}

/// The pair through the whole search.
pub fn pair_table(seeds: &Range<u64>) -> Table {
    let trials = [
        ("sphere-50cm", 50, 20.0),
        ("sphere-50cm", 200, 20.0),
        ("sphere-50cm", 50, 30.0),
        ("sphere-50cm", 200, 30.0),
        ("sphere-50cm", 0, 20.0),
        ("sphere-10cm", 200, 20.0),
        ("sphere-10cm", 200, 30.0),
    ];
    let row = |(motion, sweeps, snr_db): (&str, usize, f64)| {
        let seeds: Vec<u64> = seeds.clone().collect();
        let pairs: Vec<(bool, Vec<[f64; 2]>)> =
            seeds.par_iter().map(|seed| pair_errors(motion, sweeps, snr_db, *seed)).collect();
        let mut errors_mm: Vec<f64> = pairs.iter().flat_map(|(_, errors)| errors).map(|[mm, _]| *mm).collect();
        vec![
            motion.to_owned(),
            counted(sweeps),
            format!("{snr_db:.0}"),
            format!("{} of {}", pairs.iter().filter(|(both, _)| *both).count(), pairs.len()),
            format!("{:.1}", quantile(&mut errors_mm, 0.5)),
            format!("{:.1}", quantile(&mut errors_mm, 0.95)),
            format!("{:.2}", mean(pairs.iter().flat_map(|(_, errors)| errors).map(|[_, normalised]| *normalised))),
        ]
    };
    let head = ["motion", "sweeps", "SNR (dB)", "two found", "median (mm)", "95 % (mm)", "NEES"];
    let caption = "Errors: from each reflector to the nearest report. NEES: 3 when covariances are consistent.";
    Table { head: head.map(str::to_owned).to_vec(), rows: trials.map(row).to_vec(), caption: caption.into() }
}

/// Whether two were found, and of each reflector the error, mm, and the normalised squared error.
fn pair_errors(motion: &str, sweeps: usize, snr_db: f64, seed: u64) -> (bool, Vec<[f64; 2]>) {
    let (observations, truth) = recorded("pair", motion, snr_db, seed);
    let found = found(&observations, (truth[0] + truth[1]) * 0.5, sweeps);
    let error = |at: &DVec3| {
        let distance_m = |obstacle: &Obstacle| obstacle.position_m.distance(*at);
        let nearest = found.iter().min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)))?;
        let off = nearest.position_m - *at;
        Some([off.length() * 1e3, off.dot(nearest.covariance_m2.inverse() * off)])
    };
    (found.len() == 2, truth.iter().filter_map(error).collect())
}

fn counted(sweeps: usize) -> String {
    if sweeps == 0 { "all".into() } else { sweeps.to_string() }
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
        range_bias_m: None,
    };
    let (observations, _) = observe_all(&scenario.config, observer, &simulated.frames, &simulated.poses);
    (observations, simulated.truth.obstacles.iter().map(|o| o.points_m[0]).collect())
}

fn chosen(observations: &[Observation], count: usize) -> Vec<Observation> {
    let positions: Vec<DVec3> = observations.iter().map(|o| o.tracking_from_sensor.translation).collect();
    let count = if count == 0 { positions.len() } else { count };
    farthest_points(&positions, count).into_iter().map(|n| observations[n].clone()).collect()
}

fn found(observations: &[Observation], truth: DVec3, max_sweeps: usize) -> Vec<Obstacle> {
    let region = Aabb { min: truth - 0.5, max: truth + 0.5 };
    let settings = ReflectorSettings { max_sweeps, ..Default::default() };
    find_reflectors(observations, &Beam::Lensless, &region, &settings, &PositionErrors::default())
}

//! Selection of sweeps: how accurately a corner reflector is located from a few sweeps, by
//! selection method.
//!
//!     cargo run --release -p lab --example selection -- [FIRST..END] [MOTION]
//!
//! 20 dB at 1 m, default tracking errors, motion sphere-50cm by default, 10 s at 120 sweeps per
//! second, seeds 100..130. For each selection and number of sweeps: median / 95th percentile of the
//! 3-D error, millimetres, of the refined position that `ls` finds in a 3 m cube. `thesis-hull` may
//! keep fewer sweeps than requested: the mean number kept is in brackets.

use a121::preset;
use glam::DVec3;
use radar_mapping::{ObserverSettings, observe_all};
use radar_mapping::{ReflectorSettings, find_reflectors};
use radar_sar::HistorySettings;
use radar_sar::geometry::Aabb;
use radar_sar::{Beam, Candidate, Observation};
use radar_sar::{PositionErrors, Selection};
use radar_simulation::Scenario;

const COUNTS: [usize; 4] = [5, 10, 20, 50];

fn main() {
    let (mut seeds, mut motion) = (100..130, "sphere-50cm".to_string());
    for argument in std::env::args().skip(1) {
        match argument.split_once("..") {
            Some((first, end)) => seeds = first.parse().expect("a seed")..end.parse().expect("a seed"),
            None => motion = argument,
        }
    }
    let recordings: Vec<(u64, Vec<Observation>, DVec3)> = seeds.map(|seed| recording(&motion, seed)).collect();
    println!("{motion}, {} seeds, median/p95 in mm (sweeps kept)", recordings.len());
    println!("{:16}{}", "", COUNTS.map(|n| format!("{:>22}", format!("N = {n}"))).concat());
    for selection in Selection::ALL {
        let cells = COUNTS.map(|count| {
            cell(&recordings, |all, seed| {
                let candidates: Vec<Candidate> = all.iter().map(Candidate::from).collect();
                selection.choose(&candidates, count, middle(), seed)
            })
        });
        println!("{:16}{}", selection.name(), cells.concat());
    }
    let all = cell(&recordings, |all, _| (0..all.len()).collect());
    println!("{:16}{all}", "all");
}

/// Observations of one recording, and the reflector's position.
fn recording(motion: &str, seed: u64) -> (u64, Vec<Observation>, DVec3) {
    let mut scenario = Scenario::new("corner-reflector", motion, preset("fine").expect("a preset"), 10.0, seed);
    scenario.snr_db = Some(20.0);
    let simulated = scenario.run().unwrap_or_else(|error| panic!("{error}"));
    let observer = ObserverSettings {
        history: HistorySettings::default(),
        head_from_sensor: scenario.head_from_sensor,
        time_offset_s: 0.0,
        range_bias_m: None,
    };
    let (observations, _) = observe_all(&scenario.config, observer, &simulated.frames, &simulated.poses);
    (seed, observations, simulated.truth.obstacles[0].points_m[0])
}

/// Centre of the searched cube.
fn middle() -> DVec3 {
    DVec3::new(0.0, 1.5, -1.5)
}

fn cell(recordings: &[(u64, Vec<Observation>, DVec3)], choose: impl Fn(&[Observation], u64) -> Vec<usize>) -> String {
    let region = Aabb { min: middle() - 1.5, max: middle() + 1.5 };
    let (settings, errors) = (ReflectorSettings::default(), PositionErrors::default());
    let (mut errors_mm, mut kept) = (Vec::new(), 0);
    for (seed, all, truth) in recordings {
        let chosen: Vec<Observation> = choose(all, *seed).into_iter().map(|n| all[n].clone()).collect();
        kept += chosen.len();
        let found = find_reflectors(&chosen, &Beam::Lensless, &region, &settings, &errors);
        // No detection counts as an infinite error.
        errors_mm.push(found.first().map_or(f64::INFINITY, |o| o.position_m.distance(*truth) * 1e3));
    }
    errors_mm.sort_by(f64::total_cmp);
    let quantile = |share: f64| errors_mm[((errors_mm.len() as f64 * share) as usize).min(errors_mm.len() - 1)];
    let kept = kept as f64 / recordings.len() as f64;
    format!("{:>22}", format!("{:.1}/{:.1} ({kept:.0})", quantile(0.5), quantile(0.95)))
}

//! Detection of furniture and false reports in simulated rooms.
//!
//!     cargo run --release -p lab --example rooms -- [FIRST..END] [SCENE] [--each] \
//!         [--poses-hz=250] [rooms.explain.min_score=3 …]
//!
//! Runs 30 s with preset d16 through the whole mapper for every seed and scores the scene against
//! the truth, as `replay` does. Objects that came within 1 m are due. Found: a report within 10 cm
//! of one of their points. False: a report farther than 25 cm from every point and wall. In
//! brackets: only objects that were in the beam for 0.75 s. Settings are named as in `--set`;
//! `--each` prints every score in full.

use radar_mapping::in_time_order;
use std::time::Instant;

use a121::preset;
use radar_chaperone::report::{Limits, Score, score};
use radar_chaperone::settings::Settings;
use radar_mapping::Mapper;
use radar_simulation::Scenario;

const DURATION_S: f64 = 30.0;
/// Minimum time in the beam before an object counts, seconds. Choice.
const SEEN_S: f64 = 0.75;

fn main() {
    let (mut seeds, mut scene, mut each, mut changes) = (0..4, "furnished-room".to_string(), false, Vec::new());
    let mut poses_hz = None;
    for argument in std::env::args().skip(1) {
        match argument.split_once("..") {
            Some((first, end)) => seeds = first.parse().expect("a seed")..end.parse().expect("a seed"),
            None if argument.starts_with("--poses-hz=") => poses_hz = argument[11..].parse().ok(),
            None if argument.contains('=') => changes.push(argument),
            None if argument == "--each" => each = true,
            None => scene = argument,
        }
    }
    let settings = Settings::from_toml("", &changes).unwrap_or_else(|error| panic!("{error}"));
    let (mut scores, start) = (Vec::new(), Instant::now());
    for seed in seeds {
        let score = play(&scene, seed, poses_hz, &settings);
        println!("seed {seed}: {}", line(std::slice::from_ref(&score)));
        if each {
            println!("{score}\n");
        }
        scores.push(score);
    }
    println!("all: {}, {:.1} s a run", line(&scores), start.elapsed().as_secs_f64() / scores.len().max(1) as f64);
}

fn play(scene: &str, seed: u64, poses_hz: Option<f64>, settings: &Settings) -> Score {
    let mut scenario = Scenario::new(scene, "natural", preset("d16").expect("d16 exists"), DURATION_S, seed);
    scenario.errors.rate_hz = poses_hz.unwrap_or(scenario.errors.rate_hz);
    let simulated = scenario.run().unwrap_or_else(|error| panic!("{error}"));
    let mut mapper = Mapper::new(&scenario.config, &scenario.head_from_sensor, &settings.mapping());
    mapper.push_all(in_time_order(simulated.frames, simulated.poses));
    score(&mapper.scene(), &simulated.truth, &Limits::default())
}

fn line(scores: &[Score]) -> String {
    let sum = |of: fn(&Score) -> usize| scores.iter().map(of).sum::<usize>();
    let mut errors: Vec<f64> =
        scores.iter().flat_map(|s| &s.obstacles).filter(|o| o.due).filter_map(|o| o.nearest_report_m).collect();
    errors.sort_by(f64::total_cmp);
    let median_m = errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN);
    format!(
        "found {} of {} due ({} of {} in the beam ≥ 0.75 s), false {} of {} reports, at walls {}; walls found {} of \
         {}, false {}; median error {:.0} mm",
        sum(|s| s.due_found),
        sum(|s| s.due),
        sum(|s| s.obstacles.iter().filter(|o| o.due && o.in_beam_s >= SEEN_S && o.found).count()),
        sum(|s| s.obstacles.iter().filter(|o| o.due && o.in_beam_s >= SEEN_S).count()),
        sum(|s| s.false_reports),
        sum(|s| s.reports),
        sum(|s| s.wall_reports),
        sum(|s| s.walls_found),
        sum(|s| s.walls),
        sum(|s| s.walls_false),
        median_m * 1000.0
    )
}

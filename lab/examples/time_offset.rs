//! Accuracy of the estimated time offset between the pose stream and the sweep stream, and the
//! benefit of correcting it.
//!
//!     cargo run --release -p lab --example time_offset -- \
//!         [FIRST..END] [SCENE or MOTION …] [rooms]
//!
//! First table: a corner reflector (20 dB at 1 m, 120 sweeps per second, default tracking errors),
//! −20, 0 and +20 ms between the streams, seeds 100..120. For each motion and each time since the
//! recording began: median / 95th percentile of the error, median of the stated 1σ, the normalised
//! squared error (error/1σ)², 1 on average when the 1σ is consistent, and the share of recordings
//! in which the offset is reported as observable. Errors of unobservable offsets count too. Names
//! restrict the table to these scenes or motions. straight-0.3 moves straight ahead at constant
//! speed and must be unobservable; approach-1.0 accelerates and brakes and is observable. Furnished
//! rooms and single objects (preset d16) follow.
//!
//! Second table: the reflector's error with 20 ms between the streams, uncorrected and estimated,
//! and without offset. With `rooms`, the same for furnished rooms of 30 s (takes minutes).

use a121::preset;
use radar_chaperone::report::{Limits, score};
use radar_chaperone::settings::Settings;
use radar_mapping::Mapper;
use radar_mapping::in_time_order;
use radar_sar::TimeOffset;
use radar_simulation::{Scenario, Simulated};

/// Scene, motion, preset, and times at which the estimate is read, seconds.
type Trial = (&'static str, &'static str, &'static str, [f64; 3]);
const TRIALS: [Trial; 12] = [
    ("corner-reflector", "sphere-50cm", "fine", [1.0, 2.0, 5.0]),
    ("corner-reflector", "sphere-10cm", "fine", [1.0, 2.0, 5.0]),
    ("corner-reflector", "x-50cm", "fine", [1.0, 2.0, 5.0]),
    ("corner-reflector", "approach-1.0", "fine", [0.5, 1.0, 2.0]),
    ("corner-reflector", "straight-0.3", "fine", [0.5, 1.0, 2.0]),
    ("corner-reflector", "straight-0.3", "d16", [0.5, 1.0, 2.0]),
    ("corner-reflector", "stationary", "fine", [1.0, 2.0, 5.0]),
    ("furnished-room", "natural", "d16", [2.0, 4.0, 8.0]),
    ("empty-room", "natural", "d16", [2.0, 4.0, 8.0]),
    ("chair", "sphere-50cm", "d16", [2.0, 4.0, 8.0]),
    ("clothes-hanger", "sphere-50cm", "d16", [2.0, 4.0, 8.0]),
    ("nothing", "natural", "d16", [2.0, 4.0, 8.0]),
];
const OFFSETS_S: [f64; 3] = [-0.02, 0.0, 0.02];
/// The estimate needs poses up to this long after a time, seconds: its own reach and half the
/// smoothing window.
const POSES_BEHIND_S: f64 = 0.15;

fn main() {
    let (mut seeds, mut rooms, mut names) = (100..120, false, Vec::new());
    for argument in std::env::args().skip(1) {
        match argument.split_once("..") {
            Some((first, end)) => seeds = first.parse().expect("a seed")..end.parse().expect("a seed"),
            None if argument == "rooms" => rooms = true,
            None => names.push(argument),
        }
    }
    println!("{:40}{:>8}{:>16}{:>10}{:>8}{:>12}", "", "after", "|error| ms", "1σ ms", "nees", "observable");
    let wanted =
        |trial: &Trial| names.is_empty() || names.iter().any(|name| [trial.0, trial.1].contains(&name.as_str()));
    for (scene, motion, preset, times_s) in TRIALS.into_iter().filter(wanted) {
        let mut results = times_s.map(|_| Vec::new());
        for (offset_s, seed) in OFFSETS_S.iter().flat_map(|o| seeds.clone().map(move |s| (*o, s))) {
            let (scenario, simulated) = simulated(scene, motion, preset, 10.0, offset_s, seed);
            for (estimate, result) in estimates(&scenario, simulated, times_s).into_iter().zip(&mut results) {
                result.push((estimate, offset_s));
            }
        }
        for (time_s, result) in times_s.iter().zip(&results) {
            println!("{:40}{:>6} s{}", format!("{scene}, {motion}, {preset}"), time_s, row(result));
        }
    }
    if !names.is_empty() {
        return;
    }
    println!("\ncorner-reflector, sphere-50cm, 10 s: position error, median / p95");
    for (offset_s, estimate) in [(0.0, false), (0.02, false), (0.02, true)] {
        let mut errors_mm: Vec<f64> = Vec::new();
        for seed in seeds.clone() {
            let (scenario, simulated) = simulated("corner-reflector", "sphere-50cm", "fine", 10.0, offset_s, seed);
            let truth = simulated.truth.obstacles[0].points_m[0];
            let found = replayed(&scenario, simulated, estimate).scene();
            errors_mm.push(found.obstacles.first().map_or(f64::INFINITY, |o| o.position_m.distance(truth) * 1e3));
        }
        println!("{:28} {:.1} / {:.1} mm", what(offset_s, estimate), at(&mut errors_mm, 0.5), at(&mut errors_mm, 0.95));
    }
    if rooms {
        println!("\nfurnished-room, natural, 30 s, eight seeds");
        for (offset_s, estimate) in [(0.0, false), (0.0, true), (0.02, false), (0.02, true)] {
            println!(
                "{:28} {}",
                what(offset_s, estimate),
                furnished_room_score(seeds.start..seeds.start + 8, offset_s, estimate)
            );
        }
    }
}

fn what(offset_s: f64, estimate: bool) -> String {
    format!("{:2.0} ms, {}", offset_s * 1e3, if estimate { "estimated" } else { "uncorrected" })
}

fn simulated(
    scene: &str,
    motion: &str,
    name: &str,
    duration_s: f64,
    offset_s: f64,
    seed: u64,
) -> (Scenario, Simulated) {
    let mut scenario = Scenario::new(scene, motion, preset(name).expect("a preset"), duration_s, seed);
    scenario.time_offset_s = offset_s;
    scenario.snr_db = (scene == "corner-reflector").then_some(20.0);
    let simulated = scenario.run().unwrap_or_else(|error| panic!("{error}"));
    (scenario, simulated)
}

/// The whole recording through the mapper.
fn replayed(scenario: &Scenario, simulated: Simulated, estimate: bool) -> Mapper {
    let change = format!("tracking.estimate_time_offset={estimate}");
    let settings = Settings::from_toml("", &[change]).unwrap_or_else(|error| panic!("{error}"));
    let mut mapper = Mapper::new(&scenario.config, &scenario.head_from_sensor, &settings.mapping());
    mapper.push_all(in_time_order(simulated.frames, simulated.poses));
    mapper
}

/// Estimates after the given durations of the recording.
fn estimates(scenario: &Scenario, simulated: Simulated, times_s: [f64; 3]) -> [Option<TimeOffset>; 3] {
    let start_s = simulated.frames.first().map_or(0.0, |f| f.host_time_ns as f64 * 1e-9);
    times_s.map(|time_s| {
        let until = |ns: i64, behind_s: f64| (ns as f64) * 1e-9 - start_s <= time_s + behind_s;
        let part = Simulated {
            frames: simulated.frames.iter().filter(|f| until(f.host_time_ns, 0.0)).cloned().collect(),
            poses: simulated.poses.iter().filter(|p| until(p.time_ns, POSES_BEHIND_S)).cloned().collect(),
            truth: simulated.truth.clone(),
        };
        replayed(scenario, part, true).time_offset_estimate()
    })
}

fn row(results: &[(Option<TimeOffset>, f64)]) -> String {
    let told: Vec<(f64, TimeOffset)> = results
        .iter()
        .filter_map(|(estimate, truth)| Some((estimate.as_ref()?.offset_s - truth, (*estimate)?)))
        .collect();
    let mut errors_ms: Vec<f64> = told.iter().map(|(error, _)| error.abs() * 1e3).collect();
    let mut sigmas_ms: Vec<f64> = told.iter().map(|(_, e)| e.sigma_s * 1e3).collect();
    let nees = told.iter().map(|(error, e)| (error / e.sigma_s).powi(2)).sum::<f64>() / told.len() as f64;
    let observable = told.iter().filter(|(_, e)| e.observable).count();
    format!(
        "{:>16}{:>10.2}{:>8.2}{:>12}",
        format!("{:.2} / {:.2}", at(&mut errors_ms, 0.5), at(&mut errors_ms, 0.95)),
        at(&mut sigmas_ms, 0.5),
        nees,
        format!("{observable} of {}", results.len())
    )
}

/// A quantile; NaN without values.
fn at(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = ((values.len() as f64 * share) as usize).min(values.len().saturating_sub(1));
    values.get(n).copied().unwrap_or(f64::NAN)
}

fn furnished_room_score(seeds: std::ops::Range<u64>, offset_s: f64, estimate: bool) -> String {
    let (mut due, mut found, mut wrong, mut reports, mut errors_cm) = (0, 0, 0, 0, Vec::new());
    for seed in seeds {
        let (scenario, simulated) = simulated("furnished-room", "natural", "d16", 30.0, offset_s, seed);
        let truth = simulated.truth.clone();
        let score = score(&replayed(&scenario, simulated, estimate).scene(), &truth, &Limits::default());
        (due, found) = (due + score.due, found + score.due_found);
        (wrong, reports) = (wrong + score.false_reports, reports + score.reports);
        errors_cm.extend(score.median_error_m.map(|m| m * 100.0));
    }
    format!(
        "found {found} of {due} due, false {wrong} of {reports} reports, median error {:.1} cm",
        at(&mut errors_cm, 0.5)
    )
}

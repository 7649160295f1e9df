//! Accuracy of the estimated time offset between the pose stream and the sweep stream, and the
//! benefit of correcting it.

use std::ops::Range;

use a121::preset;
use rayon::prelude::*;

use super::{mean, quantile};
use radar_chaperone::report::{Limits, Table, score};
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
/// Offsets given to the simulated streams, seconds. Choice: none, and in both directions what costs
/// 21 mm uncorrected.
const OFFSETS_S: [f64; 3] = [-0.02, 0.0, 0.02];
/// The estimate needs poses up to this long after a time, seconds. Choice: its own reach and half
/// the smoothing window.
const POSES_BEHIND_S: f64 = 0.15;

/// Errors of the estimate after the given times, one row per scene, motion and time. `names`
/// restricts the table to these scenes or motions.
///
/// # Panics
/// Never: the scenes and motions exist.
pub fn time_offset_table(seeds: &Range<u64>, names: &[String]) -> Table {
    let is_wanted =
        |trial: &Trial| names.is_empty() || names.iter().any(|name| [trial.0, trial.1].contains(&name.as_str()));
    let mut rows = Vec::new();
    for (scene, motion, preset, times_s) in TRIALS.into_iter().filter(is_wanted) {
        let recordings: Vec<(f64, u64)> =
            OFFSETS_S.iter().flat_map(|offset_s| seeds.clone().map(|seed| (*offset_s, seed))).collect();
        let estimated: Vec<[Option<TimeOffset>; 3]> = recordings
            .par_iter()
            .map(|(offset_s, seed)| {
                let (scenario, simulated) = simulated(scene, motion, preset, 10.0, *offset_s, *seed);
                estimates(&scenario, &simulated, times_s)
            })
            .collect();
        for (n, time_s) in times_s.iter().enumerate() {
            let results: Vec<(Option<TimeOffset>, f64)> =
                estimated.iter().zip(&recordings).map(|(each, (offset_s, _))| (each[n], *offset_s)).collect();
            let mut cells = vec![scene.to_owned(), motion.to_owned(), preset.to_owned(), time_s.to_string()];
            cells.extend(row(&results));
            rows.push(cells);
        }
    }
    let head = ["scene", "motion", "preset", "after (s)", "error (ms)", "95 % (ms)", "1σ (ms)", "NEES", "observable"];
    let caption = "−20, 0 and +20 ms between the streams. error: magnitude, median; also where the offset is not \
        observable. 1σ: as reported, median. NEES: (error / 1σ)², 1 on average when the 1σ is consistent. observable: \
        recordings in which the estimate is used; a constant velocity (straight-0.3) and rest must not be.";
    Table { head: head.map(str::to_owned).to_vec(), rows, caption: caption.into() }
}

/// The reflector's position with 20 ms between the streams, uncorrected and estimated, and without
/// offset.
pub fn correction_table(seeds: &Range<u64>) -> Table {
    let row = |(offset_s, estimate): (f64, bool)| {
        let seeds: Vec<u64> = seeds.clone().collect();
        let error_mm = |seed: &u64| {
            let (scenario, simulated) = simulated("corner-reflector", "sphere-50cm", "fine", 10.0, offset_s, *seed);
            let truth = simulated.truth.obstacles[0].points_m[0];
            let found = replayed(&scenario, simulated, estimate).scene();
            found.obstacles.first().map_or(f64::INFINITY, |o| o.position_m.distance(truth) * 1e3)
        };
        let mut errors_mm: Vec<f64> = seeds.par_iter().map(error_mm).collect();
        vec![
            format!("{:.0}", offset_s * 1e3),
            if estimate { "estimated" } else { "uncorrected" }.to_owned(),
            format!("{:.1}", quantile(&mut errors_mm, 0.5)),
            format!("{:.1}", quantile(&mut errors_mm, 0.95)),
        ]
    };
    let head = ["offset (ms)", "offset is", "position error, median (mm)", "95 % (mm)"];
    let rows = [(0.0, false), (0.02, false), (0.02, true)].map(row).to_vec();
    Table { head: head.map(str::to_owned).to_vec(), rows, caption: String::new() }
}

/// The same for eight furnished rooms of 30 s.
pub fn correction_in_rooms(seeds: &Range<u64>) -> Table {
    let row = |(offset_s, estimate): (f64, bool)| {
        vec![
            format!("{:.0}", offset_s * 1e3),
            if estimate { "estimated" } else { "uncorrected" }.to_owned(),
            furnished_room_score(seeds.start..seeds.start + 8, offset_s, estimate),
        ]
    };
    let rows = [(0.0, false), (0.0, true), (0.02, false), (0.02, true)].map(row).to_vec();
    Table { head: ["offset (ms)", "offset is", "score"].map(str::to_owned).to_vec(), rows, caption: String::new() }
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
fn estimates(scenario: &Scenario, simulated: &Simulated, times_s: [f64; 3]) -> [Option<TimeOffset>; 3] {
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

fn row(results: &[(Option<TimeOffset>, f64)]) -> Vec<String> {
    let stated: Vec<(f64, TimeOffset)> = results
        .iter()
        .filter_map(|(estimate, truth)| Some((estimate.as_ref()?.offset_s - truth, (*estimate)?)))
        .collect();
    let mut errors_ms: Vec<f64> = stated.iter().map(|(error, _)| error.abs() * 1e3).collect();
    let mut sigmas_ms: Vec<f64> = stated.iter().map(|(_, e)| e.sigma_s * 1e3).collect();
    let observable = stated.iter().filter(|(_, e)| e.observable).count();
    vec![
        format!("{:.2}", quantile(&mut errors_ms, 0.5)),
        format!("{:.2}", quantile(&mut errors_ms, 0.95)),
        format!("{:.2}", quantile(&mut sigmas_ms, 0.5)),
        format!("{:.2}", mean(stated.iter().map(|(error, e)| (error / e.sigma_s).powi(2)))),
        format!("{observable} of {}", results.len()),
    ]
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
        quantile(&mut errors_cm, 0.5)
    )
}

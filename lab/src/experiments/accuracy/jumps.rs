//! How well jumps of the tracking frame are followed: by how much the map frame moves against the room at each.

use glam::DVec3;
use rayon::prelude::*;

use super::quantile;
use radar_chaperone::report::Table;
use radar_chaperone::settings::Settings;
use radar_mapping::{Observer, ObserverSettings};
use radar_sar::geometry::Pose;
use radar_simulation::{PlaySession, Session, TrackingErrors};

/// How long after a jump the map frame is read, seconds. Choice: what a player does not notice.
const READ_AFTER_S: f64 = 0.1;
/// A jump of the map frame that is more than this away from one of the tracking frame is false, seconds.
const NEAR_S: f64 = 0.2;
/// Distance ahead of the head of an object that shows errors of the rotation, metres. Choice: an arm's length and a step.
const AHEAD_M: f64 = 1.5;

/// One row per kind of tracking. Poses alone are used, of play.
pub fn jumps_table(session: &PlaySession, kinds: &[(&str, TrackingErrors)], seeds: &std::ops::Range<u64>) -> Table {
    let row = |(name, errors): &(&str, TrackingErrors)| {
        let rooms: Vec<Followed> = seeds
            .clone()
            .into_par_iter()
            .map(|seed| {
                let session = PlaySession { seed, ..session.clone() };
                followed(&session.prepare().unwrap_or_else(|error| panic!("{error}")), *errors)
            })
            .collect();
        let mut off_mm: Vec<f64> = rooms.iter().flat_map(|room| &room.off_m).map(|off_m| off_m * 1e3).collect();
        let mut size_mm: Vec<f64> = rooms.iter().flat_map(|room| &room.size_m).map(|size_m| size_m * 1e3).collect();
        let of = |count: fn(&Followed) -> usize| rooms.iter().map(count).sum::<usize>();
        let minutes = rooms.iter().map(|room| room.minutes).sum::<f64>();
        vec![
            (*name).to_owned(),
            off_mm.len().to_string(),
            format!("{:.1}", quantile(&mut size_mm, 0.5)),
            format!("{:.0}", 100.0 * of(|room| room.followed) as f64 / off_mm.len().max(1) as f64),
            format!("{:.1}", quantile(&mut off_mm, 0.5)),
            format!("{:.1}", quantile(&mut off_mm, 0.95)),
            format!("{:.1}", of(|room| room.false_steps) as f64 / minutes),
        ]
    };
    let head = ["tracking", "jumps", "size (mm)", "followed (%)", "left (mm)", "95 % (mm)", "false a minute"];
    let caption = "Play of a minute in each room. size: by how much an object 1.5 m ahead of the head jumps in the tracking \
        frame, median. followed: share of the jumps at which the map frame moved against the tracking frame. left: by how \
        much the object has jumped in the map frame 0.1 s later, median and 95 %. false: steps of the map frame without a \
        jump.";
    Table { head: head.map(str::to_owned).to_vec(), rows: kinds.iter().map(row).collect(), caption: caption.into() }
}

#[derive(Default)]
struct Followed {
    size_m: Vec<f64>,
    off_m: Vec<f64>,
    followed: usize,
    false_steps: usize,
    minutes: f64,
}

fn followed(session: &Session, errors: TrackingErrors) -> Followed {
    let play = session.play();
    let history = Settings::default().tracking.history;
    let settings =
        ObserverSettings { history, head_from_sensor: play.head_from_sensor, time_offset_s: 0.0, range_bias_m: None };
    let mut observer = Observer::new(&play.config, settings);
    // Time, tracked_from_true, map_from_tracking and the number of steps so far, after each pose.
    let mut states: Vec<(f64, Pose, Pose, u64)> = Vec::new();
    for (pose, tracked_from_true) in session.tracked_with(errors) {
        // What is refused is counted.
        let _ = observer.push_pose(&pose);
        let time_s = (pose.time_ns - Session::host_ns(0.0)) as f64 * 1e-9;
        states.push((time_s, tracked_from_true, observer.map_from_tracking(), observer.counters().tracking_jumps));
    }
    let mut found = Followed { minutes: play.duration_s / 60.0, ..Followed::default() };
    let mut jumps_s = Vec::new();
    for n in 1..states.len() {
        let (before, at) = (states[n - 1], states[n]);
        if before.1 == at.1 {
            continue;
        }
        jumps_s.push(at.0);
        let later = states.partition_point(|state| state.0 < at.0 + READ_AFTER_S).min(states.len() - 1);
        let object_m = session.head_at(at.0).transform_point(DVec3::NEG_Z * AHEAD_M);
        let in_map_m = |state: &(f64, Pose, Pose, u64)| (state.2 * state.1).transform_point(object_m);
        found.size_m.push(before.1.transform_point(object_m).distance(at.1.transform_point(object_m)));
        found.off_m.push(in_map_m(&before).distance(in_map_m(&states[later])));
        found.followed += usize::from(states[later].3 > before.3);
    }
    let is_false = |time_s: f64| jumps_s.iter().all(|jump_s| (time_s - jump_s).abs() > NEAR_S);
    found.false_steps = states.windows(2).filter(|pair| pair[1].3 > pair[0].3 && is_false(pair[1].0)).count();
    found
}

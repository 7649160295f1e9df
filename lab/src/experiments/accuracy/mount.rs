//! Accuracy of the sensor's position on the head, estimated from play together with the time offset.

use std::ops::Range;

use glam::{DQuat, DVec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::{mean, quantile};
use radar_chaperone::report::Table;
use radar_chaperone::settings::Settings;
use radar_mapping::{Event, MountEstimate, Observer, ObserverSettings, in_time_order};
use radar_sar::geometry::Pose;
use radar_sar::{Boresight, Calibration, CalibrationSettings, SelfCalibration, TimeOffset};
use radar_simulation::{Headset, PlaySession, PlayWorld, Session, TrackingErrors};

/// Farthest that the true mount is from the assumed one. Choice: a sensor taped anywhere to a headset's front.
const MAX_SHIFT_M: f64 = 0.08;
const MAX_TURN_DEG: f64 = 20.0;
/// Directions that a sensor is set to face by mistake, yaw and pitch, and the right one.
const SET_DEG: [(&str, f64, f64); 6] = [
    ("left", 90.0, 0.0),
    ("right", -90.0, 0.0),
    ("back", 180.0, 0.0),
    ("up", 0.0, 90.0),
    ("down", 0.0, -90.0),
    ("as it faces", 0.0, 0.0),
];
/// Times after which the estimate is read, seconds.
const READ_S: [f64; 3] = [15.0, 30.0, 60.0];

/// Interval of the estimates, a divisor of all of them.
const ESTIMATE_S: f64 = 5.0;

/// The estimate in one room after one of [`READ_S`].
struct Read {
    error_m: DVec3,
    /// Squared error in units of the stated covariance.
    squared: f64,
    /// Where the sensor faces and by how much that is wrong, rad, when it counts as observed.
    boresight: Option<(f64, Boresight)>,
    found: Calibration,
}

/// Errors of the mount and of the time offset, which is 0, after 15, 30 and 60 s of play, one row for each headset and
/// time. The assumed mount is wrong by up to 8 cm and 20°, differently in each room.
///
/// # Panics
/// The session cannot be simulated.
pub fn mount_table(session: &PlaySession, worlds: &[PlayWorld], headsets: &[Headset], seeds: &Range<u64>) -> Table {
    let mut rows = Vec::new();
    for world in worlds {
        for headset in headsets {
            let of_seed = |seed: u64| {
                let errors = TrackingErrors { mount_m: 0.0, ..headset.errors() };
                played(&PlaySession { seed, world: *world, errors, ..session.clone() })
            };
            let rooms: Vec<[Option<Read>; 3]> = seeds.clone().into_par_iter().map(of_seed).collect();
            for (n, time_s) in READ_S.iter().enumerate() {
                let reads: Vec<&Read> = rooms.iter().filter_map(|room| room[n].as_ref()).collect();
                rows.push(row(&format!("{world:?}"), &format!("{headset:?}"), *time_s, &reads));
            }
        }
    }
    let head = [
        "world",
        "headset",
        "after (s)",
        "rooms",
        "mount (mm)",
        "90 % (mm)",
        "NEES",
        "offset (ms)",
        "90 % (ms)",
        "off by 3σ (%)",
        "drift (mm)",
        "direction known (%)",
        "wrong by (°)",
        "90 % (°)",
    ];
    let caption = "mount: error in each axis, median. NEES: squared error in units of the stated covariance, 3 on \
        average when it is honest, median. offset: error of the time offset. off by 3σ: share of the time offsets that \
        count as observed. drift: slow tracking error as estimated, median. direction: share of the rooms in which the \
        direction counts as observed, and the angle by which it is wrong there, median.";
    Table { head: head.map(str::to_owned).to_vec(), rows, caption: caption.into() }
}

fn row(world: &str, headset: &str, time_s: f64, reads: &[&Read]) -> Vec<String> {
    let mut errors_mm: Vec<f64> =
        reads.iter().flat_map(|read| read.error_m.abs().to_array()).map(|m| m * 1e3).collect();
    let mut squared: Vec<f64> = reads.iter().map(|read| read.squared).collect();
    let mut offsets_ms: Vec<f64> = reads.iter().map(|read| read.found.time_offset.offset_s.abs() * 1e3).collect();
    let mut drifts_mm: Vec<f64> = reads.iter().map(|read| read.found.drift_m * 1e3).collect();
    let boresights = reads.iter().filter_map(|read| read.boresight);
    let mut wrong_deg: Vec<f64> = boresights.map(|(wrong_rad, _)| wrong_rad.to_degrees()).collect();
    let observed = reads.iter().map(|read| read.found.time_offset).filter(|offset| offset.observable);
    let is_off = |offset: TimeOffset| f64::from(u8::from(offset.offset_s.abs() > 3.0 * offset.sigma_s));
    vec![
        world.to_lowercase(),
        headset.to_lowercase(),
        format!("{time_s}"),
        reads.len().to_string(),
        format!("{:.1}", quantile(&mut errors_mm, 0.5)),
        format!("{:.1}", quantile(&mut errors_mm, 0.9)),
        format!("{:.1}", quantile(&mut squared, 0.5)),
        format!("{:.2}", quantile(&mut offsets_ms, 0.5)),
        format!("{:.2}", quantile(&mut offsets_ms, 0.9)),
        format!("{:.0}", 100.0 * mean(observed.map(is_off))),
        format!("{:.1}", quantile(&mut drifts_mm, 0.5)),
        format!("{:.0}", 100.0 * wrong_deg.len() as f64 / reads.len().max(1) as f64),
        format!("{:.1}", quantile(&mut wrong_deg, 0.5)),
        format!("{:.1}", quantile(&mut wrong_deg, 0.9)),
    ]
}

/// Plays one room whose sensor is elsewhere than assumed.
fn played(session: &PlaySession) -> [Option<Read>; 3] {
    played_as(session, &session.head_from_sensor, &random_shift(session.seed))
}

/// Plays one room whose sensor is off the assumed one. Echoes and path alone are used: nothing is mapped.
fn played_as(session: &PlaySession, assumed: &Pose, off: &Pose) -> [Option<Read>; 3] {
    let duration_s = READ_S[READ_S.len() - 1] + 1.0;
    let session = PlaySession { duration_s, head_from_sensor: *assumed * *off, ..session.clone() };
    let session = session.prepare().unwrap_or_else(|error| panic!("{error}"));
    let tracking = Settings::default().tracking;
    let settings = ObserverSettings { history: tracking.history, head_from_sensor: *assumed, time_offset_s: 0.0 };
    let mut observer = Observer::new(&session.play().config, settings);
    let mut calibration = SelfCalibration::new(CalibrationSettings::new(0.0, tracking.errors));
    let mut reads = [const { None }; 3];
    let mut next_s = ESTIMATE_S;
    let frames = session.frames(0..session.frame_count());
    for event in in_time_order(frames, session.poses().collect::<Vec<_>>()) {
        let time_s = (event.time_ns() - Session::host_ns(0.0)) as f64 * 1e-9;
        // What is refused is counted.
        let _ = match event {
            Event::Frame(frame) => observer.push_frame(frame),
            Event::Pose(pose) => observer.push_pose(&pose),
            Event::Hands(_) => Ok(()),
        };
        for at in observer.take_path() {
            calibration.push_path(at.time_ns, &at.tracking_from_sensor, at.velocity_m_per_s);
        }
        observer.take_ready().iter().for_each(|observation| calibration.push_sweep(observation));
        if time_s < next_s {
            continue;
        }
        let found = calibration.estimate();
        if let Some(n) = READ_S.iter().position(|read_s| (read_s - next_s).abs() < 1e-6) {
            reads[n] = found.map(|found| {
                let error_m = found.mount_shift_m - off.translation;
                let boresight = calibration.boresight(&session.play().beam).filter(|found| found.observable);
                let truth = off.rotation * DVec3::NEG_Z;
                let boresight = boresight.map(|found| (found.direction.angle_between(truth), found));
                let squared = error_m.dot(found.mount_covariance_m2.inverse() * error_m);
                Read { error_m, squared, boresight, found }
            });
        }
        next_s += ESTIMATE_S;
    }
    reads
}

/// In how many rooms a sensor that looks ahead, and is set to face elsewhere, contradicts that; and one that is set right.
///
/// # Panics
/// The session cannot be simulated.
pub fn gross_table(session: &PlaySession, worlds: &[PlayWorld], headsets: &[Headset], seeds: &Range<u64>) -> Table {
    let mut rows = Vec::new();
    for (world, headset) in worlds.iter().flat_map(|world| headsets.iter().map(move |headset| (world, headset))) {
        for (name, yaw_deg, pitch_deg) in SET_DEG {
            let of_seed = |seed: u64| {
                let errors = TrackingErrors { mount_m: 0.0, ..headset.errors() };
                contradicted(&PlaySession { seed, world: *world, errors, ..session.clone() }, [yaw_deg, pitch_deg])
            };
            let rooms: Vec<[bool; 3]> = seeds.clone().into_par_iter().map(of_seed).collect();
            let percent = |n: usize| 100.0 * mean(rooms.iter().map(|room| f64::from(u8::from(room[n]))));
            let names = [format!("{world:?}").to_lowercase(), format!("{headset:?}").to_lowercase(), name.to_owned()];
            let shares = (0..3).map(|n| format!("{:.0}", percent(n)));
            rows.push(names.into_iter().chain([rooms.len().to_string()]).chain(shares).collect());
        }
    }
    let head = ["world", "headset", "set to face", "rooms", "after 15 s (%)", "after 30 s (%)", "after 60 s (%)"];
    let caption = "Share of the rooms in which the data contradict the direction.".into();
    Table { head: head.map(str::to_owned).to_vec(), rows, caption }
}

/// Whether a sensor whose direction is set wrong by a yaw and a pitch contradicts it, after each of [`READ_S`].
fn contradicted(session: &PlaySession, [yaw_deg, pitch_deg]: [f64; 2]) -> [bool; 3] {
    let turn = DQuat::from_rotation_y(yaw_deg.to_radians()) * DQuat::from_rotation_x(pitch_deg.to_radians());
    let assumed = session.head_from_sensor * Pose::new(DVec3::ZERO, turn);
    let contradicts = |read: Read| {
        let boresight = read.boresight.map(|(_, found)| found);
        MountEstimate::new(&assumed, &read.found, boresight.as_ref()).contradicts_direction()
    };
    let off = Pose::new(DVec3::ZERO, turn.inverse());
    played_as(session, &assumed, &off).map(|read| read.is_some_and(contradicts))
}

fn random_shift(seed: u64) -> Pose {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x4d4f);
    let mut direction = || DVec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0))).normalize();
    let (along, axis) = (direction(), direction());
    let share: f64 = rng.random_range(0.0..1.0);
    let rotation = DQuat::from_axis_angle(axis, (MAX_TURN_DEG * share).to_radians());
    Pose { translation: along * MAX_SHIFT_M * share, rotation }
}

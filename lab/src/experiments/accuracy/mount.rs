//! Accuracy of the sensor's position on the head, estimated from play together with the time offset.

use std::ops::Range;

use glam::{DQuat, DVec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::{mean, quantile};
use radar_chaperone::report::Table;
use radar_chaperone::settings::Settings;
use radar_mapping::{Event, MountEstimate, MountInUse, Observer, ObserverSettings, in_time_order};
use radar_sar::geometry::Pose;
use radar_sar::{Calibration, CalibrationSettings, EchoDirections, PoseSample, SelfCalibration, TimeOffset};
use radar_simulation::{Headset, PlaySession, PlayWorld, Session, TrackingErrors};

/// Farthest that the true mount is from the assumed one. Choice: a sensor taped anywhere to a headset's front.
const MAX_SHIFT_M: f64 = 0.08;
const MAX_TURN_DEG: f64 = 20.0;

/// A mistake in the settings, or in where the poses come from.
struct Mistake {
    name: &'static str,
    /// By how much the sensor is set to face elsewhere.
    yaw_deg: f64,
    pitch_deg: f64,
    /// By how much the place that the poses state is off the head's origin, in the head's frame, metres.
    origin_m: DVec3,
    poses: Poses,
}

/// What is wrong with every pose.
#[derive(Clone, Copy, PartialEq)]
enum Poses {
    Right,
    /// The x axis of positions points the other way.
    MirroredPositions,
    /// Rotations from the tracking frame to the head's.
    InvertedRotations,
}

const NONE: Mistake =
    Mistake { name: "none", yaw_deg: 0.0, pitch_deg: 0.0, origin_m: DVec3::ZERO, poses: Poses::Right };
const MISTAKES: [Mistake; 9] = [
    Mistake { name: "faces left", yaw_deg: 90.0, ..NONE },
    Mistake { name: "faces right", yaw_deg: -90.0, ..NONE },
    Mistake { name: "faces back", yaw_deg: 180.0, ..NONE },
    Mistake { name: "faces up", pitch_deg: 90.0, ..NONE },
    Mistake { name: "faces down", pitch_deg: -90.0, ..NONE },
    Mistake { name: "origin 20 cm off", origin_m: DVec3::new(0.0, -0.16, 0.12), ..NONE },
    Mistake { name: "x axis mirrored", poses: Poses::MirroredPositions, ..NONE },
    Mistake { name: "rotations inverted", poses: Poses::InvertedRotations, ..NONE },
    NONE,
];

/// Times after which the estimate is read, seconds.
const READ_S: [f64; 3] = [15.0, 30.0, 60.0];

/// Interval of the estimates, a divisor of all of them.
const ESTIMATE_S: f64 = 5.0;

/// The estimate in one room after one of [`READ_S`].
struct Read {
    /// Along the head's axes.
    error_m: DVec3,
    /// Whether the motion made the position along each observable.
    observed: [bool; 3],
    /// Squared error in units of the stated covariance.
    squared: f64,
    /// By how much the direction is wrong where it counts as observed, rad.
    boresight_off_rad: Option<f64>,
    directions: EchoDirections,
    /// The simulated module's range bias, metres.
    true_bias_m: f64,
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
        "axes (%)",
        "mount (mm)",
        "90 % (mm)",
        "NEES",
        "offset (ms)",
        "90 % (ms)",
        "off by 3σ (%)",
        "drift (mm)",
        "range bias (mm)",
        "of 1σ (mm)",
        "off by 2σ (%)",
        "direction known (%)",
        "wrong by (°)",
        "90 % (°)",
    ];
    let caption = "axes: share of the head's axes along which the sensor's position counts as observed (1σ of 1 cm or \
        better). mount: error along these, median. NEES: squared error in units of the stated covariance, 3 on \
        average when it is honest, median. offset: error of the time offset. off by 3σ: share of the time offsets that \
        count as observed. drift: slow tracking error as estimated, median. range bias: \
        its error, median; off by 2σ: share of the rooms. direction: share of the rooms in which the \
        direction counts as observed, and the angle by which it is wrong there, median.";
    Table { head: head.map(str::to_owned).to_vec(), rows, caption: caption.into() }
}

fn row(world: &str, headset: &str, time_s: f64, reads: &[&Read]) -> Vec<String> {
    let axes = reads.iter().flat_map(|read| read.observed.into_iter().zip(read.error_m.to_array()));
    let mut errors_mm: Vec<f64> = axes.filter(|axis| axis.0).map(|axis| axis.1.abs() * 1e3).collect();
    let observed_axes = errors_mm.len() as f64 / (3 * reads.len()).max(1) as f64;
    let mut squared: Vec<f64> = reads.iter().map(|read| read.squared).collect();
    let mut offsets_ms: Vec<f64> = reads.iter().map(|read| read.found.time_offset.offset_s.abs() * 1e3).collect();
    let mut drifts_mm: Vec<f64> = reads.iter().map(|read| read.found.drift_m * 1e3).collect();
    let biases_m = reads.iter().map(|read| (read.found.range_bias_m - read.true_bias_m, read.found.range_bias_sigma_m));
    let mut bias_errors_mm: Vec<f64> = biases_m.clone().map(|(error_m, _)| error_m.abs() * 1e3).collect();
    let mut bias_sigmas_mm: Vec<f64> = biases_m.clone().map(|(_, sigma_m)| sigma_m * 1e3).collect();
    let are_biases_off = biases_m.map(|(error_m, sigma_m)| f64::from(u8::from(error_m.abs() > 2.0 * sigma_m)));
    let mut wrong_deg: Vec<f64> = reads.iter().filter_map(|read| read.boresight_off_rad).map(f64::to_degrees).collect();
    let observed = reads.iter().map(|read| read.found.time_offset).filter(|offset| offset.observable);
    let is_off = |offset: TimeOffset| f64::from(u8::from(offset.offset_s.abs() > 3.0 * offset.sigma_s));
    vec![
        world.to_lowercase(),
        headset.to_lowercase(),
        format!("{time_s}"),
        reads.len().to_string(),
        format!("{:.0}", 100.0 * observed_axes),
        format!("{:.1}", quantile(&mut errors_mm, 0.5)),
        format!("{:.1}", quantile(&mut errors_mm, 0.9)),
        format!("{:.1}", quantile(&mut squared, 0.5)),
        format!("{:.2}", quantile(&mut offsets_ms, 0.5)),
        format!("{:.2}", quantile(&mut offsets_ms, 0.9)),
        format!("{:.0}", 100.0 * mean(observed.map(is_off))),
        format!("{:.1}", quantile(&mut drifts_mm, 0.5)),
        format!("{:.1}", quantile(&mut bias_errors_mm, 0.5)),
        format!("{:.1}", quantile(&mut bias_sigmas_mm, 0.5)),
        format!("{:.0}", 100.0 * mean(are_biases_off)),
        format!("{:.0}", 100.0 * wrong_deg.len() as f64 / reads.len().max(1) as f64),
        format!("{:.1}", quantile(&mut wrong_deg, 0.5)),
        format!("{:.1}", quantile(&mut wrong_deg, 0.9)),
    ]
}

/// Plays one room whose sensor is elsewhere than assumed.
fn played(session: &PlaySession) -> [Option<Read>; 3] {
    played_as(session, &session.head_from_sensor, &random_shift(session.seed), Poses::Right)
}

/// Plays one room whose sensor is off the assumed one. Echoes and path alone are used: nothing is mapped.
fn played_as(session: &PlaySession, assumed: &Pose, off: &Pose, poses: Poses) -> [Option<Read>; 3] {
    let duration_s = READ_S[READ_S.len() - 1] + 1.0;
    let session = PlaySession { duration_s, head_from_sensor: *assumed * *off, ..session.clone() };
    let session = session.prepare().unwrap_or_else(|error| panic!("{error}"));
    let tracking = Settings::default().tracking;
    let settings = ObserverSettings {
        history: tracking.history,
        head_from_sensor: *assumed,
        time_offset_s: 0.0,
        range_bias_m: None,
    };
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
            Event::Pose(pose) => observer.push_pose(&poses.of(pose)),
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
                let shift_error_m = found.mount_shift_m - off.translation;
                let directions = calibration.echo_directions(&session.play().beam);
                let true_bias_m = session.range_bias_m(0);
                let truth = off.rotation * DVec3::NEG_Z;
                let boresight = directions.boresight.filter(|found| found.observable);
                let boresight_off_rad = boresight.map(|found| found.direction.angle_between(truth));
                let squared = shift_error_m.dot(found.mount_covariance_m2.inverse() * shift_error_m);
                let observed = MountEstimate::new(assumed, &found, &directions).observed;
                let error_m = assumed.transform_vector(shift_error_m);
                Read { error_m, observed, squared, boresight_off_rad, directions, true_bias_m, found }
            });
        }
        next_s += ESTIMATE_S;
    }
    reads
}

/// In how many rooms the data contradict a mistake, and in how many they contradict what is right.
///
/// # Panics
/// The session cannot be simulated.
pub fn gross_table(session: &PlaySession, worlds: &[PlayWorld], headsets: &[Headset], seeds: &Range<u64>) -> Table {
    let mut rows = Vec::new();
    for (world, headset) in worlds.iter().flat_map(|world| headsets.iter().map(move |headset| (world, headset))) {
        for mistake in MISTAKES {
            let of_seed = |seed: u64| {
                let errors = TrackingErrors { mount_m: 0.0, ..headset.errors() };
                contradicted(&PlaySession { seed, world: *world, errors, ..session.clone() }, &mistake)
            };
            let rooms: Vec<[bool; 3]> = seeds.clone().into_par_iter().map(of_seed).collect();
            let percent = |n: usize| 100.0 * mean(rooms.iter().map(|room| f64::from(u8::from(room[n]))));
            let names = [format!("{world:?}"), format!("{headset:?}"), mistake.name.to_owned()];
            let shares = (0..3).map(|n| format!("{:.0}", percent(n)));
            let row = names.map(|name| name.to_lowercase()).into_iter().chain([rooms.len().to_string()]).chain(shares);
            rows.push(row.collect());
        }
    }
    let head = ["world", "headset", "mistake", "rooms", "after 15 s (%)", "after 30 s (%)", "after 60 s (%)"];
    let caption = "Share of the rooms in which the data contradict the mount or the poses.".into();
    Table { head: head.map(str::to_owned).to_vec(), rows, caption }
}

/// Whether the data contradict a mistake, after each of [`READ_S`].
fn contradicted(session: &PlaySession, mistake: &Mistake) -> [bool; 3] {
    let Mistake { yaw_deg, pitch_deg, origin_m, poses, .. } = *mistake;
    let turn = DQuat::from_rotation_y(yaw_deg.to_radians()) * DQuat::from_rotation_x(pitch_deg.to_radians());
    let Pose { translation, rotation } = session.head_from_sensor;
    let assumed = Pose { translation: translation - origin_m, rotation: rotation * turn };
    let off = assumed.inverse() * session.head_from_sensor;
    let contradicts = |read: Read| {
        let estimate = Some(MountEstimate::new(&assumed, &read.found, &read.directions));
        MountInUse { assumed, in_use: assumed, estimate }.is_contradicted()
    };
    played_as(session, &assumed, &off, poses).map(|read| read.is_some_and(contradicts))
}

impl Poses {
    fn of(self, mut sample: PoseSample) -> PoseSample {
        match self {
            Self::Right => {}
            Self::MirroredPositions => sample.position_m[0] = -sample.position_m[0],
            Self::InvertedRotations => sample.quaternion_xyzw[3] = -sample.quaternion_xyzw[3],
        }
        sample
    }
}

fn random_shift(seed: u64) -> Pose {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x4d4f);
    let mut direction = || DVec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0))).normalize();
    let (along, axis) = (direction(), direction());
    let share: f64 = rng.random_range(0.0..1.0);
    let rotation = DQuat::from_axis_angle(axis, (MAX_TURN_DEG * share).to_radians());
    Pose { translation: along * MAX_SHIFT_M * share, rotation }
}

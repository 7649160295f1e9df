//! Recordings that are valid as files but contain invalid data: each bad frame or pose is counted
//! and skipped, and the rest is used.

use a121::{Frame, preset};
use num_complex::Complex;
use radar_recording::{Existing, Header, RecordingWriter};
use radar_sar::PoseSample;
use radar_sar::TrackingResult;
use radar_simulation::Scenario;

use crate::common::Folder;
use crate::found::counter;

/// Frames and poses to be damaged.
#[derive(Clone)]
struct Streams {
    header: Header,
    frames: Vec<Frame>,
    poses: Vec<PoseSample>,
}

/// A kind of damage, and what replay prints about it.
struct Case {
    name: &'static str,
    damage: fn(&mut Streams),
    message: &'static str,
}

/// The second half, so that enough good data remain to be imaged.
fn late<T>(all: &mut [T]) -> impl Iterator<Item = &mut T> {
    let half = all.len() / 2;
    all[half..].iter_mut()
}

fn each_pose(streams: &mut Streams, damage: fn(&mut PoseSample)) {
    late(&mut streams.poses).step_by(7).take(5).for_each(damage);
}

fn each_frame(streams: &mut Streams, damage: fn(&mut Frame)) {
    late(&mut streams.frames).step_by(7).take(5).for_each(damage);
}

const NUMBERS: &str = "left out: 5 poses with impossible numbers";
const LENGTH: &str = "left out: 5 frames of wrong length";
const NO_POSE: &str = "No sweep has a pose";
const CASES: [Case; 29] = [
    Case { name: "no damage", damage: |_| {}, message: " 0 frames without a pose skipped\n\n" },
    Case { name: "position NaN", damage: |s| each_pose(s, |p| p.position_m[1] = f64::NAN), message: NUMBERS },
    Case { name: "position infinite", damage: |s| each_pose(s, |p| p.position_m[2] = f64::INFINITY), message: NUMBERS },
    Case { name: "rotation NaN", damage: |s| each_pose(s, |p| p.quaternion_xyzw[0] = f64::NAN), message: NUMBERS },
    Case {
        name: "rotation infinite",
        damage: |s| each_pose(s, |p| p.quaternion_xyzw[3] = -f64::INFINITY),
        message: NUMBERS,
    },
    Case { name: "rotation zero", damage: |s| each_pose(s, |p| p.quaternion_xyzw = [0.0; 4]), message: NUMBERS },
    Case { name: "rotation tiny", damage: |s| each_pose(s, |p| p.quaternion_xyzw = [1e-300; 4]), message: NUMBERS },
    Case { name: "rotation huge", damage: |s| each_pose(s, |p| p.quaternion_xyzw = [1e300; 4]), message: "obstacle" },
    Case { name: "poses far out", damage: |s| each_pose(s, |p| p.position_m = [1e6, -1e6, 1e6]), message: "obstacle" },
    Case { name: "poses at 1e300 m", damage: |s| each_pose(s, |p| p.position_m = [1e300; 3]), message: "obstacle" },
    Case {
        name: "all far out",
        damage: |s| s.poses.iter_mut().for_each(|p| p.position_m[0] += 1e9),
        message: "obstacle",
    },
    Case {
        name: "all at 1e300 m",
        damage: |s| s.poses.iter_mut().for_each(|p| p.position_m = [1e300; 3]),
        message: "obstacle",
    },
    Case {
        name: "marked invalid",
        damage: |s| each_pose(s, |p| p.valid = false),
        message: "left out: 5 poses marked invalid",
    },
    Case {
        name: "rotation only",
        damage: |s| each_pose(s, |p| p.result = TrackingResult::RotationOnly),
        message: "left out: 5 poses marked invalid",
    },
    Case { name: "all marked invalid", damage: |s| s.poses.iter_mut().for_each(|p| p.valid = false), message: NO_POSE },
    Case {
        name: "pose times leap back",
        damage: |s| each_pose(s, |p| p.time_ns -= 500_000_000),
        message: "left out: 5 poses not later than the one before",
    },
    Case {
        name: "pose times run backwards",
        damage: |s| s.poses.reverse(),
        message: "poses not later than the one before",
    },
    Case {
        name: "pose times at the limits of i64",
        damage: |s| (s.poses[0].time_ns, s.poses[1].time_ns) = (i64::MIN, i64::MAX),
        message: "left out: 2 poses far ahead in time",
    },
    Case {
        name: "frame times leap back",
        damage: |s| each_frame(s, |f| f.host_time_ns -= 500_000_000),
        message: "left out: 5 frames not later than the one before",
    },
    Case {
        name: "frame times run backwards",
        damage: |s| s.frames.reverse(),
        message: "frames not later than the one before",
    },
    Case {
        name: "frame times at the limits of i64",
        damage: |s| (s.frames[0].host_time_ns, s.frames[1].host_time_ns) = (i64::MIN, i64::MAX),
        message: "left out: 2 frames far ahead in time",
    },
    Case {
        name: "one pose of another day",
        damage: |s| s.poses[20].time_ns += 86_400_000_000_000,
        message: "left out: 1 poses far ahead in time",
    },
    Case {
        name: "the first frame of another day",
        damage: |s| s.frames[0].host_time_ns += 86_400_000_000_000,
        message: "left out: 1 frames far ahead in time",
    },
    Case { name: "frames cut", damage: |s| each_frame(s, |f| f.samples.truncate(17)), message: LENGTH },
    Case {
        name: "frames too long",
        damage: |s| each_frame(s, |f| f.samples.push(Complex::new(1, 1))),
        message: LENGTH,
    },
    Case {
        name: "frames saturated",
        damage: |s| each_frame(s, |f| f.data_saturated = true),
        message: "left out: 5 frames saturated",
    },
    Case { name: "no poses", damage: |s| s.poses.clear(), message: NO_POSE },
    Case { name: "no frames", damage: |s| s.frames.clear(), message: NO_POSE },
    Case { name: "nothing at all", damage: |s| (s.frames, s.poses) = Default::default(), message: NO_POSE },
];

#[test]
fn bad_content_is_counted_and_skipped_by_the_reflector_search() {
    replay_each_case("fine", "sphere-10cm");
}

#[test]
fn bad_content_is_counted_and_skipped_by_the_room_mapper() {
    replay_each_case("c16", "natural");
}

fn replay_each_case(preset_name: &str, motion: &str) {
    let folder = Folder::new(&format!("bad_content_{preset_name}"));
    let config = preset(preset_name).unwrap();
    let scenario = Scenario::new("corner-reflector", motion, config, 0.6, 1);
    let simulated = scenario.run().unwrap();
    let header = Header::new("a test", scenario.config, scenario.head_from_sensor);
    let sound = Streams { header, frames: simulated.frames, poses: simulated.poses };
    for case in CASES {
        println!("{}", case.name);
        let mut streams = sound.clone();
        (case.damage)(&mut streams);
        write(&folder, &streams);
        check_commands(&folder, &streams, case.message);
    }
}

/// Writes both streams interleaved, whatever their times are.
fn write(folder: &Folder, streams: &Streams) {
    let mut writer = RecordingWriter::create(folder.path("r.mcap"), &streams.header, Existing::Replace).unwrap();
    let (frames, poses) = (&streams.frames, &streams.poses);
    let mut written = 0;
    for (index, frame) in frames.iter().enumerate() {
        let until = poses.len() * index / frames.len();
        poses[written..until].iter().for_each(|pose| writer.write_pose(pose).unwrap());
        written = until;
        writer.write_frame(frame).unwrap();
    }
    poses[written..].iter().for_each(|pose| writer.write_pose(pose).unwrap());
    writer.finish().unwrap();
}

fn check_commands(folder: &Folder, streams: &Streams, message: &str) {
    folder.run("info r.mcap").succeeds().prints("Damage     none");
    folder.run("replay r.mcap --out found --set reflectors.voxel_m=0.2").succeeds().prints(message);
    assert_eq!(counter(folder, "frames"), streams.frames.len() as u64);
    assert_eq!(counter(folder, "poses"), streams.poses.len() as u64);
    let outcome = folder.run("reconstruct r.mcap --voxel-m 0.2 --sweeps 10 --out v.npy");
    assert!(outcome.succeeded() || outcome.err.contains("no sweep of r.mcap has a pose"), "{outcome:#?}");
    folder.run("recover r.mcap --out saved.mcap --force").succeeds().prints("r.mcap was not damaged");
    assert!(folder.read("saved.mcap") == folder.read("r.mcap"));
}

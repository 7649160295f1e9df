//! Files for the tests of this module: small generated ones, and real recordings.

use radar_mapping::Event;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use glam::{DQuat, DVec3};
use num_complex::Complex;

use super::{Existing, Header, RecordingWriter};
use a121::{Frame, preset};
use radar_sar::PoseSample;
use radar_sar::TrackingResult;
use radar_sar::geometry::Pose;
use radar_sar::truth::{Truth, TruthObstacle};

const MS: i64 = 1_000_000;

/// A unique path in the system's temporary directory; the file is removed on drop.
pub struct TestFile(pub PathBuf);

impl TestFile {
    pub fn new() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let name = format!("radar-chaperone-{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        Self(std::env::temp_dir().join(name))
    }

    pub fn with(bytes: &[u8]) -> Self {
        let file = Self::new();
        std::fs::write(&file.0, bytes).unwrap();
        file
    }
}

impl Drop for TestFile {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

/// Path of a recording of the vendor.
///
/// # Panics
/// If it is not available. Tests that need one are ignored unless asked for: none passes by doing
/// nothing.
pub fn real_recording(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/recordings").join(name);
    assert!(path.exists(), "{} does not exist: this test needs the vendor's recordings", path.display());
    path
}

pub fn header() -> Header {
    let mount = Pose::new(DVec3::new(0.0, 0.031, -0.1), DQuat::from_rotation_x(-0.2));
    let mut header = Header::new("test room, seed 1", preset("c16").unwrap(), mount);
    header.sensor.ticks_per_second = Some(1_000_000);
    header.sensor.board = Some("simulated".into());
    header.settings = "[radar]\npreset = \"c16\"\n".into();
    header.truth = Some(Truth {
        title: "two posts".into(),
        seed: 1,
        obstacles: vec![TruthObstacle {
            name: "post".into(),
            points_m: vec![DVec3::new(0.1, 1.0 / 3.0, -2.0)],
            rcs_dbsm: vec![-12.345678901234567],
            closest_approach_m: 0.7,
            in_beam_s: 3.1,
        }],
        walls: vec![],
        time_offset_s: 0.01,
    });
    header
}

/// Frames at 20 Hz with noise, and poses at 40 Hz, some of them invalid.
pub fn events(seconds: i64) -> Vec<Event> {
    let mut noise = 1u32;
    let mut next = move || {
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (noise >> 16) as i16
    };
    let mut events = Vec::new();
    for i in 0..seconds * 40 {
        let pose = Pose::new(DVec3::new(i as f64 * 0.01, 1.6, 0.1), DQuat::from_rotation_y(i as f64 * 0.02));
        let mut sample = PoseSample::valid(i * 25 * MS, &pose);
        match i % 40 {
            7 => sample.position_m[1] = f64::NAN,
            9 => sample.result = TrackingResult::RotationOnly,
            _ => {}
        }
        events.push(Event::Pose(sample));
        if i % 2 == 0 {
            events.push(Event::Frame(Frame {
                tick: i * 25_000,
                host_time_ns: i * 25 * MS + 3,
                temperature_c: -7,
                data_saturated: i % 50 == 0,
                frame_delayed: i % 30 == 0,
                calibration_needed: i % 70 == 0,
                samples: (0..50).map(|_| Complex::new(next(), next())).collect(),
            }));
        }
    }
    events
}

/// The bytes of a recording of these events.
pub fn recorded(events: &[Event]) -> Vec<u8> {
    recorded_with(events, &header())
}

/// The same with another header.
pub fn recorded_with(events: &[Event], header: &Header) -> Vec<u8> {
    let file = TestFile::new();
    let mut writer = RecordingWriter::create(&file.0, header, Existing::Replace).unwrap();
    for event in events {
        writer.write(event).unwrap();
    }
    writer.finish().unwrap();
    std::fs::read(&file.0).unwrap()
}

/// Asserts equality to the bit: NaN equals the same NaN, and −0 does not equal 0.
pub fn assert_same(read: &[Event], written: &[Event]) {
    assert_eq!(read.len(), written.len());
    for (a, b) in read.iter().zip(written) {
        match (a, b) {
            (Event::Pose(a), Event::Pose(b)) => assert_eq!(pose_bits(a), pose_bits(b)),
            _ => assert_eq!(a, b),
        }
    }
}

fn pose_bits(pose: &PoseSample) -> (i64, [u64; 3], [u64; 4], bool, TrackingResult) {
    let position = pose.position_m.map(f64::to_bits);
    (pose.time_ns, position, pose.quaternion_xyzw.map(f64::to_bits), pose.valid, pose.result)
}

//! The vendor's real recordings. `-- --ignored` runs these tests; CONTRIBUTING.md says where the
//! recordings have to be.
//!
//! The expected first and last frames were read with another HDF5 library, h5py 3.16 with HDF5 2.0:
//! `frame[i]` as little-endian i16, real before imaginary, through `zlib.crc32`; tick, temperature
//! and flags as stored.

use a121::vendor_h5::VendorRecording;
use a121::{Frame, SensorConfig};
use radar_mapping::Event;
use radar_recording::Recording;
use radar_simulation::RecordedSensor;

use crate::common::Folder;
use crate::found::{counter, obstacles_of, only};

#[test]
#[ignore = "needs the vendor's recordings in ../shared/recordings"]
fn tank_reflector_is_found_at_its_position() {
    let folder = Folder::new("tank");
    folder.copy_real("medium_tank.h5");
    folder.copy_real("medium_tank_poses.tum");
    folder
        .run("import medium_tank.h5 --poses medium_tank_poses.tum --out tank.mcap")
        .succeeds()
        .prints("import of medium_tank.h5 and medium_tank_poses.tum")
        .prints("1740 over");
    let found = only(obstacles_of(&folder, "tank.mcap"));
    assert!((found.position_m.z + 0.8).abs() < 0.02, "{}", found.position_m);
    assert!(found.position_m.truncate().length() < 0.05, "{}", found.position_m);
    assert_eq!(found.observed, "range_only");
    assert!(counter(&folder, "frames_without_pose") > 1300);
}

#[test]
#[ignore = "needs the vendor's recordings in ../shared/recordings"]
fn recordings_without_poses_import_and_replay_reports_missing_poses() {
    let folder = Folder::new("vendor");
    for name in ["corner-reflector", "distance_fixed_strength", "input", "fr10Hz-spf4"] {
        folder.copy_real(&format!("{name}.h5"));
        folder.run(&format!("import {name}.h5 --out r.mcap --force")).succeeds().prints("Damage     none");
        folder.run("info r.mcap").succeeds().prints(&format!("import of {name}.h5"));
        folder.run("replay r.mcap").succeeds().prints("No sweep has a pose").prints("\n0 obstacles, 0 walls\n");
    }
}

/// A frame as read by another reader.
struct Known {
    tick: i64,
    temperature_c: i16,
    samples: usize,
    crc32: u32,
}

const fn known(tick: i64, temperature_c: i16, samples: usize, crc32: u32) -> Known {
    Known { tick, temperature_c, samples, crc32 }
}

/// File, number of frames, ticks per second, first and last frame. None of them has a flag set.
const FIRST_AND_LAST: [(&str, usize, f64, Known, Known); 5] = [
    ("medium_tank", 1740, 1e3, known(67_977, 28, 287, 0x9199_6de3), known(88_100, 30, 287, 0xfd6f_2e96)),
    ("corner-reflector", 113, 1e3, known(7_092, 33, 74, 0xdd0c_3641), known(9_332, 32, 74, 0x66a6_9039)),
    (
        "distance_fixed_strength",
        93,
        1e6,
        known(223_351_035, 33, 33, 0x26d4_d8fc),
        known(241_751_030, 31, 33, 0xd3af_aac8),
    ),
    ("input", 10, 1e6, known(98_889_705, 32, 160, 0xf19e_f8bd), known(98_914_457, 34, 160, 0x375c_b92f)),
    ("fr10Hz-spf4", 10, 1e6, known(231_901_480, 37, 640, 0xd17a_ae4d), known(232_807_237, 36, 640, 0x87a9_022f)),
];

#[test]
#[ignore = "needs the vendor's recordings in ../shared/recordings"]
fn first_and_last_frames_are_those_of_another_reader() {
    let folder = Folder::new("first_and_last");
    for (name, count, ticks_per_second, first, last) in FIRST_AND_LAST {
        folder.copy_real(&format!("{name}.h5"));
        folder.run(&format!("import {name}.h5 --out r.mcap --force")).succeeds();
        let mut recording = Recording::open(folder.path("r.mcap")).unwrap();
        let frame = |event| if let Event::Frame(frame) = event { Some(frame) } else { None };
        let frames: Vec<Frame> = recording.by_ref().filter_map(frame).collect();
        assert_eq!((frames.len(), recording.damage().is_none()), (count, true), "{name}");
        assert_is(&frames[0], &first, name);
        assert_is(&frames[count - 1], &last, name);
        // Times count from the first tick.
        let after_ns = (last.tick - first.tick) as f64 / ticks_per_second * 1e9;
        assert_eq!((frames[0].host_time_ns, frames[count - 1].host_time_ns), (0, after_ns.round() as i64), "{name}");
    }
}

fn assert_is(frame: &Frame, known: &Known, name: &str) {
    let bytes = frame.samples.iter().flat_map(|s| [s.re.to_le_bytes(), s.im.to_le_bytes()]).flatten();
    assert_eq!((frame.samples.len(), crc32(bytes)), (known.samples, known.crc32), "{name} at tick {}", known.tick);
    assert_eq!((frame.tick, frame.temperature_c), (known.tick, known.temperature_c), "{name}");
    assert!(!(frame.data_saturated || frame.frame_delayed || frame.calibration_needed), "{name}");
}

/// CRC-32 as in zlib, bit by bit.
fn crc32(bytes: impl Iterator<Item = u8>) -> u32 {
    let shifted = |crc: u32| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 };
    !bytes.fold(u32::MAX, |crc, byte| (0..8).fold(crc ^ u32::from(byte), |crc, _| shifted(crc)))
}

#[test]
#[ignore = "needs the vendor's recordings in ../shared/recordings"]
fn damaged_real_file_is_imported_completely_or_refused() {
    let folder = Folder::new("damaged_real_file");
    folder.copy_real("input.h5");
    crate::bad_files::import_damaged(&folder, "input.h5");
}

#[test]
fn crc32_matches_the_standard_check_value() {
    assert_eq!(crc32(b"123456789".iter().copied()), 0xcbf4_3926);
}

/// The model's jitter with HWAAS 8 is 0.094 rad, with a slow part of 0.046 rad.
#[test]
#[ignore = "needs the vendor's recordings in ../shared/recordings"]
fn scenes_at_rest_show_the_jitter_of_the_model() {
    let folder = Folder::new("sensor_at_rest");
    let read = |name: &str| {
        folder.copy_real(name);
        let recording = VendorRecording::open(folder.path(name)).unwrap();
        let frames: Vec<Frame> = recording.frames().collect::<Result<_, _>>().unwrap();
        (recording.config, frames)
    };
    let (full, empty) = (read("waste-level-full.h5"), read("waste-level-empty.h5"));
    let of = |recordings: &[&(SensorConfig, Vec<Frame>)]| {
        let scenes = recordings.iter().map(|(config, frames)| (config, frames.as_slice()));
        RecordedSensor::of_scenes_at_rest(scenes).unwrap()
    };
    let (rms_rad, hwaas) = of(&[&full, &empty]).phase_jitter().unwrap();
    let model_rad = f64::hypot(0.094, 0.046);
    assert!(hwaas == 8 && (rms_rad / model_rad - 1.0).abs() < 0.1, "{rms_rad} rad with HWAAS {hwaas}");
    assert!(of(&[&full, &empty]).has_noise() && of(&[&empty]).phase_jitter().is_none());
}

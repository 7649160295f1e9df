//! A small file that swells cannot take the memory of the machine.

use crate::PROGRAM;
use crate::common::Folder;
use a121::{Frame, preset};
use radar_recording::{Existing, Header, RecordingWriter};
use radar_sar::geometry::Pose;
use radar_sar::{PoseSample, TrackingResult};
use std::process::Command;

/// Address space of a command, KiB. The samples of the file alone take as much. Measured with
/// `ulimit -v`: `reconstruct` needs 250 MiB for it, `calibrate` 350.
const LIMIT_KIB: usize = 400 << 10;
const SAMPLES: usize = 100_000_000;

/// Silence with poses: 400 MB of samples in a file of a few.
fn write_silence(folder: &Folder) {
    let config = preset("d16").unwrap();
    let samples = a121::FrameLayout::of(&config).samples_per_frame();
    let header = Header::new("silence", config, Pose::IDENTITY);
    let mut writer = RecordingWriter::create(folder.path("silence.mcap"), &header, Existing::Replace).unwrap();
    for n in 0..(SAMPLES / samples) as i64 {
        let time_ns = n * 15_000_000;
        let pose = PoseSample {
            time_ns,
            position_m: [(n % 2) as f64 * 0.001, 0.0, 0.0],
            quaternion_xyzw: [0.0, 0.0, 0.0, 1.0],
            valid: true,
            result: TrackingResult::Ok,
        };
        writer.write_pose(&pose).unwrap();
        let frame = Frame {
            tick: time_ns / 1000,
            host_time_ns: time_ns,
            temperature_c: 30,
            data_saturated: false,
            frame_delayed: false,
            calibration_needed: false,
            samples: vec![Default::default(); samples],
        };
        writer.write_frame(&frame).unwrap();
    }
    writer.finish().unwrap();
    assert!(folder.read("silence.mcap").len() < 20_000_000);
}

#[test]
fn a_file_that_swells_does_not_take_the_memory() {
    let folder = Folder::new("memory");
    write_silence(&folder);
    for (command, message) in [
        ("info silence.mcap", ""),
        ("reconstruct silence.mcap --voxel-m 0.2 --sweeps 10 --out v.npy", ""),
        ("reconstruct silence.mcap --voxel-m 0.2 --out all.npy", "sweeps are more than fit in memory"),
        ("calibrate silence.mcap", "no stationary reflector"),
    ] {
        let limited = format!("ulimit -v {LIMIT_KIB}; exec {PROGRAM} {command}");
        let mut shell = Command::new("sh");
        // One arena and two threads: each reserves address space that it does not use.
        shell.env("MALLOC_ARENA_MAX", "1").env("RAYON_NUM_THREADS", "2").current_dir(folder.path("."));
        let output = shell.args(["-c", &limited]).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.success(), message.is_empty(), "{command}: {said}");
        assert!(said.contains(message), "{command}: {said}");
    }
}

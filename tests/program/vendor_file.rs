//! Import of a file in the format of the vendor's exploration tool with a pose track, both made
//! from a simulation: the path that real data take, with known truth.

use std::fmt::Write;

use a121::{Frame, SensorConfig, preset};
use glam::DVec3;
use hdf5_pure::{CompoundTypeBuilder, FileBuilder, GroupBuilder};
use radar_mapping::Event;
use radar_recording::Recording;
use radar_simulation::{Scenario, Simulated};

use crate::common::Folder;
use crate::found::{obstacles_of, only};

#[test]
fn imported_corner_reflector_is_as_accurate_as_simulated() {
    let folder = Folder::new("vendor_file");
    // Five seeds keep the test short; `lab/examples/ls_accuracy.rs` measured a median of 3.5 mm
    // over twenty.
    let mut errors_m: Vec<f64> = (1..=5).map(|seed| error_of_import_m(&folder, seed)).collect();
    errors_m.sort_by(f64::total_cmp);
    assert!(errors_m[2] <= 0.005 && errors_m[4] <= 0.012, "{errors_m:?} m");
}

#[test]
fn csv_and_tum_tracks_give_equal_poses() {
    let folder = Folder::new("vendor_csv");
    let config = preset("fine").unwrap();
    let scenario = Scenario::new("corner-reflector", "robot-arm", config, 0.5, 1);
    let simulated = scenario.run().unwrap();
    folder.write("frames.h5", h5(&scenario.config, &simulated.frames));
    let tum = track(&scenario, &simulated);
    folder.write("arm.tum", &tum);
    // As a controller may write it: other columns first, millimetres, semicolons.
    let row = |line: &str| {
        let n: Vec<f64> = line.split(' ').map(|word| word.parse().unwrap()).collect();
        format!("1;{};{};{};{};{};{};{};{}\n", n[7], n[4], n[5], n[6], n[1] * 1e3, n[2] * 1e3, n[3] * 1e3, n[0] * 1e3)
    };
    let rows: String = tum.lines().skip(1).map(row).collect();
    folder.write("arm.csv", format!("joint_1;qw;qx;qy;qz;x_mm;y_mm;z_mm;time_ms\n{rows}"));
    let [tum, csv] = ["tum", "csv"].map(|format| {
        folder.run(&format!("import frames.h5 --poses arm.{format} --out {format}.mcap")).succeeds();
        let recording = Recording::open(folder.path(&format!("{format}.mcap"))).unwrap();
        let poses = recording.filter_map(|event| match event {
            Event::Pose(pose) => Some(pose),
            _ => None,
        });
        poses.collect::<Vec<_>>()
    });
    assert!(tum.len() > 100 && tum.len() == csv.len());
    for (a, b) in tum.iter().zip(&csv) {
        assert!((a.time_ns - b.time_ns).abs() <= 1 && a.quaternion_xyzw == b.quaternion_xyzw, "{a:?} {b:?}");
        assert!(DVec3::from_array(a.position_m).distance(DVec3::from_array(b.position_m)) < 1e-9, "{a:?} {b:?}");
    }
    folder.write("bad.csv", "time_s,x,y,z,roll,pitch,yaw\n0,0,0,0,0,0,0\n");
    folder
        .run("import frames.h5 --poses bad.csv --out r.mcap")
        .fails_with("bad.csv, line 1: no column for qx, qy, qz, qw");
    folder.write("short.csv", "t,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n\n1,0\n");
    folder
        .run("import frames.h5 --poses short.csv --out r.mcap")
        .fails_with("short.csv, line 4: 2 cells under 8 names");
}

#[test]
fn track_that_lost_digits_is_reported_and_its_poses_are_not_used() {
    let folder = Folder::new("vendor_cut");
    folder.write("frames.h5", short_h5());
    let row = |n: i32| format!("{:.2} 0 0 0 0 0 0.7071068 0.7071068\n", f64::from(n) * 0.01);
    let rows: String = (-10..70).map(row).collect();
    folder.write("whole.tum", &rows);
    let whole = folder.run("import frames.h5 --poses whole.tum --out r.mcap").succeeds().prints("all valid");
    assert!(whole.err.is_empty(), "{whole:#?}");
    folder.write("cut.tum", rows.trim_end().strip_suffix(".7071068").unwrap());
    let cut = folder.run("import frames.h5 --poses cut.tum --out r.mcap --force").succeeds().prints("Poses      79 ");
    assert!(cut.err.contains("cut.tum, line 80: the track ends without a line end"), "{cut:#?}");
    folder.write("short.tum", rows.replacen(".7071068\n", "\n", 3));
    let short = folder.run("import frames.h5 --poses short.tum --out r.mcap --force").succeeds().prints("3 invalid");
    let message = "the quaternions of 3 poses do not have length 1 and are not used, the first at -0.100 s";
    assert!(short.err.contains(message), "{short:#?}");
}

#[test]
fn track_too_sparse_for_the_settings_is_reported_with_the_remedy() {
    let folder = Folder::new("vendor_sparse");
    folder.write("frames.h5", short_h5());
    let rows: String = (-3..10).map(|n| format!("{:.1} 0 0 0 0 0 0 1\n", f64::from(n) * 0.1)).collect();
    folder.write("slow.tum", rows);
    let finding = "poses come at 10.0 Hz (median spacing 100 ms), tracking.history.max_gap_s joins those within 50 ms. Record the \
                   poses at 40 Hz or more, or have them joined, less exactly, with --set tracking.history.max_gap_s=0.15.";
    let imported = folder.run("import frames.h5 --poses slow.tum --out r.mcap").succeeds();
    assert!(imported.err.contains(finding), "{imported:#?}");
    folder.run("replay r.mcap").succeeds().prints(&format!("\n60 sweeps have no pose: {finding}\nNo sweep has a pose"));
    let raised = folder.run("replay r.mcap --set tracking.history.max_gap_s=0.15").succeeds();
    let raised = raised.prints("60 sweeps imaged, 0 frames without a pose skipped\n\n");
    assert!(!raised.out.contains("have no pose"), "{raised:#?}");
}

#[test]
fn sensor_at_rest_is_imported_with_a_fixed_pose() {
    let folder = Folder::new("vendor_fixed");
    folder.write("frames.h5", short_h5());
    for (option, position_m) in
        [("--fixed-pose", DVec3::ZERO), ("--fixed-pose=-1,1.6,0,0,0,0,1", DVec3::new(-1.0, 1.6, 0.0))]
    {
        folder
            .run(&format!("import frames.h5 {option} --out r.mcap --force"))
            .succeeds()
            .prints("import of frames.h5 at a fixed pose");
        folder.run("replay r.mcap").succeeds().prints("60 sweeps imaged, 0 frames without a pose skipped\n\n");
        let recording = Recording::open(folder.path("r.mcap")).unwrap();
        let poses = recording.filter_map(|event| if let Event::Pose(pose) = event { Some(pose) } else { None });
        let poses: Vec<_> = poses.collect();
        assert!(poses.len() >= 150 && poses.iter().all(|pose| pose.position_m == position_m.to_array()), "{option}");
    }
    folder
        .run("import frames.h5 --fixed-pose=1,2 --out r.mcap --force")
        .fails_with("\"1,2\" is no pose: give x,y,z or");
    folder.write("track.tum", "0 0 0 0 0 0 0 1\n");
    folder.run("import frames.h5 --fixed-pose --poses track.tum --out r.mcap").fails_with("cannot be used with");
}

#[test]
fn interrupted_file_is_imported_as_far_as_it_goes_or_refused_as_not_closed() {
    let folder = Folder::new("vendor_not_closed");
    let mut grown = short_h5();
    grown.extend([7; 100]);
    folder.write("grown.h5", grown);
    let imported = folder.run("import grown.h5 --out r.mcap --force").succeeds().prints("Frames     60 over");
    let says =
        "grown.h5 was not closed by its writer: 60 frames recovered, 100 bytes written after the last flush lost";
    assert!(imported.err.contains(says), "{imported:#?}");
    // A superblock as at the creation of the file, then nothing.
    let mut never_flushed = b"\x89HDF\r\n\x1a\n\0\0\0\0\0\x08\x08\0\x04\0\x10\0\x01\0\0\0".to_vec();
    never_flushed.extend([0, u64::MAX, 2048, u64::MAX, 0, 96, 1, 136, 680].into_iter().flat_map(u64::to_le_bytes));
    never_flushed.resize(8328, 0);
    folder.write("never.h5", never_flushed);
    folder.run("import never.h5 --out r.mcap --force").fails_with("never.h5 was not closed by its writer");
}

/// The system ends the reader's process in the middle of its work; the program says so, and leaves nothing behind.
#[cfg(unix)]
#[test]
fn reader_that_ends_abruptly_is_reported() {
    let folder = Folder::new("vendor_abrupt");
    let scenario = Scenario::new("corner-reflector", "robot-arm", preset("fine").unwrap(), 0.5, 1);
    folder.write("frames.h5", h5(&scenario.config, &scenario.run().unwrap().frames));
    // Eight of the shell's unit, 512 or 1024 bytes, are all that it may write to a file.
    let shell = format!("ulimit -f 8; exec {} import frames.h5 --out r.mcap", crate::PROGRAM);
    let output = std::process::Command::new("sh").args(["-c", &shell]).current_dir(folder.path("")).output().unwrap();
    let says = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{says}");
    assert!(says.contains("the reader of .h5 files ended abruptly (signal: 25"), "{says}");
    assert!(std::fs::read_dir(folder.path("")).unwrap().all(|file| {
        let name = file.unwrap().file_name();
        name == "frames.h5" || name == "streams"
    }));
}

/// Simulated, written as the vendor's file and a track, imported, replayed with 50 sweeps: distance
/// to the truth, metres.
fn error_of_import_m(folder: &Folder, seed: u64) -> f64 {
    let config = preset("fine").unwrap();
    let mut scenario = Scenario::new("corner-reflector", "sphere-50cm", config, 10.0, seed);
    scenario.snr_db = Some(20.0);
    let simulated = scenario.run().unwrap();
    folder.write("frames.h5", h5(&scenario.config, &simulated.frames));
    folder.write("track.tum", track(&scenario, &simulated));
    folder
        .run("import frames.h5 --poses track.tum --out r.mcap --force")
        .succeeds()
        .prints("Frames     1200 over 9.99 s");
    let found = only(obstacles_of(folder, "r.mcap --set reflectors.max_sweeps=50"));
    found.position_m.distance(DVec3::new(-0.3, 1.5, -1.0))
}

/// The sensor's poses as TUM text, seconds since the first frame.
fn track(scenario: &Scenario, simulated: &Simulated) -> String {
    let mut text = String::from("# timestamp_s tx ty tz qx qy qz qw\n");
    for sample in &simulated.poses {
        let pose = sample.tracking_from_head().unwrap() * scenario.head_from_sensor;
        let time_s = (sample.time_ns - simulated.frames[0].host_time_ns) as f64 * 1e-9;
        let (p, q) = (pose.translation, pose.rotation);
        writeln!(text, "{time_s:.9} {} {} {} {} {} {} {}", p.x, p.y, p.z, q.x, q.y, q.z, q.w).unwrap();
    }
    text
}

/// Half a second of a simulation as the vendor's file.
pub fn short_h5() -> Vec<u8> {
    let scenario = Scenario::new("corner-reflector", "robot-arm", preset("fine").unwrap(), 0.5, 1);
    h5(&scenario.config, &scenario.run().unwrap().frames)
}

/// The parts of the vendor's layout that an import reads.
fn h5(config: &SensorConfig, frames: &[Frame]) -> Vec<u8> {
    let mut file = FileBuilder::new();
    let server = r#"{"ticks_per_second": 1000000, "rss_version": "simulated", "hardware_name": "simulated"}"#;
    file.create_dataset("server_info").with_vlen_strings(&[server]);
    let mut session = file.create_group("session");
    let session_config = serde_json::json!({"groups": [{"1": config}]}).to_string();
    session.create_dataset("session_config").with_vlen_strings(&[&session_config]);
    let mut group = session.create_group("group_0");
    let mut entry = group.create_group("entry_0");
    entry.create_dataset("sensor_id").with_i64_data(&[1]);
    entry.create_dataset("metadata").with_vlen_strings(&[r#"{"base_step_length_m": 0.0025}"#]);
    let mut result = entry.create_group("result");
    fill_result(&mut result, config, frames);
    entry.add_group(result.finish());
    group.add_group(entry.finish());
    session.add_group(group.finish());
    file.add_group(session.finish());
    file.finish().unwrap()
}

fn fill_result(result: &mut GroupBuilder, config: &SensorConfig, frames: &[Frame]) {
    let complex = CompoundTypeBuilder::new().i16_field("real").i16_field("imag").build().unwrap();
    let samples = frames.iter().flat_map(|f| &f.samples);
    let bytes: Vec<u8> = samples.flat_map(|s| [s.re.to_le_bytes(), s.im.to_le_bytes()].concat()).collect();
    let count = frames.len() as u64;
    let shape = [count, config.sweeps_per_frame.into(), config.points_per_sweep() as u64];
    result.create_dataset("frame").with_compound_data(complex, bytes, count * shape[1] * shape[2]).with_shape(&shape);
    let ticks: Vec<i64> = frames.iter().map(|f| f.tick).collect();
    result.create_dataset("tick").with_i64_data(&ticks);
    result.create_dataset("temperature").with_i64_data(&vec![30; frames.len()]);
    for flag in ["data_saturated", "frame_delayed", "calibration_needed"] {
        result.create_dataset(flag).with_u8_data(&vec![0; frames.len()]);
    }
}

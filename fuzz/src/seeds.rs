//! Seeds of each target's corpus, made with the program's own writers.

use std::path::Path;

use a121::{Frame, SensorConfig, Subsweep};
use glam::{DMat3, DVec3};
use hdf5_pure::{CompoundTypeBuilder, FileBuilder};
use num_complex::Complex;
use radar_chaperone::settings::Settings;
use radar_mapping::{Event, SavedMap, SavedPoint, SavedWall};
use radar_recording::{Existing, Header, MapFile, RecordingWriter};
use radar_sar::PoseSample;
use radar_sar::geometry::{Aabb, Plane, Pose};

use crate::board::{Board, result, setup};
use crate::file::temp_path;

/// Writes a target's seeds to the directory in the environment variable `SEEDS`, if set.
pub fn write(target: &str) {
    let Some(folder) = std::env::var_os("SEEDS") else { return };
    let seeds = match target {
        "parser" => parser(),
        "session" => sessions(),
        "recording" => recordings(),
        "track" => {
            vec![b"# timestamp_s tx ty tz qx qy qz qw\n0.5 1 2 3 0 0 0 1\n1e0 -1 nan 3e-1 0 0 0.6 0.8 # c\n".to_vec()]
        }
        "settings" => settings(),
        "vendor_h5" => vec![vendor_h5(3), vendor_h5(0)],
        "events" => events(),
        "map" => maps(),
        "recover" => edits(),
        _ => panic!("no target {target}"),
    };
    for (index, seed) in seeds.iter().enumerate() {
        std::fs::write(Path::new(&folder).join(format!("seed-{index}")), seed).expect("the corpus can be written");
    }
}

/// Streams of each set-up, after the replies to its commands.
fn parser() -> Vec<Vec<u8>> {
    let stream = |choice: u8| {
        let setup = setup(choice);
        let mut bytes = vec![choice, 7];
        let mut board = Board::new(setup.clone(), true);
        for command in ["get_system_info", "get_sensor_info", "set_uart_baudrate", "setup", "start_streaming"] {
            bytes.extend(board.answer(format!("\"{command}\"\n").as_bytes()));
        }
        for (tick, flags, fill) in [(77, 0, 0), (4_294_967_295, 7, b'{'), (15_000, 2, b'"'), (30_000, 0, b'\n')] {
            bytes.extend(result(&setup, tick, flags, fill));
            bytes
                .extend(b"{\"status\":\"log\",\"level\":\"info\",\"timestamp\":7,\"module\":\"m\",\"log\":\"{ok}\"}\n");
        }
        bytes.extend(b"{\"status\":\"error\",\"message\":\"no\"}\n{\"status\":\"stop\",\"payload_size\":0}\n");
        bytes
    };
    (0..4).map(stream).chain([stream(0xf0)]).collect()
}

/// Scripts for the session target: open, stream, faults, lost and reopened line.
fn sessions() -> Vec<Vec<u8>> {
    const OPEN: [u8; 14] = [12, 0, 0, 0, 0, 0, 0, 0, 7, 7, 7, 7, 7, 7];
    let script = |choice: u8, is_tcp: u8, rest: &[u8]| [&[choice, is_tcp], &OPEN[..], rest].concat();
    let wrong_tick = [8, 1, 2, 3, 4, 0, 0, 0, 0, 0, 9, 0, 7, 7];
    let calibration = [8, 0, 0, 0, 0, 0, 0, 0, 0, 2, 9, 0, 7, 7, 0, 7, 7];
    let damage = [8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 9, 2, 20, 0, 4, 0, 7, 7];
    vec![
        script(0, 0, &[7, 7, 7, 14, 0x42, 0]),
        script(1, 1, &[13, 13, 0, 0, 0, 7, 7, 7]),
        script(2, 0, &wrong_tick),
        script(3, 1, &calibration),
        script(0, 0, &damage),
        script(1, 0, &[11, 100, 11, 100, 12, 12, 12, 6, 2, 6, 3, 6, 4]),
    ]
}

fn frame(index: i64) -> Frame {
    Frame {
        tick: index * 15_000,
        host_time_ns: index * 15_000_000,
        temperature_c: 25,
        data_saturated: index == 1,
        frame_delayed: false,
        calibration_needed: false,
        samples: (0..4).map(|n| Complex::new(n, -n)).collect(),
    }
}

fn config() -> SensorConfig {
    SensorConfig { subsweeps: vec![Subsweep { num_points: 4, ..Default::default() }], ..Default::default() }
}

/// A complete and a truncated recording.
fn recordings() -> Vec<Vec<u8>> {
    let whole = recording(4);
    vec![whole[..whole.len() * 2 / 3].to_vec(), whole]
}

/// A recording of several chunks.
pub fn long_recording() -> Vec<u8> {
    recording(500)
}

fn recording(frames: i64) -> Vec<u8> {
    let path = temp_path("-seed");
    let header = Header::new("a seed", config(), Pose::IDENTITY);
    let mut writer = RecordingWriter::create(&path, &header, Existing::Replace).expect("a file");
    for index in 0..frames {
        writer.write(&Event::Frame(frame(index))).expect("a frame");
        writer.write(&Event::Pose(PoseSample::valid(index * 15_000_000, &Pose::IDENTITY))).expect("a pose");
    }
    writer.finish().expect("a recording");
    let whole = std::fs::read(&path).expect("a recording");
    std::fs::remove_file(&path).expect("a recording");
    whole
}

/// A sound stream with each kind of fault in it, and one with its times alone wrong.
fn events() -> Vec<Vec<u8>> {
    let far = i64::MAX.to_le_bytes();
    let nan = f64::NAN.to_bits().to_le_bytes();
    let faults = [&[2, 9, 0, 3, 4][..], &nan, &[1, 4], &nan, &[7, 7], &nan].concat();
    let times = [&[5][..], &far, &[6], &far, &[5], &[0; 8], &[6], &[0; 8]].concat();
    [faults, times].map(|wrong| [&[0, 100][..], &wrong, &[0, 100]].concat()).into()
}

/// A map of an obstacle and a wall, in both formats. Format 1 has the same content without a checksum, which no edit would keep.
fn maps() -> Vec<Vec<u8>> {
    let path = temp_path("-seed");
    let point = SavedPoint {
        id: 3,
        position_m: DVec3::new(0.3, 0.5, -1.5),
        covariance_m2: DMat3::from_diagonal(DVec3::new(1e-4, 4e-4, 9e-4)),
        score: 8.5,
        strengths: std::array::from_fn(|side| side as f64),
        shape: vec![(DVec3::new(0.3, 0.3, 0.0), 7.5)],
        first_ns: -1_000_000_007,
        last_ns: -5,
    };
    let wall = SavedWall {
        id: 1,
        plane: Plane { outward: DVec3::new(0.6, 0.0, -0.8), offset_m: 2.0 },
        score: 20.0,
        seen_at: Aabb { min: DVec3::NEG_ONE, max: DVec3::ONE },
        first_ns: -9,
        last_ns: -4,
    };
    let map = SavedMap { places: vec![point], walls: vec![wall] };
    MapFile::new(7, 1.0, Pose::IDENTITY, map).write(&path).expect("a map");
    let bytes = std::fs::read(&path).expect("a map");
    std::fs::remove_file(&path).expect("a map");
    let text = String::from_utf8(bytes).expect("JSON");
    let (_, content) = text.split_once(',').expect("a checksum");
    let first_format = format!("{{{content}").replace("\"format_version\":2", "\"format_version\":1");
    [first_format, text].map(String::into_bytes).into()
}

/// Each kind of edit.
fn edits() -> Vec<Vec<u8>> {
    vec![vec![], vec![9, 80, 0, 3], vec![0, 40, 1, 255, 0, 90, 2, 200], vec![7, 120, 3, 4, 1, 2, 3, 4]]
}

fn settings() -> Vec<Vec<u8>> {
    let manual = include_str!("../../docs/settings.toml").to_owned();
    let changes = "[tracking]\ntime_offset_s = 0.02\n%\nprocessing.mode=rooms\nradar.beam=[[0, 1.0], [30, 0.2]]\n";
    [manual, Settings::default().to_toml(), changes.to_owned(), String::new()].map(String::into_bytes).into()
}

/// The parts of the vendor's layout that the import reads.
fn vendor_h5(count: usize) -> Vec<u8> {
    let mut file = FileBuilder::new();
    let server = r#"{"ticks_per_second": 1000000, "rss_version": "a121-v1.12.0", "hardware_name": "xc120"}"#;
    file.create_dataset("server_info").with_vlen_strings(&[server]);
    let mut session = file.create_group("session");
    let session_config = serde_json::json!({"groups": [{"1": config()}]}).to_string();
    session.create_dataset("session_config").with_vlen_strings(&[&session_config]);
    let mut group = session.create_group("group_0");
    let mut entry = group.create_group("entry_0");
    entry.create_dataset("sensor_id").with_i64_data(&[1]);
    entry.create_dataset("metadata").with_vlen_strings(&[r#"{"base_step_length_m": 0.0025}"#]);
    let mut result = entry.create_group("result");
    let samples = (0..count * 4).flat_map(|n| [n as i16, -(n as i16)]).flat_map(i16::to_le_bytes).collect();
    let complex = CompoundTypeBuilder::new().i16_field("real").i16_field("imag").build().expect("a type");
    result.create_dataset("frame").with_compound_data(complex, samples, count as u64).with_shape(&[count as u64, 1, 4]);
    let ticks: Vec<i64> = (0..count as i64).map(|n| n * 15_000).collect();
    result.create_dataset("tick").with_i64_data(&ticks);
    result.create_dataset("temperature").with_i64_data(&vec![25; count]);
    for name in ["data_saturated", "frame_delayed", "calibration_needed"] {
        result.create_dataset(name).with_u8_data(&vec![0; count]);
    }
    entry.add_group(result.finish());
    group.add_group(entry.finish());
    session.add_group(group.finish());
    file.add_group(session.finish());
    file.finish().expect("a file")
}

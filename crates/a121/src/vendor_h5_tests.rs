//! Tests with small generated files, and with the vendor's own.

use std::sync::atomic::{AtomicU32, Ordering};

use hdf5_pure::{CompoundTypeBuilder, FileBuilder};
use serde_json::Value;

use super::*;
use crate::preset;

/// A unique path in the system's temporary directory; the file is removed on drop.
struct TestFile(PathBuf);

impl TestFile {
    fn with(bytes: &[u8]) -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let name = format!("a121-vendor-{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        let path = std::env::temp_dir().join(name);
        std::fs::write(&path, bytes).unwrap();
        Self(path)
    }
}

impl Drop for TestFile {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

/// A recording, and its frames.
struct Whole {
    recording: VendorRecording,
    frames: Vec<Frame>,
}

impl std::fmt::Debug for Whole {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        self.recording.fmt(f)
    }
}

impl std::ops::Deref for Whole {
    type Target = VendorRecording;

    fn deref(&self) -> &VendorRecording {
        &self.recording
    }
}

fn whole(path: impl AsRef<Path>) -> Result<Whole, VendorFileError> {
    let recording = VendorRecording::open(path)?;
    let frames: Vec<Frame> = recording.frames().collect::<Result<_, _>>()?;
    assert!(recording.times_ns().eq(frames.iter().map(|frame| frame.host_time_ns)));
    Ok(Whole { recording, frames })
}

fn read(bytes: &[u8]) -> Result<Whole, VendorFileError> {
    whole(&TestFile::with(bytes).0)
}

fn message(bytes: &[u8]) -> String {
    read(bytes).unwrap_err().to_string()
}

/// What a generated file says, right or wrong.
struct Claims {
    config: SensorConfig,
    server: &'static str,
    session_config: Option<String>,
    ticks: Vec<i64>,
    temperatures: Vec<i64>,
    /// Shape of the samples; their number follows from it.
    shape: Vec<u64>,
    names: [&'static str; 2],
    sensors: usize,
    /// Samples from this one on are 0.
    silent_from: u64,
}

impl Claims {
    /// A sound file with this many frames.
    fn sound(count: usize) -> Self {
        let config = preset("c16").unwrap();
        Self {
            server: r#"{"ticks_per_second": 1000, "rss_version": "a121-v1.12.0", "hardware_name": "xm125"}"#,
            session_config: None,
            ticks: (0..count as i64).map(|n| 500 + 15 * n).collect(),
            temperatures: vec![-7; count],
            shape: vec![count as u64, config.sweeps_per_frame.into(), config.points_per_sweep() as u64],
            names: ["real", "imag"],
            sensors: 1,
            silent_from: u64::MAX,
            config,
        }
    }

    fn samples(&self) -> u64 {
        self.shape.iter().product()
    }

    fn file(&self) -> Vec<u8> {
        let mut file = FileBuilder::new();
        file.create_dataset("server_info").with_vlen_strings(&[self.server]);
        let mut session = file.create_group("session");
        let session_config = serde_json::json!({"groups": [{"3": self.config}]}).to_string();
        let session_config = self.session_config.as_deref().unwrap_or(&session_config);
        session.create_dataset("session_config").with_vlen_strings(&[session_config]);
        let mut group = session.create_group("group_0");
        for index in 0..self.sensors {
            let mut entry = group.create_group(&format!("entry_{index}"));
            entry.create_dataset("sensor_id").with_i64_data(&[3]);
            entry.create_dataset("metadata").with_vlen_strings(&[r#"{"base_step_length_m": 0.0025}"#]);
            let mut result = entry.create_group("result");
            let [real, imag] = self.names;
            let complex = CompoundTypeBuilder::new().i16_field(real).i16_field(imag).build().unwrap();
            let level = |n: u64| if n < self.silent_from { n as i16 } else { 0 };
            let samples = (0..self.samples()).flat_map(|n| [level(n), -level(n)]).flat_map(i16::to_le_bytes);
            result
                .create_dataset("frame")
                .with_compound_data(complex, samples.collect(), self.samples())
                .with_shape(&self.shape);
            result.create_dataset("tick").with_i64_data(&self.ticks);
            result.create_dataset("temperature").with_i64_data(&self.temperatures);
            for (index, name) in ["data_saturated", "frame_delayed", "calibration_needed"].into_iter().enumerate() {
                let flags: Vec<u8> = (0..self.ticks.len()).map(|n| u8::from(n == index)).collect();
                result.create_dataset(name).with_u8_data(&flags);
            }
            entry.add_group(result.finish());
            group.add_group(entry.finish());
        }
        session.add_group(group.finish());
        file.add_group(session.finish());
        file.finish().unwrap()
    }
}

#[test]
fn everything_in_a_file_is_read() {
    let claims = Claims { sensors: 2, ..Claims::sound(5) };
    let recording = read(&claims.file()).unwrap();
    assert_eq!(recording.config, claims.config);
    assert_eq!((recording.ticks_per_second, recording.base_step_length_m), (1000, Some(0.0025)));
    let said = (recording.board.as_deref(), recording.rss_version.as_deref());
    assert_eq!(said, (Some("xm125"), Some("a121-v1.12.0")));
    assert_eq!(recording.contents, Contents { sessions: 1, groups: 1, sensors: 2 });
    assert!(recording.contents.has_more());
    assert_eq!(recording.frames.len(), 5);
    let points = claims.config.points_per_frame();
    for (index, frame) in recording.frames.iter().enumerate() {
        let n = (index * points) as i16;
        assert_eq!((frame.samples[0].re, frame.samples[0].im, frame.samples.len()), (n, -n, points));
        assert_eq!((frame.tick, frame.temperature_c), (500 + 15 * index as i64, -7));
        assert_eq!(frame.host_time_ns, 15_000_000 * index as i64);
        let flags = [frame.data_saturated, frame.frame_delayed, frame.calibration_needed];
        assert_eq!(flags, [index == 0, index == 1, index == 2]);
    }
    let empty = read(&Claims::sound(0).file()).unwrap();
    assert!(empty.frames.is_empty() && !empty.contents.has_more());
}

#[test]
fn update_rate_of_the_session_is_the_frame_rate() {
    let with_rates = |update_rate: Value, frame_rate: Option<f64>| {
        let mut claims = Claims::sound(1);
        claims.config.frame_rate = frame_rate;
        let session = serde_json::json!({"update_rate": update_rate, "groups": [{"3": claims.config}]});
        claims.session_config = Some(session.to_string());
        read(&claims.file())
    };
    assert_eq!(with_rates(Value::Null, None).unwrap().config.frame_rate, None);
    assert_eq!(with_rates(5.0.into(), None).unwrap().config.frame_rate, Some(5.0));
    assert_eq!(with_rates(Value::Null, Some(7.0)).unwrap().config.frame_rate, Some(7.0));
    let error = with_rates((-1.0).into(), None).unwrap_err().to_string();
    assert!(error.contains("breaks a rule of the sensor"), "{error}");
}

#[test]
fn foreign_files_are_rejected_with_a_reason() {
    let of_path = |path: &Path| whole(path).unwrap_err().to_string();
    assert!(of_path(Path::new("/no/such.h5")).contains("cannot read /no/such.h5"));
    assert!(of_path(&std::env::temp_dir()).contains("is a folder"));
    assert!(message(b"").contains("cannot be read as HDF5"));
    assert!(message(b"timestamp_s tx ty tz").contains("cannot be read as HDF5"));
    let mut other = FileBuilder::new();
    other.create_dataset("data").with_f64_data(&[1.0]);
    assert!(message(&other.finish().unwrap()).contains("has neither `session` nor `sessions/session_0`"));
}

#[test]
fn claims_that_contradict_each_other_are_rejected_with_their_values() {
    let refused = |change: fn(&mut Claims)| {
        let mut claims = Claims::sound(4);
        change(&mut claims);
        message(&claims.file())
    };
    type Case = (fn(&mut Claims), &'static str);
    let cases: [Case; 10] = [
        (|c| c.server = "{}", "`server_info` is not the expected JSON"),
        (|c| c.server = r#"{"ticks_per_second": 0}"#, "has 0 ticks_per_second"),
        (|c| c.session_config = Some("{}".into()), "holds no configuration in groups[0]"),
        (|c| c.session_config = Some(r#"{"groups": [{"3": 5}]}"#.into()), "is unreadable"),
        (|c| c.config.sweeps_per_frame = 0, "breaks a rule of the sensor"),
        (|c| c.config.sweeps_per_frame += 1, "samples a frame; its configuration says"),
        (|c| c.shape = vec![c.samples()], "not [frame, sweep, point]"),
        (|c| c.names = ["imag", "real"], "another type than {real: i16, imag: i16}"),
        (|c| c.temperatures[2] = 1 << 20, "[2] is 1048576 °C"),
        (|c| c.ticks[3] = i64::MAX, "result/tick` [3] is 9223372036854775807"),
    ];
    for (change, says) in cases {
        let message = refused(change);
        assert!(message.contains(says), "{message}");
    }
}

#[test]
fn frames_that_lack_parts_are_left_out_and_counted() {
    type Case = (fn(&mut Claims), usize, u64);
    let cases: [Case; 6] = [
        (|_| {}, 5, 0),
        (|c| c.ticks.truncate(3), 3, 2),
        (|c| c.temperatures.truncate(0), 0, 5),
        (|c| c.ticks.push(900), 5, 1),
        // Reserved and never written.
        (|c| c.ticks[3..].fill(0), 3, 2),
        (|c| c.temperatures[3..].fill(0), 5, 0),
    ];
    for (case, (change, frames, incomplete_frames)) in cases.into_iter().enumerate() {
        let mut claims = Claims::sound(5);
        change(&mut claims);
        let recording = read(&claims.file()).unwrap();
        assert_eq!(recording.frames.len(), frames, "case {case}");
        let expected = Unfinished { not_closed: false, incomplete_frames, unindexed_bytes: 0 };
        assert_eq!(recording.unfinished, (incomplete_frames > 0).then_some(expected), "case {case}");
    }
}

#[test]
fn silent_frames_count_as_unwritten_only_in_an_interrupted_file() {
    let mut claims = Claims::sound(5);
    claims.silent_from = claims.samples() / 5 * 3;
    let whole = read(&claims.file()).unwrap();
    assert_eq!((whole.frames.len(), whole.unfinished), (5, None));
    let mut left_open = claims.file();
    left_open.extend([7; 1000]);
    assert_eq!(read(&left_open).unwrap().frames.len(), 3);
}

/// What h5py 3.16 with HDF5 2.0 leaves when the process ends before the file is closed or flushed:
/// the superblock as at the creation, zeros, and the chunks that did not fit its cache.
fn never_flushed(latest: bool, chunks: &[u8]) -> Vec<u8> {
    const UNDEFINED: [u8; 8] = [0xff; 8];
    let address = |address: u64| address.to_le_bytes();
    let mut file = b"\x89HDF\r\n\x1a\n".to_vec();
    if latest {
        // Version 3, sizes, open for writing; base, extension, end, root, checksum.
        file.extend([3, 8, 8, 1]);
        file.extend([address(0), UNDEFINED, address(0x800), address(0x30)].concat());
        file.extend([0x58, 0x55, 0x84, 0xba]);
    } else {
        // Version 0, sizes, widths of trees, flags; base, free space, end, driver; the root's name
        // and header, and where its tree and heap will be.
        file.extend([0, 0, 0, 0, 0, 8, 8, 0, 4, 0, 16, 0, 1, 0, 0, 0]);
        file.extend([address(0), UNDEFINED, address(0x800), UNDEFINED].concat());
        file.extend([address(0), address(0x60), address(1), address(0x88), address(0x2a8)].concat());
    }
    file.resize(8328, 0);
    file.extend(chunks);
    file
}

#[test]
fn file_that_was_never_flushed_is_refused_as_not_closed() {
    // A compressed chunk: an empty stream of zlib will do.
    let chunk = b"\x78\x5e\x03\x00\x00\x00\x00\x01".repeat(1000);
    for (latest, chunks) in [(false, &[][..]), (false, &chunk), (true, &[]), (true, &chunk)] {
        let error = read(&never_flushed(latest, chunks)).unwrap_err();
        assert!(matches!(error, VendorFileError::NotClosed { .. }), "{error}");
        let message = error.to_string();
        for says in ["was not closed by its writer", "none can be recovered", "record again"] {
            assert!(message.contains(says), "{message}");
        }
    }
    // Cut off, or damaged: it was closed.
    let sound = Claims::sound(3).file();
    assert!(matches!(read(&sound[..sound.len() - 1]), Err(VendorFileError::Hdf5 { .. })));
    assert_survives_damage("never flushed", &never_flushed(false, &chunk));
}

/// The checksum of a version 2 or 3 superblock, as the reader computes it.
fn with_fixed_superblock(mut bytes: Vec<u8>) -> Vec<u8> {
    let message = message(&bytes);
    let (_, computed) = message.split_once("computed 0x").expect("a checksum");
    let sum = u32::from_str_radix(&computed[..8], 16).expect("a checksum");
    bytes[44..48].copy_from_slice(&sum.to_le_bytes());
    bytes
}

#[test]
fn flushed_file_that_was_not_closed_is_read_as_far_as_it_goes() {
    let claims = Claims { ticks: vec![500, 515, 530], ..Claims::sound(5) };
    let sound = claims.file();
    assert!(matches!(sound[8], 2 | 3), "the version of the superblock is {}", sound[8]);
    // Chunks that were written after the flush.
    let mut grown = sound.clone();
    grown.extend([7; 1000]);
    let mut marked = sound.clone();
    marked[8] = 3;
    marked[11] |= 1;
    for (bytes, unindexed_bytes) in [(grown, 1000), (with_fixed_superblock(marked), 0)] {
        let recording = read(&bytes).unwrap();
        assert_eq!(recording.frames.len(), 3);
        let expected = Unfinished { not_closed: true, incomplete_frames: 2, unindexed_bytes };
        assert_eq!(recording.unfinished, Some(expected));
    }
    // With an index that cannot be read.
    let mut damaged = sound.clone();
    let at = damaged.windows(7).position(|name| name == b"session").expect("a group's name");
    damaged[at] = b'S';
    damaged.extend([7; 1000]);
    let message = message(&damaged);
    assert!(message.contains("not closed by its writer") && message.contains("h5clear and h5repack"), "{message}");
}

/// The file with this number of frames in the shape of its samples, and the checksum of that.
fn with_claimed_frames(claims: &Claims, claimed: u64) -> Vec<u8> {
    let mut bytes = claims.file();
    let of_shape: Vec<u8> = claims.shape.iter().flat_map(|edge| edge.to_le_bytes()).collect();
    for at in 0..bytes.len() - of_shape.len() {
        if bytes[at..].starts_with(&of_shape) {
            bytes[at..at + 8].copy_from_slice(&claimed.to_le_bytes());
        }
    }
    let message = message(&bytes);
    let (_, sums) = message.split_once("checksum mismatch: expected 0x").expect("a checksum");
    let (stored, computed) = sums.split_once(", computed 0x").expect("two checksums");
    let sum = |text: &str| u32::from_str_radix(&text[..8], 16).expect("a checksum").to_le_bytes();
    let (stored, computed) = (sum(stored), sum(computed));
    let at = bytes.windows(4).position(|four| four == stored).expect("the checksum is stored");
    bytes[at..at + 4].copy_from_slice(&computed);
    bytes
}

#[test]
fn lengths_in_a_file_are_not_believed() {
    let claims = Claims::sound(5);
    // Frames that only one of the data sets has are left out and counted.
    for (claimed, frames) in [(6, 5), (1 << 14, 5)] {
        let recording = read(&with_claimed_frames(&claims, claimed)).unwrap();
        let incomplete = recording.unfinished.unwrap().incomplete_frames;
        assert_eq!((recording.frames.len() as u64, incomplete), (frames, claimed - frames), "{claimed}");
    }
    let (held, limit) = ("bytes can hold", "frames, more than the 2097152");
    for (claimed, says) in
        [(4, "cannot be read"), (1 << 20, held), (1 << 23, limit), (1 << 40, limit), (u64::MAX, limit)]
    {
        let message = message(&with_claimed_frames(&claims, claimed));
        assert!(message.contains(says), "{claimed}: {message}");
    }
}

/// Any damage gives an error or complete frames, never a panic.
fn assert_survives_damage(name: &str, bytes: &[u8]) {
    for length in (0..bytes.len()).step_by(bytes.len() / 37) {
        assert!(read(&bytes[..length]).is_err(), "{name} cut to {length}");
    }
    for position in (0..bytes.len()).step_by(bytes.len() / 211) {
        let mut damaged = bytes.to_vec();
        damaged[position] ^= 0xff;
        if let Ok(recording) = read(&damaged) {
            let points = recording.config.points_per_frame();
            assert!(recording.frames.iter().all(|f| f.samples.len() == points), "{name} at {position}");
        }
    }
}

#[test]
fn damaged_files_give_an_error_or_complete_frames() {
    assert_survives_damage("generated", &Claims::sound(3).file());
}

/// Path of a recording of the vendor. Tests that need one are ignored unless asked for, and then
/// fail without it: none passes by doing nothing.
fn real(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/recordings").join(name);
    assert!(path.exists(), "{} does not exist: this test needs the vendor's recordings", path.display());
    path
}

/// FNV-1a hash. The constants below come from h5py and the same hash in Python.
fn checksum(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes.into_iter().fold(0xcbf2_9ce4_8422_2325, |sum, b| (sum ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
}

#[test]
#[ignore = "needs the vendor's recordings in ../shared/recordings"]
fn real_recordings_match_h5py() {
    // Name, frames, points per frame; hashes of samples, ticks and temperatures; last time in
    // ns.
    let known: [(&str, usize, usize, [u64; 3], i64); 5] = [
        (
            "corner-reflector.h5",
            113,
            74,
            [0xdf8d_0647_58e0_5695, 0x230b_baa6_92ba_dabc, 0xf491_09a9_d9a1_ba64],
            2_240_000_000,
        ),
        (
            "distance_fixed_strength.h5",
            93,
            33,
            [0x4911_4d76_c73e_5383, 0x2473_8a96_80b8_0c93, 0x49ad_7c04_2d57_7a39],
            18_399_995_000,
        ),
        ("fr10Hz-spf4.h5", 10, 640, [0xc826_5a96_ac4d_2505, 0x2f4c_a5c4_8dac_a767, 0x1fc3_a03d_0dee_bbc4], 905_757_000),
        ("input.h5", 10, 160, [0x0622_9340_8c57_dd19, 0xd6c9_6d13_fa50_e605, 0x2eaa_ec36_b267_ffc5], 24_752_000),
        (
            "medium_tank.h5",
            1740,
            287,
            [0xf80c_af47_1bc6_1ef8, 0x1333_9c2c_e0ac_1efa, 0x10f0_6aa6_9ffa_3b05],
            20_123_000_000,
        ),
    ];
    for (name, count, points, checksums, last_ns) in known {
        let recording = whole(real(name)).unwrap();
        let frames = &recording.frames;
        assert_eq!(frames.len(), count, "{name}");
        assert!(frames.iter().all(|f| f.samples.len() == points), "{name}");
        let samples = frames.iter().flat_map(|f| &f.samples);
        let samples = checksum(samples.flat_map(|s| [s.re, s.im]).flat_map(i16::to_le_bytes));
        let ticks = checksum(frames.iter().flat_map(|f| f.tick.to_le_bytes()));
        let temperatures = checksum(frames.iter().flat_map(|f| i64::from(f.temperature_c).to_le_bytes()));
        assert_eq!([samples, ticks, temperatures], checksums, "{name}");
        assert_eq!((frames[0].host_time_ns, frames[count - 1].host_time_ns), (0, last_ns), "{name}");
        assert!(!frames.iter().any(|f| f.data_saturated || f.frame_delayed || f.calibration_needed), "{name}");
    }
}

#[test]
#[ignore = "needs the vendor's recordings in ../shared/recordings"]
fn damaged_real_files_give_an_error_or_complete_frames() {
    for name in ["corner-reflector.h5", "input.h5"] {
        assert_survives_damage(name, &std::fs::read(real(name)).unwrap());
    }
}

#[test]
#[ignore = "needs the vendor's recordings in ../shared/recordings"]
fn every_real_recording_is_read() {
    let mut names: Vec<PathBuf> = std::fs::read_dir(real("")).unwrap().map(|entry| entry.unwrap().path()).collect();
    names.retain(|path| path.extension().is_some_and(|extension| extension == "h5"));
    assert!(!names.is_empty());
    for path in names {
        let recording = whole(&path).unwrap();
        println!("{}: {} frames, {:?}", path.display(), recording.frames.len(), recording.contents);
        assert!(!recording.frames.is_empty(), "{}", path.display());
    }
    let contents = |name: &str| whole(real(name)).unwrap().contents;
    assert_eq!(contents("cargo_20_feet_utilization_and_presence.h5").sessions, 10);
    assert_eq!(contents("hand-motion-default.h5").sessions, 4);
    assert!(!contents("input.h5").has_more());
}

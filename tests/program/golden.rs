//! Golden outputs of five recordings: `tests/golden/README.md`.
//!
//! Each recording is replayed by the program. Obstacles are compared as text, everything else by
//! checksum. The same files serve every operating system, instruction set and number of threads.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::Folder;

/// When set, the test writes the files instead of comparing them.
const UPDATE: &str = "GOLDEN_UPDATE";
const STATISTICS: [&str; 7] = ["thesis-full", "thesis", "ls", "log", "glrt", "coherent", "blocks"];
/// The sensor assumed 5 cm beside its place.
const WRONG_MOUNT: &str = " --set tracking.mount={translation=[0.05,0.03,-0.1],rotation=[0.0,0.0,0.0,1.0]}";
/// The defaults of now: the recordings carry those of the day they were made.
const SETTINGS: &str = "settings.toml";
/// A box around the reflector: 16³ voxels.
const BOX: &str = "-0.7,1.1,-1.4,0.1,1.9,-0.6";

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name)
}

/// Text and checksums of the outputs of one recording.
#[derive(Debug, PartialEq)]
struct Outputs {
    obstacles: String,
    checksums: String,
}

impl Outputs {
    /// Replays a recording of this folder with additional environment variables.
    fn of_replay(folder: &Folder, name: &str, environment: &[(&str, &str)]) -> Self {
        Self::of_replay_set(folder, name, "", environment)
    }

    /// The same with more arguments.
    fn of_replay_set(folder: &Folder, name: &str, arguments: &str, environment: &[(&str, &str)]) -> Self {
        folder.write(SETTINGS, include_bytes!("../../docs/settings.toml"));
        let command = format!("replay {name}.mcap --settings {SETTINGS} --out out --results results.mcap{arguments}");
        folder.run_with(&command, environment).succeeds();
        let mut checksums = String::new();
        for file in ["obstacles.ply", "shape.ply"] {
            let _ = writeln!(checksums, "{file} {:08x}", crc32fast::hash(&folder.read(&format!("out/{file}"))));
        }
        for (topic, (count, checksum)) in topics(&folder.read("results.mcap")) {
            let _ = writeln!(checksums, "{topic} {count} messages {checksum:08x}");
        }
        Self { obstacles: String::from_utf8(folder.read("out/obstacles.json")).unwrap(), checksums }
    }

    /// Adds one volume per statistic.
    fn with_volumes(mut self, folder: &Folder, name: &str, environment: &[(&str, &str)]) -> Self {
        for statistic in STATISTICS {
            let options = format!("--statistic {statistic} --sweeps 60 --box={BOX} --out v.npy");
            folder.run_with(&format!("reconstruct {name}.mcap {options}"), environment).succeeds();
            let _ = writeln!(self.checksums, "volume {statistic} {:08x}", crc32fast::hash(&folder.read("v.npy")));
        }
        self
    }

    fn files(&self, name: &str) -> [(PathBuf, &str); 2] {
        [
            (golden(&format!("{name}.obstacles.json")), &self.obstacles),
            (golden(&format!("{name}.txt")), &self.checksums),
        ]
    }

    /// Compares with the files in the repository, or writes them.
    fn compare(&self, name: &str) {
        for (path, now) in self.files(name) {
            if std::env::var_os(UPDATE).is_some() {
                fs::write(&path, now).unwrap();
            }
            // A checkout on Windows may have converted the line ends.
            let before = fs::read_to_string(&path).unwrap().replace("\r\n", "\n");
            let differing = before.lines().zip(now.lines()).find(|(a, b)| a != b);
            assert!(before == now, "{} differs, first (before, now): {differing:?}", path.display());
        }
    }
}

/// Number of messages of each topic, and checksum of their times and bytes. Without the copies of
/// the recording's own frames and poses and without the log's text: these are no results.
fn topics(bytes: &[u8]) -> BTreeMap<String, (usize, u32)> {
    let mut hashers: BTreeMap<String, (usize, crc32fast::Hasher)> = BTreeMap::new();
    for message in mcap::MessageStream::new(bytes).unwrap() {
        let message = message.unwrap();
        let topic = &message.channel.topic;
        if topic.starts_with("/radar") || topic.starts_with("/tracking") || topic == "/log" {
            continue;
        }
        let (count, hasher) = hashers.entry(topic.clone()).or_default();
        *count += 1;
        hasher.update(&message.log_time.to_le_bytes());
        hasher.update(&message.data);
    }
    hashers.into_iter().map(|(topic, (count, hasher))| (topic, (count, hasher.finalize()))).collect()
}

/// A folder with a copy of the recording.
fn with_recording(test: &str, name: &str) -> Folder {
    let folder = Folder::new(&format!("golden-{test}"));
    let file = format!("{name}.mcap");
    folder.write(&file, fs::read(golden(&file)).unwrap());
    folder
}

#[test]
fn golden_d16_room() {
    let folder = with_recording("d16", "d16_room");
    Outputs::of_replay(&folder, "d16_room", &[]).compare("d16_room");
}

#[test]
fn golden_room_whose_mount_is_corrected() {
    let folder = with_recording("mount", "d16_room");
    let outputs = Outputs::of_replay_set(&folder, "d16_room", WRONG_MOUNT, &[]);
    let result: serde_json::Value = serde_json::from_str(&outputs.obstacles).unwrap();
    let in_use_m: Vec<f64> = serde_json::from_value(result["mount"]["in_use_m"].clone()).unwrap();
    let off_m = glam::DVec3::from_slice(&in_use_m).distance(glam::DVec3::new(0.0, 0.03, -0.1));
    assert!(off_m < 5e-3, "{in_use_m:?}");
    outputs.compare("wrong_mount");
}

#[test]
fn golden_c16_room() {
    let folder = with_recording("c16", "c16_room");
    Outputs::of_replay(&folder, "c16_room", &[]).compare("c16_room");
}

#[test]
fn golden_play_session() {
    let folder = with_recording("play", "play");
    Outputs::of_replay(&folder, "play", &[]).compare("play");
}

#[test]
fn golden_reflector_and_its_volumes() {
    let folder = with_recording("reflector", "reflector");
    Outputs::of_replay(&folder, "reflector", &[]).with_volumes(&folder, "reflector", &[]).compare("reflector");
}

#[test]
fn golden_damaged_recording() {
    let folder = Folder::new("golden-damaged");
    let mut bytes = fs::read(golden("d16_room.mcap")).unwrap();
    let (third, kept) = (bytes.len() / 3, bytes.len() * 9 / 10);
    bytes[third..third + 64].fill(0x5a);
    bytes.truncate(kept);
    folder.write("damaged.mcap", bytes);
    Outputs::of_replay(&folder, "damaged", &[]).compare("damaged");
}

/// Runs with one thread, and with every instruction set that this processor has; without AVX-512
/// that limit changes nothing.
#[test]
fn golden_outputs_do_not_depend_on_threads_and_instructions() {
    for instructions in ["portable", "avx2", "avx512"] {
        for (name, threads) in [("reflector", "3"), ("c16_room", "1")] {
            let environment = [("RADAR_CHAPERONE_INSTRUCTIONS", instructions), ("RAYON_NUM_THREADS", threads)];
            let folder = with_recording(&format!("{instructions}-{name}"), name);
            let outputs = Outputs::of_replay(&folder, name, &environment);
            match name {
                "reflector" => outputs.with_volumes(&folder, name, &environment).compare(name),
                _ => outputs.compare(name),
            }
        }
        let environment = [("RADAR_CHAPERONE_INSTRUCTIONS", instructions), ("RAYON_NUM_THREADS", "1")];
        let folder = with_recording(&format!("{instructions}-mount"), "d16_room");
        Outputs::of_replay_set(&folder, "d16_room", WRONG_MOUNT, &environment).compare("wrong_mount");
    }
}

#[test]
fn an_unknown_instruction_set_is_refused() {
    let folder = with_recording("unknown-instructions", "reflector");
    folder
        .run_with("info reflector.mcap", &[("RADAR_CHAPERONE_INSTRUCTIONS", "sse9")])
        .fails_with("portable, neon, avx2 or avx512");
}

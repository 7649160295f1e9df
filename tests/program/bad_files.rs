//! Files that a command cannot use: missing, empty, foreign, truncated, damaged.

use crate::common::Folder;
use crate::vendor_file::short_h5;

/// The commands that read a recording. `FILE` stands for it.
const READERS: [&str; 4] = [
    "info FILE",
    "replay FILE --out found --set reflectors.voxel_m=0.2",
    "reconstruct FILE --voxel-m 0.2 --sweeps 10 --out v.npy --force",
    "recover FILE --out saved.mcap --force",
];

/// Three and a half seconds, so that there are several chunks.
fn write_recording(folder: &Folder) -> Vec<u8> {
    folder.write("sensor.json", r#"{"subsweeps": [{"num_points": 80, "step_length": 6}], "frame_rate": 20.0}"#);
    let scenario = "corner-reflector --motion sphere-50cm --config sensor.json --duration-s 3.5 --snr-db 20";
    folder.run(&format!("simulate {scenario} --out sound.mcap")).succeeds();
    folder.read("sound.mcap")
}

fn write_foreign_files(folder: &Folder) {
    folder.write("empty", "");
    folder.write("text", "timestamp_s tx ty tz qx qy qz qw\n0 0 0 0 0 0 0 1\n");
    folder.write("picture", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01\x08\x02\0\0\0");
    // MCAP, but without this program's records.
    folder.write("mcap", b"\x89MCAP0\r\n");
    std::fs::create_dir(folder.path("folder")).unwrap();
}

#[test]
fn non_recordings_are_refused_with_a_reason() {
    let folder = Folder::new("no_recording");
    write_foreign_files(&folder);
    for command in READERS {
        for (file, message) in [
            ("missing", "cannot open missing: No such file or directory"),
            ("folder", "folder is a folder or a device: give the recording's file"),
            ("empty", "empty is empty: the recording ended before anything was written; record again"),
            ("text", "text is not a recording: it does not begin as an MCAP file"),
            ("picture", "picture is not a recording: it does not begin as an MCAP file"),
            ("mcap", "mcap is an MCAP file, but holds no radar-chaperone header"),
        ] {
            folder.run(&command.replace("FILE", file)).fails_with(message);
            let left = ["saved.mcap", "v.npy", "found/obstacles.json"].map(|name| folder.path(name).exists());
            assert_eq!(left, [false; 3], "{command} of {file} left a file");
        }
    }
}

#[test]
fn non_vendor_files_are_refused_with_a_reason() {
    let folder = Folder::new("no_vendor_file");
    write_foreign_files(&folder);
    folder.run("simulate nothing --preset c16 --duration-s 0.2 --out mcap --force").succeeds();
    for (file, message) in [
        ("missing", "cannot read missing: No such file or directory"),
        ("folder", "folder is a folder or a device: give the file itself"),
        ("empty", "empty cannot be read as HDF5"),
        ("text", "text cannot be read as HDF5"),
        ("picture", "picture cannot be read as HDF5"),
        ("mcap", "mcap cannot be read as HDF5"),
    ] {
        folder.run(&format!("import {file} --out r.mcap")).fails_with(message);
        assert!(!folder.path("r.mcap").exists());
    }
}

#[test]
fn truncated_recording_is_read_up_to_the_cut() {
    let folder = Folder::new("cut");
    let bytes = write_recording(&folder);
    let mut most = 0;
    for share in [1, 2, 5, 20, 40, 60, 80, 95, 99] {
        folder.write("cut.mcap", &bytes[..bytes.len() * share / 100]);
        for command in READERS {
            let outcome = folder.run(&command.replace("FILE", "cut.mcap"));
            let refused_rightly = |message: &[&str]| message.iter().any(|s| outcome.err.contains(s));
            assert!(
                outcome.succeeded()
                    || refused_rightly(&[
                        "cut right at its start",
                        "no sweep of cut.mcap has a pose",
                        "nothing could be saved"
                    ]),
                "{share} %: {outcome:#?}"
            );
            if outcome.succeeded() && command.starts_with("recover") {
                let saved: usize = saved_frames(&outcome.out);
                assert!(saved >= most, "{share} %: {saved} frames, fewer than of a shorter piece");
                most = saved;
                folder.run("info saved.mcap").succeeds().prints("Damage     none");
            }
        }
    }
    // Everything but the closing index is there.
    assert_eq!(most, 70);
}

fn saved_frames(text: &str) -> usize {
    text.split("Saved ").nth(1).and_then(|rest| rest.split(' ').next()).unwrap().parse().unwrap()
}

#[test]
fn flipped_bytes_are_counted_or_refused_without_panic() {
    let folder = Folder::new("flipped");
    let bytes = write_recording(&folder);
    let mut damage_seen = 0;
    for position in (0..bytes.len()).step_by(bytes.len() / 31) {
        let mut damaged = bytes.clone();
        damaged[position] ^= 0xff;
        folder.write("damaged.mcap", damaged);
        for command in READERS {
            let outcome = folder.run(&command.replace("FILE", "damaged.mcap"));
            if outcome.succeeded() && command.starts_with("info") {
                damage_seen += usize::from(!outcome.out.contains("Damage     none"));
            }
        }
    }
    assert!(damage_seen > 15, "damage was reported {damage_seen} times");
}

#[test]
fn damaged_chunk_loses_only_its_own_second() {
    let folder = Folder::new("second");
    let mut bytes = write_recording(&folder);
    let chunk = chunks(&bytes)[2].clone();
    bytes[chunk.start + chunk.len() / 2] ^= 0xff;
    folder.write("damaged.mcap", bytes);
    folder.run("info damaged.mcap").succeeds().prints("Damage     1 chunk");
    let recovered = folder.run("recover damaged.mcap --out saved.mcap --force").succeeds().prints("Damage: 1 chunk");
    let saved = saved_frames(&recovered.out);
    assert!((48..=52).contains(&saved), "{saved} of 70 frames at 20 Hz");
    folder.run("info saved.mcap").succeeds().prints(&format!("Frames     {saved} over")).prints("Damage     none");
    let replayed = folder.run("replay damaged.mcap --out found").succeeds().prints(&format!("{saved} frames"));
    assert!(replayed.err.contains("damaged.mcap is damaged: 1 chunk"), "{replayed:#?}");
}

/// Byte ranges of the chunks in an MCAP file: each record is one byte of type, eight of length,
/// then the content.
fn chunks(bytes: &[u8]) -> Vec<std::ops::Range<usize>> {
    const CHUNK: u8 = 6;
    let mut chunks = Vec::new();
    let mut at = 8;
    while at + 9 < bytes.len() {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        if bytes[at] == CHUNK {
            chunks.push(at + 9..at + 9 + length);
        }
        at += 9 + length;
    }
    chunks
}

#[test]
fn bad_track_is_refused_with_its_line_number() {
    let folder = Folder::new("track");
    folder.write("input.h5", short_h5());
    write_foreign_files(&folder);
    for (line, message) in [
        ("1 2 3", "line 2: 3 columns instead of 8"),
        ("0 0 0 zero 0 0 0 1", "line 2: \"zero\" is not a number"),
        ("1e300 0 0 0 0 0 0 1", "line 2: a time of"),
    ] {
        folder.write("track.tum", format!("# a track\n{line}\n"));
        folder.run("import input.h5 --poses track.tum --out r.mcap --force").fails_with(message);
    }
    for (file, message) in [
        ("missing", "cannot read missing"),
        ("folder", "folder is a folder"),
        ("picture", "picture, line 1: not text"),
        ("text", "text, line 1: \"timestamp_s\" is not a number"),
    ] {
        folder.run(&format!("import input.h5 --poses {file} --out r.mcap --force")).fails_with(message);
    }
    folder.run("import input.h5 --poses empty --out r.mcap --force").succeeds();
    folder.run("replay r.mcap").succeeds().prints("No sweep has a pose");
}

#[test]
fn damaged_vendor_file_is_imported_completely_or_refused() {
    let folder = Folder::new("damaged_vendor_file");
    folder.write("input.h5", short_h5());
    import_damaged(&folder, "input.h5");
}

/// Imports a vendor's file with its end cut off, and with single bytes inverted.
pub fn import_damaged(folder: &Folder, name: &str) {
    let bytes = folder.read(name);
    for length in (0..bytes.len()).step_by(bytes.len() / 9) {
        folder.write("cut.h5", &bytes[..length]);
        folder.run("import cut.h5 --out r.mcap --force").fails_with("cut.h5 cannot be read as HDF5");
    }
    for position in (0..bytes.len()).step_by(bytes.len() / 41) {
        let mut damaged = bytes.clone();
        damaged[position] ^= 0xff;
        folder.write("damaged.h5", damaged);
        if folder.run("import damaged.h5 --out r.mcap --force").succeeded() {
            folder.run("info r.mcap").succeeds().prints("Damage     none");
        }
    }
}

//! Every command over short recordings, with the same bytes on every run.

use crate::common::Folder;

#[test]
fn a_recording_goes_through_every_command() {
    let folder = Folder::new("round_trip");
    let written = folder.run("simulate chair --preset c16 --duration-s 2 --seed 3 --out r.mcap").succeeds();
    let written = written.prints("Source     simulation: chair, natural, seed 3").prints("Written to r.mcap");
    let info = folder.run("info r.mcap").succeeds().prints("Frames     1000 over").prints("Damage     none");
    assert!(written.out.starts_with(info.out.trim_end()), "info should print what simulate printed: {}", info.out);
    folder
        .run("replay r.mcap --out found")
        .succeeds()
        .prints("1000 frames, 289 poses: 1000 sweeps imaged, 0 frames without a pose skipped")
        .prints("Against the truth in the recording:")
        .prints("Written to found");
    folder
        .run("recover r.mcap --out saved.mcap")
        .succeeds()
        .prints("r.mcap was not damaged.")
        .prints("Saved 1000 of 1000 frames (100.0 %) and 289 poses to saved.mcap");
    assert!(folder.read("r.mcap") == folder.read("saved.mcap"), "a sound recording is saved as it was");
}

#[test]
fn a_seed_gives_the_same_recording() {
    let folder = Folder::new("seed");
    for (seed, file) in [(7, "a"), (7, "b"), (8, "c")] {
        let scenario = format!("two-chairs --preset d16 --duration-s 1 --dropouts-per-minute 60 --seed {seed}");
        folder.run(&format!("simulate {scenario} --out {file}.mcap")).succeeds();
    }
    assert!(folder.read("a.mcap") == folder.read("b.mcap"));
    assert!(folder.read("a.mcap") != folder.read("c.mcap"));
}

#[test]
fn replay_writes_the_same_bytes_on_every_run_and_any_number_of_threads() {
    let folder = Folder::new("same_bytes");
    folder.run("simulate furnished-room --duration-s 2 --out room.mcap").succeeds();
    folder.run("simulate corner-reflector --motion sphere-10cm --duration-s 2 --out reflector.mcap").succeeds();
    for recording in ["room", "reflector"] {
        for (threads, out) in [("2", "a"), ("2", "b"), ("1", "c")] {
            let line = format!("replay {recording}.mcap --out {out}");
            folder.run_with(&line, &[("RAYON_NUM_THREADS", threads)]).succeeds();
        }
        for file in ["obstacles.json", "map.png", "report.html", "obstacles.ply", "shape.ply"] {
            let first = folder.read(&format!("a/{file}"));
            assert!(!first.is_empty());
            assert!(first == folder.read(&format!("b/{file}")), "{recording}: {file} differs on the second run");
            assert!(first == folder.read(&format!("c/{file}")), "{recording}: {file} differs on one thread");
        }
    }
}

#[test]
fn replay_at_a_given_speed_finds_the_same() {
    let folder = Folder::new("speed");
    folder.run("simulate chair --preset c16 --duration-s 0.5 --out r.mcap").succeeds();
    folder.run("replay r.mcap --out fast").succeeds();
    folder.run("replay r.mcap --speed 4 --out slow").succeeds();
    assert!(folder.read("fast/obstacles.json") == folder.read("slow/obstacles.json"));
}

#[test]
fn reconstruct_writes_a_volume_and_what_it_is_for_every_statistic() {
    let folder = Folder::new("reconstruct");
    folder.run("simulate corner-reflector --motion sphere-50cm --snr-db 20 --duration-s 2 --out r.mcap").succeeds();
    for statistic in ["thesis-full", "thesis", "ls", "log", "glrt", "coherent", "subaperture"] {
        let region = "--box -0.5,1.4,-1.2,0,1.6,-0.8 --voxel-m 0.05 --sweeps 20";
        folder
            .run(&format!(
                "reconstruct r.mcap --statistic {statistic} {region} --out v.npy --cloud c.ply --cloud-share 0.9"
            ))
            .succeeds()
            .prints("points written to c.ply")
            .prints(&format!("{statistic} over 8 × 4 × 10 voxels [z][y][x] of 0.05 m, 20 sweeps"));
        let bytes = folder.read("v.npy");
        assert!(bytes.starts_with(b"\x93NUMPY"));
        // The header is padded to a multiple of 64 bytes.
        assert_eq!((bytes.len() - 8 * 4 * 10 * 4) % 64, 0);
        let info = folder.json("v.json");
        assert_eq!(info["statistic"], statistic);
        assert_eq!(info["sweeps"], 20);
        assert_eq!(info["axes"], serde_json::json!(["z", "y", "x"]));
        assert!(info["value_unit"].is_string() && info["frame"].as_str().unwrap().starts_with("tracking"));
        assert!(folder.read("c.ply").starts_with(b"ply\nformat binary_little_endian 1.0\n"));
    }
}

#[test]
fn adaptive_search_equals_the_dense_volume_above_threshold() {
    let folder = Folder::new("adaptive");
    folder.run("simulate corner-reflector --motion sphere-50cm --snr-db 20 --duration-s 5 --out r.mcap").succeeds();
    for statistic in ["thesis-full", "thesis", "ls", "log", "glrt", "coherent"] {
        let line = format!("reconstruct r.mcap --statistic {statistic} --voxel-m 0.05 --sweeps 40");
        folder.run(&format!("{line} --out dense.npy")).succeeds();
        folder
            .run(&format!("{line} --search adaptive --threshold-share 0.8 --out found.npy"))
            .succeeds()
            .prints("of the work");
        let (dense, found) = (folder.read("dense.npy"), folder.read("found.npy"));
        let values = |bytes: &[u8]| -> Vec<f32> {
            bytes[bytes.len() - 60 * 60 * 60 * 4..]
                .chunks(4)
                .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
                .collect()
        };
        let (dense, found) = (values(&dense), values(&found));
        let limit = folder.json("found.json")["threshold"].as_f64().unwrap() as f32;
        let wanted: Vec<f32> = dense.iter().map(|&v| if v >= limit { v } else { 0.0 }).collect();
        assert!(limit > 0.0 && found == wanted, "{statistic}");
    }
}

#[test]
fn the_peak_of_a_volume_lies_at_the_reflector() {
    let folder = Folder::new("peak");
    folder.run("simulate corner-reflector --motion sphere-50cm --snr-db 20 --duration-s 10 --out r.mcap").succeeds();
    let line = "reconstruct r.mcap --box -0.6,1.2,-1.3,0,1.8,-0.7 --voxel-m 0.02 --sweeps 100 --out v.npy";
    let text = folder.run(line).succeeds().out;
    let peak = text.split("at (").nth(1).and_then(|rest| rest.split(')').next()).expect("a peak is printed");
    let peak: Vec<f64> = peak.split(',').map(|n| n.trim().parse().unwrap()).collect();
    let errors = [(peak[0] + 0.3).abs(), (peak[1] - 1.5).abs(), (peak[2] + 1.0).abs()];
    assert!(errors.iter().all(|&e| e < 0.03), "peak at {peak:?} m");
}

#[test]
fn every_command_has_help() {
    let folder = Folder::new("help");
    let text = folder.run("--help").succeeds().out;
    for command in ["demo", "simulate", "replay", "reconstruct", "import", "info", "recover", "calibrate"] {
        assert!(text.contains(&format!("\n  {command} ")), "{command} is not listed");
        folder.run(&format!("{command} --help")).succeeds().prints(&format!("Usage: radar-chaperone {command}"));
    }
    folder.run("--version").succeeds().prints("radar-chaperone ");
    let bare = folder.run("");
    assert!(bare.code == Some(2) && bare.err.contains("Usage: radar-chaperone"), "{bare:#?}");
    folder.run("levitate").fails_with("unrecognized subcommand 'levitate'");
}

//! Recordings made with SteamVR replay like any other recording.

use serde_json::{Value, json};

use crate::rig::{MOUNT, Rig};

/// Replays a recording and returns the detections.
fn replayed(rig: &Rig, file: &str) -> Value {
    let ended = rig.run(&["replay", file, "--out", "out"]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    serde_json::from_slice(&std::fs::read(rig.path("out/obstacles.json")).unwrap()).unwrap()
}

fn has_seen_the_room(found: &Value) {
    let streams = &found["counters"]["streams"];
    let [frames, poses] = ["frames", "poses"].map(|stream| streams[stream].as_u64().unwrap());
    assert!(frames > 300 && poses > 1000, "{streams}");
    assert!(streams["observations"].as_u64().unwrap() > 12 * frames, "nearly every sweep has a pose: {streams}");
    assert!(!found["obstacles"].as_array().unwrap().is_empty(), "nothing found");
    let offset_s = found["time_offset_s"].as_f64().unwrap();
    assert!(offset_s.abs() < 0.005, "poses and sweeps are {offset_s} s apart");
}

#[test]
fn run_records_while_warning() {
    let mut rig = Rig::new("run-record");
    rig.start_sensor("furnished-room", "approach-chair", 1, 60);
    rig.start_steamvr(&json!({}), true);
    let program = rig.start_run(&["--record", "room.mcap"]);
    rig.wait_report("seven seconds", |report| report["frames"].as_u64() > Some(630));
    let ended = program.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(ended.out.contains("Written to room.mcap"), "{}", ended.out);
    has_seen_the_room(&replayed(&rig, "room.mcap"));
    let again = rig.run(&["run", "--record", "room.mcap"]);
    assert!(again.code == Some(1) && again.err.contains("is there already"), "{}", again.err);
}

#[test]
fn record_uses_headset_poses() {
    let mut rig = Rig::new("record");
    rig.start_sensor("furnished-room", "approach-chair", 1, 60);
    rig.start_steamvr(&json!({}), true);
    let arguments = ["record", "--out", "r.mcap", "--port", "sensor", "--mount", MOUNT, "--preset", "d16"];
    let ended = rig.run(&[&arguments[..], &["--duration-s", "7"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(ended.out.contains("Poses of SteamVR's headset"), "{}", ended.out);
    has_seen_the_room(&replayed(&rig, "r.mcap"));
}

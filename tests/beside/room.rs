//! The room moves while the program runs: the user recentres, tracking is lost, or the tracking
//! universe changes.

use glam::DVec3;
use radar_sar::geometry::Pose;
use serde_json::{Value, json};

use crate::rig::Rig;

/// Starts the program in a furnished room, and waits for a warning.
fn warning(rig: &mut Rig) -> crate::rig::Program {
    rig.start_sensor("furnished-room", "approach-chair", 1, 120);
    rig.start_steamvr(&json!({}), true);
    let program = rig.start_run(&["--report", "run.json"]);
    rig.wait_report("a warning", |report| report["visible"].as_u64() > Some(0));
    program
}

fn end(rig: &Rig, program: crate::rig::Program) -> Value {
    let ended = program.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert_eq!(rig.report()["violations"], json!({}));
    serde_json::from_slice(&std::fs::read(rig.path("run.json")).unwrap()).unwrap()
}

#[test]
fn recentring_keeps_warnings_fixed_in_the_room() {
    let mut rig = Rig::new("recentre");
    let program = warning(&mut rig);
    // The head is at the chair from the fifth to the eighth second.
    rig.wait_report("the way to the chair", |report| report["frames"].as_u64() > Some(500));
    let before = rig.shoot("before");
    rig.send_command(&json!({"do": "recenter", "x": 0.4, "z": -0.3, "yaw_deg": 50.0}));
    // The command is executed a few times per second; the program polls ten times per second.
    std::thread::sleep(std::time::Duration::from_millis(800));
    let after = rig.shoot("after");
    // Warnings stay where they were in the room, except for what the head has seen meanwhile.
    let places = |shot: &Value| -> Vec<DVec3> {
        let world_from_tracking = pose(&shot["tracking_from_world"]).inverse();
        let overlays = shot["overlays"].as_array().unwrap().iter();
        overlays.map(|overlay| (world_from_tracking * pose(&overlay["tracking_from_overlay"])).translation).collect()
    };
    let moved = pose(&before["tracking_from_world"]).translation - pose(&after["tracking_from_world"]).translation;
    assert!(moved.length() > 0.3, "the user has recentred");
    let (before, after) = (places(&before), places(&after));
    let stays = before.iter().any(|was| after.iter().any(|is| is.distance(*was) < 0.15));
    assert!(stays, "{before:?} {after:?}");
    let report = end(&rig, program);
    assert_eq!((&report["recentred"], &report["forgotten"]), (&json!(1), &json!(0)));
}

#[test]
fn universe_change_restarts_the_map() {
    let mut rig = Rig::new("universe");
    let program = warning(&mut rig);
    rig.send_command(&json!({"do": "universe"}));
    rig.wait_for("its message", || program.err().contains("the map is reset").then_some(()));
    let report = end(&rig, program);
    assert!(report["forgotten"].as_u64() >= Some(1));
}

#[test]
fn warnings_persist_one_second_after_tracking_loss() {
    let mut rig = Rig::new("lost");
    let program = warning(&mut rig);
    rig.send_command(&json!({"do": "invalid", "for_s": 4.0}));
    rig.wait_report("no warning", |report| report["visible"].as_u64() == Some(0));
    rig.wait_report("a warning", |report| report["visible"].as_u64() > Some(0));
    let report = end(&rig, program);
    let streams = &report["reconstruction"]["counters"]["streams"];
    assert!(streams["poses_invalid"].as_u64() > Some(100), "{streams}");
    assert_eq!(report["forgotten"], 0);
}

fn pose(pose: &Value) -> Pose {
    let number = |list: &str, i: usize| pose[list][i].as_f64().unwrap();
    let turn = [0, 1, 2, 3].map(|i| number("quaternion_xyzw", i));
    Pose::try_new([0, 1, 2].map(|i| number("position_m", i)), turn).unwrap()
}

//! The room moves while the program runs: the user recentres, tracking is lost, or the tracking
//! universe changes.

use glam::DVec3;
use radar_sar::geometry::Pose;
use serde_json::{Value, json};

use crate::rig::Rig;
use crate::saved_map::to;
use crate::warnings::chair;

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
    let chair = chair();
    // The simulated room is the fake runtime's world: there the chair stays where it is.
    let panels = |shot: &Value, world_from_tracking: Pose| -> Vec<DVec3> {
        let overlays = shot["overlays"].as_array().unwrap().iter().filter(|overlay| overlay["sort_order"] == 1);
        overlays.map(|overlay| (world_from_tracking * pose(&overlay["tracking_from_overlay"])).translation).collect()
    };
    let world_from_tracking = |shot: &Value| pose(&shot["tracking_from_world"]).inverse();
    let is_at_chair = |point: &DVec3| to(&chair, *point) < 0.3;
    let is_warned = |shot: &Value| panels(shot, world_from_tracking(shot)).iter().any(is_at_chair);
    let before = rig.wait_shot("before", is_warned);
    rig.send_command(&json!({"do": "recenter", "x": 0.4, "z": -0.3, "yaw_deg": 50.0}));
    let origin = |shot: &Value| pose(&shot["tracking_from_world"]).translation;
    let has_moved = |shot: &Value| origin(shot).distance(origin(&before)) > 0.3;
    // The first shot after it, wherever the head is by then: nothing is where the map would have
    // taken the chair's warning if it had moved with the origin.
    let moved = rig.wait_shot("moved", has_moved);
    let wrong: Vec<DVec3> = panels(&before, world_from_tracking(&before))
        .into_iter()
        .zip(panels(&before, world_from_tracking(&moved)))
        .filter_map(|(right, wrong)| is_at_chair(&right).then_some(wrong))
        .collect();
    let there = panels(&moved, world_from_tracking(&moved));
    assert!(there.iter().all(|is| wrong.iter().all(|wrong| is.distance(*wrong) > 0.15)), "{there:?} {wrong:?}");
    // The head comes to the chair again and again.
    rig.wait_shot("after", |shot| has_moved(shot) && is_warned(shot));
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

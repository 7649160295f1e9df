//! A silent or unplugged radar is reported in the headset: a room without warnings looks like one
//! without obstacles.

use serde_json::{Value, json};

use crate::rig::{DATA, Program, Rig};

/// Counts the notice's overlays, identified by key.
fn notices(shot: &Value) -> usize {
    let overlays = shot["overlays"].as_array().unwrap();
    overlays.iter().filter(|overlay| overlay["key"] == "radar-chaperone.notice").count()
}

/// Takes shots until the notice is shown or hidden.
fn wait_notice(rig: &Rig, what: &str, wanted: usize) -> Value {
    rig.wait_shot(what, |shot| notices(shot) == wanted)
}

fn streaming(rig: &Rig, more: &[&str]) -> Program {
    let program = rig.start_run(more);
    rig.wait_for("the sensor", || program.out().contains("ticks a second").then_some(()));
    rig.wait_report("frames", |report| report["frames"].as_u64() > Some(300));
    program
}

#[test]
fn silent_or_unplugged_radar_is_reported_in_the_headset() {
    let mut rig = Rig::new("notice");
    rig.start_sensor("empty-room", "natural", 1, 300);
    rig.start_steamvr(&json!({}), true);
    let program = streaming(&rig, &[]);
    assert_eq!(notices(&rig.shoot("well")), 0, "there is no fault");
    let logs = |rig: &Rig, words: &str| rig.wait_for(words, || program.err().contains(words).then_some(()));
    rig.hold_sensor(true);
    logs(&rig, "notice in the headset: Radar is silent");
    wait_notice(&rig, "silent", 1);
    assert!(!program.err().contains("connection is lost"), "the sensor is connected");
    rig.hold_sensor(false);
    logs(&rig, "notice in the headset: The radar works again");
    wait_notice(&rig, "no_notice", 0);
    rig.unplug_sensor();
    logs(&rig, "notice in the headset: Radar lost");
    wait_notice(&rig, "unplugged", 1);
    let ended = program.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let report = rig.report();
    assert_eq!((&report["violations"], &report["left_at_cleanup"]), (&json!({}), &json!(0)));
}

#[test]
fn notices_can_be_disabled() {
    let mut rig = Rig::new("no-notice");
    rig.start_sensor("empty-room", "natural", 1, 300);
    rig.start_steamvr(&json!({}), true);
    let program = streaming(&rig, &["--set", "headset.notices=false"]);
    rig.unplug_sensor();
    rig.wait_for("its message", || program.err().contains("connection is lost").then_some(()));
    // A notice comes within four seconds.
    rig.wait_frames(8 * 90);
    assert_eq!(notices(&rig.shoot("without")), 0);
    let ended = program.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(!ended.err.contains("notice in the headset"), "{}", ended.err);
}

#[test]
fn first_session_welcomes_once() {
    let mut rig = Rig::new("welcome");
    let marker = rig.path(DATA).join("welcomed");
    std::fs::remove_file(&marker).unwrap();
    rig.start_sensor("empty-room", "natural", 1, 600);
    rig.start_steamvr(&json!({}), true);
    let program = streaming(&rig, &[]);
    wait_notice(&rig, "welcome", 1);
    wait_notice(&rig, "read", 0);
    assert_eq!(program.interrupt().code, Some(0));
    assert!(marker.exists());
    let program = streaming(&rig, &[]);
    rig.wait_frames(3 * 90);
    assert_eq!(notices(&rig.shoot("again")), 0);
    let ended = program.interrupt();
    assert!(ended.code == Some(0) && !ended.err.contains("notice in the headset"), "{}", ended.err);
}

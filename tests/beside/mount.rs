//! The sensor's place on the headset is found while the program runs, and kept from one start to the next.

use glam::DVec3;
use serde_json::{Value, json};

use crate::rig::{Program, Rig};

const TRUE_MOUNT_M: DVec3 = DVec3::new(0.0, 0.03, -0.10);
/// Assumed 5 cm beside it.
const WRONG: &[&str] = &["run", "--port", "sensor", "--preset", "d16", "--mount", "0.05,0.03,-0.10", "--report"];

const KEPT: &str = "home/.local/share/radar-chaperone/mounts.json";

/// How far from its true place a report's sensor is, metres.
fn off_m(rig: &Rig, report: &str) -> f64 {
    let report: Value = serde_json::from_slice(&std::fs::read(rig.path(report)).unwrap()).unwrap();
    let at: Vec<f64> = serde_json::from_value(report["mount"]["in_use"]["translation"].clone()).unwrap();
    DVec3::from_slice(&at).distance(TRUE_MOUNT_M)
}

/// Waits until it has its sensor and has drawn for a second.
fn begun(rig: &Rig, program: &Program) {
    rig.wait_for("the sensor's description", || program.out().contains("Carried by").then_some(()));
    rig.wait_frames(90);
}

#[test]
fn the_mount_is_found_and_the_next_session_begins_with_it() {
    let mut rig = Rig::new("mount");
    rig.start_sensor("furnished-room", "natural", 7, 300);
    rig.start_steamvr(&json!({}), true);
    let program = rig.start(&[WRONG, &["first.json"]].concat());
    rig.wait_for("the correction", || {
        let kept: Value = serde_json::from_slice(&std::fs::read(rig.path(KEPT)).ok()?).ok()?;
        let in_use = &kept.as_object()?.values().next()?["in_use"]["translation"];
        (DVec3::from_slice(&serde_json::from_value::<Vec<f64>>(in_use.clone()).ok()?).distance(TRUE_MOUNT_M) < 0.015)
            .then_some(())
    });
    let ended = program.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let first_m = off_m(&rig, "first.json");
    assert!(first_m < 0.015, "{first_m} {}", ended.err);
    assert!(ended.out.contains("Mount     sensor at"), "{}", ended.out);

    let seen = rig.run(&["doctor", "--port", "sensor"]);
    assert!(seen.out.contains("on the head, ") && seen.out.contains("mm from where it is set"), "{}", seen.out);

    let program = rig.start(&[WRONG, &["second.json"]].concat());
    begun(&rig, &program);
    let ended = program.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let second_m = off_m(&rig, "second.json");
    assert!(second_m < 0.015, "{second_m} {}", ended.err);

    // Another assumed mount has nothing of it.
    let other = ["run", "--port", "sensor", "--mount", "0,0,-0.05", "--report", "third.json"];
    let program = rig.start(&[&other[..], &["--set", "tracking.estimate_mount=false"]].concat());
    begun(&rig, &program);
    program.interrupt();
    assert!((off_m(&rig, "third.json") - 0.05831).abs() < 1e-4);
}

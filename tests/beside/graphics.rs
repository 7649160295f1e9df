//! The graphics device is lost while the program runs: driver reset or removed card.

use serde_json::{Value, json};

use crate::rig::Rig;

#[test]
fn lost_device_is_reopened_and_warnings_return() {
    let mut rig = Rig::new("lost-device");
    let lose = rig.with_devices_to_lose();
    rig.start_sensor("furnished-room", "approach-chair", 1, 120);
    rig.start_steamvr(&json!({}), true);
    let program = rig.start_run(&["--report", "run.json", "--set", "warning.fade_distance_m=3.5"]);
    let is_shown = |report: &Value| report["visible"].as_u64() > Some(0);
    for round in 1..=2u64 {
        rig.wait_report("a warning", |report| is_shown(report) && report["frames"].as_u64() > Some(400));
        std::fs::write(&lose, round.to_string()).unwrap();
        rig.wait_for("its message", || {
            (program.err().matches("lost its device").count() as u64 >= round).then_some(())
        });
        // Textures come from another device, and are shown.
        rig.wait_report("a warning on the new device", |report| {
            report["devices_lost"].as_u64() == Some(round) && is_shown(report)
        });
    }
    let ended = program.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert_eq!(ended.err.matches("lost its device").count(), 2, "reported once each: {}", ended.err);
    assert!(!ended.err.contains("panicked"), "{}", ended.err);
    let report = rig.report();
    assert_eq!((&report["violations"], &report["left_at_cleanup"]), (&json!({}), &json!(0)));
    let own: Value = serde_json::from_slice(&std::fs::read(rig.path("run.json")).unwrap()).unwrap();
    assert_eq!(own["devices_lost"], 2);
}

//! `run --view` without a desktop. Its content is tested under a virtual desktop.

use serde_json::json;

use crate::rig::Rig;

#[test]
fn view_without_desktop_reports_an_error() {
    let mut rig = Rig::new("no-desktop");
    for name in ["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"] {
        rig.set(name, "");
    }
    rig.start_sensor("empty-room", "natural", 1, 120);
    rig.start_steamvr(&json!({}), true);
    let ended = rig.start_run(&["--view"]).ended();
    assert_eq!(ended.code, Some(1), "{}", ended.err);
    assert!(ended.err.contains("no window can be opened") && ended.err.contains("without --view"), "{}", ended.err);
    assert!(!ended.err.contains("panicked") && !ended.err.contains(".rs:"), "{}", ended.err);
}

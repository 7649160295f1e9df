//! Start and exit: SteamVR missing, starting, quitting, killed; the program interrupted, killed,
//! started twice.

use std::path::Path;
use std::time::Duration;

use serde_json::json;

use crate::rig::{Program, Rig};

/// Limit that a user perceives as immediate. The program is much faster; the machine may be busy.
const EXIT_LIMIT: Duration = Duration::from_secs(3);

/// Rounds of the repeated tests: three by default, the full number with `RADAR_CHAPERONE_LONG=1`.
fn rounds(long: usize) -> usize {
    if std::env::var_os("RADAR_CHAPERONE_LONG").is_some_and(|value| value != "0") { long } else { 3 }
}

#[test]
fn missing_steamvr_is_reported() {
    let rig = Rig::new("without");
    let ended = rig.run(&["run"]);
    assert_eq!(ended.code, Some(1));
    assert!(
        ended.err.contains("SteamVR is not installed") && ended.err.contains("openvrpaths.vrpath"),
        "{}",
        ended.err
    );
}

#[test]
fn wait_option_waits_for_steamvr_and_survives_its_exit() {
    let mut rig = Rig::new("wait");
    rig.start_steamvr(&json!({}), false);
    rig.end_steamvr();
    let ended = rig.run(&["run"]);
    assert_eq!(ended.code, Some(1));
    assert!(ended.err.contains("SteamVR is not running") && ended.err.contains("--wait"), "{}", ended.err);

    rig.start_sensor("empty-room", "natural", 1, 300);
    let program = rig.start_run(&["--wait"]);
    rig.wait_for("its message", || program.out().contains("Waiting for SteamVR").then_some(()));
    for session in 1..=2 {
        rig.start_steamvr(&json!({}), true);
        rig.wait_report("frames", |report| report["frames"].as_u64() > Some(20));
        rig.end_steamvr();
        rig.wait_for("its message", || (program.out().matches("SteamVR has ended").count() == session).then_some(()));
    }
    let (ended, took) = program.interrupt_timed();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(took < EXIT_LIMIT, "{took:?}");
}

#[test]
fn program_exits_with_steamvr() {
    let mut rig = Rig::new("leaves");
    rig.start_sensor("empty-room", "natural", 1, 120);
    rig.start_steamvr(&json!({}), true);
    let program = rig.start_run(&[]);
    rig.wait_report("frames", |report| report["frames"].as_u64() > Some(20));
    rig.send_command(&json!({"do": "quit"}));
    let ended = program.ended();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(ended.out.contains("SteamVR has ended"), "{}", ended.out);
    let report = rig.report();
    let asked_s = report["quit_asked_s"].as_f64().unwrap();
    assert!(report["quit_acknowledged_s"].as_f64().unwrap() >= asked_s);
    assert!(report["cleanup_s"].as_f64().unwrap() - asked_s < EXIT_LIMIT.as_secs_f64());
    assert_eq!(report["left_at_cleanup"], 0);
    assert_eq!(report["violations"], json!({}));
}

#[test]
fn second_instance_is_rejected() {
    let mut rig = Rig::new("second");
    rig.start_sensor("empty-room", "natural", 1, 120);
    rig.start_steamvr(&json!({}), true);
    let first = rig.start_run(&[]);
    rig.wait_report("frames", |report| report["frames"].as_u64() > Some(20));
    let second = rig.run(&["run"]);
    assert_eq!(second.code, Some(1));
    assert!(second.err.contains("another radar-chaperone runs"), "{}", second.err);
    let ended = first.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
}

#[test]
fn repeated_starts_and_stops_work() {
    let mut rig = Rig::new("again");
    rig.start_sensor("empty-room", "natural", 1, 1000);
    rig.start_steamvr(&json!({}), true);
    for _ in 0..rounds(50) {
        let program = streaming(&rig);
        let (ended, took) = program.interrupt_timed();
        assert_eq!(ended.code, Some(0), "{}", ended.err);
        assert!(took < EXIT_LIMIT, "{took:?}");
        let report = rig.report();
        assert_eq!(report["left_at_cleanup"], 0);
        assert_eq!(report["violations"], json!({}));
        nothing_is_left(&rig);
    }
}

#[test]
fn killed_program_does_not_block_the_next() {
    let mut rig = Rig::new("killed");
    rig.start_sensor("empty-room", "natural", 1, 1000);
    rig.start_steamvr(&json!({}), true);
    for _ in 0..rounds(20) {
        streaming(&rig).kill();
        nothing_is_left(&rig);
    }
    let ended = streaming(&rig).interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
}

#[test]
fn killed_runtime_is_detected_and_the_next_one_used() {
    let mut rig = Rig::new("killed-runtime");
    rig.start_sensor("empty-room", "natural", 1, 1000);
    for _ in 0..rounds(20) {
        rig.start_steamvr(&json!({}), true);
        let program = streaming(&rig);
        rig.kill_steamvr();
        let ended = program.ended();
        assert_eq!(ended.code, Some(1), "{}", ended.out);
        assert!(ended.err.contains("exited unexpectedly"), "{}", ended.err);
        nothing_is_left(&rig);
    }
}

#[test]
fn missing_sensor_is_waited_for() {
    let mut rig = Rig::new("no-sensor");
    rig.start_steamvr(&json!({}), false);
    let program = rig.start_run(&[]);
    rig.wait_for("its message", || program.err().contains("Retrying every").then_some(()));
    rig.start_sensor("empty-room", "natural", 1, 120);
    rig.wait_for("the sensor", || program.out().contains("ticks a second").then_some(()));
    let ended = program.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(ended.out.contains("0 frames lost"), "{}", ended.out);
}

/// The program, once display and sensor frames arrive.
fn streaming(rig: &Rig) -> Program {
    let _ = std::fs::remove_file(rig.path("vr/report.json"));
    let program = rig.start_run(&[]);
    rig.wait_report("frames", |report| report["frames"].as_u64() > Some(20));
    rig.wait_for("the sensor", || program.out().contains("ticks a second").then_some(()));
    program
}

/// Only the processes of the rig run, and only the lock and the log are left in the home folder.
fn nothing_is_left(rig: &Rig) {
    let state = rig.path("home/.local/state/radar-chaperone");
    let mut left: Vec<String> = std::fs::read_dir(&state)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    left.sort();
    assert_eq!(left, ["run.lock", "run.log"]);
    let home = rig.path("home");
    let running = std::fs::read_dir("/proc").unwrap().filter_map(Result::ok).filter(|process| {
        let command = std::fs::read(process.path().join("cmdline")).unwrap_or_default();
        let environment = std::fs::read(process.path().join("environ")).unwrap_or_default();
        let is_run = command.split(|byte| *byte == 0).nth(1) == Some(b"run");
        is_run && contains(&environment, &home)
    });
    assert_eq!(running.count(), 0, "a process is left");
}

fn contains(environment: &[u8], home: &Path) -> bool {
    let wanted = format!("HOME={}", home.display());
    environment.split(|byte| *byte == 0).any(|variable| variable == wanted.as_bytes())
}

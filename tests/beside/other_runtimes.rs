//! Runtimes that differ from SteamVR of today: older ones, ones that refuse, answer with nothing, or hang.

use serde_json::{Value, json};

use crate::displays::{at_the_chair, end};
use crate::rig::{Program, Rig};

/// A failure of a function that does not end.
fn refuse(rig: &Rig, function: &str) {
    rig.send_command(&json!({"do": "fail", "function": function, "count": 1_000_000}));
}

/// Whether shots show visible overlays of the kind.
fn shows(shot: &Value, count: impl Fn(usize) -> bool) -> bool {
    let overlays = shot["overlays"].as_array().unwrap();
    count(overlays.iter().filter(|overlay| overlay["alpha"].as_f64() > Some(0.1)).count())
}

#[test]
fn older_runtimes_serve_as_well() {
    for sdk in ["2.5", "2.12"] {
        let mut rig = Rig::new(&format!("sdk-{sdk}"));
        let (program, _, _) = at_the_chair(&mut rig, &json!({"sdk": sdk}), &[]);
        assert!(program.out().contains("SteamVR"), "{}", program.out());
        end(&rig, program);
        assert_eq!(rig.report()["sdk_version"], Value::Null, "it does not ask for it");
    }
}

#[test]
fn refused_display_is_replaced_by_panels() {
    for (display, function) in [("projection", "SetOverlayTransformProjection"), ("stereo", "SetOverlayTexture")] {
        let mut rig = Rig::new(&format!("refused-{display}"));
        rig.start_sensor("furnished-room", "approach-chair", 1, 600);
        rig.start_steamvr(&json!({}), true);
        let set = format!("headset.display={display}");
        let program = rig.start_run(&["--set", &set, "--report", "run.json"]);
        rig.wait_report("frames", |report| report["frames"].as_u64() > Some(0));
        refuse(&rig, function);
        rig.wait_for("the fall-back", || program.err().contains("Panels are shown instead").then_some(()));
        let way = if display == "projection" {
            rig.wait_shot("panels", |shot| shows(shot, |count| count > 0));
            assert!(program.err().contains("notice in the headset: Warnings are shown as panels"), "{}", program.err());
            "panels"
        } else {
            // Panels need textures too.
            let is_said = || program.err().contains("Tones and pulses warn instead").then_some(());
            rig.wait_for("the end of all displays", is_said);
            "cues"
        };
        let ended = program.interrupt();
        assert_eq!(ended.code, Some(0), "{}", ended.err);
        assert!(ended.out.contains("refused by the VR runtime"), "{}", ended.out);
        let report: Value = serde_json::from_slice(&std::fs::read(rig.path("run.json")).unwrap()).unwrap();
        assert_eq!(report["warnings_by"], way);
        assert_eq!(rig.report()["violations"], json!({}));
    }
}

#[test]
fn settings_answered_with_zero_are_not_taken() {
    let mut rig = Rig::new("zero-settings");
    // The chair is lit, which it is not in black.
    let (program, _, _) = at_the_chair(&mut rig, &json!({"defects": ["zero_settings"]}), &[]);
    end(&rig, program);
}

#[test]
fn rooms_without_id_are_reported() {
    let mut rig = Rig::new("no-universe-id");
    rig.start_sensor("empty-room", "natural", 1, 300);
    rig.start_steamvr(&json!({"defects": ["no_universe_id"]}), true);
    let program = rig.start_run(&[]);
    rig.wait_for("its message", || program.err().contains("the map is not kept for the next session").then_some(()));
    assert!(rig.run(&["doctor"]).out.contains("no ids of rooms"));
    assert_eq!(program.interrupt().code, Some(0));
}

#[test]
fn library_that_aborts_is_reported_by_the_doctor() {
    let mut rig = Rig::new("aborts");
    rig.start_steamvr(&json!({"defects": ["aborts_in_init"]}), false);
    let doctor = rig.run(&["doctor"]);
    assert_eq!(doctor.code, Some(1), "{doctor:?}");
    assert!(doctor.out.contains("the VR runtime's library ended the process"), "{}", doctor.out);
    assert!(doctor.out.contains("Board"), "the other checks follow: {}", doctor.out);
}

#[test]
fn failed_install_leaves_nothing_behind() {
    let mut rig = Rig::new("install-fails");
    rig.start_steamvr(&json!({}), false);
    let manifest = "home/.local/share/radar-chaperone/manifest.vrmanifest";
    let rename = |from: &str, to: &str| std::fs::rename(rig.path(from), rig.path(to)).unwrap();
    rename("vr/runtime/bin/linux64/vrclient.so", "vr/gone.so");
    assert_eq!(rig.run(&["install"]).code, Some(1));
    assert!(!rig.path(manifest).exists());
    rename("vr/gone.so", "vr/runtime/bin/linux64/vrclient.so");
    assert_eq!(rig.run(&["install"]).code, Some(0));
    assert!(rig.path(manifest).exists());
}

#[test]
fn runtime_that_is_not_steamvr_is_named() {
    let mut rig = Rig::new("not-steamvr");
    rig.start_steamvr(&json!({}), false);
    std::fs::remove_file(rig.path("vr/runtime/bin/linux64/vrserver")).unwrap();
    let doctor = rig.run(&["doctor"]);
    assert!(doctor.out.contains("is not SteamVR") && !doctor.out.contains("SteamVR 2"), "{}", doctor.out);
}

/// Waits until the program has said that the runtime hangs.
fn hang(rig: &Rig, program: &Program, for_s: u32) {
    rig.wait_report("frames", |report| report["frames"].as_u64() > Some(50));
    rig.send_command(&json!({"do": "hang", "for_s": for_s}));
    rig.wait_for("its message", || program.err().contains("has not answered for 3 s").then_some(()));
}

#[test]
fn interrupt_ends_the_program_while_the_runtime_hangs() {
    let mut rig = Rig::new("hangs");
    rig.start_sensor("empty-room", "natural", 1, 300);
    rig.start_steamvr(&json!({}), true);
    let program = rig.start_run(&["--record", "room.mcap"]);
    hang(&rig, &program, 1000);
    let ended = program.interrupt();
    assert_eq!(ended.code, Some(1), "{}", ended.err);
    assert!(ended.err.contains("exiting without it"), "{}", ended.err);
    let info = rig.run(&["info", "room.mcap"]);
    assert!(info.code == Some(0) && info.out.contains("Damage     none"), "the recording is complete: {info:?}");
}

#[test]
fn runtime_that_answers_again_is_used_again() {
    let mut rig = Rig::new("hangs-a-while");
    rig.start_sensor("empty-room", "natural", 1, 300);
    rig.start_steamvr(&json!({}), true);
    let program = rig.start_run(&[]);
    hang(&rig, &program, 5);
    rig.wait_for("its message", || program.err().contains("the VR runtime answers again").then_some(()));
    rig.wait_frames(50);
    let ended = program.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
}

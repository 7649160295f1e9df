//! Registration with SteamVR: installed, started by SteamVR, moved, uninstalled; and the output of
//! `doctor`.

use std::fs;

use serde_json::json;

use crate::rig::Rig;

const MANIFEST: &str = "home/.local/share/radar-chaperone/manifest.vrmanifest";
const ICON: &str = "home/.local/share/radar-chaperone/icon.png";

#[test]
fn install_and_uninstall_register_the_manifest() {
    let mut rig = Rig::new("install");
    rig.start_steamvr(&json!({}), false);
    let before = rig.run(&["uninstall"]);
    assert_eq!((before.code, before.out.contains("nothing to do")), (Some(0), true), "{before:?}");

    for nonsense in [["--nonsense", ""], ["--mount", "nonsense"], ["--set", "cues.volume=9"]] {
        let arguments: Vec<&str> =
            ["install", "--"].into_iter().chain(nonsense).filter(|word| !word.is_empty()).collect();
        let refused = rig.run(&arguments);
        assert!(refused.code == Some(1) && !refused.out.contains("starts it"), "{nonsense:?}: {refused:?}");
    }
    let installed = rig.run(&["install", "--", "--port", "a b", "--preset", "c16"]);
    assert_eq!(installed.code, Some(0), "{}", installed.err);
    assert!(installed.out.contains("SteamVR starts it with the headset"), "{}", installed.out);
    let manifest: serde_json::Value = serde_json::from_slice(&fs::read(rig.path(MANIFEST)).unwrap()).unwrap();
    let application = &manifest["applications"][0];
    assert_eq!(application["binary_path_linux"], env!("CARGO_BIN_EXE_radar-chaperone"));
    assert_eq!(application["arguments"], "run --port \"a b\" --preset c16");
    assert_eq!(application["image_path"], rig.path(ICON).display().to_string());
    assert_eq!(fs::read(rig.path(ICON)).unwrap(), include_bytes!("../../overlay_assets/icon.png"));
    assert!(rig.run(&["install"]).code == Some(0), "installing twice must work");
    assert!(doctor(&rig).contains("SteamVR starts this program with the headset"));

    let removed = rig.run(&["uninstall"]);
    assert_eq!(removed.code, Some(0), "{}", removed.err);
    assert!(!rig.path(MANIFEST).exists() && !rig.path(ICON).exists());
    assert!(doctor(&rig).contains("SteamVR does not know this program"));
}

#[test]
fn moved_binary_is_reported() {
    let mut rig = Rig::new("moved");
    rig.start_steamvr(&json!({}), false);
    let copy = rig.path("copy");
    fs::copy(env!("CARGO_BIN_EXE_radar-chaperone"), &copy).unwrap();
    assert!(rig.command(&copy).arg("install").status().unwrap().success());
    assert!(doctor(&rig).contains("another copy of this program"));
    fs::remove_file(&copy).unwrap();
    let doctor_text = doctor(&rig);
    assert!(
        doctor_text.contains("fix ") && doctor_text.contains("which is not there: `radar-chaperone install` fixes it"),
        "{doctor_text}"
    );
    let program = rig.start_run(&[]);
    rig.wait_for("its message", || program.err().contains("`radar-chaperone install` fixes it").then_some(()));
    assert_eq!(program.interrupt().code, Some(0));
}

#[test]
fn steamvr_autolaunches_the_program() {
    let mut rig = Rig::new("autolaunch");
    rig.start_steamvr(&json!({}), false);
    assert_eq!(rig.run(&["install"]).code, Some(0));
    rig.end_steamvr();
    rig.start_steamvr_with(&json!({}), &["--autolaunch"]);
    rig.wait_report("frames", |report| report["frames"].as_u64() > Some(20));
    rig.end_steamvr();
    let report = rig.wait_report("its end", |report| report["cleanup_s"].is_number());
    assert_eq!(report["left_at_cleanup"], 0);
}

#[test]
fn doctor_reports_headset_and_graphics() {
    let mut rig = Rig::new("doctor");
    assert!(doctor(&rig).contains("SteamVR is not installed"));
    rig.start_steamvr(&json!({}), false);
    let doctor_text = doctor(&rig);
    for word in ["Fake headset", "90 frames a second", "the head is at 0.00, 1.60, 0.00 m", "play area"] {
        assert!(doctor_text.contains(word), "{word} is not in: {doctor_text}");
    }
    assert!(doctor_text.contains("as SteamVR wants it") || doctor_text.contains("graphics"), "{doctor_text}");
    rig.end_steamvr();
    assert!(doctor(&rig).contains("SteamVR is not running"));
}

fn doctor(rig: &Rig) -> String {
    rig.run(&["doctor"]).out
}

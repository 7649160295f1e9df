//! The settings file changes while the program runs.

use std::fs;
use std::path::Path;
use std::time::Instant;

use serde_json::{Value, json};

use crate::eyes::Eye;
use crate::rig::{Rig, TIMEOUT};

/// Frames of one walk to the chair and back: 14 s at 90 a second.
const WALK_FRAMES: u64 = 14 * 90;

/// Brightest colour channel in the left eye's image; `None` without a visible warning.
fn hue(rig: &Rig, number: &mut u32) -> Option<char> {
    *number += 1;
    let name = format!("look{number}");
    let [eye, _] = Eye::both(&rig.path("vr/shots"), Path::new(&name), &rig.shoot(&name));
    let [red, green] = eye.brightest_red_and_green();
    let is_lit = red.max(green) > 100;
    is_lit.then_some(if red > 2 * green {
        'r'
    } else if green > 2 * red {
        'g'
    } else {
        '?'
    })
}

fn wait_for_hue(rig: &Rig, number: &mut u32, wanted: char) {
    let begin = Instant::now();
    while hue(rig, number) != Some(wanted) {
        assert!(begin.elapsed() < TIMEOUT, "no warning of colour {wanted}");
    }
}

#[test]
fn settings_changes_apply_at_once_and_invalid_ones_are_ignored() {
    let mut rig = Rig::new("settings");
    rig.start_sensor("furnished-room", "approach-chair", 1, 300);
    rig.start_steamvr(&json!({}), true);
    let file = rig.path("own.toml");
    let color =
        |color: &str| format!("# kept\n[warning]\ncolor = {color}\nfull_distance_m = 2.5\nfade_distance_m = 3.5\n");
    fs::write(&file, color("[0, 255, 0]")).unwrap();
    let program = rig.start_run(&["--settings", "own.toml", "--report", "run.json"]);
    rig.wait_report("a warning", |report| report["visible"].as_u64() > Some(0));
    let number = &mut 0;
    wait_for_hue(&rig, number, 'g');
    fs::write(&file, color("[255, 0, 0]")).unwrap();
    wait_for_hue(&rig, number, 'r');

    // Invalid content: reported once, and nothing changes.
    fs::write(&file, color("[0, 255, 0")).unwrap();
    rig.wait_for("its message", || program.err().contains("own.toml").then_some(()));
    wait_for_hue(&rig, number, 'r');
    // The program looks at the file several times meanwhile.
    rig.wait_frames(90);
    assert_eq!(program.err().matches("stay in use").count(), 1, "{}", program.err());
    // Empty, then away: as some editors save, and as some files end.
    fs::write(&file, "").unwrap();
    rig.wait_for("its message", || program.err().contains("it is empty").then_some(()));
    fs::remove_file(&file).unwrap();
    rig.wait_for("its message", || program.err().contains("it was removed").then_some(()));
    wait_for_hue(&rig, number, 'r');
    // By renaming.
    fs::write(rig.path("new.toml"), color("[0, 255, 0]")).unwrap();
    fs::rename(rig.path("new.toml"), &file).unwrap();
    wait_for_hue(&rig, number, 'g');

    // Another display mode, no warnings, another search mode: while it runs.
    fs::write(&file, color("[255, 0, 0]") + "[headset]\ndisplay = \"stereo\"\n").unwrap();
    wait_for_hue(&rig, number, 'r');
    fs::write(&file, color("[255, 0, 0]") + "[headset]\nwarnings = false\n").unwrap();
    rig.wait_report("no warning", |report| report["visible"] == 0);
    fs::write(&file, color("[0, 255, 0]") + "[rooms.tracks]\nconfirm_score = 6.0\n").unwrap();
    wait_for_hue(&rig, number, 'g');

    let ended = program.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert_eq!(rig.report()["violations"], json!({}));
    let own: Value = serde_json::from_slice(&fs::read(rig.path("run.json")).unwrap()).unwrap();
    assert_eq!((&own["forgotten"], &own["reconstruction"]["epoch"]), (&json!(0), &json!(1)), "{own}");
}

#[test]
fn invalid_settings_at_start_fall_back_to_defaults() {
    let mut rig = Rig::new("settings_wrong");
    rig.start_sensor("furnished-room", "approach-chair", 1, 300);
    rig.start_steamvr(&json!({}), true);
    let folder = rig.path("home/.config/radar-chaperone");
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("settings.toml"), "broken [").unwrap();
    let program = rig.start_run(&[]);
    rig.wait_for("its message", || program.err().contains("the defaults apply").then_some(()));
    rig.wait_report("a warning", |report| report["visible"].as_u64() > Some(0));
    let ended = program.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
}

#[test]
fn play_area_changes_are_followed() {
    let mut rig = Rig::new("play_area");
    // The wearer stays within 0.5 m of the origin, where nothing stands.
    rig.start_sensor("furnished-room", "sphere-10cm", 1, 300);
    rig.start_steamvr(&json!({ "chaperone": { "size_m": [8, 8] } }), true);
    let arguments = ["--set", "warning.play_area_margin_m=0", "--set", "warning.fade_distance_m=3.5"];
    let program = rig.start_run(&[&arguments[..], &["--report", "run.json"]].concat());
    let is_visible = |report: &Value| report["visible"].as_u64() > Some(0);
    // The room is mapped; then none of it is within reach.
    rig.wait_report("a warning", is_visible);
    rig.send_command(&json!({ "do": "play_area", "x": 1.0, "z": 1.2 }));
    rig.wait_report("the small play area", |report| report["commands"] == 1);
    rig.wait_report("no warning", |report| !is_visible(report));
    rig.wait_frames(WALK_FRAMES / 10);
    for _ in 0..10 {
        assert!(!is_visible(&rig.wait_frames(WALK_FRAMES / 10)), "all is out of reach");
    }
    // A wearer who has left the play area can reach everything.
    rig.send_command(&json!({ "do": "play_area", "x": 0.01, "z": 0.01 }));
    rig.wait_report("a warning past the boundary", is_visible);
    rig.send_command(&json!({ "do": "play_area", "x": 8, "z": 8 }));
    rig.wait_report("a warning", is_visible);
    assert_eq!(program.interrupt().code, Some(0));
    let own: Value = serde_json::from_slice(&fs::read(rig.path("run.json")).unwrap()).unwrap();
    assert_eq!(own["forgotten"], 0, "the room has not moved: {own}");
}

#[test]
fn settings_of_a_game_apply_while_it_is_shown() {
    let mut rig = Rig::new("games");
    rig.start_sensor("furnished-room", "approach-chair", 1, 300);
    rig.start_steamvr(&json!({}), true);
    let warning = "full_distance_m = 2.5\nfade_distance_m = 3.5\n";
    let text =
        format!("[warning]\ncolor = [0, 255, 0]\n{warning}[games.\"steam.app.1\".warning]\ncolor = [255, 0, 0]\n");
    fs::write(rig.path("own.toml"), text).unwrap();
    let program = rig.start_run(&["--settings", "own.toml"]);
    // What is sent before the program has connected is lost.
    rig.wait_report("a warning", |report| report["visible"].as_u64() > Some(0));
    let number = &mut 0;
    wait_for_hue(&rig, number, 'g');
    rig.send_command(&json!({"do": "game", "key": "steam.app.1"}));
    wait_for_hue(&rig, number, 'r');
    rig.send_command(&json!({"do": "game", "key": "steam.app.2"}));
    wait_for_hue(&rig, number, 'g');
    let ended = program.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert_eq!(rig.report()["violations"], json!({}));
}

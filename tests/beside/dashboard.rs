//! The dashboard panel: shown, operated, closed; and a runtime without a dashboard.

use std::collections::BTreeSet;
use std::fs;

use radar_chaperone::panel;
use radar_chaperone::settings::Settings;
use serde_json::{Value, json};

use crate::rig::Rig;

const OWN: &str = "home/.config/radar-chaperone/settings.toml";
const TEXT: &str = "# my own\n[warning] # near objects\nfade_distance_m = 3.5 # far\nfull_distance_m = 2.5\n";

/// Presses a switch.
fn press(rig: &Rig, name: &str) {
    let settings = toml::Table::try_from(Settings::default()).unwrap();
    let [x, y] = panel::target(&settings, name).unwrap();
    rig.send_command(&json!({"do": "mouse", "action": "click", "x": x, "y": y}));
}

/// The tab as submitted last.
fn shoot(rig: &Rig, name: &str) -> image::RgbaImage {
    rig.send_command(&json!({"do": "tab_shot", "name": name}));
    let path = rig.path(&format!("vr/shots/{name}.png"));
    rig.wait_for("the tab's picture", || image::open(&path).ok()).to_rgba8()
}

fn textures(report: &Value) -> u64 {
    report["dashboard_textures"].as_u64().unwrap()
}

fn is_warning(report: &Value) -> bool {
    report["visible"].as_u64() > Some(0)
}

#[test]
fn panel_is_shown_and_its_changes_are_saved() {
    let mut rig = Rig::new("dashboard");
    fs::create_dir_all(rig.path(OWN).parent().unwrap()).unwrap();
    fs::write(rig.path(OWN), TEXT).unwrap();
    rig.start_sensor("furnished-room", "approach-chair", 1, 300);
    rig.start_steamvr(&json!({}), true);
    let program = rig.start_run(&["--report", "run.json"]);
    rig.wait_report("a warning", |report| is_warning(report) && report["frames"].as_u64() > Some(1000));
    assert_eq!(textures(&rig.report()), 1, "only the button's: the panel is not shown");

    rig.send_command(&json!({"do": "dashboard", "open": true}));
    rig.wait_report("the panel", |report| textures(report) > 5);
    let picture = shoot(&rig, "open");
    assert_eq!([picture.width(), picture.height()], panel::SIZE);
    assert!(picture.pixels().all(|pixel| pixel[3] == 255), "the panel must be opaque");
    let colors: BTreeSet<[u8; 4]> = picture.pixels().map(|pixel| pixel.0).collect();
    assert!(colors.len() > 100, "{} colours", colors.len());
    let thumbnail = image::open(rig.path("vr/shots/open_thumbnail.png")).unwrap().to_rgba8();
    assert!(thumbnail.pixels().any(|pixel| pixel[2] > 150), "the button must have an icon");

    // A switch changes the active settings, the image, and the file, which keeps everything else.
    press(&rig, "headset.warnings");
    rig.wait_report("no warnings", |report| !is_warning(report));
    rig.wait_for("the file", || {
        fs::read_to_string(rig.path(OWN)).ok().filter(|text| text.contains("warnings = false"))
    });
    let text = fs::read_to_string(rig.path(OWN)).unwrap();
    assert!(text.starts_with(TEXT), "{text}");
    let [x, y] = panel::target(&toml::Table::try_from(Settings::default()).unwrap(), "headset.warnings").unwrap();
    let switch = |picture: &image::RgbaImage| *picture.get_pixel(x as u32, y as u32);
    let mut shots = 0..100;
    let mut shoot_switch =
        || switch(&shoot(&rig, &format!("off{}", shots.next().expect("the switch never looks off"))));
    while shoot_switch() == switch(&picture) {}
    println!("the switch looks off in shot {}", shots.start);
    press(&rig, "headset.warnings");
    rig.wait_report("warnings", is_warning);
    // A number, changed twice.
    press(&rig, "warning.fade_distance_m-");
    press(&rig, "warning.fade_distance_m-");
    let changed = TEXT.replace("3.5", "3.3");
    rig.wait_for("the file", || fs::read_to_string(rig.path(OWN)).ok().filter(|text| text.starts_with(&changed)));

    rig.send_command(&json!({"do": "dashboard", "open": false}));
    // A picture may still be under way. After that the count stays where it is.
    rig.wait_for("two seconds without a picture of the closed panel", || {
        let before = textures(&rig.report());
        (textures(&rig.wait_frames(180)) == before).then_some(())
    });

    let ended = program.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert_eq!(ended.err.matches("settings").count(), 0, "the program's own write must not be reported: {}", ended.err);
    let report = rig.report();
    assert_eq!((&report["violations"], &report["left_at_cleanup"]), (&json!({}), &json!(0)));
}

#[test]
fn warnings_work_without_a_dashboard() {
    let mut rig = Rig::new("no-dashboard");
    rig.start_sensor("furnished-room", "approach-chair", 1, 120);
    let fail = json!({"at_s": 0, "do": "fail", "function": "CreateDashboardOverlay", "count": 1});
    rig.start_steamvr(&json!({"events": [fail]}), true);
    let program = rig.start_run(&["--set", "warning.fade_distance_m=3.5"]);
    rig.wait_report("a warning", is_warning);
    let ended = program.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert_eq!(ended.err.matches("no panel in the dashboard").count(), 1, "{}", ended.err);
    assert_eq!(rig.report()["violations"], json!({}));
}

//! docs/settings.toml documents the settings: it must hold all of them with the program's defaults.

use radar_chaperone::settings::Settings;

use crate::common::Folder;

const MANUAL: &str = include_str!("../../docs/settings.toml");

/// Sorted dotted names of a TOML table's values.
fn names(prefix: &str, table: &toml::Table, into: &mut Vec<String>) {
    for (name, value) in table {
        let name = format!("{prefix}{name}");
        match value {
            toml::Value::Table(inner) => names(&format!("{name}."), inner, into),
            _ => into.push(name),
        }
    }
    into.sort();
}

fn names_in(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    names("", &text.parse().unwrap(), &mut found);
    found
}

#[test]
fn manual_has_the_default_values() {
    assert_eq!(Settings::from_toml(MANUAL, &[]).unwrap(), Settings::default());
}

#[test]
fn manual_lists_every_setting() {
    assert_eq!(names_in(MANUAL), names_in(&Settings::default().to_toml()));
}

#[test]
fn commented_out_settings_are_valid() {
    // Uncomments the lines of the optional settings.
    let is_setting = |rest: &str| rest.starts_with('[') || rest.contains(" = [") || rest.starts_with("range_bias_m = ");
    let uncomment = |line: &str| match line.strip_prefix("# ") {
        Some(rest) if is_setting(rest) => rest.to_owned(),
        _ => line.to_owned(),
    };
    let text: String = MANUAL.lines().map(|line| uncomment(line) + "\n").collect();
    let settings = Settings::from_toml(&text, &[]).unwrap();
    assert_eq!(settings.radar.range_bias_m, Some(-0.003));
    let mount = settings.tracking.mount.expect("tracking.mount");
    assert_eq!(mount.translation.to_array(), [0.0, 0.03, -0.10]);
    let region = settings.processing.region.expect("processing.region");
    assert_eq!(region.max.to_array(), [1.5, 3.0, 0.0]);
}

/// Ends of the settings' intervals that make mapping hardest.
const HARDEST: [&str; 25] = [
    "rooms.subapertures.duration_s=0.2",
    "rooms.subapertures.min_sweeps=36",
    "rooms.subapertures.decay_s=0.5",
    "rooms.subapertures.min_amplitude=0.7",
    "rooms.subapertures.plane_min_amplitude=0.25",
    "rooms.subapertures.min_range_m=1",
    "rooms.subapertures.max_range_m=1",
    "rooms.subapertures.voxel_m=0.5",
    "rooms.clean.min_score=15",
    "rooms.clean.min_candidate_score=15",
    "rooms.clean.max_candidates=10",
    "rooms.clean.plane_min_subapertures=44",
    "rooms.clean.plane_min_score=20",
    "rooms.clean.mask_range_m=10",
    "rooms.clean.mask_lobes=1000",
    "rooms.clean.max_sigma_m=0.05",
    "rooms.clean.min_feet_rms_m=0.3",
    "rooms.clean.min_over_point=6",
    "rooms.tracks.confirm_score=15",
    "rooms.tracks.confirm_log_odds=3",
    "rooms.tracks.hands_reach_m=10",
    "rooms.tracks.match_m=1",
    "rooms.tracks.existence.confirm_log_odds=4",
    "rooms.tracks.existence.loss=0.3",
    "tracking.errors.wander_m=1",
];

#[test]
fn no_setting_within_its_bounds_ends_all_warnings() {
    let folder = Folder::new("hardest_settings");
    folder
        .run("simulate furnished-room --motion natural --preset d16 --duration-s 10 --seed 3 --out room.mcap")
        .succeeds();
    for change in HARDEST {
        folder.run(&format!("replay room.mcap --out o --set {change}")).succeeds();
        let found = folder.json("o/obstacles.json");
        let count = |what: &str| found[what].as_array().unwrap().len();
        assert!(count("obstacles") > 0 && count("walls") > 0, "{change}: {}, {}", count("obstacles"), count("walls"));
    }
}

//! docs/settings.toml documents the settings: it must hold all of them with the program's defaults.

use radar_chaperone::settings::Settings;

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
    // Uncomments the lines of the optional tables.
    let uncomment = |line: &str| match line.strip_prefix("# ") {
        Some(rest) if rest.starts_with('[') || rest.contains(" = [") => rest.to_owned(),
        _ => line.to_owned(),
    };
    let text: String = MANUAL.lines().map(|line| uncomment(line) + "\n").collect();
    let settings = Settings::from_toml(&text, &[]).unwrap();
    let mount = settings.tracking.mount.expect("tracking.mount");
    assert_eq!(mount.translation.to_array(), [0.0, 0.03, -0.10]);
    let region = settings.processing.region.expect("processing.region");
    assert_eq!(region.max.to_array(), [1.5, 3.0, 0.0]);
}

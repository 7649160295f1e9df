//! The desktop view without a desktop: its pictures, and that it does not change the results.

use std::collections::BTreeSet;

use crate::common::{Folder, Outcome};

const SHOTS: [&str; 4] = ["overview.png", "above.png", "first-person.png", "maps.png"];

/// Records a walk through a furnished room.
fn recorded(folder: &Folder) {
    let line = "simulate furnished-room --motion natural --preset d16 --duration-s 6 --seed 3 --out room.mcap";
    folder.run(line).succeeds();
}

/// Silences Mesa's device selection, which prints on standard error where there is no desktop.
const QUIET: [(&str, &str); 1] = [("NODEVICE_SELECT", "1")];

/// Runs the program, which needs a Vulkan driver to draw.
fn drawn(folder: &Folder, line: &str) -> Outcome {
    folder.run_with(line, &QUIET).succeeds()
}

/// Number of colours in a picture, at most 1000.
fn colors(folder: &Folder, name: &str) -> usize {
    let picture = image::load_from_memory(&folder.read(name)).unwrap().into_rgb8();
    assert_eq!(picture.dimensions(), (1600, 1000), "{name}");
    let mut colors = BTreeSet::new();
    picture.pixels().any(|pixel| colors.insert(pixel.0) && colors.len() >= 1000);
    colors.len()
}

#[test]
fn view_pictures_have_content_and_do_not_change_results() {
    let folder = Folder::new("view-shots");
    recorded(&folder);
    folder.run("replay room.mcap --out plain").succeeds();
    let shown = drawn(&folder, "replay room.mcap --view --view-shot shots --out looked");
    assert_eq!(folder.read("looked/obstacles.json"), folder.read("plain/obstacles.json"));
    for name in SHOTS {
        let path = format!("shots/{name}");
        assert!(shown.out.contains(name), "{shown:#?}");
        assert!(colors(&folder, &path) >= 100, "{name} has few colours");
        // Compressed to a tenth of its pixels.
        assert!(folder.read(&path).len() <= 1600 * 1000 * 3 / 10, "{name}: {} bytes", folder.read(&path).len());
    }
    // The pictures differ from each other.
    let pictures: BTreeSet<Vec<u8>> = SHOTS.iter().map(|name| folder.read(&format!("shots/{name}"))).collect();
    assert_eq!(pictures.len(), SHOTS.len());
}

#[test]
fn settings_apply_to_the_view() {
    let folder = Folder::new("view-settings");
    recorded(&folder);
    // All poses are ten seconds away from the sweeps.
    let line = "replay room.mcap --view-shot shots --out out --set tracking.time_offset_s=10";
    drawn(&folder, line);
    assert_eq!(folder.json("out/obstacles.json")["obstacles"].as_array().unwrap().len(), 0);
    assert!(folder.read("shots/overview.png").len() > 10_000);
}

#[test]
#[cfg(target_os = "linux")]
fn missing_desktop_is_reported_in_one_sentence() {
    let folder = Folder::new("view-no-desktop");
    recorded(&folder);
    let nowhere = [("DISPLAY", ""), ("WAYLAND_DISPLAY", ""), ("WAYLAND_SOCKET", "")];
    let run = folder.run_with("replay room.mcap --view", &nowhere);
    assert_eq!(run.code, Some(1), "{run:#?}");
    assert!(run.err.contains("no window can be opened") && run.err.contains("--view-shot"), "{run:#?}");
    assert!(!run.err.contains(".rs:"), "{run:#?}");
}

#[test]
fn empty_recording_is_shown() {
    let folder = Folder::new("view-empty");
    let line = "simulate corner-reflector --motion stationary --preset fine --duration-s 0.2 --seed 1 --out short.mcap";
    folder.run(line).succeeds();
    drawn(&folder, "replay short.mcap --view-shot shots");
    assert!(folder.read("shots/maps.png").len() > 5_000);
}

//! `results`: its pages, its error messages.

use crate::common::Folder;

#[test]
fn without_names_the_pages_are_listed() {
    let folder = Folder::new("results_listed");
    let mut listed = folder.run("results").succeeds();
    for page in [
        "reflectors",
        "rooms",
        "play",
        "living",
        "realism",
        "calibration",
        "experiments",
        "benchmark",
        "speed",
        "gpu",
        "memory",
        "scale",
    ] {
        listed = listed.prints(page);
    }
    folder.run("results walls").fails_with("there is no page \"walls\": use reflectors, rooms, play");
}

#[test]
fn a_quick_page_states_command_commit_and_machine() {
    let folder = Folder::new("results_rooms");
    folder.run("results rooms living realism calibration speed --quick --out r").succeeds().prints("Written to");
    for (page, needs) in [
        ("rooms", &["| objects that came within 1 m: found", "| d16 "][..]),
        ("living", &["| warned before 0.4 m or 0.6 s, % ", "| Lighthouse", "| poor tracker", "| all but walls "][..]),
        ("calibration", &["| points ", "cm off, estimated ", "cm off, as assumed "][..]),
        ("realism", &["| everything on ", "| sensor: noise alone "][..]),
        ("speed", &["| ls, 16³ × 10 ", "| instruction set", "| the whole mapper ", "drawn from it"][..]),
    ] {
        let text = String::from_utf8(folder.read(&format!("r/{page}.md"))).unwrap();
        let made = text.split("\n\n").nth(1).unwrap().replace('\n', " ");
        let command = format!("Made by `cargo run --release -p lab -- results {page} --quick` at ");
        assert!(made.starts_with(&command), "{made}");
        assert!(made.contains(" cores of "), "{made}");
        needs.iter().for_each(|part| assert!(text.contains(part), "{part}: {text}"));
    }
}

#[test]
fn a_sensor_recording_that_cannot_be_used_is_told() {
    let folder = Folder::new("results_recording");
    folder.run("results realism --sensor-recording none.h5").fails_with("cannot read the recording none.h5");
    folder.run("play --diffuse-db 3").fails_with("--spacing and --diffuse-db are for rooms of surfaces: give --world");
    folder.run("play --world living --spacing 0.1").fails_with("give spacings of 0.25 to 4");
}

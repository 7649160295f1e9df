//! `results`: its pages, its error messages.

use crate::common::Folder;

#[test]
fn without_names_the_pages_are_listed() {
    let folder = Folder::new("results_listed");
    let mut listed = folder.run("results").succeeds();
    for page in ["reflectors", "rooms", "play", "experiments", "benchmark", "speed"] {
        listed = listed.prints(page);
    }
    folder.run("results walls").fails_with("there is no page \"walls\": use reflectors, rooms, play");
}

#[test]
fn a_quick_page_states_command_commit_and_machine() {
    let folder = Folder::new("results_rooms");
    folder.run("results rooms speed --quick --out r").succeeds().prints("Written to");
    for (page, needs) in [
        ("rooms", &["| objects that came within 1 m: found", "| d16 "][..]),
        ("speed", &["| instruction set", "| the whole mapper ", "drawn from it"][..]),
    ] {
        let text = String::from_utf8(folder.read(&format!("r/{page}.md"))).unwrap();
        let made = text.split("\n\n").nth(1).unwrap().replace('\n', " ");
        let command = format!("Made by `cargo run --release -p lab -- results {page} --quick` at ");
        assert!(made.starts_with(&command), "{made}");
        assert!(made.contains(" cores of "), "{made}");
        needs.iter().for_each(|part| assert!(text.contains(part), "{part}: {text}"));
    }
}

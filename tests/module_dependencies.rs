//! Checks the module table in ARCHITECTURE.md against the code: a module uses exactly the modules
//! in its row, all of them above it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Modules in the table's order, each with the modules that its row names.
fn table() -> Vec<(String, BTreeSet<String>)> {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let rows = text.lines().skip_while(|line| *line != "| room | holds | uses |").skip(2);
    let cells = rows.take_while(|line| line.starts_with('|')).map(|line| {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        let uses = cells[2].split(", ").filter(|room| *room != "–").map(String::from).collect();
        (cells[0].trim_matches('`').to_owned(), uses)
    });
    cells.collect()
}

/// Collects the modules whose names follow `crate::` in a file, or in any file of a folder.
fn uses(path: &Path, into: &mut BTreeSet<String>) {
    if path.is_dir() {
        return fs::read_dir(path).unwrap().for_each(|entry| uses(&entry.unwrap().path(), into));
    }
    if path.extension().is_some_and(|e| e == "rs") {
        let text = fs::read_to_string(path).unwrap();
        assert!(!text.contains("crate::{"), "{}: write one `use` per module", path.display());
        let names = text.split("crate::").skip(1).map(|rest| {
            rest.chars().take_while(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || *c == '_').collect::<String>()
        });
        into.extend(names.filter(|name| !name.is_empty()));
    }
}

#[test]
fn modules_use_exactly_the_modules_in_their_row() {
    let mut in_code: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for entry in fs::read_dir(root().join("src")).unwrap() {
        let path = entry.unwrap().path();
        let room = path.file_stem().unwrap().to_string_lossy().into_owned();
        if !["lib", "main"].contains(&room.as_str()) {
            let used = in_code.entry(room.clone()).or_default();
            uses(&path, used);
            used.remove(&room);
        }
    }
    assert_eq!(in_code, table().into_iter().collect());
}

#[test]
fn modules_only_use_modules_above_them() {
    let mut above = BTreeSet::new();
    for (room, uses) in table() {
        assert!(uses.is_subset(&above), "{room} uses {uses:?}, but only {above:?} are above it");
        above.insert(room);
    }
}

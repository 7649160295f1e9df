//! The tables in ARCHITECTURE.md against manifests and code: a crate uses exactly the crates in its
//! row, a module of the program exactly the modules in its row, all of them above it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

type Uses = BTreeMap<String, BTreeSet<String>>;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Rows of a table in their order, each with the names in its last column.
fn table(first_column: &str) -> Vec<(String, BTreeSet<String>)> {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let head = format!("| {first_column} | holds | uses |");
    let rows = text.lines().skip_while(|line| *line != head).skip(2).take_while(|line| line.starts_with('|'));
    let cells = rows.map(|line| {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        let uses = cells[2].split(", ").filter(|name| *name != "–").map(String::from).collect();
        (cells[0].trim_matches('`').to_owned(), uses)
    });
    let rows: Vec<_> = cells.collect();
    assert!(rows.len() > 5, "the table of each {first_column} is missing");
    rows
}

fn only_uses_rows_above(table: &[(String, BTreeSet<String>)]) {
    let mut above = BTreeSet::new();
    for (name, uses) in table {
        assert!(uses.is_subset(&above), "{name} uses {uses:?}, above it are {above:?}");
        above.insert(name.clone());
    }
}

/// Crates of the workspace in a manifest's dependencies, without those for tests.
fn dependencies(manifest: &Path) -> (String, BTreeSet<String>) {
    let manifest: toml::Table = toml::from_str(&fs::read_to_string(manifest).unwrap()).unwrap();
    let is_own = |name: &&String| *name == "a121" || name.starts_with("radar-");
    let dependencies = manifest["dependencies"].as_table().unwrap().keys().filter(is_own).cloned().collect();
    (manifest["package"]["name"].as_str().unwrap().to_owned(), dependencies)
}

#[test]
fn crates_use_exactly_the_crates_in_their_row() {
    let folders = fs::read_dir(root().join("crates")).unwrap().map(|entry| entry.unwrap().path());
    let folders = folders.chain([root().to_owned(), root().join("lab")]);
    let in_manifests: Uses = folders.map(|folder| dependencies(&folder.join("Cargo.toml"))).collect();
    let table = table("crate");
    assert_eq!(in_manifests, table.iter().cloned().collect());
    only_uses_rows_above(&table);
}

/// The modules whose names follow `crate::` in a file or any file of a folder.
fn uses(path: &Path, into: &mut BTreeSet<String>) {
    if path.is_dir() {
        return fs::read_dir(path).unwrap().for_each(|entry| uses(&entry.unwrap().path(), into));
    }
    if path.extension().is_some_and(|e| e == "rs") {
        let text = fs::read_to_string(path).unwrap();
        assert!(!text.contains("crate::{"), "{}: write one use for each module", path.display());
        let names = text.split("crate::").skip(1).map(|rest| {
            rest.chars().take_while(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || *c == '_').collect::<String>()
        });
        into.extend(names.filter(|name| !name.is_empty()));
    }
}

#[test]
fn modules_use_exactly_the_modules_in_their_row() {
    let mut in_code = Uses::new();
    for entry in fs::read_dir(root().join("src")).unwrap() {
        let path = entry.unwrap().path();
        let module = path.file_stem().unwrap().to_string_lossy().into_owned();
        if !["lib", "main"].contains(&module.as_str()) {
            let used = in_code.entry(module.clone()).or_default();
            uses(&path, used);
            used.remove(&module);
        }
    }
    let table = table("module");
    assert_eq!(in_code, table.iter().cloned().collect());
    only_uses_rows_above(&table);
}

//! Every tunable constant's comment says where its value comes from; a choice has its reason.

use std::fs;
use std::path::{Path, PathBuf};

/// Types of constants that can be tuned. The others are names.
const NUMBERS: [&str; 13] =
    ["f64", "f32", "Duration", "usize", "isize", "u8", "u16", "u32", "u64", "i8", "i16", "i32", "i64"];

/// The Rust sources below a folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let below = |path: PathBuf| if path.is_dir() { sources(&path) } else { vec![path] };
    let name = |path: &PathBuf| path.to_string_lossy().into_owned();
    let is_source = |path: &PathBuf| name(path).ends_with(".rs") && !name(path).ends_with("tests.rs");
    paths.into_iter().flat_map(below).filter(is_source).collect()
}

/// Name of the constant that a line declares, when it is a number or several of one type.
fn numeric_constant(line: &str) -> Option<&str> {
    let (visibility, declared) = line.split_once("const ")?;
    let (name, rest) = declared.split_once(": ")?;
    let kind = rest.trim_start_matches(['[', '(']).split([';', ',', ')', ' ']).next()?;
    let is_declaration = visibility.trim().is_empty() || visibility.trim().starts_with("pub");
    (is_declaration && NUMBERS.contains(&kind)).then_some(name)
}

/// Whether a comment calls the value a choice and gives no reason.
fn is_bare_choice(comment: &str) -> bool {
    let comment = comment.to_lowercase();
    comment.contains("(choice)")
        || comment.contains("choice. ")
        || ["choice.", "choice:"].iter().any(|end| comment.ends_with(end))
}

/// The constants of a source whose comments give no reason.
fn bare_choices(source: &str) -> Vec<&str> {
    let (mut comment, mut bare) = (String::new(), Vec::new());
    for line in source.lines().map(str::trim).take_while(|line| !line.starts_with("mod tests")) {
        match (line.strip_prefix("///"), numeric_constant(line)) {
            (Some(text), _) => comment = format!("{comment} {}", text.trim()),
            (None, Some(name)) if is_bare_choice(&comment) => bare.push(name),
            (None, None) if line.starts_with("#[") => continue,
            _ => {}
        }
        if !line.starts_with("///") {
            comment.clear();
        }
    }
    bare
}

#[test]
fn every_choice_has_a_reason() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let crates = fs::read_dir(root.join("crates")).unwrap().map(|member| member.unwrap().path().join("src"));
    let folders: Vec<PathBuf> = crates.chain([root.join("src"), root.join("lab/src")]).collect();
    let mut bare = Vec::new();
    for path in folders.iter().flat_map(|folder| sources(folder)) {
        let source = fs::read_to_string(&path).unwrap();
        bare.extend(bare_choices(&source).into_iter().map(|name| format!("{}: {name}", path.display())));
    }
    assert!(bare.is_empty(), "a choice without its reason:\n{}", bare.join("\n"));
}

#[test]
fn choice_without_reason_is_found() {
    let source = "/// A, metres (choice).\nconst A: f64 = 1.0;\n/// B. Choice.\npub(super) const B: (u32, u32) = (1, 2);\n\
                  /// C. Choice: D.\nconst C: Duration = Duration::MAX;\nmod tests {\n/// Choice.\nconst E: i64 = 1;";
    assert_eq!(bare_choices(source), ["A", "B"]);
}

//! Every link between the project's documents leads to a file.

use std::path::{Path, PathBuf};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// README and the other documents at the top, and everything in docs.
fn documents() -> Vec<PathBuf> {
    let mut folders = vec![PathBuf::from(ROOT).join("docs")];
    let top = std::fs::read_dir(ROOT).unwrap().map(|entry| entry.unwrap().path());
    let mut documents: Vec<PathBuf> = top.filter(|path| is_markdown(path)).collect();
    while let Some(folder) = folders.pop() {
        for path in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            match path.is_dir() {
                true => folders.push(path),
                false if is_markdown(&path) => documents.push(path),
                false => {}
            }
        }
    }
    documents.extend(["fuzz/README.md", "tests/golden/README.md"].map(|path| Path::new(ROOT).join(path)));
    documents
}

fn is_markdown(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "md")
}

/// Targets of `[text](target)` and `![alt](target)`, without anchors; addresses of the web are left
/// out.
fn targets(text: &str) -> impl Iterator<Item = &str> {
    text.split("](").skip(1).filter_map(|rest| {
        let target = rest.split(')').next()?.split('#').next()?;
        (!target.is_empty() && !target.contains("://")).then_some(target)
    })
}

#[test]
fn links_between_documents_lead_to_files() {
    let mut missing = Vec::new();
    let mut followed = 0;
    for document in documents() {
        let text = std::fs::read_to_string(&document).unwrap();
        for target in targets(&text) {
            followed += 1;
            if !document.parent().unwrap().join(target).exists() {
                missing.push(format!("{}: {target}", document.display()));
            }
        }
    }
    assert!(followed > 40, "only {followed} links were found");
    assert!(missing.is_empty(), "{missing:#?}");
}

#[test]
fn result_pages_were_made_in_full_from_a_commit() {
    let folder = Path::new(ROOT).join("docs/results");
    for page in ["play", "reflectors", "rooms", "experiments", "benchmark", "speed"] {
        let text = std::fs::read_to_string(folder.join(format!("{page}.md"))).unwrap();
        let made = text.split("\n\n").nth(1).unwrap_or_default().replace('\n', " ");
        let command = format!("Made by `cargo run --release -p lab -- results {page}` at commit ");
        assert!(made.starts_with(&command) && !made.contains("uncommitted"), "{page}.md: {made}");
    }
}

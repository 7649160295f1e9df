//! The transcripts in `docs/commands.md` against the program.

use std::path::Path;

use crate::common::Folder;

/// Placeholder for any text: within a line for a part of it, alone on a line for any number of
/// lines.
const ANYTHING: char = '…';

/// A command of a `console` block and the expected lines.
struct Transcript {
    command: String,
    lines: Vec<String>,
}

fn transcripts() -> Vec<Transcript> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/commands.md");
    let text = std::fs::read_to_string(path).unwrap();
    let mut found: Vec<Transcript> = Vec::new();
    for block in text.split("```console\n").skip(1) {
        for line in block.split("```").next().unwrap().lines() {
            match line.strip_prefix("$ radar-chaperone ") {
                Some(command) => found.push(Transcript { command: command.into(), lines: Vec::new() }),
                None => found.last_mut().expect("a block begins with a command").lines.push(line.trim_end().into()),
            }
        }
    }
    found
}

/// Whether a line of the document matches a line of the program.
fn is_line(wanted: &str, line: &str) -> bool {
    let mut parts = wanted.split(ANYTHING);
    let Some(mut rest) = parts.next().and_then(|first| line.strip_prefix(first)) else { return false };
    let mut parts = parts.peekable();
    if parts.peek().is_none() {
        return rest.is_empty();
    }
    while let Some(part) = parts.next() {
        if parts.peek().is_none() {
            return rest.ends_with(part);
        }
        let Some(at) = rest.find(part) else { return false };
        rest = &rest[at + part.len()..];
    }
    true
}

/// Whether the lines of the document match those of the program.
fn are_lines(wanted: &[String], lines: &[&str]) -> bool {
    match wanted.split_first() {
        None => lines.is_empty(),
        Some((first, rest)) if first.chars().eq([ANYTHING]) => (0..=lines.len()).any(|n| are_lines(rest, &lines[n..])),
        Some((first, rest)) => {
            lines.split_first().is_some_and(|(line, after)| is_line(first, line) && are_lines(rest, after))
        }
    }
}

#[test]
fn transcripts_are_what_the_program_prints() {
    let folder = Folder::new("transcripts");
    let transcripts = transcripts();
    assert!(transcripts.len() >= 8);
    for Transcript { command, lines } in transcripts {
        let out = folder.run(&command).succeeds().out;
        let printed: Vec<&str> = out.lines().map(str::trim_end).collect();
        assert!(are_lines(&lines, &printed), "docs/commands.md, `{command}`:\n{lines:#?}\nprints:\n{out}");
    }
}

#[test]
fn ellipsis_matches_parts_and_lines() {
    assert!(is_line("a … c", "a b c") && is_line("…", "x") && !is_line("a … c", "a b d") && !is_line("a", "ab"));
    let wanted = ["a", "…", "d"].map(String::from);
    assert!(
        are_lines(&wanted, &["a", "b", "c", "d"])
            && are_lines(&wanted, &["a", "d"])
            && !are_lines(&wanted, &["a", "b"])
    );
}

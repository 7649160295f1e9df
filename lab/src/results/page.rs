//! One page: Markdown and its pictures.

use std::path::Path;
use std::time::Duration;

use anyhow::Result;

use super::Provenance;
use radar_chaperone::report::{Picture, Table, write_atomically};

/// A page of results under construction.
#[derive(Debug, Clone)]
pub struct Page {
    title: String,
    body: String,
    /// File name and PNG bytes.
    pictures: Vec<(String, Vec<u8>)>,
    /// What follows `cargo run --release -p lab --` to make this page.
    pub command: String,
}

impl Page {
    /// An empty page.
    pub fn new(title: &str, command: &str) -> Self {
        Self { title: title.into(), body: String::new(), pictures: Vec::new(), command: command.into() }
    }

    /// Adds a heading of a section.
    pub fn heading(self, heading: &str) -> Self {
        self.text(&format!("## {heading}"))
    }

    /// Adds a paragraph.
    pub fn text(mut self, text: &str) -> Self {
        self.body += "\n";
        self.body += &wrapped(text.trim_end());
        self.body += "\n";
        self
    }

    /// Adds Markdown as it is.
    pub fn markdown(mut self, text: &str) -> Self {
        self.body += text;
        self
    }

    /// Adds a table and its caption.
    pub fn table(mut self, table: &Table) -> Self {
        self.body += "\n";
        self.body += &table.markdown();
        if table.caption.is_empty() { self } else { self.text(&table.caption) }
    }

    /// Adds a picture, written as `name`.png beside the page.
    ///
    /// # Errors
    /// The picture cannot be encoded.
    pub fn picture(mut self, name: &str, alt: &str, picture: &Picture) -> Result<Self> {
        let file = format!("{name}.png");
        let line = format!("![{alt}]({file})");
        self.pictures.push((file, picture.png()?));
        Ok(self.text(&line))
    }

    /// Writes FOLDER/NAME.md and the pictures.
    ///
    /// # Errors
    /// Files that cannot be written.
    pub fn write(&self, folder: &Path, name: &str, provenance: &Provenance, took: Duration) -> Result<()> {
        for (file, bytes) in &self.pictures {
            write_atomically(&folder.join(file), bytes)?;
        }
        let made = wrapped(&format!(
            "Made by `cargo run --release -p lab -- {}` {provenance}, in {:.0} s.",
            self.command,
            took.as_secs_f64()
        ));
        let text = format!("# {}\n\n{made}\n{}", self.title, self.body);
        write_atomically(&folder.join(format!("{name}.md")), text.as_bytes())?;
        Ok(())
    }
}

/// Lines of at most 120 characters; breaks only at spaces outside code.
fn wrapped(text: &str) -> String {
    let (mut lines, mut in_code) = (vec![String::new()], false);
    for word in text.split(' ') {
        let line = lines.last_mut().expect("never empty");
        if line.is_empty() {
            line.push_str(word);
        } else if !in_code && line.chars().count() + 1 + word.chars().count() > 120 {
            lines.push(word.to_owned());
        } else {
            line.push(' ');
            line.push_str(word);
        }
        in_code ^= word.matches('`').count() % 2 == 1;
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_break_at_spaces_but_never_within_code() {
        let long = "word ".repeat(40);
        assert!(wrapped(&long).lines().all(|line| line.len() <= 120));
        assert_eq!(wrapped(&long).replace('\n', " "), long);
        let code = format!("{} `a b c d e f g` end", "x".repeat(110));
        assert!(wrapped(&code).contains("`a b c d e f g`"));
    }
}

//! report.html: one self-contained file. No scripts and no external resources; all text is escaped;
//! light or dark according to the reader's system.

use std::fmt::Write as _;
use std::path::Path;

use super::base64::base64;
use super::{Picture, ReportError, write_atomically};

const STYLE: &str = include_str!("report.css");

/// An image with a caption.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Bytes of a PNG file, from [`Picture::png`].
    pub png: Vec<u8>,
    /// Alternative text.
    pub alt: String,
    /// Caption below the image.
    pub caption: String,
}

impl Figure {
    /// A figure from an image. The caption is also the alternative text.
    ///
    /// # Errors
    /// As [`Picture::png`].
    pub fn new(picture: &Picture, caption: impl Into<String>) -> Result<Self, ReportError> {
        let caption = caption.into();
        Ok(Self { png: picture.png()?, alt: caption.clone(), caption })
    }
}

/// A table of text. Numeric cells are right-aligned.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Table {
    /// Column heads; empty for none.
    pub head: Vec<String>,
    /// The rows, each as long as the head.
    pub rows: Vec<Vec<String>>,
    /// Caption above the table; empty for none.
    pub caption: String,
}

#[derive(Debug, Clone)]
enum Block {
    Text(String),
    Preformatted(String),
    Table(Table),
    Figure(Figure),
}

/// A section of a report: a heading, and its blocks in the order of addition.
#[derive(Debug, Clone)]
pub struct Section {
    heading: String,
    blocks: Vec<Block>,
}

impl Section {
    /// An empty section with a heading.
    pub fn new(heading: impl Into<String>) -> Self {
        Self { heading: heading.into(), blocks: Vec::new() }
    }

    /// Adds a paragraph.
    pub fn text(self, text: impl Into<String>) -> Self {
        self.with(Block::Text(text.into()))
    }

    /// Adds monospaced lines, for example the table of a score.
    pub fn preformatted(self, text: impl Into<String>) -> Self {
        self.with(Block::Preformatted(text.into()))
    }

    /// Adds a table.
    pub fn table(self, table: Table) -> Self {
        self.with(Block::Table(table))
    }

    /// Adds a figure.
    pub fn figure(self, figure: Figure) -> Self {
        self.with(Block::Figure(figure))
    }

    fn with(mut self, block: Block) -> Self {
        self.blocks.push(block);
        self
    }
}

/// A report page under construction.
#[derive(Debug, Clone)]
pub struct Report {
    title: String,
    intro: Vec<String>,
    sections: Vec<Section>,
}

impl Report {
    /// An empty report with a title.
    pub fn new(title: impl Into<String>) -> Self {
        Self { title: title.into(), intro: Vec::new(), sections: Vec::new() }
    }

    /// Adds a paragraph before the first section.
    pub fn intro(mut self, text: impl Into<String>) -> Self {
        self.intro.push(text.into());
        self
    }

    /// Adds a section.
    pub fn section(mut self, section: Section) -> Self {
        self.sections.push(section);
        self
    }

    /// The HTML page.
    pub fn html(&self) -> String {
        let title = escaped(&self.title);
        let mut page = format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title}</title>\n\
             <style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n<header>\n<h1>{title}</h1>\n"
        );
        for text in &self.intro {
            push(&mut page, format_args!("<p class=\"intro\">{}</p>\n", escaped(text)));
        }
        page.push_str("</header>\n");
        if self.sections.len() > 2 {
            contents(&mut page, &self.sections);
        }
        for (n, section) in self.sections.iter().enumerate() {
            push(&mut page, format_args!("<section id=\"s{}\">\n<h2>{}</h2>\n", n + 1, escaped(&section.heading)));
            for block in &section.blocks {
                push_block(&mut page, block);
            }
            page.push_str("</section>\n");
        }
        page.push_str("</main>\n</body>\n</html>\n");
        page
    }

    /// Writes the page atomically.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), ReportError> {
        write_atomically(path, self.html().as_bytes())
    }
}

fn contents(page: &mut String, sections: &[Section]) {
    page.push_str("<nav>\n<ol>\n");
    for (n, section) in sections.iter().enumerate() {
        push(page, format_args!("<li><a href=\"#s{}\">{}</a></li>\n", n + 1, escaped(&section.heading)));
    }
    page.push_str("</ol>\n</nav>\n");
}

fn push_block(page: &mut String, block: &Block) {
    match block {
        Block::Text(text) => push(page, format_args!("<p>{}</p>\n", escaped(text))),
        Block::Preformatted(text) => push(page, format_args!("<pre>{}</pre>\n", escaped(text))),
        Block::Table(table) => push_table(page, table),
        Block::Figure(figure) => push(
            page,
            format_args!(
                "<figure>\n<img alt=\"{}\" src=\"data:image/png;base64,{}\">\n<figcaption>{}</figcaption>\n</figure>\n",
                escaped(&figure.alt),
                base64(&figure.png),
                escaped(&figure.caption)
            ),
        ),
    }
}

fn push_table(page: &mut String, table: &Table) {
    page.push_str("<div class=\"scroll\">\n<table>\n");
    if !table.caption.is_empty() {
        push(page, format_args!("<caption>{}</caption>\n", escaped(&table.caption)));
    }
    let numeric = |column: usize| {
        let mut cells = table.rows.iter().filter_map(|row| row.get(column)).filter(|cell| !cell.is_empty()).peekable();
        cells.peek().is_some() && cells.all(|cell| is_number(cell))
    };
    let columns = table.rows.iter().map(Vec::len).chain([table.head.len()]).max().unwrap_or(0);
    let classes: Vec<&str> = (0..columns).map(|n| if numeric(n) { " class=\"number\"" } else { "" }).collect();
    if !table.head.is_empty() {
        push_row(page, "th", &table.head, &classes);
    }
    for row in &table.rows {
        push_row(page, "td", row, &classes);
    }
    page.push_str("</table>\n</div>\n");
}

fn push_row(page: &mut String, element: &str, cells: &[String], classes: &[&str]) {
    page.push_str("<tr>");
    for (cell, class) in cells.iter().zip(classes) {
        push(page, format_args!("<{element}{class}>{}</{element}>", escaped(cell)));
    }
    page.push_str("</tr>\n");
}

/// A number, possibly with a unit, or a dash for a missing value.
fn is_number(cell: &str) -> bool {
    let first = cell.split_whitespace().next().unwrap_or_default().trim_end_matches(['%', '×']);
    matches!(first, "–" | "-") || first.replace('−', "-").parse::<f64>().is_ok()
}

fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            // HTML cannot represent these.
            c if c.is_control() && !matches!(c, '\n' | '\t') => safe.push('\u{fffd}'),
            c => safe.push(c),
        }
    }
    safe
}

fn push(page: &mut String, text: std::fmt::Arguments) {
    // Writing to a String cannot fail.
    let _ = page.write_fmt(text);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn strings(cells: &[&str]) -> Vec<String> {
        cells.iter().map(|cell| cell.to_string()).collect()
    }

    #[test]
    fn page_is_complete_and_self_contained() {
        let table = Table {
            head: strings(&["name", "error"]),
            rows: vec![strings(&["<chair>", "1.2 cm"]), strings(&["lamp", "–"])],
            caption: "A & B".into(),
        };
        let figure = Figure { png: b"foo".to_vec(), alt: "a \"quoted\" alt".into(), caption: "It's a caption".into() };
        let section = Section::new("One").text("1 < 2").preformatted("a  b").table(table).figure(figure);
        let page = Report::new("T & C").intro("Hello").section(section).html();
        for part in [
            "<title>T &amp; C</title>",
            "<h1>T &amp; C</h1>",
            "<p class=\"intro\">Hello</p>",
            "<h2>One</h2>",
            "<p>1 &lt; 2</p>",
            "<pre>a  b</pre>",
            "<caption>A &amp; B</caption>",
            "<th>name</th><th class=\"number\">error</th>",
            "<td>&lt;chair&gt;</td><td class=\"number\">1.2 cm</td>",
            "<td class=\"number\">–</td>",
            "alt=\"a &quot;quoted&quot; alt\" src=\"data:image/png;base64,Zm9v\"",
            "<figcaption>It&#39;s a caption</figcaption>",
        ] {
            assert!(page.contains(part), "{part} in {page}");
        }
        for foreign in ["<script", "http:", "https:", "url(", "@import"] {
            assert!(!page.contains(foreign), "{foreign}");
        }
    }

    proptest! {
        #[test]
        fn text_is_escaped(text in ".*") {
            let safe = escaped(&text);
            prop_assert!(!safe.contains(['<', '>', '"', '\'']));
            prop_assert!(safe.split('&').skip(1).all(|rest| rest.contains(';')));
        }

        #[test]
        fn ragged_tables_do_not_panic(rows in prop::collection::vec(prop::collection::vec("[a-z0-9 ]{0,3}", 0..4), 0..4)) {
            let page = Report::new("").section(Section::new("").table(Table { rows, ..Table::default() })).html();
            prop_assert!(page.ends_with("</html>\n"));
        }
    }
}

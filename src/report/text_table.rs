//! Tables as text: aligned for a terminal, as Markdown, or as CSV.

use super::Table;

impl Table {
    /// Columns side by side, numbers right-aligned, one row per line.
    pub fn aligned(&self) -> String {
        let widths = self.widths();
        let line = |row: &Vec<String>| {
            let cells = row.iter().enumerate().map(|(n, cell)| {
                let width = widths.get(n).copied().unwrap_or(0);
                if self.is_numeric(n) { format!("{cell:>width$}") } else { format!("{cell:<width$}") }
            });
            cells.collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
        };
        std::iter::once(&self.head).chain(&self.rows).map(line).collect()
    }

    /// As Markdown, with aligned source text.
    pub fn markdown(&self) -> String {
        let widths = self.widths();
        let line = |row: &Vec<String>| {
            let cells = row.iter().enumerate().map(|(n, cell)| {
                let (cell, width) = (cell.replace('|', "\\|"), widths.get(n).copied().unwrap_or(0));
                if self.is_numeric(n) { format!("{cell:>width$}") } else { format!("{cell:<width$}") }
            });
            format!("| {} |\n", cells.collect::<Vec<_>>().join(" | "))
        };
        let rule = widths
            .iter()
            .enumerate()
            .map(|(n, width)| if self.is_numeric(n) { "-".repeat(width + 1) + ":" } else { "-".repeat(width + 2) });
        let rule = format!("|{}|\n", rule.collect::<Vec<_>>().join("|"));
        line(&self.head) + &rule + &self.rows.iter().map(line).collect::<String>()
    }

    /// As comma-separated values (RFC 4180), the head first.
    pub fn csv(&self) -> String {
        let cell = |cell: &String| match cell.contains([',', '"', '\n', '\r']) {
            true => format!("\"{}\"", cell.replace('"', "\"\"")),
            false => cell.clone(),
        };
        let line = |row: &Vec<String>| row.iter().map(cell).collect::<Vec<_>>().join(",") + "\r\n";
        std::iter::once(&self.head).chain(&self.rows).map(line).collect()
    }

    fn widths(&self) -> Vec<usize> {
        let width = |n: usize| {
            let cells = std::iter::once(&self.head).chain(&self.rows).filter_map(|row| row.get(n));
            cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
        };
        (0..self.head.len()).map(width).collect()
    }

    /// Whether all cells of a column are numbers, dashes or empty, with at least one number.
    fn is_numeric(&self, column: usize) -> bool {
        let cells = || self.rows.iter().filter_map(|row| row.get(column));
        let number = |cell: &&String| cell.parse::<f64>().is_ok();
        cells().any(|cell| number(&cell))
            && cells().all(|cell| number(&cell) || matches!(cell.as_str(), "" | "–" | "all"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_align_and_numbers_are_right_aligned() {
        let row = |cells: [&str; 2]| cells.map(str::to_owned).to_vec();
        let rows = vec![row(["a", "1.0"]), row(["long", "10.0"]), row(["–", "all"])];
        let table = Table { head: row(["name", "n"]), rows, caption: String::new() };
        assert_eq!(table.aligned(), "name     n\na      1.0\nlong  10.0\n–      all\n");
        assert_eq!(table.markdown().lines().nth(1), Some("|------|-----:|"));
        assert!(table.markdown().lines().all(|line| line.chars().count() == 15), "{}", table.markdown());
        assert_eq!(Table::default().aligned(), "\n");
    }

    /// Parses comma-separated values (RFC 4180).
    fn read_csv(text: &str) -> Vec<Vec<String>> {
        let (mut rows, mut row, mut cell) = (Vec::new(), Vec::new(), String::new());
        let (mut is_quoted, mut letters) = (false, text.chars().peekable());
        while let Some(letter) = letters.next() {
            match letter {
                '"' if is_quoted && letters.next_if_eq(&'"').is_some() => cell.push('"'),
                '"' => is_quoted = !is_quoted,
                ',' if !is_quoted => row.push(std::mem::take(&mut cell)),
                '\r' if !is_quoted => {
                    assert_eq!(letters.next(), Some('\n'), "a line ends with both");
                    row.push(std::mem::take(&mut cell));
                    rows.push(std::mem::take(&mut row));
                }
                other => cell.push(other),
            }
        }
        assert!(!is_quoted && cell.is_empty() && row.is_empty());
        rows
    }

    #[test]
    fn csv_quotes_separators_and_roundtrips() {
        let row = |cells: [&str; 3]| cells.map(str::to_owned).to_vec();
        let rows = vec![
            row(["plain", "", "–"]),
            row(["1,5", "said \"so\"", "\""]),
            row(["two\nlines", "a return\ralone", ",\"\r\n\","]),
        ];
        let table = Table { head: row(["a", "b, c", "d"]), rows, caption: "left out".into() };
        let text = table.csv();
        assert!(text.starts_with("a,\"b, c\",d\r\nplain,,–\r\n\"1,5\",\"said \"\"so\"\"\",\"\"\"\"\r\n"), "{text}");
        assert_eq!(read_csv(&text), [vec![table.head], table.rows].concat());
    }
}

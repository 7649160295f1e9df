//! Texts of others on the terminal.

/// A text without characters that a terminal obeys: texts of recordings and boards are printed. Lines and tabs remain.
pub fn printable(text: &str) -> String {
    text.chars()
        .map(|c| if c.is_control() && c != '\n' && c != '\t' { char::REPLACEMENT_CHARACTER } else { c })
        .collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn texts_cannot_command_a_terminal() {
        assert_eq!(super::printable("a\u{1b}[2J\u{9b}b\n\tc°\r"), "a\u{fffd}[2J\u{fffd}b\n\tc°\u{fffd}");
    }
}

//! Texts of others on the terminal.

/// A text without characters that a terminal obeys, or that reverse what follows: texts of recordings and boards are printed.
/// Lines and tabs remain.
pub fn printable(text: &str) -> String {
    let is_command = |c: char| c.is_control() && c != '\n' && c != '\t';
    let is_direction = |c: char| matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    text.chars().map(|c| if is_command(c) || is_direction(c) { char::REPLACEMENT_CHARACTER } else { c }).collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn texts_cannot_command_a_terminal() {
        assert_eq!(
            super::printable("a\u{1b}[2J\u{9b}b\n\tc°\r\u{202e}"),
            "a\u{fffd}[2J\u{fffd}b\n\tc°\u{fffd}\u{fffd}"
        );
    }
}

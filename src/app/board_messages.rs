//! Messages of a board in the log: short, and not more than a person reads, however many it sends.

use std::time::{Duration, Instant};

use a121::LogLine;

/// Errors and warnings that are shown within a span. Choice: what one reads; a board in trouble sends thousands a second.
const SHOWN: u32 = 10;
const SPAN: Duration = Duration::from_secs(10);
/// Longest part of a message that is shown, characters. Choice: two lines of a terminal.
const MAX_CHARACTERS: usize = 160;

/// Counts a board's errors and warnings.
#[derive(Debug, Default)]
pub(super) struct BoardMessages {
    since: Option<Instant>,
    shown: u32,
    left_out: u64,
}

impl BoardMessages {
    /// What to show for a message, with its level: nothing when there were too many; how many were left out once they may be
    /// shown again.
    pub fn take(&mut self, line: &LogLine, now: Instant) -> Vec<(log::Level, String)> {
        let short = |text: &str| -> String {
            text.chars().take(MAX_CHARACTERS).map(|c| if c == '\n' { ' ' } else { c }).collect()
        };
        let shown = format!("message of the board ({}): {}", short(&line.module), short(&line.text));
        if !["error", "warning", "ERROR", "WARNING"].contains(&line.level.as_str()) {
            return vec![(log::Level::Debug, shown)];
        }
        let mut lines = Vec::new();
        if self.since.is_none_or(|since| now.duration_since(since) >= SPAN) {
            if self.left_out > 0 {
                lines.push((log::Level::Warn, format!("{} more messages of the board were left out", self.left_out)));
            }
            *self = Self { since: Some(now), ..Self::default() };
        }
        if self.shown == SHOWN {
            self.left_out += 1;
            return lines;
        }
        self.shown += 1;
        lines.push((log::Level::Warn, shown));
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_is_counted_and_long_messages_are_cut() {
        let line = LogLine { level: "error".into(), module: "m".into(), text: "x".repeat(100_000) };
        let (mut messages, start) = (BoardMessages::default(), Instant::now());
        let shown: Vec<_> = (0..1000).flat_map(|_| messages.take(&line, start)).collect();
        assert_eq!(shown.len(), SHOWN as usize);
        assert!(shown.iter().all(|(level, text)| *level == log::Level::Warn && text.len() < 200));
        let harmless = LogLine { level: "info".into(), ..line.clone() };
        assert_eq!(messages.take(&harmless, start)[0].0, log::Level::Debug);
        let later = messages.take(&line, start + SPAN);
        assert_eq!(later.len(), 2);
        assert!(later[0].1.starts_with("990 more messages"), "{later:?}");
    }
}

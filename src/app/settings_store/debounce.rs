//! Debounces a settings file that other programs write.
//!
//! Editors overwrite a file, rename one over it, or empty it first, and a file may be read half
//! written. So a text is accepted once it has been stable for a moment and is valid. An invalid or
//! missing file is rejected once that has lasted for longer. Each state is reported once.

/// A text that has been stable for this time is complete, nanoseconds. Choice: two short polls; an
/// editor that writes in pieces continues within milliseconds.
const STABLE_NS: i64 = 150_000_000;
/// An invalid file is reported after this time, nanoseconds. Choice: an editor may be saving it.
const REPORT_AFTER_NS: i64 = 1_000_000_000;

/// State of the file as read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum FileState {
    /// No file.
    Absent,
    /// Unreadable, with the reason.
    Unreadable(String),
    /// Its text.
    Text(String),
}

/// Result of an observation.
#[derive(Debug, PartialEq)]
pub(super) enum Outcome<T> {
    /// Nothing to do.
    Unchanged,
    /// A new text and the value that its check returned; in use from now on.
    Accepted(String, T),
    /// Rejected, with the reason for the user.
    Rejected(String),
}

/// Debounces one file.
#[derive(Debug)]
pub(super) struct FileDebouncer {
    /// The last state that was accepted or rejected.
    settled: FileState,
    /// A newer state, and since when it has been seen.
    coming: Option<(FileState, i64)>,
}

impl FileDebouncer {
    /// Starts with the first state, whose text is in use.
    pub fn new(first: FileState) -> Self {
        Self { settled: first, coming: None }
    }

    /// Whether a newer state waits to be accepted or rejected.
    pub fn is_waiting(&self) -> bool {
        self.coming.is_some()
    }

    /// This program has written the text itself.
    pub fn set_written(&mut self, text: &str) {
        self.settled = FileState::Text(text.to_owned());
        self.coming = None;
    }

    /// Takes the file's current state. `check` validates a text.
    pub fn observe<T>(
        &mut self,
        now_ns: i64,
        seen: FileState,
        check: impl FnOnce(&str) -> Result<T, String>,
    ) -> Outcome<T> {
        if seen == self.settled {
            self.coming = None;
            return Outcome::Unchanged;
        }
        let since_ns = match &self.coming {
            Some((coming, since_ns)) if *coming == seen => *since_ns,
            _ => {
                self.coming = Some((seen, now_ns));
                return Outcome::Unchanged;
            }
        };
        let age_ns = now_ns.saturating_sub(since_ns);
        let wrong = match &seen {
            FileState::Text(text) if text.trim().is_empty() => "it is empty".to_owned(),
            FileState::Text(_) if age_ns < STABLE_NS => return Outcome::Unchanged,
            FileState::Text(text) => match check(text) {
                Ok(checked) => {
                    let text = text.clone();
                    self.settle(seen);
                    return Outcome::Accepted(text, checked);
                }
                Err(why) => why,
            },
            FileState::Absent => "it was removed".to_owned(),
            FileState::Unreadable(why) => why.clone(),
        };
        if age_ns < REPORT_AFTER_NS {
            return Outcome::Unchanged;
        }
        self.settle(seen);
        Outcome::Rejected(wrong)
    }

    fn settle(&mut self, seen: FileState) {
        (self.settled, self.coming) = (seen, None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    fn text(text: &str) -> FileState {
        FileState::Text(text.to_owned())
    }

    /// Accepts a number.
    fn check(text: &str) -> Result<i32, String> {
        text.trim().parse().map_err(|_| format!("{text} is no number"))
    }

    /// Observes every 100 ms for a while; the results and their observation numbers.
    fn observe_for(
        debouncer: &mut FileDebouncer,
        from_ms: i64,
        times: i64,
        seen: &FileState,
    ) -> Vec<(i64, Outcome<i32>)> {
        let outcomes = (0..times).map(|n| (n, debouncer.observe((from_ms + 100 * n) * MS, seen.clone(), check)));
        outcomes.filter(|(_, outcome)| *outcome != Outcome::Unchanged).collect()
    }

    #[test]
    fn text_is_accepted_once_stable() {
        let mut debouncer = FileDebouncer::new(text("1"));
        assert!(observe_for(&mut debouncer, 0, 5, &text("1")).is_empty());
        assert!(observe_for(&mut debouncer, 500, 1, &text("2")).is_empty(), "half written");
        assert_eq!(observe_for(&mut debouncer, 600, 20, &text("22")), [(2, Outcome::Accepted("22".into(), 22))]);
    }

    #[test]
    fn editor_save_sequences_are_not_reported() {
        let mut debouncer = FileDebouncer::new(text("1"));
        assert!(observe_for(&mut debouncer, 0, 3, &text("")).is_empty());
        assert!(observe_for(&mut debouncer, 300, 3, &FileState::Absent).is_empty());
        assert!(observe_for(&mut debouncer, 600, 2, &text("1")).is_empty(), "it is as it was");
        assert!(!debouncer.is_waiting());
    }

    #[test]
    fn faults_are_reported_once_until_they_change() {
        let mut debouncer = FileDebouncer::new(text("1"));
        for (n, seen) in
            [text("x"), text(""), FileState::Absent, FileState::Unreadable("no".into())].into_iter().enumerate()
        {
            let outcomes = observe_for(&mut debouncer, 10_000 * n as i64, 50, &seen);
            assert!(matches!(outcomes[..], [(10, Outcome::Rejected(_))]), "{seen:?}: {outcomes:?}");
        }
        assert_eq!(observe_for(&mut debouncer, 90_000, 9, &text("1")), [(2, Outcome::Accepted("1".into(), 1))]);
    }

    #[test]
    fn own_writes_are_unchanged() {
        let mut debouncer = FileDebouncer::new(FileState::Absent);
        debouncer.set_written("7");
        assert!(observe_for(&mut debouncer, 0, 20, &text("7")).is_empty());
    }
}

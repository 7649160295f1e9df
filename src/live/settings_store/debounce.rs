//! What a settings file that others write means: when what is seen of it counts.
//!
//! Editors save by writing over, by renaming, or through an empty file, and files are seen half written. So text counts once it
//! has stayed the same for a moment and can be used; that it cannot, or that there is none, counts when it has stayed so for longer.
//! Each state counts once: a wrong file is told of once, until it is another.

/// Text that has stayed the same for so long is whole, nanoseconds.
const STABLE_NS: i64 = 150_000_000;
/// What cannot be used is told of after so long, nanoseconds: an editor may be at work.
const REPORT_AFTER_NS: i64 = 1_000_000_000;

/// What is seen of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum FileState {
    /// No file.
    Absent,
    /// It cannot be read: why.
    Unreadable(String),
    /// Its text.
    Text(String),
}

/// What is to be done.
#[derive(Debug, PartialEq)]
pub(super) enum Outcome<T> {
    /// Nothing.
    Unchanged,
    /// The text, and what its check made of it, is in force from now on.
    Accepted(String, T),
    /// It stays as it was; why, for people.
    Rejected(String),
}

/// Follows one file.
#[derive(Debug)]
pub(super) struct FileDebouncer {
    /// What counted last.
    settled: FileState,
    /// What was seen since, and since when.
    coming: Option<(FileState, i64)>,
}

impl FileDebouncer {
    /// After a first look, whose text is in force.
    pub fn new(first: FileState) -> Self {
        Self { settled: first, coming: None }
    }

    /// Whether something was seen that does not count yet.
    pub fn is_waiting(&self) -> bool {
        self.coming.is_some()
    }

    /// We have written it ourselves.
    pub fn set_written(&mut self, text: &str) {
        self.settled = FileState::Text(text.to_owned());
        self.coming = None;
    }

    /// Takes in a look at the file. `check` says what a text means, or what is wrong with it.
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
            FileState::Absent => "it is not there any more".to_owned(),
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

    /// A number is good.
    fn check(text: &str) -> Result<i32, String> {
        text.trim().parse().map_err(|_| format!("{text} is no number"))
    }

    /// Looks every 100 ms for a while; what came of it, and after how many looks.
    fn look_for(debouncer: &mut FileDebouncer, from_ms: i64, looks: i64, seen: &FileState) -> Vec<(i64, Outcome<i32>)> {
        let outcomes = (0..looks).map(|n| (n, debouncer.observe((from_ms + 100 * n) * MS, seen.clone(), check)));
        outcomes.filter(|(_, outcome)| *outcome != Outcome::Unchanged).collect()
    }

    #[test]
    fn text_is_accepted_once_stable() {
        let mut debouncer = FileDebouncer::new(text("1"));
        assert!(look_for(&mut debouncer, 0, 5, &text("1")).is_empty());
        assert!(look_for(&mut debouncer, 500, 1, &text("2")).is_empty(), "half written");
        assert_eq!(look_for(&mut debouncer, 600, 20, &text("22")), [(2, Outcome::Accepted("22".into(), 22))]);
    }

    #[test]
    fn editor_save_sequences_are_not_reported() {
        let mut debouncer = FileDebouncer::new(text("1"));
        assert!(look_for(&mut debouncer, 0, 3, &text("")).is_empty());
        assert!(look_for(&mut debouncer, 300, 3, &FileState::Absent).is_empty());
        assert!(look_for(&mut debouncer, 600, 2, &text("1")).is_empty(), "it is as it was");
        assert!(!debouncer.is_waiting());
    }

    #[test]
    fn faults_are_reported_once_until_they_change() {
        let mut debouncer = FileDebouncer::new(text("1"));
        for (n, seen) in
            [text("x"), text(""), FileState::Absent, FileState::Unreadable("no".into())].into_iter().enumerate()
        {
            let told = look_for(&mut debouncer, 10_000 * n as i64, 50, &seen);
            assert!(matches!(told[..], [(10, Outcome::Rejected(_))]), "{seen:?}: {told:?}");
        }
        assert_eq!(look_for(&mut debouncer, 90_000, 9, &text("1")), [(2, Outcome::Accepted("1".into(), 1))]);
    }

    #[test]
    fn own_writes_are_unchanged() {
        let mut debouncer = FileDebouncer::new(FileState::Absent);
        debouncer.set_written("7");
        assert!(look_for(&mut debouncer, 0, 20, &text("7")).is_empty());
    }
}

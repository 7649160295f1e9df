//! What a settings file that others write means: when what is seen of it counts.
//!
//! Editors save by writing over, by renaming, or through an empty file, and files are seen half written. So text counts once it
//! has stayed the same for a moment and can be used; that it cannot, or that there is none, counts when it has stayed so for longer.
//! Each state counts once: a wrong file is told of once, until it is another.

/// Text that has stayed the same for so long is whole, nanoseconds.
const WHOLE_NS: i64 = 150_000_000;
/// What cannot be used is told of after so long, nanoseconds: an editor may be at work.
const PATIENCE_NS: i64 = 1_000_000_000;

/// What is seen of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Seen {
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
    Nothing,
    /// The text, and what its check made of it, is in force from now on.
    New(String, T),
    /// It stays as it was; why, for people.
    Kept(String),
}

/// Follows one file.
#[derive(Debug)]
pub(super) struct Follower {
    /// What counted last.
    settled: Seen,
    /// What was seen since, and since when.
    coming: Option<(Seen, i64)>,
}

impl Follower {
    /// After a first look, whose text is in force.
    pub fn new(first: Seen) -> Self {
        Self { settled: first, coming: None }
    }

    /// Whether something was seen that does not count yet.
    pub fn is_waiting(&self) -> bool {
        self.coming.is_some()
    }

    /// We have written it ourselves.
    pub fn wrote(&mut self, text: &str) {
        self.settled = Seen::Text(text.to_owned());
        self.coming = None;
    }

    /// Takes in a look at the file. `check` says what a text means, or what is wrong with it.
    pub fn look<T>(&mut self, now_ns: i64, seen: Seen, check: impl FnOnce(&str) -> Result<T, String>) -> Outcome<T> {
        if seen == self.settled {
            self.coming = None;
            return Outcome::Nothing;
        }
        let since_ns = match &self.coming {
            Some((coming, since_ns)) if *coming == seen => *since_ns,
            _ => {
                self.coming = Some((seen, now_ns));
                return Outcome::Nothing;
            }
        };
        let age_ns = now_ns.saturating_sub(since_ns);
        let wrong = match &seen {
            Seen::Text(text) if text.trim().is_empty() => "it is empty".to_owned(),
            Seen::Text(_) if age_ns < WHOLE_NS => return Outcome::Nothing,
            Seen::Text(text) => match check(text) {
                Ok(checked) => {
                    let text = text.clone();
                    self.settle(seen);
                    return Outcome::New(text, checked);
                }
                Err(why) => why,
            },
            Seen::Absent => "it is not there any more".to_owned(),
            Seen::Unreadable(why) => why.clone(),
        };
        if age_ns < PATIENCE_NS {
            return Outcome::Nothing;
        }
        self.settle(seen);
        Outcome::Kept(wrong)
    }

    fn settle(&mut self, seen: Seen) {
        (self.settled, self.coming) = (seen, None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    fn text(text: &str) -> Seen {
        Seen::Text(text.to_owned())
    }

    /// A number is good.
    fn check(text: &str) -> Result<i32, String> {
        text.trim().parse().map_err(|_| format!("{text} is no number"))
    }

    /// Looks every 100 ms for a while; what came of it, and after how many looks.
    fn look_for(follower: &mut Follower, from_ms: i64, looks: i64, seen: &Seen) -> Vec<(i64, Outcome<i32>)> {
        let outcomes = (0..looks).map(|n| (n, follower.look((from_ms + 100 * n) * MS, seen.clone(), check)));
        outcomes.filter(|(_, outcome)| *outcome != Outcome::Nothing).collect()
    }

    #[test]
    fn text_counts_once_it_is_whole() {
        let mut follower = Follower::new(text("1"));
        assert!(look_for(&mut follower, 0, 5, &text("1")).is_empty());
        assert!(look_for(&mut follower, 500, 1, &text("2")).is_empty(), "half written");
        assert_eq!(look_for(&mut follower, 600, 20, &text("22")), [(2, Outcome::New("22".into(), 22))]);
    }

    #[test]
    fn an_editor_that_empties_or_renames_first_is_not_told_of() {
        let mut follower = Follower::new(text("1"));
        assert!(look_for(&mut follower, 0, 3, &text("")).is_empty());
        assert!(look_for(&mut follower, 300, 3, &Seen::Absent).is_empty());
        assert!(look_for(&mut follower, 600, 2, &text("1")).is_empty(), "it is as it was");
        assert!(!follower.is_waiting());
    }

    #[test]
    fn what_is_wrong_is_told_once_until_it_is_another() {
        let mut follower = Follower::new(text("1"));
        for (n, seen) in [text("x"), text(""), Seen::Absent, Seen::Unreadable("no".into())].into_iter().enumerate() {
            let told = look_for(&mut follower, 10_000 * n as i64, 50, &seen);
            assert!(matches!(told[..], [(10, Outcome::Kept(_))]), "{seen:?}: {told:?}");
        }
        assert_eq!(look_for(&mut follower, 90_000, 9, &text("1")), [(2, Outcome::New("1".into(), 1))]);
    }

    #[test]
    fn what_was_written_here_is_no_news() {
        let mut follower = Follower::new(Seen::Absent);
        follower.wrote("7");
        assert!(look_for(&mut follower, 0, 20, &text("7")).is_empty());
    }
}

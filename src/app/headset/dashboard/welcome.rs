//! The notice of the first session: what the program does and where its switches are.

use crate::panel::Notice;

/// How long it is shown, nanoseconds. Choice: time to notice it and read three sentences.
const WELCOME_NS: i64 = 15_000_000_000;

/// Shows the notice once, as soon as the radar measures.
#[derive(Debug, Default)]
pub(super) struct Welcome {
    is_due: bool,
    since_ns: Option<i64>,
}

impl Welcome {
    /// `is_due`: this user has not seen it yet.
    pub fn new(is_due: bool) -> Self {
        Self { is_due, since_ns: None }
    }

    /// Whether it has been shown to its end.
    pub fn is_done(&self) -> bool {
        !self.is_due
    }

    /// The notice, while it is shown. `may_show`: the radar measures and nothing else is said.
    pub fn update(&mut self, now_ns: i64, may_show: bool) -> Option<Notice> {
        if !self.is_due || !(may_show || self.since_ns.is_some()) {
            return None;
        }
        let since_ns = *self.since_ns.get_or_insert(now_ns);
        self.is_due = now_ns.saturating_sub(since_ns) < WELCOME_NS;
        (self.is_due && may_show).then_some(Notice::Welcome)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_shown_once_and_gives_way_to_faults() {
        const S: i64 = 1_000_000_000;
        let mut welcome = Welcome::new(true);
        assert_eq!(welcome.update(0, false), None, "the radar does not measure yet");
        assert_eq!(welcome.update(5 * S, true), Some(Notice::Welcome));
        assert_eq!(welcome.update(6 * S, false), None, "a fault is said");
        assert_eq!(welcome.update(19 * S, true), Some(Notice::Welcome));
        assert!(!welcome.is_done());
        assert_eq!(welcome.update(20 * S, true), None);
        assert!(welcome.is_done() && welcome.update(99 * S, true).is_none());
        assert_eq!(Welcome::new(false).update(0, true), None);
    }
}

//! Which time stamps of a stream to believe: one that leaps far ahead counts only when the next one goes on from there.
//!
//! Streams must rise in time, so a single wrong stamp far in the future would shut out everything after it. A leap therefore
//! waits for its witness: the sample itself is given up, and nothing else. The first stamp of all has nothing to be held
//! against; when the next two go on from each other far before it, the first was the wrong one and is taken back.

/// Stamps farther ahead than this leap, nanoseconds: longer than a stream pauses without a reason, and short enough for a
/// smaller error to pass by itself.
const MAX_STEP_NS: i64 = 1_000_000_000;
/// Streams slower than that are known by two equal steps, up to this one, nanoseconds.
const SLOWEST_STEP_NS: i64 = 10_000_000_000;

/// What to do with a sample, by its time stamp.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TimestampVerdict {
    /// It goes on from the one before.
    Next,
    /// It goes on from another far before the first one, which was wrong: begin anew with this one.
    Restart,
    /// Not later than the one before: not used.
    NotRising,
    /// Far ahead, with nothing to confirm it: not used.
    Jump,
}

/// Judges the stamps of one stream.
#[derive(Debug, Clone, Copy)]
pub(super) struct TimestampFilter {
    last_ns: Option<i64>,
    /// One far away that waits for its witness.
    pending_ns: Option<i64>,
    /// Another stamp has gone on from the last one, or it from another.
    is_confirmed: bool,
    /// Widest step that is no leap.
    max_step_ns: i64,
}

impl Default for TimestampFilter {
    fn default() -> Self {
        Self { last_ns: None, pending_ns: None, is_confirmed: false, max_step_ns: MAX_STEP_NS }
    }
}

impl TimestampFilter {
    /// Judges the next stamp.
    pub fn classify(&mut self, time_ns: i64) -> TimestampVerdict {
        let Some(last_ns) = self.last_ns else {
            self.last_ns = Some(time_ns);
            return TimestampVerdict::Next;
        };
        if time_ns > last_ns && time_ns.saturating_sub(last_ns) <= self.max_step_ns {
            self.accept(time_ns);
            return TimestampVerdict::Next;
        }
        if let Some(pending_ns) = self.pending_ns.filter(|&pending_ns| time_ns > pending_ns) {
            let (step_ns, leap_ns) = (time_ns.saturating_sub(pending_ns), pending_ns.saturating_sub(last_ns));
            if step_ns <= self.max_step_ns.max(leap_ns.min(SLOWEST_STEP_NS)) {
                self.accept(time_ns);
                // A slow stream: its steps are no leaps.
                self.max_step_ns = self.max_step_ns.max(step_ns.saturating_mul(2)).min(2 * SLOWEST_STEP_NS);
                return if pending_ns > last_ns { TimestampVerdict::Next } else { TimestampVerdict::Restart };
            }
        }
        if time_ns > last_ns {
            self.pending_ns = Some(time_ns);
            return TimestampVerdict::Jump;
        }
        if !self.is_confirmed && last_ns.saturating_sub(time_ns) > self.max_step_ns {
            self.pending_ns = Some(time_ns);
        }
        TimestampVerdict::NotRising
    }

    fn accept(&mut self, time_ns: i64) {
        (self.last_ns, self.pending_ns, self.is_confirmed) = (Some(time_ns), None, true);
    }
}

#[cfg(test)]
mod tests {
    use super::TimestampVerdict::{Jump, Next, NotRising, Restart};
    use super::*;

    fn classified(times_ms: &[i64]) -> Vec<TimestampVerdict> {
        let mut stamps = TimestampFilter::default();
        times_ms.iter().map(|ms| stamps.classify(ms.saturating_mul(1_000_000))).collect()
    }

    #[test]
    fn single_wrong_timestamp_drops_only_itself() {
        assert_eq!(classified(&[0, 10, 900_000, 20, 30]), [Next, Next, Jump, Next, Next]);
        assert_eq!(classified(&[0, 10, i64::MAX, 20, i64::MAX, 30]), [Next, Next, Jump, Next, Jump, Next]);
        assert_eq!(classified(&[0, 10, i64::MIN, 20, 15, 20]), [Next, Next, NotRising, Next, NotRising, NotRising]);
    }

    #[test]
    fn wrong_first_timestamp_is_revoked() {
        assert_eq!(classified(&[i64::MAX, 0, 10, 20]), [Next, NotRising, Restart, Next]);
        assert_eq!(classified(&[i64::MIN, 0, 10, 20]), [Next, Jump, Next, Next]);
        // One wrong one far before it is no witness against it.
        assert_eq!(classified(&[0, i64::MIN, 10, 20]), [Next, NotRising, Next, Next]);
        // Once gone on from, it stands.
        assert_eq!(classified(&[5000, 5010, 0, 10, 5020]), [Next, Next, NotRising, NotRising, Next]);
    }

    #[test]
    fn real_pause_drops_one_sample() {
        assert_eq!(classified(&[0, 10, 60_000, 60_010, 60_020]), [Next, Next, Jump, Next, Next]);
        // Two wrong ones that do not go on from each other confirm nothing.
        assert_eq!(classified(&[0, 10, 60_000, 90_000, 20]), [Next, Next, Jump, Jump, Next]);
    }

    #[test]
    fn slow_stream_is_accepted() {
        assert_eq!(classified(&[0, 4000, 8000, 12_000, 16_000]), [Next, Jump, Next, Next, Next]);
    }
}

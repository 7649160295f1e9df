//! Filter of time stamps: one that jumps far ahead is accepted only when the next one follows it.
//!
//! The times of a stream must rise, so a single wrong time stamp far in the future would block
//! everything after it. A jump therefore waits for a second time stamp to confirm it; the sample
//! itself is dropped, and nothing else. The first time stamp of a stream has nothing to be compared
//! with. When the next two follow each other far before it, the first was wrong and is revoked.

/// A time stamp farther ahead than this is a jump, nanoseconds. Choice: longer than a stream pauses
/// without a reason, and short enough that a smaller error passes by itself.
const MAX_STEP_NS: i64 = 1_000_000_000;
/// Streams slower than that are recognised by two equal steps, up to this one, nanoseconds. Choice:
/// a frame rate of 0.1 Hz, below any use.
const SLOWEST_STEP_NS: i64 = 10_000_000_000;

/// What to do with a sample, by its time stamp.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TimestampVerdict {
    /// It follows the one before.
    Next,
    /// It follows another far before the first one, which was wrong: restart with this one.
    Restart,
    /// Not later than the one before: not used.
    NotRising,
    /// Far ahead, with nothing to confirm it: not used.
    Jump,
}

/// Classifies the time stamps of one stream.
#[derive(Debug, Clone, Copy)]
pub(super) struct TimestampFilter {
    last_ns: Option<i64>,
    /// A time stamp far away that is not confirmed yet.
    pending_ns: Option<i64>,
    /// The last one was confirmed: it followed another, or another followed it.
    is_confirmed: bool,
    /// Widest step that is not a jump.
    max_step_ns: i64,
}

impl Default for TimestampFilter {
    fn default() -> Self {
        Self { last_ns: None, pending_ns: None, is_confirmed: false, max_step_ns: MAX_STEP_NS }
    }
}

impl TimestampFilter {
    /// Classifies the next time stamp.
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
                // A slow stream: its steps are no jumps.
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
        // A single wrong one far before it does not revoke it.
        assert_eq!(classified(&[0, i64::MIN, 10, 20]), [Next, NotRising, Next, Next]);
        // Once another has followed, it stands.
        assert_eq!(classified(&[5000, 5010, 0, 10, 5020]), [Next, Next, NotRising, NotRising, Next]);
    }

    #[test]
    fn real_pause_drops_one_sample() {
        assert_eq!(classified(&[0, 10, 60_000, 60_010, 60_020]), [Next, Next, Jump, Next, Next]);
        // Two wrong ones that do not follow each other confirm nothing.
        assert_eq!(classified(&[0, 10, 60_000, 90_000, 20]), [Next, Next, Jump, Jump, Next]);
    }

    #[test]
    fn slow_stream_is_accepted() {
        assert_eq!(classified(&[0, 4000, 8000, 12_000, 16_000]), [Next, Jump, Next, Next, Next]);
    }
}

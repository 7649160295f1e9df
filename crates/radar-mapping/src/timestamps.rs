//! Filter of time stamps: one that leaps is accepted only when others follow it.
//!
//! The times of a stream must rise, so a wrong time stamp far in the future would block everything after it. Stamps far from the
//! last one therefore wait until enough follow each other there; these are dropped, and nothing else. Far ahead, that is a pause of
//! the stream; far behind, those accepted before were wrong, and they are revoked.

/// A time stamp farther ahead than this is a leap, nanoseconds. Choice: longer than a stream pauses
/// without a reason, and short enough that a smaller error passes by itself.
const MAX_STEP_NS: i64 = 1_000_000_000;
/// A time stamp less far ahead follows too soon, nanoseconds. Choice: no tracker and no sensor is faster, and what a tenth of a second
/// of them costs stays bounded.
const MIN_STEP_NS: i64 = 100_000;
/// So many stamps in a row, or so long a time that they rise by, nanoseconds, confirm a leap. Choice: what is wrong comes alone or
/// in a buffer's worth; a tenth of a second of poses, and of slower streams what they give in the longer time.
const CONFIRMING: u32 = 8;
const CONFIRMING_NS: i64 = 300_000_000;
/// Streams slower than [`MAX_STEP_NS`] are recognised by their first two steps, up to this one, nanoseconds. Choice:
/// a frame rate of 0.1 Hz, below any use.
const SLOWEST_STEP_NS: i64 = 10_000_000_000;

/// What to do with a sample, by its time stamp.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TimestampVerdict {
    /// It follows the one before.
    Next,
    /// It follows others far before the last one, which was wrong: restart with this one.
    Restart,
    /// Not later than the one before, or hardly: not used.
    NotRising,
    /// Far ahead, with nothing to confirm it: not used.
    Leap,
}

/// Time stamps far from the last one that follow each other.
#[derive(Debug, Clone, Copy)]
struct Run {
    first_ns: i64,
    last_ns: i64,
    count: u32,
}

/// Classifies the time stamps of one stream.
#[derive(Debug, Clone, Copy)]
pub(super) struct TimestampFilter {
    last_ns: Option<i64>,
    /// Whether another followed the one before the last.
    is_confirmed: bool,
    /// Those that are not confirmed yet.
    pending: Option<Run>,
    /// Widest step that is not a leap.
    max_step_ns: i64,
}

impl Default for TimestampFilter {
    fn default() -> Self {
        Self { last_ns: None, is_confirmed: false, pending: None, max_step_ns: MAX_STEP_NS }
    }
}

impl TimestampFilter {
    /// Classifies the next time stamp.
    pub fn classify(&mut self, time_ns: i64) -> TimestampVerdict {
        let Some(last_ns) = self.last_ns else {
            self.last_ns = Some(time_ns);
            return TimestampVerdict::Next;
        };
        let is_ahead = time_ns.saturating_sub(last_ns) >= MIN_STEP_NS;
        if is_ahead && time_ns.saturating_sub(last_ns) <= self.max_step_ns {
            self.accept(time_ns);
            return TimestampVerdict::Next;
        }
        if last_ns.saturating_sub(time_ns) <= self.max_step_ns && !is_ahead {
            return TimestampVerdict::NotRising;
        }
        if self.confirms(time_ns, last_ns) {
            self.accept(time_ns);
            return if is_ahead { TimestampVerdict::Next } else { TimestampVerdict::Restart };
        }
        if is_ahead { TimestampVerdict::Leap } else { TimestampVerdict::NotRising }
    }

    fn accept(&mut self, time_ns: i64) {
        (self.last_ns, self.is_confirmed, self.pending) = (Some(time_ns), true, None);
    }

    /// Adds a stamp to those that wait; whether it confirms them.
    fn confirms(&mut self, time_ns: i64, last_ns: i64) -> bool {
        let follows = |run: &Run| time_ns > run.last_ns;
        let Some(run) = self.pending.filter(follows) else {
            self.pending = Some(Run { first_ns: time_ns, last_ns: time_ns, count: 1 });
            return false;
        };
        let (step_ns, leap_ns) = (time_ns.saturating_sub(run.last_ns), run.first_ns.saturating_sub(last_ns));
        if step_ns <= self.max_step_ns {
            let run = Run { last_ns: time_ns, count: run.count + 1, ..run };
            self.pending = Some(run);
            let is_long = run.count > CONFIRMING || time_ns.saturating_sub(run.first_ns) >= CONFIRMING_NS;
            // Two that follow each other outweigh the first of the stream, which none follows.
            return is_long || !self.is_confirmed;
        }
        // A stream that is slow from its beginning: its steps are no leaps.
        let is_slow = !self.is_confirmed && run.count == 1 && step_ns <= leap_ns.min(SLOWEST_STEP_NS);
        if is_slow {
            self.max_step_ns = step_ns.saturating_mul(2).min(2 * SLOWEST_STEP_NS);
        } else {
            self.pending = Some(Run { first_ns: time_ns, last_ns: time_ns, count: 1 });
        }
        is_slow
    }
}

#[cfg(test)]
mod tests {
    use super::TimestampVerdict::{Leap, Next, NotRising, Restart};
    use super::*;

    fn classified(times_ms: &[i64]) -> Vec<TimestampVerdict> {
        let mut stamps = TimestampFilter::default();
        times_ms.iter().map(|ms| stamps.classify(ms.saturating_mul(1_000_000))).collect()
    }

    /// Stamps that are 10 ms apart, from a time on.
    fn run_from(first_ms: i64, count: usize) -> Vec<i64> {
        (0..count as i64).map(|n| first_ms.saturating_add(10 * n)).collect()
    }

    #[test]
    fn wrong_timestamps_drop_only_themselves() {
        assert_eq!(classified(&[0, 10, 900_000, 20, 30]), [Next, Next, Leap, Next, Next]);
        assert_eq!(classified(&[0, 10, i64::MAX, 20, i64::MAX, 30]), [Next, Next, Leap, Next, Leap, Next]);
        assert_eq!(classified(&[0, 10, i64::MIN, 20, 15, 20]), [Next, Next, NotRising, Next, NotRising, NotRising]);
        for wrong_ms in [3_600_000, -3_600_000, 5000, -5000] {
            let stamps = [run_from(0, 5), run_from(wrong_ms, CONFIRMING as usize), run_from(50, 5)].concat();
            let used = classified(&stamps).into_iter().filter(|verdict| *verdict == Next).count();
            assert_eq!(used, 10, "{wrong_ms}");
        }
    }

    #[test]
    fn wrong_first_timestamps_are_revoked() {
        assert_eq!(classified(&[i64::MAX, 0, 10, 20]), [Next, NotRising, Restart, Next]);
        assert_eq!(classified(&[i64::MIN, 0, 10, 20]), [Next, Leap, Next, Next]);
        for wrong in [&[3_600_000, 3_600_010][..], &[3_600_000, 3_600_010, 3_600_020]] {
            let verdicts = classified(&[wrong, &run_from(0, 12)].concat());
            let refused = vec![NotRising; CONFIRMING as usize];
            assert_eq!(verdicts[wrong.len()..], [&refused[..], &[Restart, Next, Next, Next]].concat());
        }
        // A single wrong one far before it does not revoke it.
        assert_eq!(classified(&[0, i64::MIN, 10, 20]), [Next, NotRising, Next, Next]);
    }

    #[test]
    fn real_pause_drops_what_confirms_it() {
        let verdicts = classified(&[run_from(0, 2), run_from(60_000, 10)].concat());
        assert_eq!(verdicts, [&[Next; 2][..], &[Leap; CONFIRMING as usize], &[Next; 2]].concat());
        // Of a slower stream, fewer.
        assert_eq!(classified(&[0, 400, 60_000, 60_400, 60_800]), [Next, Next, Leap, Next, Next]);
        // Two wrong ones that do not follow each other confirm nothing.
        for second_ms in [61_500, 65_000, 90_000] {
            assert_eq!(classified(&[0, 10, 60_000, second_ms, 20, 30]), [Next, Next, Leap, Leap, Next, Next]);
        }
    }

    #[test]
    fn what_follows_too_soon_is_not_used() {
        let mut stamps = TimestampFilter::default();
        let used = (0..100_000).filter(|us| stamps.classify(us * 1000) == Next).count();
        assert_eq!(used, 1000);
    }

    #[test]
    fn slow_stream_is_accepted() {
        assert_eq!(classified(&[0, 4000, 8000, 12_000, 16_000]), [Next, Leap, Next, Next, Next]);
    }
}

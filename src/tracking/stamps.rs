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
pub(super) enum Stamp {
    /// It goes on from the one before.
    Next,
    /// It goes on from another far before the first one, which was wrong: begin anew with this one.
    Anew,
    /// Not later than the one before: not used.
    NotRising,
    /// Far ahead, with nothing to confirm it: not used.
    Leap,
}

/// Judges the stamps of one stream.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stamps {
    last_ns: Option<i64>,
    /// One far away that waits for its witness.
    far_ns: Option<i64>,
    /// Another stamp has gone on from the last one, or it from another.
    is_witnessed: bool,
    /// Widest step that is no leap.
    max_step_ns: i64,
}

impl Default for Stamps {
    fn default() -> Self {
        Self { last_ns: None, far_ns: None, is_witnessed: false, max_step_ns: MAX_STEP_NS }
    }
}

impl Stamps {
    /// Judges the next stamp.
    pub fn judge(&mut self, time_ns: i64) -> Stamp {
        let Some(last_ns) = self.last_ns else {
            self.last_ns = Some(time_ns);
            return Stamp::Next;
        };
        if time_ns > last_ns && time_ns.saturating_sub(last_ns) <= self.max_step_ns {
            self.believe(time_ns);
            return Stamp::Next;
        }
        if let Some(far_ns) = self.far_ns.filter(|&far_ns| time_ns > far_ns) {
            let (step_ns, leap_ns) = (time_ns.saturating_sub(far_ns), far_ns.saturating_sub(last_ns));
            if step_ns <= self.max_step_ns.max(leap_ns.min(SLOWEST_STEP_NS)) {
                self.believe(time_ns);
                // A slow stream: its steps are no leaps.
                self.max_step_ns = self.max_step_ns.max(step_ns.saturating_mul(2)).min(2 * SLOWEST_STEP_NS);
                return if far_ns > last_ns { Stamp::Next } else { Stamp::Anew };
            }
        }
        if time_ns > last_ns {
            self.far_ns = Some(time_ns);
            return Stamp::Leap;
        }
        if !self.is_witnessed && last_ns.saturating_sub(time_ns) > self.max_step_ns {
            self.far_ns = Some(time_ns);
        }
        Stamp::NotRising
    }

    fn believe(&mut self, time_ns: i64) {
        (self.last_ns, self.far_ns, self.is_witnessed) = (Some(time_ns), None, true);
    }
}

#[cfg(test)]
mod tests {
    use super::Stamp::{Anew, Leap, Next, NotRising};
    use super::*;

    fn judged(times_ms: &[i64]) -> Vec<Stamp> {
        let mut stamps = Stamps::default();
        times_ms.iter().map(|ms| stamps.judge(ms.saturating_mul(1_000_000))).collect()
    }

    #[test]
    fn one_wrong_stamp_costs_itself_alone() {
        assert_eq!(judged(&[0, 10, 900_000, 20, 30]), [Next, Next, Leap, Next, Next]);
        assert_eq!(judged(&[0, 10, i64::MAX, 20, i64::MAX, 30]), [Next, Next, Leap, Next, Leap, Next]);
        assert_eq!(judged(&[0, 10, i64::MIN, 20, 15, 20]), [Next, Next, NotRising, Next, NotRising, NotRising]);
    }

    #[test]
    fn a_wrong_first_stamp_is_taken_back() {
        assert_eq!(judged(&[i64::MAX, 0, 10, 20]), [Next, NotRising, Anew, Next]);
        assert_eq!(judged(&[i64::MIN, 0, 10, 20]), [Next, Leap, Next, Next]);
        // One wrong one far before it is no witness against it.
        assert_eq!(judged(&[0, i64::MIN, 10, 20]), [Next, NotRising, Next, Next]);
        // Once gone on from, it stands.
        assert_eq!(judged(&[5000, 5010, 0, 10, 5020]), [Next, Next, NotRising, NotRising, Next]);
    }

    #[test]
    fn a_true_pause_costs_one_sample() {
        assert_eq!(judged(&[0, 10, 60_000, 60_010, 60_020]), [Next, Next, Leap, Next, Next]);
        // Two wrong ones that do not go on from each other confirm nothing.
        assert_eq!(judged(&[0, 10, 60_000, 90_000, 20]), [Next, Next, Leap, Leap, Next]);
    }

    #[test]
    fn a_slow_stream_is_followed() {
        assert_eq!(judged(&[0, 4000, 8000, 12_000, 16_000]), [Next, Leap, Next, Next, Next]);
    }
}

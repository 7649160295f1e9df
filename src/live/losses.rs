//! Frames that should have come and did not: a pause of several usual intervals has lost the frames between.

use std::collections::VecDeque;

/// Intervals that the usual one is the median of.
const REMEMBERED: usize = 63;
/// Intervals until it is known.
const LEAST: usize = 8;

/// Counts lost frames by the frames' own times.
#[derive(Debug, Clone, Default)]
pub struct Losses {
    last_ns: Option<i64>,
    intervals_ns: VecDeque<i64>,
    lost: u64,
}

impl Losses {
    /// The stream began anew: what is between was not to come.
    pub fn begin(&mut self) {
        self.last_ns = None;
    }

    /// A frame of this time, host nanoseconds.
    pub fn push(&mut self, time_ns: i64) {
        let Some(last_ns) = self.last_ns.replace(time_ns) else { return };
        let interval_ns = time_ns.saturating_sub(last_ns);
        if interval_ns <= 0 {
            return;
        }
        if self.intervals_ns.len() >= LEAST {
            let mut sorted: Vec<i64> = self.intervals_ns.iter().copied().collect();
            let middle = sorted.len() / 2;
            let usual_ns = *sorted.select_nth_unstable(middle).1;
            self.lost += ((interval_ns as f64 / usual_ns as f64).round() as u64).saturating_sub(1);
        }
        if self.intervals_ns.len() == REMEMBERED {
            self.intervals_ns.pop_front();
        }
        self.intervals_ns.push_back(interval_ns);
    }

    /// Frames lost so far.
    pub fn lost(&self) -> u64 {
        self.lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_are_counted_in_frames_and_jitter_is_not() {
        let mut losses = Losses::default();
        let mut time_ns = 0;
        for n in 0..1000i64 {
            // 2 ms, give or take 0.4; three frames missing here and there.
            time_ns += 2_000_000 + 400_000 * (n % 3 - 1) + if n % 100 == 99 { 6_000_000 } else { 0 };
            losses.push(time_ns);
        }
        assert_eq!(losses.lost(), 30);
        losses.begin();
        losses.push(time_ns + 1_000_000_000_000);
        losses.push(5);
        losses.push(i64::MAX);
        assert!(losses.lost() > 30);
    }
}

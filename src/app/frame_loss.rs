//! Counts lost frames: a pause of several typical intervals has lost the frames between. Uses the
//! sensor's ticks, because host times still shift while the clock estimate converges.

use std::collections::VecDeque;

/// Intervals from which the typical one is computed. Choice: a second of d16, so that a changed
/// frame rate is followed; odd, so that a median exists.
const MAX_INTERVALS: usize = 63;
/// Least number of intervals before losses are counted. Choice: the median ignores up to three lost
/// frames among these.
const MIN_INTERVALS: usize = 8;
/// A longer pause, in typical intervals, is a jump of the sensor's clock. Choice: 15 s of d16; a
/// silent line is reopened before that, which restarts the count.
const MAX_PAUSE_INTERVALS: f64 = 1000.0;

/// Counts lost frames by the frames' ticks.
#[derive(Debug, Clone, Default)]
pub struct FrameLossCounter {
    last: Option<i64>,
    intervals: VecDeque<i64>,
    lost: u64,
}

impl FrameLossCounter {
    /// The stream restarted: the pause before the next frame is no loss.
    pub fn restart(&mut self) {
        self.last = None;
    }

    /// Takes a frame's unwrapped tick.
    pub fn push(&mut self, tick: i64) {
        let Some(last) = self.last.replace(tick) else { return };
        let interval = tick.saturating_sub(last);
        if interval <= 0 {
            return;
        }
        if self.intervals.len() >= MIN_INTERVALS {
            // Coarse ticks round an interval up by as much as one.
            let intervals = ((interval as f64 - 0.5) / self.typical_interval()).round();
            if intervals > MAX_PAUSE_INTERVALS {
                return;
            }
            self.lost += (intervals as u64).saturating_sub(1);
        }
        if self.intervals.len() == MAX_INTERVALS {
            self.intervals.pop_front();
        }
        self.intervals.push_back(interval);
    }

    /// The typical interval: the mean of those near the median, because ticks may be coarse.
    fn typical_interval(&self) -> f64 {
        let mut sorted: Vec<i64> = self.intervals.iter().copied().collect();
        let middle = sorted.len() / 2;
        let median = *sorted.select_nth_unstable(middle).1;
        let alike = self.intervals.iter().filter(|&&interval| interval <= median.saturating_mul(3) / 2 + 1);
        let (sum, count) = alike.fold((0.0, 0.0), |(sum, count), &interval| (sum + interval as f64, count + 1.0));
        sum / count
    }

    /// Frames lost so far.
    pub fn lost(&self) -> u64 {
        self.lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Losses of 1000 frames at a period in ticks, with three missing after each hundred.
    fn lost(period: f64) -> u64 {
        let mut losses = FrameLossCounter::default();
        for n in 0..1000i64 {
            losses.push(((n + 3 * (n / 100)) as f64 * period) as i64);
        }
        losses.lost()
    }

    #[test]
    fn pauses_count_lost_frames_and_rounding_does_not() {
        // d16 and c16, each in ticks of 1 µs and of 1 ms.
        for period in [15_151.5, 2000.0, 15.1515, 2.0, 2.3] {
            assert_eq!(lost(period), 27, "{period}");
        }
    }

    #[test]
    fn restarts_and_clock_jumps_are_not_losses() {
        let mut losses = FrameLossCounter::default();
        (0..20).for_each(|n| losses.push(100 * n));
        losses.restart();
        [1_000_000, 1_000_100, 5, i64::MAX, i64::MIN, 7].into_iter().for_each(|tick| losses.push(tick));
        assert_eq!(losses.lost(), 0);
    }
}

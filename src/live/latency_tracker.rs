//! How fresh the reconstruction is: from a frame's arrival to its sweeps being worked off, and from a sweep's end to the
//! first scene that rests on it. Bounded memory.

use std::collections::VecDeque;

use super::{Latency, LatencyReport};

/// Frames that are followed at most; beyond, the oldest are no longer.
const MAX_TRACKED_FRAMES: usize = 4096;
/// A frame's end lies behind its last sweep's by what the sensor takes to wind up: less than this, nanoseconds.
const WIND_UP_NS: i64 = 1_000_000;

/// Follows frames through the reconstruction.
#[derive(Default)]
pub(super) struct LatencyTracker {
    /// Frames that are not worked off: end of the measurement and arrival, host nanoseconds.
    waiting: VecDeque<(i64, i64)>,
    /// Ends of frames that no scene rests on yet, host nanoseconds.
    unpublished: VecDeque<i64>,
    processed: Latency,
    evidence_age: Latency,
}

impl LatencyTracker {
    /// A frame whose measurement ended at a time was accepted; it had arrived at another.
    pub fn frame_accepted(&mut self, end_ns: i64, arrived_ns: i64) {
        self.waiting.push_back((end_ns, arrived_ns));
        if self.waiting.len() > MAX_TRACKED_FRAMES {
            self.waiting.pop_front();
        }
    }

    /// So many frames, the oldest, turned out to have no pose.
    pub fn drop_oldest(&mut self, count: u64) {
        let count = usize::try_from(count).map_or(self.waiting.len(), |count| count.min(self.waiting.len()));
        self.waiting.drain(..count);
    }

    /// All frames up to this end are worked off.
    pub fn processed_until(&mut self, newest_ns: i64, now_ns: i64) {
        while let Some((end_ns, arrived_ns)) =
            self.waiting.pop_front_if(|f| f.0 <= newest_ns.saturating_add(WIND_UP_NS))
        {
            self.processed.push(now_ns.saturating_sub(arrived_ns));
            self.unpublished.push_back(end_ns);
        }
        while self.unpublished.len() > MAX_TRACKED_FRAMES {
            self.unpublished.pop_front();
        }
    }

    /// A scene was published that rests on all sweeps up to this end.
    pub fn published_until(&mut self, evidence_ns: i64, now_ns: i64) {
        while let Some(end_ns) =
            self.unpublished.pop_front_if(|end_ns| *end_ns <= evidence_ns.saturating_add(WIND_UP_NS))
        {
            self.evidence_age.push(now_ns.saturating_sub(end_ns));
        }
    }

    /// What is under way is given up.
    pub fn reset(&mut self) {
        self.waiting.clear();
        self.unpublished.clear();
    }

    /// From arrival to worked off.
    pub fn processed(&self) -> LatencyReport {
        self.processed.report()
    }

    /// From a frame's end to the first scene that rests on it.
    pub fn evidence_age(&self) -> LatencyReport {
        self.evidence_age.report()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_timed_once_and_poseless_ones_excluded() {
        let mut latencies = LatencyTracker::default();
        (0..10).for_each(|n| latencies.frame_accepted(n * 100_000_000, n * 100_000_000 + 5));
        latencies.drop_oldest(2);
        latencies.processed_until(399_500_000, 500_000_000);
        assert_eq!((latencies.processed().count, latencies.processed().max_s), (3, 299_999_995.0 * 1e-9));
        latencies.published_until(250_000_000, 1_000_000_000);
        latencies.published_until(250_000_000, 9_000_000_000);
        assert_eq!((latencies.evidence_age().count, latencies.evidence_age().max_s), (1, 800_000_000.0 * 1e-9));
        latencies.reset();
        latencies.processed_until(i64::MAX, 2_000_000_000);
        assert_eq!((latencies.processed().count, latencies.evidence_age().count), (3, 1));
    }

    #[test]
    fn memory_is_bounded() {
        let mut latencies = LatencyTracker::default();
        for n in 0..10_000 {
            latencies.frame_accepted(n, n);
        }
        assert_eq!(latencies.waiting.len(), MAX_TRACKED_FRAMES);
        latencies.processed_until(10_000, 10_000);
        (10_000..15_000).for_each(|n| latencies.frame_accepted(n, n));
        latencies.processed_until(20_000, 20_000);
        assert_eq!((latencies.waiting.len(), latencies.unpublished.len()), (0, MAX_TRACKED_FRAMES));
        latencies.drop_oldest(u64::MAX);
    }
}

//! Latencies of the reconstruction: from a frame's arrival to its processing, and from a frame's
//! end to the first published scene that contains it. Bounded memory.

use std::collections::VecDeque;

use super::{Latency, LatencyReport};

/// Largest number of frames tracked; beyond, the oldest are dropped. Choice: more than queue and
/// mapper hold; reached only when no scene is published any more.
const MAX_TRACKED_FRAMES: usize = 4096;
/// Upper bound of the time from the end of the last sweep to the end of its frame, nanoseconds: the
/// sensor's wind-up time. Choice: above the 0.88 ms of overhead a frame measured on an XC120.
const WIND_UP_NS: i64 = 1_000_000;

/// Tracks frames through the reconstruction.
#[derive(Default)]
pub(super) struct LatencyTracker {
    /// Frames not processed yet: end of the measurement and arrival, host nanoseconds.
    waiting: VecDeque<(i64, i64)>,
    /// Ends of processed frames that no published scene contains yet, host nanoseconds.
    unpublished: VecDeque<i64>,
    processed: Latency,
    evidence_age: Latency,
}

impl LatencyTracker {
    /// A frame was accepted: end of its measurement and its arrival, host nanoseconds.
    pub fn frame_accepted(&mut self, end_ns: i64, arrived_ns: i64) {
        self.waiting.push_back((end_ns, arrived_ns));
        if self.waiting.len() > MAX_TRACKED_FRAMES {
            self.waiting.pop_front();
        }
    }

    /// Drops the oldest frames, which turned out to have no pose.
    pub fn drop_oldest(&mut self, count: u64) {
        let count = usize::try_from(count).map_or(self.waiting.len(), |count| count.min(self.waiting.len()));
        self.waiting.drain(..count);
    }

    /// All frames up to this end are processed.
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

    /// A scene was published that contains all sweeps up to this end.
    pub fn published_until(&mut self, evidence_ns: i64, now_ns: i64) {
        while let Some(end_ns) =
            self.unpublished.pop_front_if(|end_ns| *end_ns <= evidence_ns.saturating_add(WIND_UP_NS))
        {
            self.evidence_age.push(now_ns.saturating_sub(end_ns));
        }
    }

    /// Drops all frames in flight.
    pub fn reset(&mut self) {
        self.waiting.clear();
        self.unpublished.clear();
    }

    /// From arrival to processing.
    pub fn processed(&self) -> LatencyReport {
        self.processed.report()
    }

    /// From a frame's end to the first published scene that contains it.
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

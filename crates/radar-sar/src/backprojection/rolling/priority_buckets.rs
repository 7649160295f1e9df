//! Queue of cubes to be examined, approximately by falling bound: bucketed, because a full order
//! would cost more than it saves.

use super::octree_bounds::Bounds;

/// Number of buckets: sixteen per doubling of the bound, by the first bits of its mantissa. Choice:
/// eight doublings above the threshold; the order among still greater ones does not matter.
const BUCKETS: usize = 128;
const MANTISSA_BITS_DROPPED: u32 = 23 - 4;
/// Greatest number of cubes examined in parallel; a constant, so that results do not depend on the
/// number of threads. Choice: several cubes for each core, and few enough that the greatest bounds
/// stay ahead.
const BATCH: usize = 512;

/// A cube that may contain a voxel at the threshold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Candidate {
    pub(super) bound: i64,
    /// Index of the cube.
    pub(super) index: u32,
}

impl Candidate {
    /// Index of the cube.
    pub(super) fn cube(&self) -> usize {
        self.index as usize
    }
}

/// The watched cubes of an octet that may reach the threshold.
pub(super) fn candidates_of(index: u32, eight: &Bounds, threshold: i64) -> impl Iterator<Item = Candidate> {
    (0..8).filter_map(move |n| {
        let bound = i64::from(eight.bound(n));
        (eight.is_watched(n) && bound >= threshold).then_some(Candidate { bound, index: index * 8 + n as u32 })
    })
}

/// Cubes in buckets; within a bucket last in, first out.
#[derive(Debug)]
pub(super) struct PriorityBuckets {
    /// Lower end of the first bucket.
    threshold: i64,
    buckets: [Vec<Candidate>; BUCKETS],
}

impl PriorityBuckets {
    /// An empty queue.
    pub(super) fn new() -> Self {
        Self { threshold: 0, buckets: [const { Vec::new() }; BUCKETS] }
    }

    /// Empties the queue and sets a new threshold.
    pub(super) fn clear(&mut self, threshold: i64) {
        self.threshold = threshold;
        self.buckets.iter_mut().for_each(Vec::clear);
    }

    /// Adds a cube if it may reach the threshold.
    pub(super) fn put(&mut self, promise: Candidate) {
        if promise.bound >= self.threshold {
            let bits = |bound: i64| ((bound as f32).to_bits() >> MANTISSA_BITS_DROPPED) as usize;
            let class = bits(promise.bound) - bits(self.threshold);
            self.buckets[class.min(BUCKETS - 1)].push(promise);
        }
    }

    /// Removes up to `count` cubes of the greatest bucket that may reach a threshold, which must
    /// not be lower than before; none when none is left.
    pub(super) fn pop_best(&mut self, threshold: i64, count: usize) -> Vec<Candidate> {
        let mut most = Vec::new();
        for class in self.buckets.iter_mut().rev() {
            while most.len() < count.min(BATCH) {
                let Some(promise) = class.pop() else { break };
                if promise.bound >= threshold {
                    most.push(promise);
                }
            }
            if !most.is_empty() {
                break;
            }
        }
        most
    }

    /// Number of cubes that may reach the threshold, and the greatest of their bounds.
    pub(super) fn remaining(&self, threshold: i64) -> (usize, Option<i64>) {
        let bounds = self.buckets.iter().flatten().map(|promise| promise.bound).filter(|bound| *bound >= threshold);
        bounds.fold((0, None), |(count, greatest), bound| (count + 1, greatest.max(Some(bound))))
    }
}

//! The cubes that wait to be looked into, the most promising first: sorted into classes by their bound, since a full order
//! would cost more than it saves.

use super::octree_bounds::Bounds;

/// Classes: sixteen for each doubling of the bound, by the first bits of its mantissa.
const BUCKETS: usize = 128;
const MANTISSA_BITS_DROPPED: u32 = 23 - 4;
/// Cubes looked into side by side at most; a number, so that nothing depends on the number of threads.
const BATCH: usize = 512;

/// A cube that may hold a voxel at the threshold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Candidate {
    pub(super) bound: i64,
    /// Of the cube.
    pub(super) index: u32,
}

impl Candidate {
    /// Eight, and which of them.
    pub(super) fn cube(&self) -> (usize, usize) {
        (self.index as usize / 8, self.index as usize % 8)
    }
}

/// The cubes of an eight that are watched and may reach the threshold.
pub(super) fn candidates_of(index: u32, eight: &Bounds, threshold: i64) -> impl Iterator<Item = Candidate> {
    (0..8).filter_map(move |n| {
        let bound = i64::from(eight.bound(n));
        (eight.is_watched(n) && bound >= threshold).then_some(Candidate { bound, index: index * 8 + n as u32 })
    })
}

/// Cubes by classes; within a class last come, first served.
#[derive(Debug)]
pub(super) struct PriorityBuckets {
    /// Where the first class begins.
    threshold: i64,
    buckets: [Vec<Candidate>; BUCKETS],
}

impl PriorityBuckets {
    /// Nobody waits.
    pub(super) fn new() -> Self {
        Self { threshold: 0, buckets: [const { Vec::new() }; BUCKETS] }
    }

    /// Sends all away; from now on those come that may reach a threshold.
    pub(super) fn clear(&mut self, threshold: i64) {
        self.threshold = threshold;
        self.buckets.iter_mut().for_each(Vec::clear);
    }

    /// Puts a cube in, if it may reach the threshold.
    pub(super) fn put(&mut self, promise: Candidate) {
        if promise.bound >= self.threshold {
            let bits = |bound: i64| ((bound as f32).to_bits() >> MANTISSA_BITS_DROPPED) as usize;
            let class = bits(promise.bound) - bits(self.threshold);
            self.buckets[class.min(BUCKETS - 1)].push(promise);
        }
    }

    /// Takes up to so many out that may reach a threshold no lower than before, those with the greatest bounds; none when none
    /// is left.
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

    /// How many may reach the threshold, and the greatest bound of them.
    pub(super) fn remaining(&self, threshold: i64) -> (usize, Option<i64>) {
        let bounds = self.buckets.iter().flatten().map(|promise| promise.bound).filter(|bound| *bound >= threshold);
        bounds.fold((0, None), |(count, greatest), bound| (count + 1, greatest.max(Some(bound))))
    }
}

//! The cubes that wait to be looked into, the most promising first: sorted into classes by their bound, since a full order
//! would cost more than it saves.

use super::alive::Bounds;

/// Classes for each doubling of the bound.
const PER_DOUBLING: f32 = 4.0;
const CLASSES: usize = 32;
/// Cubes looked into side by side at most; a number, so that nothing depends on the number of threads.
const BATCH: usize = 512;

/// A cube that may hold a voxel at the threshold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Promise {
    pub(super) bound: i64,
    /// Of the cube.
    pub(super) index: u32,
}

impl Promise {
    /// Eight, and which of them.
    pub(super) fn cube(&self) -> (usize, usize) {
        (self.index as usize / 8, self.index as usize % 8)
    }
}

/// The cubes of an eight that are watched and may reach the threshold.
pub(super) fn promises_of(index: u32, eight: &Bounds, threshold: i64) -> impl Iterator<Item = Promise> {
    (0..8).filter_map(move |n| {
        let bound = i64::from(eight.bound(n));
        (eight.is_watched(n) && bound >= threshold).then_some(Promise { bound, index: index * 8 + n as u32 })
    })
}

/// Cubes by classes; within a class last come, first served.
pub(super) struct Waiting {
    /// Where the first class begins.
    threshold: i64,
    classes: [Vec<Promise>; CLASSES],
}

impl Waiting {
    pub(super) fn new(threshold: i64) -> Self {
        Self { threshold, classes: [const { Vec::new() }; CLASSES] }
    }

    /// Puts a cube in, if it may reach the threshold.
    pub(super) fn put(&mut self, promise: Promise) {
        if promise.bound >= self.threshold {
            let doublings = (promise.bound as f32 / self.threshold as f32).log2();
            self.classes[((doublings * PER_DOUBLING) as usize).min(CLASSES - 1)].push(promise);
        }
    }

    /// Takes some out that may reach a threshold no lower than before, those with the greatest bounds; none when none is left.
    pub(super) fn most_promising(&mut self, threshold: i64) -> Vec<Promise> {
        let mut most = Vec::new();
        for class in self.classes.iter_mut().rev() {
            while most.len() < BATCH {
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

    /// How many may reach the threshold.
    pub(super) fn count(&self, threshold: i64) -> usize {
        self.classes.iter().flatten().filter(|promise| promise.bound >= threshold).count()
    }
}

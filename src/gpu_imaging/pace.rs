//! Divides work into dispatches of about the same time.

use std::ops::Range;
use std::time::Instant;

use super::job::RunParameters;
use super::{GpuWork, VOXELS};
use crate::render::RenderError;

/// Time of one dispatch, seconds. Choice: a small part of a headset's frame of 11 ms, and ten times
/// what starting a dispatch costs.
const DISPATCH_S: f64 = 0.002;
/// Updates of the first dispatch. Choice: 2 ms on two cores of a software renderer.
const FIRST_UPDATES: f64 = 100_000.0;
/// Least updates of a dispatch. Choice: a brick and a sweep.
const LEAST_UPDATES: f64 = 64.0;
/// Factors by which the work may change from one dispatch to the next. Choice: a single slow
/// dispatch, beside a game's frame, must not take the pace away.
const CHANGE: [f64; 2] = [0.5, 4.0];

/// Adapts the work of a dispatch to the card.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pace {
    dispatch_s: f64,
    updates: f64,
}

impl Default for Pace {
    fn default() -> Self {
        Self::new(DISPATCH_S)
    }
}

impl Pace {
    pub(super) fn new(dispatch_s: f64) -> Self {
        Self { dispatch_s, updates: FIRST_UPDATES }
    }

    /// Adds runs to bricks by calls of `dispatch`, which returns when its part is done. Each brick
    /// gets its runs in order.
    pub(super) fn add(
        &mut self,
        runs: &[RunParameters],
        bricks: &Range<usize>,
        work: &mut GpuWork,
        mut dispatch: impl FnMut(Range<usize>, Range<usize>) -> Result<(), RenderError>,
    ) -> Result<(), RenderError> {
        let mut first = 0;
        while first < runs.len() {
            // Updates of a brick.
            let (mut end, mut updates) = (first, 0.0);
            while end < runs.len() && (end == first || updates * (bricks.len() as f64) < self.updates) {
                updates += f64::from(runs[end].sweeps) * VOXELS as f64;
                end += 1;
            }
            let mut brick = bricks.start;
            while brick < bricks.end {
                let count = ((self.updates / updates) as usize).clamp(1, bricks.end - brick);
                let begin = Instant::now();
                dispatch(first..end, brick..brick + count)?;
                let seconds = begin.elapsed().as_secs_f64();
                self.took(updates * count as f64, seconds);
                work.add(seconds);
                brick += count;
            }
            first = end;
        }
        Ok(())
    }

    /// A dispatch of so many updates took this time.
    fn took(&mut self, updates: f64, seconds: f64) {
        // A short dispatch at the end of a slab says little about how many updates would fit.
        if updates < 0.5 * self.updates {
            return;
        }
        let [least, most] = CHANGE.map(|factor| factor * self.updates);
        let fitting = updates * self.dispatch_s / seconds.max(1e-6);
        self.updates = fitting.clamp(least, most).max(LEAST_UPDATES);
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    /// 50 G updates/s, and 50 µs to start.
    fn seconds(updates: f64) -> f64 {
        5e-5 + updates / 50e9
    }

    #[test]
    fn the_work_settles_where_a_dispatch_takes_its_time() {
        let mut pace = Pace::default();
        (0..20).for_each(|_| pace.took(pace.updates, seconds(pace.updates)));
        assert!((seconds(pace.updates) - DISPATCH_S).abs() < 0.1 * DISPATCH_S, "{pace:?}");
    }

    #[test]
    fn one_interruption_halves_it_and_a_remainder_leaves_it() {
        let mut pace = Pace { updates: 1e6, ..Pace::default() };
        pace.took(1e4, 5e-5);
        assert_eq!(pace.updates, 1e6);
        pace.took(1e6, 1.0);
        assert_eq!(pace.updates, 5e5);
    }

    #[test]
    fn every_brick_gets_every_run_once_and_in_order() {
        let runs = [3, 64, 1, 500, 64, 64].map(|sweeps| {
            let mut run = RunParameters::zeroed();
            run.sweeps = sweeps;
            run
        });
        for updates in [64.0, 5e3, 1e5, 1e9] {
            let (mut next, mut work) = ([0; 40], GpuWork::default());
            let mut pace = Pace { updates, ..Pace::default() };
            let count = |some: Range<usize>, bricks: Range<usize>| {
                for brick in bricks {
                    assert_eq!(next[brick], some.start);
                    next[brick] = some.end;
                }
                Ok(())
            };
            pace.add(&runs, &(7..40), &mut work, count).unwrap();
            assert!(next[7..].iter().all(|n| *n == runs.len()) && next[..7] == [0; 7]);
            assert!(work.dispatches >= 1 && work.longest_s <= work.sum_s);
        }
    }
}

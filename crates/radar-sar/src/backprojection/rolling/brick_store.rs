//! The bricks in memory, rolling ones first, and the octree's cubes that they fill.

use rayon::prelude::*;

use super::super::brick_geometry::{BrickShape, VOXELS};
use super::bricks::{Brick, RollBricks, Sums};
use super::octree::Octree;
use super::window::{Change, SweepWindow};
use crate::simd::on_widest;

/// Bricks per parallel task.
const BRICKS_PER_TASK: usize = 512;
/// One in so many idle bricks is checked with each sweep, whether it has been idle too long to be
/// caught up. Choice: a scan costs little, and a brick that is dropped late only takes memory.
const IDLE_SCAN_SWEEPS: usize = 32;

/// Bricks and their sums.
#[derive(Debug, Default)]
pub(super) struct BrickStore {
    /// The first `rolling` include all sweeps of the window, the others those up to when they
    /// became idle.
    bricks: Vec<Brick>,
    sums: Vec<Sums>,
    rolling: usize,
    /// The next idle brick to be checked.
    idle_cursor: usize,
}

impl BrickStore {
    /// Number of bricks updated with every sweep.
    pub(super) fn rolling_count(&self) -> usize {
        self.rolling
    }

    pub(super) fn idle_count(&self) -> usize {
        self.bricks.len() - self.rolling
    }

    pub(super) fn len(&self) -> usize {
        self.bricks.len()
    }

    pub(super) fn get(&self, at: usize) -> (&Brick, &Sums) {
        (&self.bricks[at], &self.sums[at])
    }

    /// The bricks that include all sweeps.
    pub(super) fn rolling(&self) -> impl Iterator<Item = (&Brick, &Sums)> {
        self.bricks[..self.rolling].iter().zip(&self.sums)
    }

    /// Adds one sweep to every rolling brick and subtracts another; returns the updates and the
    /// greatest sum.
    pub(super) fn roll(&mut self, window: &SweepWindow, shape: BrickShape, Change { new, old }: Change) -> (u64, i32) {
        let (stack, number) = (window.stack(), window.newest());
        let bricks = self.bricks[..self.rolling].par_chunks_mut(BRICKS_PER_TASK);
        let parts = bricks.zip(self.sums[..self.rolling].par_chunks_mut(BRICKS_PER_TASK));
        let each = parts.map(|(bricks, sums)| on_widest(RollBricks { stack, shape, bricks, sums, new, old, number }));
        each.reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1.max(b.1)))
    }

    /// Makes rolling bricks idle that are below the limit now.
    pub(super) fn make_idle_below(&mut self, limit: i64, octree: &mut Octree) {
        for brick in (0..self.rolling).rev() {
            if i64::from(self.bricks[brick].greatest) < limit {
                self.rolling -= 1;
                self.swap(brick, self.rolling, octree);
                self.watch_idle(self.rolling, octree);
            }
        }
    }

    /// Stores the sums of an idle brick up to a sweep; returns the greatest.
    pub(super) fn store(&mut self, at: usize, sums: Sums, sweep: u64) -> i32 {
        let greatest = sums.greatest(self.bricks[at].within);
        self.sums[at] = sums;
        (self.bricks[at].sweep, self.bricks[at].greatest) = (sweep, greatest);
        greatest
    }

    /// Lets an idle brick with current sums roll.
    pub(super) fn start_rolling(&mut self, at: usize, octree: &mut Octree) {
        octree.unwatch(self.bricks[at].cube as usize);
        self.swap(at, self.rolling, octree);
        self.rolling += 1;
    }

    /// Watches the bound of an idle brick.
    pub(super) fn watch_idle(&self, brick: usize, octree: &mut Octree) {
        let Brick { cube, greatest, .. } = self.bricks[brick];
        octree.watch(cube as usize, Some(greatest));
    }

    /// Adds an idle brick without sums.
    pub(super) fn add(&mut self, brick: Brick, octree: &mut Octree) -> usize {
        let at = self.bricks.len();
        octree.set_child(brick.cube as usize, at as u32);
        self.bricks.push(brick);
        self.sums.push(Sums::of(&[0; VOXELS]));
        at
    }

    /// Drops the idle brick that is checked next, but not its bound.
    pub(super) fn drop_next_idle(&mut self, octree: &mut Octree) {
        let brick = self.next_idle();
        let cube = self.bricks[brick].cube as usize;
        self.swap(brick, self.bricks.len() - 1, octree);
        octree.clear_child(cube);
        self.bricks.pop();
        self.sums.pop();
    }

    /// Checks some idle bricks in turn and drops those that would cost more to catch up than to sum
    /// afresh. Their bounds remain. Returns their number.
    pub(super) fn drop_stale_idle(&mut self, window: &SweepWindow, octree: &mut Octree) -> u64 {
        let mut dropped = 0;
        for _ in 0..self.idle_count().div_ceil(IDLE_SCAN_SWEEPS) {
            let at = self.next_idle();
            if window.can_catch_up(self.bricks[at].sweep) {
                self.idle_cursor += 1;
            } else {
                self.drop_next_idle(octree);
                dropped += 1;
            }
        }
        dropped
    }

    /// The idle brick to be checked next.
    fn next_idle(&mut self) -> usize {
        if !(self.rolling..self.bricks.len()).contains(&self.idle_cursor) {
            self.idle_cursor = self.rolling;
        }
        self.idle_cursor
    }

    fn swap(&mut self, a: usize, b: usize, octree: &mut Octree) {
        self.bricks.swap(a, b);
        self.sums.swap(a, b);
        for at in [a, b] {
            octree.set_child(self.bricks[at].cube as usize, at as u32);
        }
    }
}

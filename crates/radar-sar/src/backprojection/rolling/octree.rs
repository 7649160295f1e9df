//! The octree of a rolling image: which cubes are open, and the bounds of all.

use rayon::prelude::*;

use super::super::grid::BrickGrid;
use super::octree_bounds::{Bounds, CLOSED, CubeIndex, Octet, RollCubes};
use super::priority_buckets::{Candidate, candidates_of};
use super::window::{Change, SweepWindow};
use crate::simd::on_widest;

/// Octets of cubes, and bricks, per parallel task. Choice: enough work for a task to pay; results
/// do not depend on it.
const OCTETS_PER_TASK: usize = 512;

/// Octets and the bounds of their cubes. Cube `n` of octet `e` has the index 8·e + n.
#[derive(Debug, Default)]
pub(super) struct Octree {
    /// The first contains only the root; the order of the others is irrelevant.
    octets: Vec<Octet>,
    bounds: Vec<Bounds>,
    /// Unused octets.
    free: Vec<u32>,
}

impl Octree {
    pub(super) fn is_empty(&self) -> bool {
        self.octets.is_empty()
    }

    /// Number of cubes.
    pub(super) fn cubes(&self) -> usize {
        (self.octets.len() - self.free.len()) * 8
    }

    /// Each octet with its bounds.
    #[cfg(test)]
    pub(super) fn iter(&self) -> impl Iterator<Item = (&Octet, &Bounds)> {
        self.octets.iter().zip(&self.bounds)
    }

    pub(super) fn cube_index(&self, cube: usize) -> CubeIndex {
        self.octets[cube / 8].cube_index(cube % 8)
    }

    /// Whether the cube is as large as a brick.
    pub(super) fn is_brick(&self, cube: usize) -> bool {
        self.octets[cube / 8].level() == 0
    }

    /// What the cube was opened to, if it was: an octet, or at level 0 a brick.
    pub(super) fn child(&self, cube: usize) -> Option<usize> {
        let child = self.octets[cube / 8].children[cube % 8];
        (child != CLOSED).then_some(child as usize)
    }

    pub(super) fn set_child(&mut self, cube: usize, child: u32) {
        self.octets[cube / 8].children[cube % 8] = child;
    }

    pub(super) fn clear_child(&mut self, cube: usize) {
        self.set_child(cube, CLOSED);
    }

    /// Watches a cube's bound; `most`: the greatest of its sums, if known.
    pub(super) fn watch(&mut self, cube: usize, most: Option<i32>) {
        self.bounds[cube / 8].watch(cube % 8, most);
    }

    /// Stops watching a cube, which is open or rolling.
    pub(super) fn unwatch(&mut self, cube: usize) {
        self.bounds[cube / 8].unwatch(cube % 8);
    }

    /// The watched cubes of an octet that may reach the threshold.
    pub(super) fn candidates(&self, octet: u32, threshold: i64) -> impl Iterator<Item = Candidate> {
        candidates_of(octet, &self.bounds[octet as usize], threshold)
    }

    /// Adds one sweep's bounds to every cube and subtracts another's, and closes cubes below the
    /// limit; returns those that may contain a voxel at the threshold, and the (cube, sweep) pairs
    /// that it took.
    pub(super) fn roll(
        &mut self,
        window: &SweepWindow,
        Change { new, old }: Change,
        threshold: i64,
        limit: i64,
    ) -> (Vec<Candidate>, u64) {
        let (stack, maxima, octets) = (window.stack(), window.maxima(), &self.octets);
        let roll = |(part, of_eights): (usize, &mut [Bounds])| {
            let pairs = on_widest(RollCubes { stack, maxima, octets: &mut *of_eights, new: &[new], old });
            let (mut bare, mut promising) = (Vec::new(), Vec::new());
            for (e, of_eight) in of_eights.iter().enumerate() {
                let (e, greatest) = (part * OCTETS_PER_TASK + e, i64::from(of_eight.greatest));
                if greatest >= threshold {
                    promising.extend(candidates_of(e as u32, of_eight, threshold));
                } else if greatest < limit && octets[e].has_no_children() && octets[e].parent != CLOSED {
                    bare.push(e);
                }
            }
            (pairs, bare, promising)
        };
        let parts: Vec<_> = self.bounds.par_chunks_mut(OCTETS_PER_TASK).enumerate().map(roll).collect();
        let (mut promising, mut all_pairs) = (Vec::new(), 0);
        for (pairs, bare, of_part) in parts {
            all_pairs += pairs;
            bare.into_iter().for_each(|eight| self.close(eight));
            promising.extend(of_part);
        }
        (promising, all_pairs)
    }

    /// Replaces eight cubes by the larger one that they fill.
    fn close(&mut self, eight: usize) {
        let parent = std::mem::replace(&mut self.octets[eight].parent, CLOSED) as usize;
        self.bounds[eight].retire();
        self.free.push(eight as u32);
        self.clear_child(parent);
        self.watch(parent, None);
    }

    /// The eight cubes within each of some cubes, their bounds over the window, and the (cube,
    /// sweep) pairs that took.
    pub(super) fn opened(
        &self,
        cubes: &[usize],
        grid: &BrickGrid,
        window: &SweepWindow,
    ) -> (Vec<Octet>, Vec<Bounds>, u64) {
        let open = |&cube: &usize| {
            let place = self.cube_index(cube);
            Octet::new(place.level - 1, place.at, cube as u32)
        };
        let octets: Vec<Octet> = cubes.iter().map(open).collect();
        let (bounds, pairs) = bounded(&octets, grid, window);
        (octets, bounds, pairs)
    }

    /// Adds an octet that a cube was opened to; returns its index.
    pub(super) fn insert(&mut self, eight: Octet, bounds: Bounds) -> u32 {
        let at = self.free.pop().unwrap_or(self.octets.len() as u32);
        self.set_child(eight.parent as usize, at);
        self.unwatch(eight.parent as usize);
        if at as usize == self.octets.len() {
            self.octets.push(eight);
            self.bounds.push(bounds);
        } else {
            (self.octets[at as usize], self.bounds[at as usize]) = (eight, bounds);
        }
        at
    }

    /// Adds the root of an empty octree.
    pub(super) fn insert_root(&mut self, grid: &BrickGrid, window: &SweepWindow) {
        let most = grid.bricks().into_iter().max().unwrap_or(1);
        let root = Octet::new(most.next_power_of_two().ilog2(), [0; 3], CLOSED);
        let (mut bounds, _) = bounded(std::slice::from_ref(&root), grid, window);
        bounds[0].watch_first_only();
        self.octets.push(root);
        self.bounds.append(&mut bounds);
    }
}

/// Bounds of cubes, summed afresh over the window.
fn bounded(octets: &[Octet], grid: &BrickGrid, window: &SweepWindow) -> (Vec<Bounds>, u64) {
    let (stack, maxima, all) = (window.stack(), window.maxima(), window.all_slots());
    let mut bounds: Vec<_> = octets.iter().map(|eight| Bounds::new(eight, grid, stack)).collect();
    let pairs = on_widest(RollCubes { stack, maxima, octets: &mut bounds, new: &all, old: None });
    (bounds, pairs)
}

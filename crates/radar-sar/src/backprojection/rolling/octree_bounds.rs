//! Octree of a rolling image: cubes with upper bounds of the sums within them. A cube stays closed
//! while its bound is below the threshold.
//!
//! Each cube holds the sum of the window's per-sweep bounds; each new sweep is added to all cubes
//! and the oldest one subtracted. An idle brick has a second bound: the greatest of its sums when
//! it became idle, plus the bounds of all sweeps since. The lesser of the two counts. Data that
//! change with every sweep are stored separately, 96 bytes for eight cubes, because the time goes
//! into streaming through them.

use super::super::bounds::{BoxLanes, RangeMaxima, SweepLanes, bounds};
use super::super::brick_geometry::EDGE;
use super::super::grid::BrickGrid;
use super::super::sweep_stack::SweepStack;
use crate::simd::{Kernel, LANES, Lanes};

/// Position of a cube of 2^level bricks: its index along each axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct CubeIndex {
    pub(super) level: u32,
    pub(super) at: [u32; 3],
}

impl CubeIndex {
    pub(super) fn brick(self) -> [usize; 3] {
        self.at.map(|n| n as usize)
    }

    /// Whether the cube contains a voxel of the grid.
    fn is_within(self, grid: &BrickGrid) -> bool {
        (0..3).all(|axis| ((self.at[axis] as usize) << self.level) * EDGE < grid.size[axis])
    }
}

/// Not opened: the cube's bound is sufficient.
pub(super) const CLOSED: u32 = u32::MAX;
/// The bound of a cube whose sums were never known.
const UNKNOWN: i32 = i32::MAX;

/// Octet: eight sibling cubes that fill a larger one. Cube `n` of octet `e` has the index 8·e + n.
#[derive(Debug, Clone)]
pub(super) struct Octet {
    /// Level of the eight cubes.
    level: u32,
    /// Position of the larger cube.
    at: [u32; 3],
    /// Index of the larger cube; [`CLOSED`] for the root.
    pub(super) parent: u32,
    /// What each cube was opened to: the index of an octet, or at level 0 of a brick; else
    /// [`CLOSED`].
    pub(super) children: [u32; 8],
}

impl Octet {
    pub(super) fn new(level: u32, at: [u32; 3], parent: u32) -> Self {
        Self { level, at, parent, children: [CLOSED; 8] }
    }

    pub(super) fn level(&self) -> u32 {
        self.level
    }

    pub(super) fn cube_index(&self, n: usize) -> CubeIndex {
        let bits = [n & 1, n >> 1 & 1, n >> 2];
        CubeIndex { level: self.level, at: std::array::from_fn(|axis| self.at[axis] * 2 + bits[axis] as u32) }
    }

    /// Whether none of the cubes is open.
    pub(super) fn has_no_children(&self) -> bool {
        self.children == [CLOSED; 8]
    }
}

/// The bounds of eight cubes.
#[derive(Debug, Clone)]
#[repr(align(32))]
pub(super) struct Bounds {
    /// The sum of the window's bounds. Each sweep's bound is limited so that the sum fits 32 bits.
    sum: [i32; 8],
    /// Greatest possible sum of an idle brick according to its own sums.
    most: [i32; 8],
    /// Centre of the larger cube, metres from the stack's origin.
    center_m: [f32; 3],
    /// Distance from it to the centres of the eight along an axis, metres.
    apart_m: f32,
    /// Half of the edge between the outermost voxel centres of a cube, metres; rounded up slightly.
    half_m: f32,
    /// The greatest watched bound after the last sweep, or 0.
    pub(super) greatest: i32,
    /// Bit n: cube n lies in the grid and is in use.
    in_use: u8,
    /// Bit n: cube n is neither opened nor a rolling brick, so its bound must be watched.
    watched: u8,
}

impl Bounds {
    /// For an octet without any sweep yet.
    pub(super) fn new(eight: &Octet, grid: &BrickGrid, stack: &SweepStack) -> Self {
        let edge_m = (EDGE << eight.level) as f64 * grid.voxel_m;
        let middle = glam::DVec3::from_array(eight.at.map(|n| (f64::from(n) + 0.5) * 2.0 * edge_m));
        let within = (0..8).filter(|&n| eight.cube_index(n).is_within(grid)).fold(0, |bits, n| bits | 1 << n);
        Self {
            sum: [0; 8],
            most: [UNKNOWN; 8],
            center_m: (grid.origin_m - stack.origin_m() + middle).as_vec3().to_array(),
            apart_m: (0.5 * edge_m) as f32,
            half_m: (0.5 * (edge_m - grid.voxel_m)) as f32 + 1e-6,
            greatest: 0,
            in_use: within,
            watched: within,
        }
    }

    /// Marks the octet as unused.
    pub(super) fn retire(&mut self) {
        (self.in_use, self.watched, self.greatest) = (0, 0, 0);
    }

    fn is_in_use(&self) -> bool {
        self.in_use != 0
    }

    /// Uses and watches only cube 0.
    pub(super) fn watch_first_only(&mut self) {
        (self.in_use, self.watched) = (1, 1);
    }

    pub(super) fn is_watched(&self, n: usize) -> bool {
        self.watched >> n & 1 == 1
    }

    /// Upper bound of the sums within cube `n`.
    pub(super) fn bound(&self, n: usize) -> i32 {
        self.sum[n].min(self.most[n])
    }

    /// Watches cube `n` from now on; `most`: the greatest of its sums, if known.
    pub(super) fn watch(&mut self, n: usize, most: Option<i32>) {
        self.watched |= 1 << n;
        self.most[n] = most.unwrap_or(UNKNOWN);
    }

    /// Stops watching cube `n`, which is open or rolling.
    pub(super) fn unwatch(&mut self, n: usize) {
        self.watched &= !(1 << n);
    }
}

/// Sign of each cube's centre relative to the larger cube's, for eight cubes twice.
const SIDES: [[f32; LANES]; 3] = {
    let mut sides = [[-1.0; LANES]; 3];
    let mut n = 0;
    while n < LANES {
        let mut axis = 0;
        while axis < 3 {
            if n >> axis & 1 == 1 {
                sides[axis][n] = 1.0;
            }
            axis += 1;
        }
        n += 1;
    }
    sides
};

/// Adds sweeps' bounds to those of cubes and subtracts another sweep's; returns the (cube, sweep)
/// pairs.
pub(super) struct RollCubes<'a> {
    pub(super) stack: &'a SweepStack,
    pub(super) maxima: &'a RangeMaxima,
    pub(super) octets: &'a mut [Bounds],
    /// One sweep after the other, because the tables of one sweep then stay in the cache.
    pub(super) new: &'a [usize],
    pub(super) old: Option<usize>,
}

impl Kernel for RollCubes<'_> {
    type Out = u64;

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) -> u64 {
        let Self { stack, maxima, octets, new, old } = self;
        let mut pairs = 0;
        for slot in new {
            let sweep = SweepLanes::one(s, &stack.groups[slot / LANES], *slot, maxima);
            for two in octets.chunks_mut(2).filter(|two| two.iter().any(Bounds::is_in_use)) {
                let come = s.store_int(bounds(s, stack, maxima, &sweep, &two_octets(s, two)));
                for (eight, come) in two.iter_mut().zip(come.as_chunks::<8>().0) {
                    // Unused ones must not be updated: they miss sweeps and would drift.
                    if !eight.is_in_use() {
                        continue;
                    }
                    pairs += u64::from(eight.in_use.count_ones());
                    for ((sum, most), come) in eight.sum.iter_mut().zip(&mut eight.most).zip(come) {
                        *sum += come;
                        *most += (*come).min(UNKNOWN - *most);
                    }
                }
            }
        }
        if let Some(old) = old {
            let sweep = SweepLanes::one(s, &stack.groups[old / LANES], old, maxima);
            for two in octets.chunks_mut(2).filter(|two| two.iter().any(Bounds::is_in_use)) {
                let go = s.store_int(bounds(s, stack, maxima, &sweep, &two_octets(s, two)));
                for (eight, go) in two.iter_mut().zip(go.as_chunks::<8>().0) {
                    // Unused ones must not be updated: they miss sweeps and would drift.
                    if !eight.is_in_use() {
                        continue;
                    }
                    pairs += u64::from(eight.in_use.count_ones());
                    for (sum, go) in eight.sum.iter_mut().zip(go) {
                        *sum -= go;
                    }
                }
            }
        }
        for eight in octets {
            eight.greatest = 0;
            for n in 0..8 {
                let watched = i32::from(eight.watched >> n & 1);
                eight.greatest = eight.greatest.max(eight.sum[n].min(eight.most[n]) * watched);
            }
        }
        pairs
    }
}

/// The cubes of two octets, or those of one twice.
#[inline(always)]
fn two_octets<S: Lanes>(s: S, two: &[Bounds]) -> BoxLanes<S> {
    let (a, b) = (&two[0], &two[two.len() - 1]);
    let apart = s.splat_two(a.apart_m, b.apart_m);
    let (x, y, z) = (&SIDES[0], &SIDES[1], &SIDES[2]);
    let center = [
        s.mul_add(apart, s.load(x), s.splat_two(a.center_m[0], b.center_m[0])),
        s.mul_add(apart, s.load(y), s.splat_two(a.center_m[1], b.center_m[1])),
        s.mul_add(apart, s.load(z), s.splat_two(a.center_m[2], b.center_m[2])),
    ];
    let half = s.splat_two(a.half_m, b.half_m);
    // Slightly more than √3.
    BoxLanes { center, half: [half; 3], radius: s.mul(half, s.splat(1.732_051)) }
}

//! What a rolling image keeps alive (cubes with their bounds, bricks with their sums), and how one sweep is added to all of
//! them while another is taken out: sixteen cubes or bricks before one sweep at a time.

use super::bounds::{RangeMaxima, SweepLanes, VoxelBox, bounds, box_lanes};
use super::dispatch::Kernel;
use super::lanes::{LANES, Lanes};
use super::power::{AddPower, add_inside};
use super::sight::{BrickShape, EDGE, Offsets, Sight, VOXELS, load3};
use super::stack::SweepStack;

/// Where a cube of 2^level bricks lies: its number along each axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Place {
    pub(super) level: u32,
    pub(super) at: [u32; 3],
}

impl Place {
    pub(super) fn brick(self) -> [usize; 3] {
        self.at.map(|n| n as usize)
    }
}

/// Not opened: the cube's bound says enough.
pub(super) const CLOSED: u32 = u32::MAX;

/// Eight cubes that fill a larger one, side by side as the kernel takes them. Cube `n` of eight `e` has the index 8·e + n.
#[derive(Debug, Clone)]
pub(super) struct Eight {
    /// Of the cubes.
    pub(super) level: u32,
    /// Of the larger cube.
    pub(super) at: [u32; 3],
    /// Bit n: cube n lies in the grid and is in use.
    pub(super) alive: u8,
    /// `[axis][cube]`, see [`VoxelBox`].
    pub(super) center_m: [[f32; 8]; 3],
    pub(super) half_m: [[f32; 8]; 3],
    pub(super) bound: [i64; 8],
    /// What each has been opened to: an eight, or at level 0 a brick.
    pub(super) opened: [u32; 8],
}

impl Eight {
    pub(super) fn new(level: u32, at: [u32; 3]) -> Self {
        let (center_m, half_m) = ([[0.0; 8]; 3], [[0.0; 8]; 3]);
        Self { level, at, alive: 0, center_m, half_m, bound: [0; 8], opened: [CLOSED; 8] }
    }

    pub(super) fn place(&self, n: usize) -> Place {
        let bits = [n & 1, n >> 1 & 1, n >> 2];
        Place { level: self.level, at: std::array::from_fn(|axis| self.at[axis] * 2 + bits[axis] as u32) }
    }

    pub(super) fn put(&mut self, n: usize, of: &VoxelBox, bound: i64) {
        self.alive |= 1 << n;
        self.bound[n] = bound;
        for axis in 0..3 {
            (self.center_m[axis][n], self.half_m[axis][n]) = (of.center_m[axis], of.half_m[axis]);
        }
    }
}

#[derive(Debug, Clone)]
pub(super) struct Brick {
    pub(super) place: Place,
    /// Index of the cube that it fills.
    pub(super) cube: u32,
    pub(super) center: [f32; 3],
    /// Bit n: voxel n lies within the grid.
    pub(super) within: u64,
}

/// A brick's steps, layer by layer; apart from the rest, so that rolling streams through them.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(super) struct Sums(pub(super) [[i32; LANES]; EDGE]);

impl Sums {
    pub(super) fn greatest(&self, within: u64) -> i32 {
        let each = self.0.as_flattened().iter().enumerate();
        each.map(|(n, sum)| if within >> n & 1 == 1 { *sum } else { 0 }).fold(0, i32::max)
    }
}

/// Adds one sweep to each brick and takes another out; gives the updates and the greatest sum.
pub(super) struct RollBricks<'a> {
    pub(super) stack: &'a SweepStack,
    pub(super) shape: BrickShape,
    pub(super) bricks: &'a [Brick],
    pub(super) sums: &'a mut [Sums],
    pub(super) new: usize,
    pub(super) old: Option<usize>,
}

impl Kernel for RollBricks<'_> {
    type Out = (u64, i32);

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) -> (u64, i32) {
        let Self { stack, shape, bricks, sums, new, old } = self;
        let offsets = Offsets::new(s, &shape);
        let (mut updates, mut greatest) = (0, 0);
        let mut most = s.splat_int(0);
        for (sixteen, sums) in bricks.chunks(LANES).zip(sums.chunks_mut(LANES)) {
            let comes = one_before_bricks(s, stack, &shape, sixteen, new);
            let goes = one_before_bricks(s, stack, &shape, sixteen, old.unwrap_or(new));
            for (l, (brick, sums)) in sixteen.iter().zip(sums).enumerate() {
                let mut more = [s.splat_int(0); EDGE];
                updates += add_one(s, stack, &shape, &comes, l, new, brick.center, &offsets, &mut more);
                let mut less = [s.splat_int(0); EDGE];
                if let Some(old) = old {
                    updates += add_one(s, stack, &shape, &goes, l, old, brick.center, &offsets, &mut less);
                }
                let mut most_here = most;
                for layer in 0..EDGE {
                    let sum = s.add_int(s.load_int(&sums.0[layer]), s.sub_int(more[layer], less[layer]));
                    sums.0[layer] = s.store_int(sum);
                    most_here = s.max_int(most_here, sum);
                }
                if brick.within == u64::MAX {
                    most = most_here;
                } else {
                    greatest = greatest.max(sums.greatest(brick.within));
                }
            }
        }
        for lane in s.store_int(most) {
            greatest = greatest.max(lane);
        }
        (updates, greatest)
    }
}

/// How one sweep sees sixteen bricks: the same as sixteen sweeps, each as far from one brick as this one is from each.
#[inline(always)]
fn one_before_bricks<S: Lanes>(s: S, stack: &SweepStack, shape: &BrickShape, bricks: &[Brick], slot: usize) -> Sight {
    let (group, of) = (&stack.groups[slot / LANES], slot % LANES);
    let mut sixteen = group.clone();
    for l in 0..LANES {
        let center = bricks[l.min(bricks.len() - 1)].center;
        for (axis, center) in center.into_iter().enumerate() {
            sixteen.position_m[axis][l] = group.position_m[axis][of] - center;
            sixteen.velocity_m_per_s[axis][l] = group.velocity_m_per_s[axis][of];
            sixteen.forward[axis][l] = group.forward[axis][of];
        }
        sixteen.first_m[l] = group.first_m[of];
        sixteen.last_m[l] = group.last_m[of];
        sixteen.entries_per_m[l] = group.entries_per_m[of];
        sixteen.time_s_per_m[l] = group.time_s_per_m[of];
        sixteen.time_at_zero_s[l] = group.time_at_zero_s[of];
    }
    Sight::new(s, stack, &sixteen, [0.0; 3], shape)
}

/// Adds one sweep to brick `l` of sixteen; returns the updates.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn add_one<S: Lanes>(
    s: S,
    stack: &SweepStack,
    shape: &BrickShape,
    sight: &Sight,
    l: usize,
    slot: usize,
    center: [f32; 3],
    offsets: &Offsets<S>,
    sums: &mut [S::I; EDGE],
) -> u64 {
    if sight.inside >> l & 1 == 1 {
        add_inside(s, sight, l, stack.table(slot, 0), stack.stride, offsets, sums);
        return VOXELS as u64;
    }
    if sight.edge >> l & 1 == 1 {
        let slots = [(slot / LANES, 1 << (slot % LANES))];
        let found = AddPower { stack, shape: *shape, center, slots: &slots }.sums();
        for (layer, sums) in sums.iter_mut().enumerate() {
            let mut lanes = [0; LANES];
            for (lane, sum) in lanes.iter_mut().zip(&found.sums[layer * LANES..]) {
                *lane = *sum as i32;
            }
            *sums = s.load_int(&lanes);
        }
        return found.updates;
    }
    0
}

/// Adds one sweep's bound to each cube's and takes another's out; gives the number of cubes.
pub(super) struct RollCubes<'a> {
    pub(super) stack: &'a SweepStack,
    pub(super) maxima: &'a RangeMaxima,
    pub(super) eights: &'a mut [Eight],
    pub(super) new: usize,
    pub(super) old: Option<usize>,
}

impl Kernel for RollCubes<'_> {
    type Out = u64;

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) -> u64 {
        let Self { stack, maxima, eights, new, old } = self;
        let mut cubes = 0;
        for two in eights.chunks_mut(2) {
            if two.iter().fold(0, |alive, eight| alive | eight.alive) == 0 {
                continue;
            }
            let (mut center, mut half) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
            for (k, eight) in two.iter().enumerate() {
                cubes += u64::from(eight.alive.count_ones());
                for axis in 0..3 {
                    center[axis][k * 8..k * 8 + 8].copy_from_slice(&eight.center_m[axis]);
                    half[axis][k * 8..k * 8 + 8].copy_from_slice(&eight.half_m[axis]);
                }
            }
            let (center, half) = (load3(s, &center), load3(s, &half));
            let sweep = SweepLanes::one(s, &stack.groups[new / LANES], new, maxima);
            let more = bounds(s, stack, maxima, &sweep, center, half);
            let mut less = [0; LANES];
            if let Some(old) = old {
                let sweep = SweepLanes::one(s, &stack.groups[old / LANES], old, maxima);
                less = bounds(s, stack, maxima, &sweep, center, half);
            }
            for (k, eight) in two.iter_mut().enumerate() {
                for n in 0..8 {
                    eight.bound[n] += i64::from(more[k * 8 + n]) - i64::from(less[k * 8 + n]);
                }
            }
        }
        cubes
    }
}

/// The sum of all sweeps' bounds for a box.
pub(super) struct SumBounds<'a> {
    pub(super) stack: &'a SweepStack,
    pub(super) maxima: &'a RangeMaxima,
    pub(super) of: VoxelBox,
}

impl Kernel for SumBounds<'_> {
    type Out = i64;

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) -> i64 {
        let (center, half) = box_lanes(s, &self.of);
        let mut sum = 0i64;
        for (index, group) in self.stack.groups.iter().enumerate() {
            let sweeps = SweepLanes::group(s, group, index, self.maxima);
            for of_sweep in bounds(s, self.stack, self.maxima, &sweeps, center, half) {
                sum += i64::from(of_sweep);
            }
        }
        sum
    }
}

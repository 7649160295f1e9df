//! Bricks of a rolling image. Those that may reach the threshold are rolling: updated with every
//! sweep. The others are idle until they may reach it again, and are then caught up.
//!
//! Rolling processes sixteen bricks for one sweep at a time; catching up processes one brick for
//! all the sweeps added and removed since.

use super::super::brick_geometry::{BrickShape, EDGE, Offsets, Sight, Sweeps, VOXELS};
use super::super::power::{AddPower, Rays, add_inside};
use super::super::sweep_stack::SweepStack;
use crate::simd::{Kernel, LANES, Lanes, load3};

/// A brick of voxels.
#[derive(Debug, Clone)]
pub(super) struct Brick {
    pub(super) center: [f32; 3],
    /// Index of the cube that it fills.
    pub(super) cube: u32,
    /// Bit n: voxel n lies within the grid.
    pub(super) within: u64,
    /// Number of the last sweep included in the sums.
    pub(super) sweep: u64,
    /// Greatest sum of its voxels.
    pub(super) greatest: i32,
}

/// A brick's sums in steps, layer by layer; stored apart from the rest, because rolling streams
/// through them.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(super) struct Sums(pub(super) [[i32; LANES]; EDGE]);

impl Sums {
    pub(super) fn greatest(&self, within: u64) -> i32 {
        let each = self.0.as_flattened().iter().enumerate();
        each.map(|(n, sum)| if within >> n & 1 == 1 { *sum } else { 0 }).fold(0, i32::max)
    }

    /// From 64-bit sums; each sweep's contribution is limited so that sums fit 32 bits.
    pub(super) fn of(sums: &[i64; VOXELS]) -> Self {
        let mut narrow = Self([[0; LANES]; EDGE]);
        narrow.0.as_flattened_mut().iter_mut().zip(sums).for_each(|(to, sum)| *to = *sum as i32);
        narrow
    }

    /// With the sums of added sweeps added and those of removed sweeps subtracted.
    pub(super) fn caught_up(&self, came: &[i64; VOXELS], went: &[i64; VOXELS]) -> Self {
        let mut now = *self;
        let changes = came.iter().zip(went).map(|(came, went)| (came - went) as i32);
        now.0.as_flattened_mut().iter_mut().zip(changes).for_each(|(sum, change)| *sum += change);
        now
    }
}

/// Adds one sweep to each brick and subtracts another; returns the updates and the greatest sum.
pub(super) struct RollBricks<'a> {
    pub(super) stack: &'a SweepStack,
    pub(super) shape: BrickShape,
    pub(super) bricks: &'a mut [Brick],
    pub(super) sums: &'a mut [Sums],
    pub(super) new: usize,
    pub(super) old: Option<usize>,
    /// Number of the new sweep.
    pub(super) number: u64,
}

impl Kernel for RollBricks<'_> {
    type Out = (u64, i32);

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) -> (u64, i32) {
        let Self { stack, shape, bricks, sums, new, old, number } = self;
        let offsets = Offsets::new(s, &shape);
        let comes = Sweeps::one(s, &stack.groups[new / LANES], new % LANES);
        let gone = old.unwrap_or(new);
        let goes = Sweeps::one(s, &stack.groups[gone / LANES], gone % LANES);
        let (mut updates, mut greatest) = (0, 0);
        for (sixteen, sums) in bricks.chunks_mut(LANES).zip(sums.chunks_mut(LANES)) {
            let mut center = [[0.0; LANES]; 3];
            for (l, brick) in sixteen.iter().enumerate() {
                (center[0][l], center[1][l], center[2][l]) = (brick.center[0], brick.center[1], brick.center[2]);
            }
            let center = load3(s, &center);
            let comes = BrickSights::new(s, stack, &comes, center, &shape);
            let goes = BrickSights::new(s, stack, &goes, center, &shape);
            for (l, (brick, sums)) in sixteen.iter_mut().zip(sums).enumerate() {
                let mut more = [s.splat_int(0); EDGE];
                updates += add_one(s, stack, &shape, &comes, l, new, brick.center, &offsets, &mut more);
                let mut less = [s.splat_int(0); EDGE];
                if let Some(old) = old {
                    updates += add_one(s, stack, &shape, &goes, l, old, brick.center, &offsets, &mut less);
                }
                let mut most = s.splat_int(0);
                for layer in 0..EDGE {
                    let sum = s.add_int(s.load_int(&sums.0[layer]), s.sub_int(more[layer], less[layer]));
                    sums.0[layer] = s.store_int(sum);
                    most = s.max_int(most, sum);
                }
                brick.sweep = number;
                brick.greatest = 0;
                if brick.within == u64::MAX {
                    for lane in s.store_int(most) {
                        brick.greatest = brick.greatest.max(lane);
                    }
                } else {
                    brick.greatest = sums.greatest(brick.within);
                }
                greatest = greatest.max(brick.greatest);
            }
        }
        (updates, greatest)
    }
}

/// Sixteen bricks as one sweep sees them.
struct BrickSights {
    sight: Sight,
    rays: Rays,
}

impl BrickSights {
    #[inline(always)]
    fn new<S: Lanes>(s: S, stack: &SweepStack, sweep: &Sweeps<S>, center: [S::F; 3], shape: &BrickShape) -> Self {
        let sight = Sight::between(s, stack, sweep, center, shape);
        let mut rays = Rays::NONE;
        rays.set(s, &sight, sweep.coarse_per_entry, shape);
        Self { sight, rays }
    }
}

/// Adds one sweep to brick `l` of sixteen; returns the updates.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn add_one<S: Lanes>(
    s: S,
    stack: &SweepStack,
    shape: &BrickShape,
    BrickSights { sight, rays }: &BrickSights,
    l: usize,
    slot: usize,
    center: [f32; 3],
    offsets: &Offsets<S>,
    sums: &mut [S::I; EDGE],
) -> u64 {
    if sight.inside >> l & 1 == 1 {
        add_inside(s, stack, slot, rays, l, offsets, sums);
        return VOXELS as u64;
    }
    if sight.edge >> l & 1 == 1 {
        let slots = [(slot / LANES, 1 << (slot % LANES))];
        let found = AddPower { stack, shape: *shape, center, slots: &slots }.sums();
        let narrow = Sums::of(&found.sums);
        for (layer, sums) in sums.iter_mut().enumerate() {
            *sums = s.load_int(&narrow.0[layer]);
        }
        return found.updates;
    }
    0
}

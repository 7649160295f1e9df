//! Integer sums over a brick: `ls` and `log`.
//!
//! Each sweep adds to each voxel its table value at the voxel's distance, rounded to whole steps.
//! The sum therefore depends neither on the order of the sweeps nor on earlier additions and
//! subtractions: rolling, adaptive and dense images are equal bit for bit. 32-bit sums are moved to
//! 64 bits before they could overflow.
//!
//! Bound: with AVX2, a sweep over a brick of coarse voxels takes 36 multiply-adds, 24 permutes, 16
//! conversions and 12 additions of eight lanes, 22 cycles on the four ports of Zen 4. Measured there
//! (`cargo bench -p radar-sar --bench backprojection`): 50, with AVX-512 40, and 170 for the geometry of a
//! group. In a loop of their own, lookups take 25: permutes and multiply-adds share a port.

use super::brick_geometry::{BrickShape, Distances, EDGE, Offsets, Sight, VOXELS};
use super::curves::{Curves, LinearWindow};
use super::dense::BrickRow;
use super::edge_geometry::{AtEdge, DISTANCE_ERROR_M, Edges, Exact, FromPoses, from_sensor, fully_visible, read};
use super::places::{Expansion, Windows};
use super::sweep_stack::{Parabolas, SweepStack, WINDOW};
use crate::simd::{Kernel, LANES, Lanes, Part, on_widest};

/// Choice: two hide most of the latency.
const GROUPS_AT_ONCE: usize = 2;

/// A brick shape accurate enough for these sums.
pub(super) fn power_shape(voxel_m: f64) -> BrickShape {
    BrickShape::new(voxel_m, DISTANCE_ERROR_M)
}

/// Sums sweeps of a stack over the voxels of one brick.
#[derive(Clone)]
pub(super) struct AddPower<'a> {
    pub stack: &'a SweepStack,
    pub shape: BrickShape,
    /// Centre of the brick relative to the stack's origin, metres.
    pub center: [f32; 3],
    /// Sweeps, as groups with masks of their lanes.
    pub slots: &'a [(usize, u16)],
}

/// Sums in steps, x fastest, and the (voxel, sweep) pairs processed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct PowerSums {
    pub sums: [i64; VOXELS],
    pub updates: u64,
}

impl AddPower<'_> {
    /// Runs on the widest instructions.
    pub(super) fn sums(self) -> PowerSums {
        on_widest(self)
    }
}

impl Kernel for AddPower<'_> {
    type Out = PowerSums;

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) -> PowerSums {
        let (inner, outer, updates) = self.accumulate(s, &mut Geometry::new());
        let mut sums = [0; VOXELS];
        inner.add_to(s, &mut sums);
        outer.add_to(s, &mut sums);
        PowerSums { sums, updates }
    }
}

/// Writes values of the statistic at a row of bricks into their slab; returns the updates.
pub(super) struct FillRow<'a> {
    pub stack: &'a SweepStack,
    pub shape: BrickShape,
    /// See [`AddPower::slots`].
    pub slots: &'a [(usize, u16)],
    pub row: BrickRow<'a>,
    pub slab: &'a mut [f32],
}

impl Kernel for FillRow<'_> {
    type Out = u64;

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) -> u64 {
        let Self { stack, shape, slots, row, slab } = self;
        let (mut geometry, mut updates) = (Geometry::new(), 0);
        for x in 0..row.bricks() {
            let (values, worked) = AddPower { stack, shape, center: row.center(x), slots }.values(s, &mut geometry);
            row.put(x, &values, slab);
            updates += worked;
        }
        updates
    }
}

impl AddPower<'_> {
    /// Values of the statistic, and the updates.
    #[inline(always)]
    fn values<S: Lanes>(&self, s: S, geometry: &mut Geometry) -> ([f32; VOXELS], u64) {
        let (inner, outer, updates) = self.accumulate(s, geometry);
        let mut values = [0.0; VOXELS];
        if inner.wide.is_none() && outer.wide.is_none() && inner.greatest + outer.greatest <= i64::from(i32::MAX) {
            // The step is a power of two, so this rounds as `value_of` does.
            let step = s.splat(self.stack.step() as f32);
            for (layer, values) in values.as_chunks_mut().0.iter_mut().enumerate() {
                let sum = s.max_int(s.add_int(inner.narrow[layer], outer.narrow[layer]), s.splat_int(0));
                *values = s.store(s.mul(s.to_float(sum), step));
            }
            return (values, updates);
        }
        let mut sums = [0; VOXELS];
        inner.add_to(s, &mut sums);
        outer.add_to(s, &mut sums);
        for (value, sum) in values.iter_mut().zip(sums) {
            *value = self.stack.value_of(sum);
        }
        (values, updates)
    }

    /// Sums of the sweeps that see the whole brick, of the others, and the updates.
    #[inline(always)]
    fn accumulate<S: Lanes>(&self, s: S, geometry: &mut Geometry) -> (Accumulator<S>, Accumulator<S>, u64) {
        let offsets = Offsets::new(s, &self.shape);
        let (mut inner, mut outer) = (Accumulator::new(s), Accumulator::new(s));
        let (mut narrow, mut updates) = (inner.narrow, 0);
        // Some groups at once: while the first's sweeps are added, the geometry of the last is still on
        // its way through square roots and divisions.
        let Geometry { distances, rays } = geometry;
        for some in self.slots.chunks(GROUPS_AT_ONCE) {
            let mut inside = [0; GROUPS_AT_ONCE];
            for (n, &(group, _)) in some.iter().enumerate() {
                distances[n].set(s, &self.stack.groups[group], self.center);
            }
            // Zipped iterators would not be compiled for the kernel's instructions.
            for (n, &(group, lanes)) in some.iter().enumerate() {
                let sweeps = &self.stack.groups[group];
                let sight = Sight::at(s, self.stack, sweeps, &distances[n], self.center, &self.shape);
                let edge = sight.edge & lanes;
                inside[n] = sight.inside & lanes;
                updates += u64::from(inside[n].count_ones() + edge.count_ones()) * VOXELS as u64;
                if edge != 0 {
                    s.apart(AddEdges { brick: self, group, sight: &sight, edge, sums: &mut outer });
                }
                if inside[n] != 0 {
                    rays[n].set(s, &sight, s.load(&sweeps.coarse_per_entry), &self.shape);
                }
            }
            for (n, &(group, _)) in some.iter().enumerate() {
                let (rays, mut rest) = (&rays[n], inside[n]);
                while rest != 0 {
                    let l = rest.trailing_zeros() as usize;
                    rest &= rest - 1;
                    let slot = group * LANES + l;
                    inner.expect(s, self.stack.greatest(slot), &mut narrow);
                    add_inside(s, self.stack, slot, rays, l, &offsets, &mut narrow);
                }
            }
        }
        inner.narrow = narrow;
        (inner, outer, updates)
    }
}

/// Room for the geometry of the groups at hand, reused from brick to brick: clearing it would take
/// as long as some sweeps.
struct Geometry {
    distances: [Distances; GROUPS_AT_ONCE],
    rays: [Rays; GROUPS_AT_ONCE],
}

impl Geometry {
    fn new() -> Self {
        Self { distances: [Distances::NONE; GROUPS_AT_ONCE], rays: [Rays::NONE; GROUPS_AT_ONCE] }
    }
}

/// Adds sweeps that may not see every voxel.
struct AddEdges<'a, S: Lanes> {
    brick: &'a AddPower<'a>,
    group: usize,
    sight: &'a Sight,
    edge: u16,
    sums: &'a mut Accumulator<S>,
}

impl<S: Lanes> Part<S> for AddEdges<'_, S> {
    type Out = ();

    #[inline(always)]
    fn run(self, s: S) {
        let Self { brick, group, sight, mut edge, sums } = self;
        let (stack, shape, sweeps) = (brick.stack, &brick.shape, &brick.stack.groups[group]);
        let (offsets, heights) = (Offsets::new(s, shape), shape.heights());
        let wide = edge & sight.wide;
        // A wide window spans at most a window of such coarse entries.
        let per_entry = s.load(&sweeps.coarse_per_entry);
        let parabolic = s.mask_bits(s.at_most(per_entry, s.splat(0.25)));
        let mut whole = 0;
        if wide != 0 {
            let poses = FromPoses::new(s, sweeps, brick.center);
            whole = wide & fully_visible(s, stack, group, (sight, &poses), shape);
            edge &= !whole;
        }
        let coarse = sight.windows.coarse(s, per_entry);
        let mut narrow = sums.narrow;
        while whole != 0 {
            let l = whole.trailing_zeros() as usize;
            whole &= whole - 1;
            let slot = group * LANES + l;
            sums.expect(s, stack.greatest(slot), &mut narrow);
            let exact = Exact::new(s, from_sensor(sight, l), &offsets, heights);
            if parabolic >> l & 1 == 1 {
                add_exact_parabolic(s, sight, &coarse, l, &stack.parabolas(slot), &exact, &mut narrow);
            } else {
                add_exact(s, sight, l, stack.values(slot), &exact, &mut narrow);
            }
        }
        while edge != 0 {
            let l = edge.trailing_zeros() as usize;
            edge &= edge - 1;
            sums.expect(s, stack.greatest(group * LANES + l), &mut narrow);
            let edges = Edges::new(s, stack, group, brick.center, l, &offsets, heights);
            if (wide & parabolic) >> l & 1 == 1 {
                add_edge_parabolic(s, stack, group, &coarse, l, &edges, &offsets, &mut narrow);
            } else {
                add_edge(s, stack, group, sight, l, &edges, &offsets, &mut narrow);
            }
        }
        sums.narrow = narrow;
    }
}

/// Sums over a brick: in 32 bits as long as they fit.
struct Accumulator<S: Lanes> {
    narrow: [S::I; EDGE],
    /// Greatest possible value of the narrow sums.
    greatest: i64,
    /// What no longer fitted.
    wide: Option<[i64; VOXELS]>,
}

impl<S: Lanes> Accumulator<S> {
    #[inline(always)]
    fn new(s: S) -> Self {
        Self { narrow: [s.splat_int(0); EDGE], greatest: 0, wide: None }
    }

    /// Makes room for a sweep that adds at most so much. `narrow`: the narrow sums, which a loop over
    /// sweeps keeps in registers.
    #[inline(always)]
    fn expect(&mut self, s: S, most: i64, narrow: &mut [S::I; EDGE]) {
        self.greatest += most;
        if self.greatest > i64::from(i32::MAX) {
            add_wide(s, narrow, self.wide.get_or_insert([0; VOXELS]));
            (*narrow, self.greatest) = ([s.splat_int(0); EDGE], most);
        }
    }

    #[inline(always)]
    fn add_to(&self, s: S, sums: &mut [i64; VOXELS]) {
        add_wide(s, &self.narrow, sums);
        if let Some(wide) = &self.wide {
            for (sum, wide) in sums.iter_mut().zip(wide) {
                *sum += wide;
            }
        }
    }
}

#[inline(always)]
fn add_wide<S: Lanes>(s: S, narrow: &[S::I; EDGE], wide: &mut [i64; VOXELS]) {
    for (layer, sum) in narrow.iter().enumerate() {
        let values = s.store_int(*sum);
        for (l, value) in values.iter().enumerate() {
            wide[layer * LANES + l] += i64::from(*value);
        }
    }
}

/// Adds a sweep that sees the whole brick. The window of the tables is in registers; the fewer entries
/// it needs, the fewer permutes where registers have eight lanes.
#[inline(always)]
pub(super) fn add_inside<S: Lanes>(
    s: S,
    stack: &SweepStack,
    slot: usize,
    rays: &Rays,
    l: usize,
    offsets: &Offsets<S>,
    sums: &mut [S::I; EDGE],
) {
    let expansion = &rays.expansion;
    let places = expansion.places(s, l, offsets);
    let first = expansion.windows.first[l] as usize;
    if rays.within_8 >> l & 1 == 1 {
        let Some(lines) = Curves::<S, 2>::new(s, stack.table(slot, 0), first) else { return };
        add_values(s, &lines, places, sums);
    } else if rays.within_8_coarse >> l & 1 == 1 {
        let Some(window) = stack.parabolas(slot).window(first) else { return };
        add_values(s, &Curves::parabolas(s, window), places, sums);
    } else {
        // An entry at most half as fine: a brick that spans a window spans half of it.
        let Some(window) = stack.parabolas(slot).window::<{ WINDOW / 2 }>(first) else { return };
        for (sum, place) in sums.iter_mut().zip(places) {
            *sum = s.add_int(*sum, s.to_int(on_parabolas(s, window, place)));
        }
    }
}

#[inline(always)]
fn add_values<S: Lanes, const TERMS: usize>(
    s: S,
    curves: &Curves<S, TERMS>,
    places: [S::F; EDGE],
    sums: &mut [S::I; EDGE],
) {
    for (sum, place) in sums.iter_mut().zip(places) {
        *sum = s.add_int(*sum, s.to_int(curves.at(s, place)));
    }
}

/// Geometry of sixteen sweeps that see a whole brick, or of one sweep that sees sixteen bricks.
pub(super) struct Rays {
    expansion: Expansion,
    /// Lanes whose windows are eight entries, or eight coarse ones; the others' are wider.
    within_8: u16,
    within_8_coarse: u16,
}

impl Rays {
    pub(super) const NONE: Self = Self { expansion: Expansion::NONE, within_8: 0, within_8_coarse: 0 };

    /// `per_entry`: coarse entries per table entry.
    #[inline(always)]
    pub(super) fn set<S: Lanes>(&mut self, s: S, sight: &Sight, per_entry: S::F, shape: &BrickShape) {
        let fine = sight.within_8;
        let per_entry = s.add(s.or_zero(s.mask(fine), s.splat(1.0)), s.or_zero(s.mask(!fine), per_entry));
        self.expansion.set(s, sight, sight.windows.coarse(s, per_entry), shape);
        (self.within_8, self.within_8_coarse) = (fine, sight.within_8_coarse);
    }
}

/// Values at positions in coarse entries from the window's start on.
#[inline(always)]
fn on_parabolas<S: Lanes, const N: usize>(s: S, [a, b, c]: [&[f32; N]; 3], at: S::F) -> S::F {
    let whole = s.floor(at);
    let (n, t) = (s.to_int(whole), s.sub(at, whole));
    let slope = s.mul_add(t, s.look_up(c, n), s.look_up(b, n));
    s.mul_add(t, slope, s.look_up(a, n))
}

/// All voxels are within range and beam; each takes its own square root.
#[inline(always)]
fn add_exact_parabolic<S: Lanes>(
    s: S,
    sight: &Sight,
    coarse: &Windows,
    l: usize,
    parabolas: &Parabolas<'_>,
    exact: &Exact<S>,
    sums: &mut [S::I; EDGE],
) {
    let Some(parabolas) = parabolas.window::<WINDOW>(coarse.first[l] as usize) else { return };
    let per_m = coarse.entries_per_m[l];
    let (entry, per_m) = (s.splat((-per_m).mul_add(sight.distance_m[l], coarse.entry[l])), s.splat(per_m));
    for (layer, sum) in sums.iter_mut().enumerate() {
        let at = s.mul_add(s.sqrt(exact.squares(s, layer)), per_m, entry);
        *sum = s.add_int(*sum, s.to_int(on_parabolas(s, parabolas, at)));
    }
}

/// The same from entries that are not coarse.
#[inline(always)]
fn add_exact<S: Lanes>(s: S, sight: &Sight, l: usize, values: &[f32], exact: &Exact<S>, sums: &mut [S::I; EDGE]) {
    let per_m = sight.windows.entries_per_m[l];
    let entry = (-per_m).mul_add(sight.distance_m[l], sight.windows.entry[l] + sight.windows.first[l] as f32);
    let (entry, per_m) = (s.splat(entry), s.splat(per_m));
    let mut places = [(s.splat_int(0), s.splat(0.0)); EDGE];
    for (layer, place) in places.iter_mut().enumerate() {
        let at = s.mul_add(s.sqrt(exact.squares(s, layer)), per_m, entry);
        let whole = s.floor(at);
        *place = (s.to_int(whole), s.sub(at, whole));
    }
    for (sum, value) in sums.iter_mut().zip(read(s, values, sight, l, &places)) {
        *sum = s.add_int(*sum, s.to_int(value));
    }
}

/// Which voxels of a layer count.
#[inline(always)]
fn counting<S: Lanes>(s: S, stack: &SweepStack, seen: &AtEdge<S>) -> S::M {
    if stack.beam.solid {
        return seen.counts;
    }
    let amplitude = super::beam_table::amplitude(s, &stack.beam, seen.cos(s));
    s.and(seen.counts, s.at_most(s.splat(f32::MIN_POSITIVE), amplitude))
}

/// Some voxels may be out of range or beam: each is tested.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn add_edge_parabolic<S: Lanes>(
    s: S,
    stack: &SweepStack,
    group: usize,
    coarse: &Windows,
    l: usize,
    edges: &Edges<'_, S>,
    offsets: &Offsets<S>,
    sums: &mut [S::I; EDGE],
) {
    let (sweeps, parabolas) = (&stack.groups[group], stack.parabolas(group * LANES + l));
    let Some(window) = parabolas.window::<WINDOW>(coarse.first[l] as usize) else { return };
    let per_m = sweeps.entries_per_m[l] * parabolas.per_entry;
    let first = (-sweeps.first_m[l]).mul_add(per_m, -(coarse.first[l] as f32));
    let (per_m, first) = (s.splat(per_m), s.splat(first));
    for (layer, sum) in sums.iter_mut().enumerate() {
        let seen = edges.layer(s, offsets, layer);
        let counts = counting(s, stack, &seen);
        let value = on_parabolas(s, window, s.mul_add(seen.distance, per_m, first));
        *sum = s.add_int(*sum, s.to_int(s.or_zero(counts, value)));
    }
}

/// The same from entries that are not coarse, however many the brick spans.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn add_edge<S: Lanes>(
    s: S,
    stack: &SweepStack,
    group: usize,
    sight: &Sight,
    l: usize,
    edges: &Edges<'_, S>,
    offsets: &Offsets<S>,
    sums: &mut [S::I; EDGE],
) {
    let sweeps = &stack.groups[group];
    // First all table positions, then the values, so that lookups do not wait for each other.
    let mut places = [(s.splat_int(0), s.splat(0.0)); EDGE];
    let mut counts = [s.mask(0); EDGE];
    for (layer, (place, counts)) in places.iter_mut().zip(&mut counts).enumerate() {
        let seen = edges.layer(s, offsets, layer);
        *counts = counting(s, stack, &seen);
        let at = s.mul(s.sub(seen.distance, s.splat(sweeps.first_m[l])), s.splat(sweeps.entries_per_m[l]));
        let whole = s.floor(at);
        *place = (s.to_int(s.or_zero(*counts, whole)), s.sub(at, whole));
    }
    let values = read(s, stack.values(group * LANES + l), sight, l, &places);
    for (sum, (value, counts)) in sums.iter_mut().zip(values.into_iter().zip(counts)) {
        *sum = s.add_int(*sum, s.to_int(s.or_zero(counts, value)));
    }
}

//! Integer sums over a brick: `ls` and `log`.
//!
//! Each sweep adds to each voxel its table value at the voxel's distance, rounded to whole steps.
//! The sum therefore depends neither on the order of the sweeps nor on earlier additions and
//! subtractions: rolling, adaptive and dense images are equal bit for bit. 32-bit sums are moved to
//! 64 bits before they could overflow.

use super::brick_geometry::{BrickShape, EDGE, Offsets, Sight, VOXELS};
use super::edge_geometry::{AtEdge, DISTANCE_ERROR_M, Edges, Exact, from_sensor, fully_visible, read};
use super::sweep_stack::{Parabolas, SweepStack, WINDOW, window};
use crate::simd::{Kernel, LANES, Lanes, lane3, on_widest};

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

    /// The same as values of the statistic.
    pub(super) fn values(self) -> ([f32; VOXELS], u64) {
        on_widest(PowerValues(self))
    }
}

impl Kernel for AddPower<'_> {
    type Out = PowerSums;

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) -> PowerSums {
        let (inner, outer, updates) = self.accumulate(s);
        let mut sums = [0; VOXELS];
        inner.add_to(s, &mut sums);
        outer.add_to(s, &mut sums);
        PowerSums { sums, updates }
    }
}

struct PowerValues<'a>(AddPower<'a>);

impl Kernel for PowerValues<'_> {
    type Out = ([f32; VOXELS], u64);

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) -> Self::Out {
        let stack = self.0.stack;
        let (inner, outer, updates) = self.0.accumulate(s);
        let mut values = [0.0; VOXELS];
        if inner.is_narrow && outer.is_narrow && inner.greatest + outer.greatest <= i64::from(i32::MAX) {
            // The step is a power of two, so this rounds as `value_of` does.
            let step = s.splat(stack.step() as f32);
            for (layer, values) in values.chunks_exact_mut(LANES).enumerate() {
                let sum = s.max_int(s.add_int(inner.narrow[layer], outer.narrow[layer]), s.splat_int(0));
                values.copy_from_slice(&s.store(s.mul(s.to_float(sum), step)));
            }
            return (values, updates);
        }
        let mut sums = [0; VOXELS];
        inner.add_to(s, &mut sums);
        outer.add_to(s, &mut sums);
        for (value, sum) in values.iter_mut().zip(sums) {
            *value = stack.value_of(sum);
        }
        (values, updates)
    }
}

impl AddPower<'_> {
    /// Sums of the sweeps that see the whole brick, of the others, and the updates. Apart, so that
    /// the former stay in registers.
    #[inline(always)]
    fn accumulate<S: Lanes>(&self, s: S) -> (Accumulator<S>, Accumulator<S>, u64) {
        let (offsets, heights) = (Offsets::new(s, &self.shape), self.shape.heights());
        let (mut inner, mut outer) = (Accumulator::new(s), Accumulator::new(s));
        let mut updates = 0;
        for &(group, lanes) in self.slots {
            let sweeps = &self.stack.groups[group];
            let sight = Sight::new(s, self.stack, sweeps, self.center, &self.shape);
            let (mut inside, mut edge) = (sight.inside & lanes, sight.edge & lanes);
            updates += u64::from(inside.count_ones() + edge.count_ones()) * VOXELS as u64;
            let wide = edge & sight.wide;
            // A wide window spans at most a window of such coarse entries.
            let per_entry = s.load(&sweeps.coarse_per_entry);
            let parabolic = s.mask_bits(s.at_most(per_entry, s.splat(0.25)));
            let mut whole = 0;
            if wide != 0 {
                whole = wide & fully_visible(s, self.stack, group, &sight, &self.shape);
                edge &= !whole;
            }
            let mut coarse = CoarseWindows::NONE;
            if inside & !sight.within_8 | wide != 0 {
                coarse = CoarseWindows::of(s, &sight, per_entry);
            }
            while inside != 0 {
                let l = inside.trailing_zeros() as usize;
                inside &= inside - 1;
                let slot = group * LANES + l;
                inner.expect(s, self.stack.greatest(slot));
                add_inside(s, self.stack, slot, &sight, &coarse, l, &offsets, &mut inner.narrow);
            }
            while whole != 0 {
                let l = whole.trailing_zeros() as usize;
                whole &= whole - 1;
                let slot = group * LANES + l;
                outer.expect(s, self.stack.greatest(slot));
                let exact = Exact::new(s, from_sensor(&sight, l), &offsets, heights);
                if parabolic >> l & 1 == 1 {
                    add_exact_parabolic(s, &sight, &coarse, l, &self.stack.parabolas(slot), &exact, &mut outer.narrow);
                } else {
                    add_exact(s, &sight, l, self.stack.values(slot), &exact, &mut outer.narrow);
                }
            }
            while edge != 0 {
                let l = edge.trailing_zeros() as usize;
                edge &= edge - 1;
                outer.expect(s, self.stack.greatest(group * LANES + l));
                let edges = Edges::new(s, self.stack, group, &sight, l, &offsets, heights);
                let sums = &mut outer.narrow;
                if (wide & parabolic) >> l & 1 == 1 {
                    add_edge_parabolic(s, self.stack, group, &coarse, l, &edges, &offsets, sums);
                } else {
                    add_edge(s, self.stack, group, &sight, l, &edges, &offsets, sums);
                }
            }
        }
        (inner, outer, updates)
    }
}

/// Sums over a brick: in 32 bits as long as they fit.
struct Accumulator<S: Lanes> {
    narrow: [S::I; EDGE],
    /// Greatest possible value of the narrow sums.
    greatest: i64,
    is_narrow: bool,
    wide: [i64; VOXELS],
}

impl<S: Lanes> Accumulator<S> {
    #[inline(always)]
    fn new(s: S) -> Self {
        Self { narrow: [s.splat_int(0); EDGE], greatest: 0, is_narrow: true, wide: [0; VOXELS] }
    }

    /// Makes room for a sweep that adds at most so much.
    #[inline(always)]
    fn expect(&mut self, s: S, most: i64) {
        self.greatest += most;
        if self.greatest > i64::from(i32::MAX) {
            add_wide(s, &self.narrow, &mut self.wide);
            (self.narrow, self.greatest, self.is_narrow) = ([s.splat_int(0); EDGE], most, false);
        }
    }

    #[inline(always)]
    fn add_to(&self, s: S, sums: &mut [i64; VOXELS]) {
        add_wide(s, &self.narrow, sums);
        for (sum, wide) in sums.iter_mut().zip(self.wide) {
            *sum += wide;
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

/// All voxels are within range and beam: the window of the tables is in registers. The fewer entries
/// it needs, the fewer permutes where registers have eight lanes.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
pub(super) fn add_inside<S: Lanes>(
    s: S,
    stack: &SweepStack,
    slot: usize,
    sight: &Sight,
    coarse: &CoarseWindows,
    l: usize,
    offsets: &Offsets<S>,
    sums: &mut [S::I; EDGE],
) {
    if (sight.within_8 & sight.second_order) >> l & 1 == 1 {
        add_linear::<S, 2>(s, sight, l, stack.table(slot, 0), offsets, sums);
    } else if sight.within_8 >> l & 1 == 1 {
        add_linear::<S, 3>(s, sight, l, stack.table(slot, 0), offsets, sums);
    } else if sight.within_8_coarse >> l & 1 == 1 {
        add_parabolic::<S, 8>(s, sight, coarse, l, &stack.parabolas(slot), offsets, sums);
    } else {
        // An entry at most half as fine: a brick that spans a window spans half of it.
        add_parabolic::<S, { WINDOW / 2 }>(s, sight, coarse, l, &stack.parabolas(slot), offsets, sums);
    }
}

/// From eight entries, with distances to second or third order.
#[inline(always)]
fn add_linear<S: Lanes, const ORDER: usize>(
    s: S,
    sight: &Sight,
    l: usize,
    table: &[f32],
    offsets: &Offsets<S>,
    sums: &mut [S::I; EDGE],
) {
    let first = sight.window[l] as usize;
    let (values, slopes) = table.split_at(table.len() / 2);
    let (Some(values), Some(slopes)) = (window::<8>(values, first), window::<8>(slopes, first)) else { return };
    let deviations = Deviations::new(s, sight, l, offsets);
    let (per_m, entry) = (s.splat(sight.entries_per_m[l]), s.splat(sight.entry[l]));
    for (layer, sum) in sums.iter_mut().enumerate() {
        let at = s.mul_add(deviations.in_layer::<ORDER>(s, offsets, layer), per_m, entry);
        let whole = s.floor(at);
        let n = s.to_int(whole);
        let value = s.mul_add(s.sub(at, whole), s.look_up(slopes, n), s.look_up(values, n));
        *sum = s.add_int(*sum, s.to_int(value));
    }
}

/// From N coarse entries.
#[inline(always)]
fn add_parabolic<S: Lanes, const N: usize>(
    s: S,
    sight: &Sight,
    coarse: &CoarseWindows,
    l: usize,
    parabolas: &Parabolas<'_>,
    offsets: &Offsets<S>,
    sums: &mut [S::I; EDGE],
) {
    let Some(parabolas) = parabolas.window::<N>(coarse.first[l] as usize) else { return };
    let deviations = Deviations::new(s, sight, l, offsets);
    let (per_m, entry) = (s.splat(coarse.entries_per_m[l]), s.splat(coarse.entry[l]));
    for (layer, sum) in sums.iter_mut().enumerate() {
        let at = s.mul_add(deviations.in_layer::<3>(s, offsets, layer), per_m, entry);
        *sum = s.add_int(*sum, s.to_int(on_parabolas(s, parabolas, at)));
    }
}

/// Windows of coarse entries, lane by lane.
pub(super) struct CoarseWindows {
    /// First entry, and the centre's entry relative to it.
    first: [i32; LANES],
    entry: [f32; LANES],
    entries_per_m: [f32; LANES],
}

impl CoarseWindows {
    /// For lanes that need none.
    const NONE: Self = Self { first: [0; LANES], entry: [0.0; LANES], entries_per_m: [0.0; LANES] };

    /// `per_entry`: coarse entries per table entry.
    #[inline(always)]
    pub(super) fn of<S: Lanes>(s: S, sight: &Sight, per_entry: S::F) -> Self {
        let start = s.mul(s.to_float(s.load_int(&sight.window)), per_entry);
        let first = s.floor(start);
        Self {
            first: s.store_int(s.to_int(first)),
            entry: s.store(s.mul_add(s.load(&sight.entry), per_entry, s.sub(start, first))),
            entries_per_m: s.store(s.mul(s.load(&sight.entries_per_m), per_entry)),
        }
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

/// Distances of a brick's voxels relative to the centre's, for one sweep; to second or third order.
struct Deviations<S: Lanes> {
    flat: S::F,
    up: S::F,
    half: S::F,
    half2: S::F,
}

impl<S: Lanes> Deviations<S> {
    #[inline(always)]
    fn new(s: S, sight: &Sight, l: usize, offsets: &Offsets<S>) -> Self {
        let [ux, uy, uz] = lane3(s, &sight.toward, l);
        let flat = s.mul_add(offsets.x, ux, s.mul(offsets.y, uy));
        Self { flat, up: uz, half: s.splat(sight.half_per_m[l]), half2: s.splat(sight.half_per_m2[l]) }
    }

    #[inline(always)]
    fn in_layer<const ORDER: usize>(&self, s: S, offsets: &Offsets<S>, layer: usize) -> S::F {
        let q = s.mul_add(offsets.z[layer], self.up, self.flat);
        let across = s.neg_mul_add(q, q, offsets.squared[layer]);
        let half = if ORDER == 2 { self.half } else { s.neg_mul_add(q, self.half2, self.half) };
        s.mul_add(across, half, q)
    }
}

/// All voxels are within range and beam; each takes its own square root.
#[inline(always)]
fn add_exact_parabolic<S: Lanes>(
    s: S,
    sight: &Sight,
    coarse: &CoarseWindows,
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
    let per_m = sight.entries_per_m[l];
    let entry = (-per_m).mul_add(sight.distance_m[l], sight.entry[l] + sight.window[l] as f32);
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
    coarse: &CoarseWindows,
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

//! Sums of amplitudes times w = D·A over a brick: `thesis-full`, `thesis`, `glrt` and `coherent`.
//!
//! D is part of the tables. Inside, where accurate enough, A is a parabola in the cosine to the
//! boresight, expanded to second order about the brick's centre. So is Σ w², accumulated over all
//! such sweeps as ten coefficients and evaluated once per brick. Elsewhere A comes from the beam's
//! polynomial or table voxel by voxel. Voxels are summed in f32, group by group of sixteen sweeps in order, with
//! separate sums for the sweeps at an edge.
//!
//! Bound: with AVX2, `coherent` takes 152 multiply-adds, 32 permutes and 28 additions of eight lanes for a
//! sweep over a brick of fine voxels, 76 cycles on the two ports of Zen 4 that multiply. Measured there
//! (`cargo bench -p radar-sar --bench backprojection`): 130, and 570 for the geometry of a group.

mod beam_expansion;
mod phase;
mod weight_sum;

use beam_expansion::{Amplitudes, BeamExpansion};
use phase::{Phase, add_turned};
use weight_sum::{WeightSum, at};

use super::beam_table::amplitude_at;
use super::brick_geometry::{BrickShape, EDGE, Offsets, Sight, VOXELS};
use super::curves::{Curves, LinearWindow, Lines};
use super::edge_geometry::{AtEdge, Edges, Exact, FromPoses, extent, from_pose, from_sensor, fully_visible, read};
use super::places::Expansion;
use super::sweep_stack::{HALF_WINDOW, SweepStack, TABLE_STEP_M, WIDE_WINDOW, WINDOW};
use crate::simd::{Kernel, LANES, Lanes, Part, dot, lane3, load3, on_widest, splat3};
use crate::{HALF_TURNS_PER_M, Statistic};

/// Greatest error of a distance, metres. Choice: 1 % of a radian of phase.
const DISTANCE_ERROR_M: f64 = 4e-6;

/// Greatest displacement of the sensor from its pose, relative to the distance, at which one
/// distance serves for range, beam and falloff. Choice: 0.4 mm at 2 m, which changes beam and
/// falloff by less than [`beam_expansion::AMPLITUDE_ERROR`].
const MOVED_SHARE: f32 = 2e-4;
/// Upper bound of the distance below which D is held constant, metres: the widest table step.
const HELD_M: f32 = TABLE_STEP_M as f32;

/// A brick shape accurate enough for sums with phase; without phase use
/// [`super::power::power_shape`].
pub(super) fn weighted_shape(voxel_m: f64) -> BrickShape {
    BrickShape::new(voxel_m, DISTANCE_ERROR_M)
}

/// The statistic over the voxels of one brick, from all sweeps of a stack.
#[derive(Clone)]
pub(super) struct AddWeighted<'a> {
    pub stack: &'a SweepStack,
    pub shape: BrickShape,
    /// Centre of the brick relative to the stack's origin, metres.
    pub center: [f32; 3],
}

/// Values, x fastest, and the (voxel, sweep) pairs processed.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct WeightedValues {
    pub values: [f32; VOXELS],
    pub updates: u64,
}

impl AddWeighted<'_> {
    /// Runs on the widest instructions.
    pub(super) fn values(self) -> WeightedValues {
        on_widest(self)
    }
}

/// Sums of the voxels: the sum (or its real part) and the imaginary part.
struct Gathered<S: Lanes> {
    re: [S::F; EDGE],
    im: [S::F; EDGE],
}

impl<S: Lanes> Gathered<S> {
    #[inline(always)]
    fn none(s: S) -> Self {
        let zero = [s.splat(0.0); EDGE];
        Self { re: zero, im: zero }
    }
}

impl Kernel for AddWeighted<'_> {
    type Out = WeightedValues;

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) -> WeightedValues {
        match self.stack.statistic() {
            Statistic::Coherent => self.sums::<S, 3>(s),
            Statistic::Glrt => self.sums::<S, 2>(s),
            _ => self.sums::<S, 1>(s),
        }
    }
}

impl AddWeighted<'_> {
    /// `PLANES`: 1 sums amplitudes, 2 also Σ w², 3 sums both parts with their phase.
    #[inline(always)]
    fn sums<S: Lanes, const PLANES: usize>(&self, s: S) -> WeightedValues {
        let offsets = Offsets::new(s, &self.shape);
        // Separate sums for the two paths: those of the inner path stay in registers.
        let (mut gathered, mut at_edge) = (Gathered::none(s), Gathered::none(s));
        let (mut weights, mut edge_weights) = (WeightSum::none(s), [s.splat(0.0); EDGE]);
        let (mut expansion, mut updates) = (Expansion::NONE, 0);
        for (group, sweeps) in self.stack.groups.iter().enumerate() {
            let sight = Sight::new(s, self.stack, sweeps, self.center, &self.shape);
            let poses = FromPoses::new(s, sweeps, self.center);
            let mut beam = BeamExpansion::FLAT;
            if sight.inside != 0 {
                beam = BeamExpansion::new(s, &self.stack.beam, sweeps, (&sight, &poses), &self.shape);
                expansion.set(s, &sight, sight.windows.clone(), &self.shape);
            }
            let phase = Phase::new(s, sweeps, &sight);
            let mut inside = sight.inside & beam.good;
            let edge = (sight.inside | sight.edge) & !inside;
            updates += u64::from((sight.inside | sight.edge).count_ones()) * VOXELS as u64;
            if PLANES > 1 {
                weights.add(s, inside, &sight, &beam);
            }
            while inside != 0 {
                let l = inside.trailing_zeros() as usize;
                inside &= inside - 1;
                let of = (&expansion, &beam, &phase);
                if sight.within_8 >> l & 1 == 1 {
                    self.add_inside::<S, PLANES, Curves<S, 2>>(s, group, of, l, &offsets, &mut gathered);
                } else if sight.within_16 >> l & 1 == 1 {
                    self.add_inside::<S, PLANES, Lines<'_, 16>>(s, group, of, l, &offsets, &mut gathered);
                } else {
                    self.add_inside::<S, PLANES, Lines<'_, WINDOW>>(s, group, of, l, &offsets, &mut gathered);
                }
            }
            if edge != 0 {
                let sums = (&mut at_edge, &mut edge_weights);
                s.apart(AddEdges::<S, PLANES> {
                    brick: self,
                    group,
                    sight: &sight,
                    poses: &poses,
                    phase: &phase,
                    edge,
                    sums,
                });
            }
        }
        let terms = weights.total(s);
        let mut values = [0.0; VOXELS];
        for (layer, values) in values.as_chunks_mut().0.iter_mut().enumerate() {
            let re = s.add(gathered.re[layer], at_edge.re[layer]);
            let im = s.add(gathered.im[layer], at_edge.im[layer]);
            let weights = s.add(at(s, &terms, &offsets, layer), edge_weights[layer]);
            *values = s.store(value::<S, PLANES>(s, re, im, weights));
        }
        WeightedValues { values, updates }
    }

    /// Voxels of a sweep that sees them all.
    #[inline(always)]
    fn add_inside<'a, S: Lanes, const PLANES: usize, W: LinearWindow<'a, S>>(
        &'a self,
        s: S,
        group: usize,
        (expansion, beam, phase): (&Expansion, &BeamExpansion, &Phase),
        l: usize,
        offsets: &Offsets<S>,
        gathered: &mut Gathered<S>,
    ) {
        let (slot, first) = (group * LANES + l, expansion.windows.first[l] as usize);
        // Where only the first is summed, the other is not read.
        let Some(first_part) = W::new(s, self.stack.table(slot, 0), first) else { return };
        let Some(second_part) = W::new(s, self.stack.table(slot, usize::from(PLANES == 3)), first) else { return };
        let windows = [first_part, second_part];
        let [gx, gy, _] = lane3(s, &beam.gradient_per_m, l);
        let flat = expansion.flat(s, l, offsets);
        let flat_g = s.mul_add(offsets.x, gx, s.mul(offsets.y, gy));
        let amplitude = Amplitudes::of(s, beam, l, offsets, [flat, flat_g]);
        let places = expansion.places(s, l, offsets);
        let ray = Ray { phase, l, windows, amplitude };
        let Gathered { re, im } = gathered;
        let mut parts = [[s.splat(0.0); 2]; EDGE];
        for (parts, place) in parts.iter_mut().zip(places) {
            *parts = ray.parts::<PLANES>(s, place);
        }
        for layer in 0..EDGE {
            let sums = [re[layer], im[layer]];
            (re[layer], im[layer]) = ray.turn::<PLANES>(s, offsets, layer, places[layer], parts[layer], sums);
        }
    }

    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    fn add_edge<S: Lanes, const PLANES: usize>(
        &self,
        s: S,
        group: usize,
        sight: &Sight,
        phase: &Phase,
        l: usize,
        offsets: &Offsets<S>,
        gathered: &mut Gathered<S>,
        weights: &mut [S::F; EDGE],
    ) {
        let (slot, sweeps) = (group * LANES + l, &self.stack.groups[group]);
        let center = s.splat(sight.distance_m[l]);
        let center_half_turns = s.splat(phase.center_half_turns[l]);
        let zero = s.splat(0.0);
        let edges = Edges::new(s, self.stack, group, self.center, l, offsets, self.shape.heights());
        // First all table positions, then the values, so that lookups do not wait for each other.
        let mut places = [(s.splat_int(0), zero); EDGE];
        let mut seens = [LayerVisibility::<S> { counts: s.mask(0), amplitude: zero, half_turns: zero }; EDGE];
        for (layer, (place, of_layer)) in places.iter_mut().zip(&mut seens).enumerate() {
            let seen = edges.layer(s, offsets, layer);
            let at = s.mul(s.sub(seen.distance, s.splat(sweeps.first_m[l])), s.splat(sweeps.entries_per_m[l]));
            let whole = s.floor(at);
            *place = (s.to_int(s.or_zero(seen.counts, whole)), s.sub(at, whole));
            let half_turns =
                s.mul_add(s.sub(seen.distance, center), s.splat(HALF_TURNS_PER_M as f32), center_half_turns);
            let amplitude = self.edge_amplitude(s, &seen);
            let half_turns = s.or_zero(seen.counts, half_turns);
            *of_layer = LayerVisibility { counts: seen.counts, amplitude, half_turns };
        }
        let mut planes = [[zero; EDGE]; PLANES];
        for (plane, values) in planes.iter_mut().enumerate() {
            *values = read(s, &self.stack.table(slot, plane)[..self.stack.stride], sight, l, &places);
        }
        for (layer, LayerVisibility { counts, amplitude, half_turns }) in seens.into_iter().enumerate() {
            // Voxels that do not count may be NaN; this must not reach the sums.
            for values in &mut planes {
                values[layer] = s.or_zero(counts, values[layer]);
            }
            if PLANES == 3 {
                let sums = [gathered.re[layer], gathered.im[layer]];
                (gathered.re[layer], gathered.im[layer]) =
                    add_turned(s, [planes[0][layer], planes[1][layer]], amplitude, half_turns, sums);
            } else {
                gathered.re[layer] = s.mul_add(planes[0][layer], amplitude, gathered.re[layer]);
            }
            if PLANES > 1 {
                weights[layer] = s.mul_add(planes[PLANES - 1][layer], s.mul(amplitude, amplitude), weights[layer]);
            }
        }
    }

    /// A of separate voxels, 0 where they do not count.
    #[inline(always)]
    fn edge_amplitude<S: Lanes>(&self, s: S, seen: &AtEdge<S>) -> S::F {
        if self.stack.beam.uniform {
            return s.or_zero(seen.counts, s.splat(1.0));
        }
        s.or_zero(seen.counts, amplitude_at(s, &self.stack.beam, seen.cos(s)))
    }

    /// `thesis`, separate voxels: |x| of the nearest point, exact D and A.
    #[inline(always)]
    fn add_edge_nearest<S: Lanes>(
        &self,
        s: S,
        group: usize,
        sight: &Sight,
        l: usize,
        offsets: &Offsets<S>,
        sums: &mut [S::F; EDGE],
    ) {
        let sweeps = &self.stack.groups[group];
        let per_m = s.splat(sweeps.points_per_m[l]);
        let least = s.splat(1.0 / sweeps.entries_per_m[l]);
        let edges = Edges::new(s, self.stack, group, self.center, l, offsets, self.shape.heights());
        let mut places = [(s.splat_int(0), s.splat(0.0)); EDGE];
        for (layer, (place, weight)) in places.iter_mut().enumerate() {
            let seen = edges.layer(s, offsets, layer);
            let at = s.mul_add(s.sub(seen.distance, s.splat(sweeps.first_m[l])), per_m, s.splat(0.5));
            *place = s.to_int(s.or_zero(seen.counts, s.floor(at)));
            let held = s.max(seen.distance, least);
            *weight = s.div(self.edge_amplitude(s, &seen), s.mul(held, held));
        }
        self.add_points(s, group, sight, l, &places, sums);
    }

    /// Lanes whose voxels [`Self::add_fully_visible_nearest`] can process: the sensor hardly moves while it
    /// samples.
    #[inline(always)]
    fn fully_visible<S: Lanes>(&self, s: S, group: usize, sight: &Sight, poses: &FromPoses<S>) -> u16 {
        if self.stack.beam.polynomial.is_none() {
            return 0;
        }
        let sweeps = &self.stack.groups[group];
        let speed = extent(s, load3(s, &sweeps.velocity_m_per_s));
        let distance = s.load(&sight.distance_m);
        let time = s.mul_add(distance, s.load(&sweeps.time_s_per_m), s.load(&sweeps.time_at_zero_s));
        let still = s.at_most(s.mul(speed, s.abs(time)), s.mul(distance, s.splat(MOVED_SHARE)));
        let beyond_first = s.at_most(s.splat(self.shape.radius_m * 1.1 + HELD_M), distance);
        s.mask_bits(s.and(still, beyond_first)) & fully_visible(s, self.stack, group, (sight, poses), &self.shape)
    }

    /// The same where each voxel counts and the sensor is nearly at rest: one distance is enough.
    #[inline(always)]
    fn add_fully_visible_nearest<S: Lanes>(
        &self,
        s: S,
        group: usize,
        sight: &Sight,
        l: usize,
        offsets: &Offsets<S>,
        sums: &mut [S::F; EDGE],
    ) {
        let Some(polynomial) = &self.stack.beam.polynomial else { return };
        let (sweeps, heights) = (&self.stack.groups[group], self.shape.heights());
        let exact = Exact::new(s, from_sensor(sight, l), offsets, heights);
        let (forward, from_pose) = (lane3(s, &sweeps.forward, l), splat3(s, from_pose(sweeps, self.center, l)));
        // t of the beam's polynomial is `along` / distance + `at_zero`.
        let along = dot(s, from_pose, forward);
        let along = s.mul_add(offsets.x, forward[0], s.mul_add(offsets.y, forward[1], along));
        let (per_cos, at_zero) = (s.splat(polynomial.per_cos), s.splat(polynomial.at_zero));
        let along = s.mul(along, per_cos);
        let up = sweeps.forward[2][l] * polynomial.per_cos;
        let (per_m, stretch) = (sweeps.points_per_m[l], sight.stretch[l]);
        let first = sight.distance_m[l] * (1.0 - stretch) - sweeps.first_m[l];
        let (first, per_m) = (s.splat(per_m.mul_add(first, 0.5)), s.splat(per_m * stretch));
        let mut places = [(s.splat_int(0), s.splat(0.0)); EDGE];
        for (layer, (place, weight)) in places.iter_mut().enumerate() {
            let square = exact.squares(s, layer);
            let distance = s.sqrt(square);
            *place = s.to_int(s.floor(s.mul_add(distance, per_m, first)));
            let inverse = s.div(s.splat(1.0), distance);
            let along = s.add(along, s.splat(up * heights[layer]));
            let mut amplitude = s.splat(0.0);
            let t = s.mul_add(along, inverse, at_zero);
            for coefficient in polynomial.coefficients.iter().rev() {
                amplitude = s.mul_add(amplitude, t, s.splat(*coefficient));
            }
            *weight = s.mul(amplitude, s.mul(inverse, inverse));
        }
        self.add_points(s, group, sight, l, &places, sums);
    }

    /// Adds |x| of points, each with its weight.
    #[inline(always)]
    fn add_points<S: Lanes>(
        &self,
        s: S,
        group: usize,
        sight: &Sight,
        l: usize,
        places: &[(S::I, S::F); EDGE],
        sums: &mut [S::F; EDGE],
    ) {
        let (sweeps, points) = (&self.stack.groups[group], self.stack.points(group * LANES + l));
        // The window's first point, at the same distance along the axis as its first entry.
        let first = sight.windows.first[l] / sweeps.entries_per_point[l];
        let from = if sight.wide >> l & 1 == 1 { points.get(first as usize..).unwrap_or_default() } else { &[] };
        let offset = s.splat_int(-first);
        // A brick that spans so few entries spans at most half as many points.
        let halves = if sweeps.entries_per_point[l] >= 2 { from } else { &[] };
        if let Some(window) = halves.first_chunk::<HALF_WINDOW>() {
            for (sum, &(n, weight)) in sums.iter_mut().zip(places) {
                *sum = s.mul_add(s.look_up(window, s.add_int(n, offset)), weight, *sum);
            }
        } else if let Some(window) = from.first_chunk::<WIDE_WINDOW>() {
            for (sum, &(n, weight)) in sums.iter_mut().zip(places) {
                *sum = s.mul_add(s.look_up(window, s.add_int(n, offset)), weight, *sum);
            }
        } else {
            for (sum, &(n, weight)) in sums.iter_mut().zip(places) {
                *sum = s.mul_add(s.gather_pairs(points, n).0, weight, *sum);
            }
        }
    }
}

/// Adds sweeps of a group to voxels one by one.
struct AddEdges<'a, S: Lanes, const PLANES: usize> {
    brick: &'a AddWeighted<'a>,
    group: usize,
    sight: &'a Sight,
    poses: &'a FromPoses<S>,
    phase: &'a Phase,
    edge: u16,
    sums: (&'a mut Gathered<S>, &'a mut [S::F; EDGE]),
}

impl<S: Lanes, const PLANES: usize> Part<S> for AddEdges<'_, S, PLANES> {
    type Out = ();

    #[inline(always)]
    fn run(self, s: S) {
        let Self { brick, group, sight, poses, phase, mut edge, sums: (gathered, weights) } = self;
        let offsets = Offsets::new(s, &brick.shape);
        let jumps = PLANES == 1 && brick.stack.statistic() == Statistic::Thesis;
        let whole = if jumps { brick.fully_visible(s, group, sight, poses) } else { 0 };
        while edge != 0 {
            let l = edge.trailing_zeros() as usize;
            edge &= edge - 1;
            if whole >> l & 1 == 1 {
                brick.add_fully_visible_nearest(s, group, sight, l, &offsets, &mut gathered.re);
            } else if jumps {
                brick.add_edge_nearest(s, group, sight, l, &offsets, &mut gathered.re);
            } else {
                brick.add_edge::<S, PLANES>(s, group, sight, phase, l, &offsets, gathered, weights);
            }
        }
    }
}

/// One sweep's geometry at a layer's voxels.
#[derive(Clone, Copy)]
struct LayerVisibility<S: Lanes> {
    counts: S::M,
    amplitude: S::F,
    /// Phase, in half turns.
    half_turns: S::F,
}

/// One sweep that sees the whole brick.
struct Ray<'a, S: Lanes, W> {
    phase: &'a Phase,
    l: usize,
    /// Windows of the tables, for each part.
    windows: [W; 2],
    amplitude: Amplitudes<S>,
}

impl<'a, S: Lanes, W: LinearWindow<'a, S>> Ray<'_, S, W> {
    /// The tables' values at places in their windows.
    #[inline(always)]
    fn parts<const PLANES: usize>(&self, s: S, place: S::F) -> [S::F; 2] {
        let real = self.windows[0].value(s, place);
        if PLANES < 3 {
            return [real, real];
        }
        [real, self.windows[1].value(s, place)]
    }

    /// The sums of a layer with this sweep added.
    #[inline(always)]
    fn turn<const PLANES: usize>(
        &self,
        s: S,
        offsets: &Offsets<S>,
        layer: usize,
        place: S::F,
        parts: [S::F; 2],
        sums: [S::F; 2],
    ) -> (S::F, S::F) {
        let (phase, l) = (self.phase, self.l);
        let amplitude = self.amplitude.in_layer(s, offsets, layer);
        if PLANES < 3 {
            return (s.mul_add(parts[0], amplitude, sums[0]), sums[1]);
        }
        let (per_entry, at_window) = (s.splat(phase.half_turns_per_entry[l]), s.splat(phase.window_half_turns[l]));
        add_turned(s, parts, amplitude, s.mul_add(place, per_entry, at_window), sums)
    }
}

/// The statistic from its sums.
#[inline(always)]
fn value<S: Lanes, const PLANES: usize>(s: S, re: S::F, im: S::F, weights: S::F) -> S::F {
    let some = s.at_most(s.splat(f32::MIN_POSITIVE), weights);
    match PLANES {
        1 => re,
        2 => s.or_zero(some, s.div(re, s.sqrt(weights))),
        _ => s.or_zero(some, s.div(s.sqrt(s.mul_add(re, re, s.mul(im, im))), s.sqrt(weights))),
    }
}

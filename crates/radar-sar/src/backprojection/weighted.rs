//! Sums of amplitudes times w = D·A over a brick: `thesis-full`, `thesis`, `glrt` and `coherent`.
//!
//! D is part of the tables. Inside, where accurate enough, A is a parabola in the cosine to the
//! boresight, expanded to second order about the brick's centre. So is Σ w², accumulated over all
//! such sweeps as ten coefficients and evaluated once per brick. Elsewhere A comes from the beam's
//! polynomial or table voxel by voxel. Voxels are summed in f32, group by group of sixteen sweeps in order, with
//! separate sums for the sweeps at an edge.
//!
//! Longer than other files: four statistics share the sight of a brick, and are inlined into one kernel
//! each.

use super::beam_table::amplitude;
use super::beam_table::{BeamTable, ENTRIES_PER_COS};
use super::brick_geometry::{BrickShape, EDGE, Offsets, Sight, VOXELS};
use super::power::{AtEdge, Edges, Exact, extent, from_sensor, fully_visible, read, window};
use super::sweep_stack::{Group, HALF_WINDOW, SweepStack, TABLE_STEP_M, WIDE_WINDOW, WINDOW};
use crate::Statistic;
use crate::WAVELENGTH_M;
use crate::simd::{Kernel, LANES, Lanes, dot, lane3, load3, on_widest, scale3, store3, sub3};

/// Greatest error of a distance, metres. Choice: 1 % of a radian of phase.
const DISTANCE_ERROR_M: f64 = 4e-6;
/// Greatest absolute error of the beam's amplitude due to its expansion, and greatest relative
/// error. Choice: below the uncertainty of any beam pattern; smaller errors leave most bricks to
/// separate voxels.
const AMPLITUDE_ERROR: f32 = 2e-3;
const AMPLITUDE_ERROR_SHARE: f32 = 2e-2;

/// Greatest displacement of the sensor from its pose, relative to the distance, at which one
/// distance serves for range, beam and falloff. Choice: 0.4 mm at 2 m, which changes beam and
/// falloff by less than [`AMPLITUDE_ERROR`].
const MOVED_SHARE: f32 = 2e-4;
/// Upper bound of the distance below which D is held constant, metres: the widest table step.
const HELD_M: f32 = TABLE_STEP_M as f32;

/// A brick shape accurate enough for sums with phase; without phase use
/// [`super::power::power_shape`].
pub(super) fn weighted_shape(voxel_m: f64) -> BrickShape {
    BrickShape::new(voxel_m, DISTANCE_ERROR_M)
}

/// The amplitude of the beam at a cosine: by its polynomial where it has one.
#[inline(always)]
fn amplitude_at<S: Lanes>(s: S, beam: &BeamTable, cos: S::F) -> S::F {
    let Some(polynomial) = &beam.polynomial else { return amplitude(s, beam, cos) };
    let t = s.mul_add(cos, s.splat(polynomial.per_cos), s.splat(polynomial.at_zero));
    let mut sum = s.splat(0.0);
    for coefficient in polynomial.coefficients.iter().rev() {
        sum = s.mul_add(sum, t, s.splat(*coefficient));
    }
    sum
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
        let mut updates = 0;
        let jumps = PLANES == 1 && self.stack.statistic() == Statistic::Thesis;
        for (group, sweeps) in self.stack.groups.iter().enumerate() {
            let sight = Sight::new(s, self.stack, sweeps, self.center, &self.shape);
            let mut beam = BeamExpansion::FLAT;
            if sight.inside != 0 {
                beam = BeamExpansion::new(s, &self.stack.beam, sweeps, &sight, &self.shape);
            }
            let phase = Phase::new(s, &sight);
            let whole = if jumps { self.fully_visible(s, group, &sight) } else { 0 };
            let mut inside = sight.inside & beam.good;
            let mut edge = (sight.inside | sight.edge) & !inside;
            updates += u64::from((sight.inside | sight.edge).count_ones()) * VOXELS as u64;
            if PLANES > 1 {
                weights.add(s, inside, &sight, &beam);
            }
            while inside != 0 {
                let l = inside.trailing_zeros() as usize;
                inside &= inside - 1;
                let of = (&sight, &beam, &phase);
                if sight.within_8 >> l & 1 == 1 {
                    self.add_inside::<S, PLANES, 8>(s, group, of, l, &offsets, &mut gathered);
                } else if sight.within_16 >> l & 1 == 1 {
                    self.add_inside::<S, PLANES, 16>(s, group, of, l, &offsets, &mut gathered);
                } else {
                    self.add_inside::<S, PLANES, WINDOW>(s, group, of, l, &offsets, &mut gathered);
                }
            }
            while edge != 0 {
                let l = edge.trailing_zeros() as usize;
                edge &= edge - 1;
                if jumps && whole >> l & 1 == 1 {
                    self.add_fully_visible_nearest(s, group, &sight, l, &offsets, &mut at_edge.re);
                } else if jumps {
                    self.add_edge_nearest(s, group, &sight, l, &offsets, &mut at_edge.re);
                } else {
                    self.add_edge::<S, PLANES>(s, group, &sight, &phase, l, &offsets, &mut at_edge, &mut edge_weights);
                }
            }
        }
        let terms = weights.total(s);
        let mut values = [0.0; VOXELS];
        for (layer, values) in values.chunks_exact_mut(LANES).enumerate() {
            let re = s.add(gathered.re[layer], at_edge.re[layer]);
            let im = s.add(gathered.im[layer], at_edge.im[layer]);
            let weights = s.add(at(s, &terms, &offsets, layer), edge_weights[layer]);
            values.copy_from_slice(&s.store(value::<S, PLANES>(s, re, im, weights)));
        }
        WeightedValues { values, updates }
    }

    /// Voxels of a sweep that sees them all; the tables' windows have N entries.
    #[inline(always)]
    fn add_inside<S: Lanes, const PLANES: usize, const N: usize>(
        &self,
        s: S,
        group: usize,
        (sight, beam, phase): (&Sight, &BeamExpansion, &Phase),
        l: usize,
        offsets: &Offsets<S>,
        gathered: &mut Gathered<S>,
    ) {
        let (slot, first) = (group * LANES + l, sight.window[l] as usize);
        let parts = if PLANES == 3 { 2 } else { 1 };
        let mut windows = [(&[0.0; N], &[0.0; N]); 2];
        for (plane, of_plane) in windows[..parts].iter_mut().enumerate() {
            let (values, slopes) = self.stack.table(slot, plane).split_at(self.stack.stride);
            let (Some(values), Some(slopes)) = (window(values, first), window(slopes, first)) else { return };
            *of_plane = (values, slopes);
        }
        let [ux, uy, _] = lane3(s, &sight.toward, l);
        let [gx, gy, _] = lane3(s, &beam.gradient_per_m, l);
        let flat = s.mul_add(offsets.x, ux, s.mul(offsets.y, uy));
        let flat_g = s.mul_add(offsets.x, gx, s.mul(offsets.y, gy));
        let amplitude = Amplitudes::of(s, beam, l, offsets, [flat, flat_g]);
        let ray = Ray { sight, beam, phase, l, windows, flat, amplitude };
        // Written four times, so that the sums have names and stay in registers.
        let Gathered { re, im } = gathered;
        (re[0], im[0]) = ray.add::<PLANES>(s, offsets, 0, re[0], im[0]);
        (re[1], im[1]) = ray.add::<PLANES>(s, offsets, 1, re[1], im[1]);
        (re[2], im[2]) = ray.add::<PLANES>(s, offsets, 2, re[2], im[2]);
        (re[3], im[3]) = ray.add::<PLANES>(s, offsets, 3, re[3], im[3]);
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
        let edges = Edges::new(s, self.stack, group, sight, l, offsets, self.shape.heights());
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
        let edges = Edges::new(s, self.stack, group, sight, l, offsets, self.shape.heights());
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
    fn fully_visible<S: Lanes>(&self, s: S, group: usize, sight: &Sight) -> u16 {
        if self.stack.beam.polynomial.is_none() {
            return 0;
        }
        let sweeps = &self.stack.groups[group];
        let speed = extent(s, load3(s, &sweeps.velocity_m_per_s));
        let distance = s.load(&sight.distance_m);
        let time = s.mul_add(distance, s.load(&sweeps.time_s_per_m), s.load(&sweeps.time_at_zero_s));
        let still = s.at_most(s.mul(speed, s.abs(time)), s.mul(distance, s.splat(MOVED_SHARE)));
        let beyond_first = s.at_most(s.splat(self.shape.radius_m * 1.1 + HELD_M), distance);
        s.mask_bits(s.and(still, beyond_first)) & fully_visible(s, self.stack, group, sight, &self.shape)
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
        let [forward, from_pose] = [lane3(s, &sweeps.forward, l), lane3(s, &sight.offset_from_pose_m, l)];
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
        let first = sight.window[l] / sweeps.entries_per_point[l];
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

/// One sweep's geometry at a layer's voxels.
#[derive(Clone, Copy)]
struct LayerVisibility<S: Lanes> {
    counts: S::M,
    amplitude: S::F,
    /// Phase, in half turns.
    half_turns: S::F,
}

/// One sweep that sees the whole brick.
struct Ray<'a, S: Lanes, const N: usize> {
    sight: &'a Sight,
    beam: &'a BeamExpansion,
    phase: &'a Phase,
    l: usize,
    /// Values and slopes of the table, for each part.
    windows: [(&'a [f32; N], &'a [f32; N]); 2],
    /// Component along the line of sight for the layer through the centre.
    flat: S::F,
    amplitude: Amplitudes<S>,
}

/// A over the brick as a polynomial in the layer's height: for each lane what two layers of equal distance from the centre
/// have in common, outer and inner ones, and the slope.
struct Amplitudes<S: Lanes> {
    even: [S::F; 2],
    slope: S::F,
}

impl<S: Lanes> Amplitudes<S> {
    /// `flat`, `flat_g`: component along the line of sight, and g, for the layer through the centre.
    #[inline(always)]
    fn of(s: S, beam: &BeamExpansion, l: usize, offsets: &Offsets<S>, [flat, flat_g]: [S::F; 2]) -> Self {
        let [a0, a1, a2] = lane3(s, &beam.terms, l);
        let of_g = s.mul_add(flat_g, a2, s.mul_add(flat, s.splat(beam.along_per_m[l]), a1));
        let across = s.neg_mul_add(flat, flat, offsets.flat_squared);
        let middle = s.mul_add(flat_g, of_g, s.mul_add(across, s.splat(beam.across_per_m2[l]), a0));
        let [slope, slope_g, slope_along] = lane3(s, &beam.slope, l);
        Self {
            even: [s.add(middle, s.splat(beam.bend[0][l])), s.add(middle, s.splat(beam.bend[1][l]))],
            slope: s.mul_add(flat_g, slope_g, s.mul_add(flat, slope_along, slope)),
        }
    }

    #[inline(always)]
    fn in_layer(&self, s: S, offsets: &Offsets<S>, layer: usize) -> S::F {
        s.mul_add(self.slope, offsets.z[layer], self.even[usize::from(layer == 1 || layer == 2)])
    }
}

impl<S: Lanes, const N: usize> Ray<'_, S, N> {
    /// The sums of a layer with this sweep added.
    #[inline(always)]
    fn add<const PLANES: usize>(&self, s: S, offsets: &Offsets<S>, layer: usize, re: S::F, im: S::F) -> (S::F, S::F) {
        let (sight, beam, phase, l) = (self.sight, self.beam, self.phase, self.l);
        let q = s.add(self.flat, s.splat(beam.up[layer][l]));
        let across = s.neg_mul_add(q, q, offsets.squared[layer]);
        let bend_per_m2 = s.neg_mul_add(q, s.splat(sight.half_per_m2[l]), s.splat(sight.half_per_m[l]));
        let deviation = s.mul_add(across, bend_per_m2, q);
        let at = s.mul_add(deviation, s.splat(sight.entries_per_m[l]), s.splat(sight.entry[l]));
        let whole = s.floor(at);
        let (n, rest) = (s.to_int(whole), s.sub(at, whole));
        let amplitude = self.amplitude.in_layer(s, offsets, layer);
        let (values, slopes) = self.windows[0];
        let real = s.mul_add(rest, s.look_up(slopes, n), s.look_up(values, n));
        if PLANES < 3 {
            return (s.mul_add(real, amplitude, re), im);
        }
        let (values, slopes) = self.windows[1];
        let imaginary = s.mul_add(rest, s.look_up(slopes, n), s.look_up(values, n));
        let half_turns = s.mul_add(deviation, s.splat(phase.half_turns_per_m[l]), s.splat(phase.center_half_turns[l]));
        add_turned(s, [real, imaginary], amplitude, half_turns, [re, im])
    }
}

/// Half turns of phase per metre of distance (two-way), and what f32 cannot represent of it.
const HALF_TURNS_PER_M: f64 = 4.0 / WAVELENGTH_M;
const HALF_TURNS_PER_M_REST: f32 = (HALF_TURNS_PER_M - HALF_TURNS_PER_M as f32 as f64) as f32;

/// Phases at a brick's centre, for each of sixteen sweeps.
struct Phase {
    /// In half turns, without whole turns.
    center_half_turns: [f32; LANES],
    half_turns_per_m: [f32; LANES],
}

impl Phase {
    #[inline(always)]
    fn new<S: Lanes>(s: S, sight: &Sight) -> Self {
        let (distance, per_m) = (s.load(&sight.distance_m), s.splat(HALF_TURNS_PER_M as f32));
        let half_turns = s.mul(distance, per_m);
        // Rounding error of the product: d·k − rounded(d·k) is exact in one operation.
        let lost = s.sub(s.splat(0.0), s.neg_mul_add(distance, per_m, half_turns));
        let lost = s.mul_add(distance, s.splat(HALF_TURNS_PER_M_REST), lost);
        let whole = s.mul(s.floor(s.mul(half_turns, s.splat(0.5))), s.splat(2.0));
        Self {
            center_half_turns: s.store(s.add(s.sub(half_turns, whole), lost)),
            half_turns_per_m: s.store(s.mul(s.load(&sight.stretch), per_m)),
        }
    }
}

/// Adds A·(re + j·im)·e^(−jφ) to a sum; φ in half turns. Accurate to 1e-4 of the amplitude.
///
/// Polynomials, since tables in registers are slower with AVX2: two lookups among 32 entries take as
/// many instructions as the rest of a voxel.
#[inline(always)]
fn add_turned<S: Lanes>(s: S, [re, im]: [S::F; 2], amplitude: S::F, half_turns: S::F, sums: [S::F; 2]) -> (S::F, S::F) {
    let (whole, bits) = s.rounded(half_turns);
    let (cos, sin) = s.cos_sin_within_half_turn(s.sub(half_turns, whole));
    // An odd half turn changes both signs.
    let amplitude = s.negate_where::<0>(amplitude, bits);
    let turned_re = s.mul_add(im, sin, s.mul(re, cos));
    let turned_im = s.neg_mul_add(re, sin, s.mul(im, cos));
    (s.mul_add(amplitude, turned_re, sums[0]), s.mul_add(amplitude, turned_im, sums[1]))
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

/// A about a brick's centre, for each of sixteen sweeps, to second order in a voxel's offset δ from
/// it: A ≈ a0 + g·(a1 + a2·g − a1·q/d) − a1·cos·(|δ|² − q²)/2d², with q along the line of sight and
/// g = δ·(b − cos·u)/d.
struct BeamExpansion {
    /// A and its derivatives with respect to the cosine to the boresight.
    terms: [[f32; LANES]; 3],
    /// (b − cos·u)/d: the gradient of g.
    gradient_per_m: [[f32; LANES]; 3],
    /// Contribution of each layer to q.
    up: [[f32; LANES]; EDGE],
    /// Slope of A along z: at the centre, and what it grows by with g and with q.
    slope: [[f32; LANES]; 3],
    /// Part of A of second order in z, in the outer and the inner layers.
    bend: [[f32; LANES]; 2],
    /// −a1/d and −a1·cos/2d².
    along_per_m: [f32; LANES],
    across_per_m2: [f32; LANES],
    /// Lanes for which it is accurate enough over the whole brick.
    good: u16,
}

impl BeamExpansion {
    /// A = 1, with layer contributions still to be set.
    const FLAT: Self = Self {
        terms: [[1.0; LANES], [0.0; LANES], [0.0; LANES]],
        gradient_per_m: [[0.0; LANES]; 3],
        up: [[0.0; LANES]; EDGE],
        slope: [[0.0; LANES]; 3],
        bend: [[0.0; LANES]; 2],
        along_per_m: [0.0; LANES],
        across_per_m2: [0.0; LANES],
        good: u16::MAX,
    };

    #[inline(always)]
    fn new<S: Lanes>(s: S, beam: &BeamTable, sweeps: &Group, sight: &Sight, shape: &BrickShape) -> Self {
        let heights = shape.heights();
        let toward = load3(s, &sight.toward);
        let up = steps(s, toward[2], heights);
        if beam.uniform {
            return Self { up, ..Self::FLAT };
        }
        let cos = s.load(&sight.cos);
        let per_m = s.div(s.splat(1.0), s.max(s.load(&sight.pose_distance_m), s.splat(1e-6)));
        // The cosine changes by at most ρ/d, and slightly more due to curvature.
        let turn = s.mul(s.splat(shape.radius_m * 1.1), per_m);
        let ([a0, a1, a2], mut good) = parabola(s, beam, cos, turn);
        // Third-order terms are neglected: g·e² is at most 0.4 ρ³/d³, across and along the line of
        // sight.
        let left_out = s.mul(s.mul(s.abs(a1), s.splat(0.4)), s.mul(turn, s.mul(turn, turn)));
        good = s.and(good, s.at_most(left_out, tolerance(s, a0)));
        let gradient = scale3(s, sub3(s, load3(s, &sweeps.forward), scale3(s, toward, cos)), per_m);
        let along = s.mul(s.mul(a1, per_m), s.splat(-1.0));
        let across = s.mul(s.mul(along, s.mul(cos, per_m)), s.splat(0.5));
        // With q and g linear in z: A's derivatives along z.
        let (u, w) = (toward[2], gradient[2]);
        let two = s.splat(2.0);
        let slope = [
            s.mul(a1, w),
            s.mul_add(s.mul(a2, two), w, s.mul(along, u)),
            s.neg_mul_add(s.mul(across, two), u, s.mul(along, w)),
        ];
        let bend = s.mul_add(s.mul_add(a2, w, s.mul(along, u)), w, s.mul(across, s.neg_mul_add(u, u, s.splat(1.0))));
        let [outer, inner, ..] = heights;
        Self {
            terms: [s.store(a0), s.store(a1), s.store(a2)],
            gradient_per_m: [s.store(gradient[0]), s.store(gradient[1]), s.store(gradient[2])],
            up,
            slope: store3(s, slope),
            bend: [s.store(s.mul(bend, s.splat(outer * outer))), s.store(s.mul(bend, s.splat(inner * inner)))],
            along_per_m: s.store(along),
            across_per_m2: s.store(across),
            good: s.mask_bits(good),
        }
    }
}

/// A slope along z as the contribution of each layer.
#[inline(always)]
fn steps<S: Lanes>(s: S, slope: S::F, heights: [f32; EDGE]) -> [[f32; LANES]; EDGE] {
    let mut steps = [[0.0; LANES]; EDGE];
    for (step, height) in steps.iter_mut().zip(heights) {
        *step = s.store(s.mul(slope, s.splat(height)));
    }
    steps
}

/// Permitted error of an amplitude.
#[inline(always)]
fn tolerance<S: Lanes>(s: S, amplitude: S::F) -> S::F {
    s.min(s.splat(AMPLITUDE_ERROR), s.mul(amplitude, s.splat(AMPLITUDE_ERROR_SHARE)))
}

/// A ≈ a0 + Δcos·(a1 + Δcos·a2) for cosines within `turn` of `cos`, and where that is accurate
/// enough.
#[inline(always)]
fn parabola<S: Lanes>(s: S, beam: &BeamTable, cos: S::F, turn: S::F) -> ([S::F; 3], S::M) {
    let width = s.max(s.min(turn, s.splat(0.25)), s.splat(2.0 / ENTRIES_PER_COS));
    // Three points `width` apart, the highest at most 1: near the axis they shift to the available
    // side.
    let high = s.min(width, s.sub(s.splat(1.0), cos));
    let [a_low, a_middle, a_high] = [
        below(s, beam, cos, high, width, 2.0),
        below(s, beam, cos, high, width, 1.0),
        below(s, beam, cos, high, width, 0.0),
    ];
    let per_width = s.div(s.splat(1.0), width);
    let slope = s.mul(s.sub(a_high, a_middle), per_width);
    let slope_low = s.mul(s.sub(a_middle, a_low), per_width);
    let a2 = s.mul(s.mul(s.sub(slope, slope_low), per_width), s.splat(0.5));
    let middle = s.sub(high, width);
    let a1 = s.neg_mul_add(a2, s.add(high, middle), slope);
    let a0 = s.add(s.neg_mul_add(slope, high, a_high), s.mul(a2, s.mul(high, middle)));
    // Checked halfway between the points.
    let (x, far) = (s.neg_mul_add(width, s.splat(0.5), high), s.neg_mul_add(width, s.splat(1.5), high));
    let off = s.sub(below(s, beam, cos, high, width, 0.5), s.mul_add(s.mul_add(a2, x, a1), x, a0));
    let off_far = s.sub(below(s, beam, cos, high, width, 1.5), s.mul_add(s.mul_add(a2, far, a1), far, a0));
    ([a0, a1, a2], s.at_most(s.max(s.abs(off), s.abs(off_far)), tolerance(s, a0)))
}

/// A at the given number of widths below the highest point.
#[inline(always)]
fn below<S: Lanes>(s: S, beam: &BeamTable, cos: S::F, high: S::F, width: S::F, widths: f32) -> S::F {
    amplitude_at(s, beam, s.add(cos, s.neg_mul_add(width, s.splat(widths), high)))
}

/// Coefficients of 1, x, y, z, x², y², z², xy, xz, yz.
const TERMS: usize = 10;

/// Σ w² of the sweeps that see the whole brick, to second order in a voxel's offset from its
/// centre. Lanes are sweeps.
struct WeightSum<S: Lanes> {
    terms: [S::F; TERMS],
}

impl<S: Lanes> WeightSum<S> {
    #[inline(always)]
    fn none(s: S) -> Self {
        Self { terms: [s.splat(0.0); TERMS] }
    }

    /// w² = A²/d⁴ with A from its expansion, 1/d⁴ ≈ (1 − 4e + 12e² − 2|δ|²/d²)/d₀⁴ and e = q/d₀.
    #[inline(always)]
    fn add(&mut self, s: S, inside: u16, sight: &Sight, beam: &BeamExpansion) {
        let mask = s.mask(inside);
        let [a0, a1, a2] = load3(s, &beam.terms);
        let per_m = s.mul(s.load(&sight.half_per_m), s.splat(2.0));
        let per_m2 = s.mul(per_m, per_m);
        let per_m4 = s.mul(per_m2, per_m2);
        let ([gx, gy, gz], u) = (load3(s, &beam.gradient_per_m), load3(s, &sight.toward));
        let [ux, uy, uz] = scale3(s, u, per_m);
        let (a00, a01) = (s.mul(s.mul(a0, a0), per_m4), s.mul(s.mul(a0, a1), per_m4));
        let bent = s.mul(a01, s.load(&sight.cos));
        let gg = s.mul(s.mul_add(s.add(a0, a0), a2, s.mul(a1, a1)), per_m4);
        let gu = s.mul(a01, s.splat(-10.0));
        let uu = s.mul_add(a00, s.splat(12.0), bent);
        let dd = s.mul(s.mul_add(a00, s.splat(-2.0), s.sub(s.splat(0.0), bent)), per_m2);
        let (g1, u1) = (s.add(a01, a01), s.mul(a00, s.splat(-4.0)));
        let square = Products { gg, gu, uu };
        let terms = [
            a00,
            s.mul_add(g1, gx, s.mul(u1, ux)),
            s.mul_add(g1, gy, s.mul(u1, uy)),
            s.mul_add(g1, gz, s.mul(u1, uz)),
            s.add(dd, square.of(s, [gx, ux], [gx, ux])),
            s.add(dd, square.of(s, [gy, uy], [gy, uy])),
            s.add(dd, square.of(s, [gz, uz], [gz, uz])),
            s.mul(s.splat(2.0), square.of(s, [gx, ux], [gy, uy])),
            s.mul(s.splat(2.0), square.of(s, [gx, ux], [gz, uz])),
            s.mul(s.splat(2.0), square.of(s, [gy, uy], [gz, uz])),
        ];
        for (sum, term) in self.terms.iter_mut().zip(terms) {
            *sum = s.add(*sum, s.or_zero(mask, term));
        }
    }

    /// The sum over the lanes.
    #[inline(always)]
    fn total(&self, s: S) -> [f32; TERMS] {
        let mut total = [0.0; TERMS];
        for (total, terms) in total.iter_mut().zip(self.terms) {
            *total = s.store(terms).iter().sum();
        }
        total
    }
}

/// A quadratic form of the gradients g and u: gg·g² + gu·g·u + uu·u².
struct Products<S: Lanes> {
    gg: S::F,
    gu: S::F,
    uu: S::F,
}

impl<S: Lanes> Products<S> {
    /// Its coefficient for two axes, symmetric.
    #[inline(always)]
    fn of(&self, s: S, [ga, ua]: [S::F; 2], [gb, ub]: [S::F; 2]) -> S::F {
        let mixed = s.mul(s.mul(self.gu, s.splat(0.5)), s.mul_add(ga, ub, s.mul(gb, ua)));
        s.mul_add(s.mul(self.gg, ga), gb, s.mul_add(s.mul(self.uu, ua), ub, mixed))
    }
}

/// The expansion at a layer's voxels.
#[inline(always)]
fn at<S: Lanes>(s: S, terms: &[f32; TERMS], offsets: &Offsets<S>, layer: usize) -> S::F {
    let [one, x, y, z, xx, yy, zz, xy, xz, yz] = *terms;
    let [dx, dy, dz] = offsets.layer(layer);
    let along_x = s.mul_add(dx, s.splat(xx), s.mul_add(dy, s.splat(xy), s.mul_add(dz, s.splat(xz), s.splat(x))));
    let along_y = s.mul_add(dy, s.splat(yy), s.mul_add(dz, s.splat(yz), s.splat(y)));
    let along_z = s.mul_add(dz, s.splat(zz), s.splat(z));
    s.add(s.splat(one), dot(s, [dx, dy, dz], [along_x, along_y, along_z]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::Portable;

    #[test]
    fn phases_are_turned_back() {
        for n in -2000..2000 {
            // As many half turns as within a brick 2 cm wide.
            let (half_turns, s) = (n as f32 * 0.0137, Portable);
            let z = [s.splat(0.3), s.splat(-0.4)];
            let (re, im) = add_turned(s, z, s.splat(2.0), s.splat(half_turns), [s.splat(2.0), s.splat(3.0)]);
            let (sin, cos) = (f64::from(half_turns) * std::f64::consts::PI).sin_cos();
            assert!((f64::from(re[0]) - 2.0 - (0.6 * cos - 0.8 * sin)).abs() < 1.5e-4);
            assert!((f64::from(im[0]) - 3.0 - (-0.8 * cos - 0.6 * sin)).abs() < 1.5e-4);
        }
    }
}

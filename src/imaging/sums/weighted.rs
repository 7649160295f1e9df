//! Sums of amplitudes times w = D·A over a brick: `thesis-full`, `thesis`, `glrt` and `coherent`.
//!
//! D is in the tables, A comes from a parabola in the cosine to the boresight about the brick's centre where that is good
//! enough, else from the beam's table voxel by voxel. Voxels are summed in the order of the sweeps, in f32.

use super::beam_table::{BeamTable, ENTRIES_PER_COS};
use super::dispatch::{Kernel, on_widest};
use super::lanes::{LANES, Lanes, WINDOW};
use super::power::{at_edge, window};
use super::sight::{BrickShape, EDGE, Offsets, Sight, VOXELS, lane3, splat3};
use super::stack::{Group, SweepStack};
use crate::imaging::Statistic;
use crate::radar::WAVELENGTH_M;

/// Largest error of a distance, metres: 1 % of a radian of phase.
const DISTANCE_ERROR_M: f64 = 4e-6;
/// Largest error of the beam's amplitude that a parabola may leave, as a share of the greatest among the sixteen sweeps: far
/// off every boresight all amplitudes are small, and only their ratio counts.
const AMPLITUDE_ERROR: f32 = 1e-3;

/// A shape that is good enough for these sums.
pub(super) fn weighted_shape(voxel_m: f64) -> BrickShape {
    BrickShape::new(voxel_m, DISTANCE_ERROR_M)
}

/// The beam's amplitude at a cosine, linear between its table's entries.
#[inline(always)]
pub(super) fn amplitude<S: Lanes>(s: S, beam: &BeamTable, cos: S::F) -> S::F {
    let at = s.mul(s.add(cos, s.splat(1.0)), s.splat(ENTRIES_PER_COS));
    let whole = s.floor(at);
    let n = s.to_int(whole);
    let (here, next) = (s.gather(&beam.amplitudes, n), s.gather(&beam.amplitudes, s.add_int(n, s.splat_int(1))));
    s.mul_add(s.sub(at, whole), s.sub(next, here), here)
}

/// The statistic over the voxels of one brick, all sweeps of a stack.
#[derive(Clone)]
pub(super) struct AddWeighted<'a> {
    pub stack: &'a SweepStack,
    pub shape: BrickShape,
    /// Relative to the stack's origin, metres.
    pub center: [f32; 3],
}

/// Values, x fastest, and the (voxel, sweep) pairs that were worked on.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct WeightedValues {
    pub values: [f32; VOXELS],
    pub updates: u64,
}

impl AddWeighted<'_> {
    /// On the widest instructions.
    pub(super) fn values(self) -> WeightedValues {
        on_widest(self)
    }
}

/// What a layer of voxels has gathered: the sum (or its real part), the imaginary part, Σ w².
struct Gathered<S: Lanes> {
    re: [S::F; EDGE],
    im: [S::F; EDGE],
    weights: [S::F; EDGE],
}

/// One sweep's terms for one layer: distance, its deviation from the brick's centre in turns of phase, A.
struct Terms<S: Lanes> {
    table: [S::F; 3],
    turns: S::F,
    amplitude: S::F,
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
    #[inline(always)]
    fn sums<S: Lanes, const PLANES: usize>(&self, s: S) -> WeightedValues {
        let offsets = Offsets::new(s, &self.shape);
        let zero = [s.splat(0.0); EDGE];
        let mut gathered = Gathered::<S> { re: zero, im: zero, weights: zero };
        let mut updates = 0;
        for (group, sweeps) in self.stack.groups.iter().enumerate() {
            let sight = Sight::new(s, self.stack, sweeps, self.center, &self.shape);
            let beam = BeamParabola::new(s, &self.stack.beam, &sight, &self.shape);
            let inside = sight.inside & beam.good;
            let mut left = sight.inside | sight.edge;
            updates += u64::from(left.count_ones()) * VOXELS as u64;
            while left != 0 {
                let l = left.trailing_zeros() as usize;
                left &= left - 1;
                if inside >> l & 1 == 1 {
                    self.add_inside::<S, PLANES>(s, group, &sight, &beam, l, &offsets, &mut gathered);
                } else {
                    self.add_edge::<S, PLANES>(s, group, &sight, l, &offsets, &mut gathered);
                }
            }
        }
        let mut values = [0.0; VOXELS];
        for layer in 0..EDGE {
            let value = gathered.value::<PLANES>(s, layer);
            values[layer * LANES..][..LANES].copy_from_slice(&s.store(value));
        }
        WeightedValues { values, updates }
    }

    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    fn add_inside<S: Lanes, const PLANES: usize>(
        &self,
        s: S,
        group: usize,
        sight: &Sight,
        beam: &BeamParabola,
        l: usize,
        offsets: &Offsets<S>,
        gathered: &mut Gathered<S>,
    ) {
        let (slot, first) = (group * LANES + l, sight.window[l] as usize);
        let sweeps = &self.stack.groups[group];
        let mut windows = [(&[0.0; WINDOW], &[0.0; WINDOW]); PLANES];
        for plane in 0..PLANES {
            let (values, slopes) = self.stack.table(slot, plane).split_at(self.stack.stride);
            let (Some(values), Some(slopes)) = (window(values, first), window(slopes, first)) else { return };
            windows[plane] = (values, slopes);
        }
        let [ux, uy, uz] = lane3(s, &sight.toward, l);
        let flat = s.mul_add(offsets.x, ux, s.mul(offsets.y, uy));
        let (half, half2) = (s.splat(sight.half_per_m[l]), s.splat(sight.half_per_m2[l]));
        let (per_m, entry) = (s.splat(sight.entries_per_m[l]), s.splat(sight.entry[l]));
        // The boresight in units of the distance, so that the products are deviations of the cosine.
        let per_distance = 1.0 / sight.pose_distance_m[l];
        let [bx, by, bz] = sweeps_forward(s, sweeps, l, per_distance);
        let flat_cos = s.mul_add(offsets.x, bx, s.mul(offsets.y, by));
        let (cos, per_distance) = (s.splat(sight.cos[l]), s.splat(per_distance));
        let [a0, a1, a2] = lane3(s, &beam.terms, l);
        let (center_turns, turns_per_m) = turns_of(sight, l);
        let (center_turns, turns_per_m) = (s.splat(center_turns), s.splat(turns_per_m));
        for layer in 0..EDGE {
            let q = s.mul_add(offsets.z[layer], uz, flat);
            let bend = s.mul(s.neg_mul_add(q, q, offsets.squared[layer]), s.neg_mul_add(q, half2, half));
            let deviation = s.add(q, bend);
            let at = s.mul_add(deviation, per_m, entry);
            let whole = s.floor(at);
            let (n, rest) = (s.to_int(whole), s.sub(at, whole));
            let mut table = [s.splat(0.0); 3];
            for plane in 0..PLANES {
                let (values, slopes) = windows[plane];
                table[plane] = s.mul_add(rest, s.look_up(slopes, n), s.look_up(values, n));
            }
            let amplitude = if self.stack.beam.uniform {
                s.splat(1.0)
            } else {
                // Δcos = (δ·b − cos·ε)/(1 + ε) with b and the deviation ε in units of the distance.
                let off = s.mul(deviation, per_distance);
                let along = s.mul_add(offsets.z[layer], bz, flat_cos);
                let inverse = s.mul_add(s.sub(off, s.splat(1.0)), off, s.splat(1.0));
                let turn = s.mul(s.neg_mul_add(cos, off, along), inverse);
                s.mul_add(s.mul_add(a2, turn, a1), turn, a0)
            };
            let turns = s.mul_add(deviation, turns_per_m, center_turns);
            gathered.add::<PLANES>(s, layer, Terms { table, turns, amplitude });
        }
    }

    #[inline(always)]
    fn add_edge<S: Lanes, const PLANES: usize>(
        &self,
        s: S,
        group: usize,
        sight: &Sight,
        l: usize,
        offsets: &Offsets<S>,
        gathered: &mut Gathered<S>,
    ) {
        let (slot, sweeps) = (group * LANES + l, &self.stack.groups[group]);
        let center = s.splat(sight.distance_m[l]);
        let (center_turns, _) = turns_of(sight, l);
        for layer in 0..EDGE {
            let (distance, counts, cos) = at_edge(s, self.stack, group, sight, l, offsets, layer);
            let at = s.mul(s.sub(distance, s.splat(sweeps.first_m[l])), s.splat(sweeps.entries_per_m[l]));
            let whole = s.floor(at);
            let n = s.to_int(s.or_zero(counts, whole));
            // What does not count may be no number; it must not reach the sums.
            let mut table = [s.splat(0.0); 3];
            for plane in 0..PLANES {
                let (values, slopes) = self.stack.table(slot, plane).split_at(self.stack.stride);
                let value = s.mul_add(s.sub(at, whole), s.gather(slopes, n), s.gather(values, n));
                table[plane] = s.or_zero(counts, value);
            }
            let amplitude = if self.stack.beam.uniform { s.splat(1.0) } else { amplitude(s, &self.stack.beam, cos) };
            let turns = s.mul_add(s.sub(distance, center), s.splat(TURNS_PER_M), s.splat(center_turns));
            let amplitude = s.or_zero(counts, amplitude);
            gathered.add::<PLANES>(s, layer, Terms { table, turns: s.or_zero(counts, turns), amplitude });
        }
    }
}

/// A sweep's boresight, scaled.
#[inline(always)]
fn sweeps_forward<S: Lanes>(s: S, sweeps: &Group, l: usize, by: f32) -> [S::F; 3] {
    let [x, y, z] = &sweeps.forward;
    splat3(s, [x[l] * by, y[l] * by, z[l] * by])
}

/// Turns of phase per metre of distance: there and back.
const TURNS_PER_M: f32 = (2.0 / WAVELENGTH_M) as f32;

/// The centre's phase in turns, whole ones left out, and turns per metre of deviation.
#[inline(always)]
fn turns_of(sight: &Sight, l: usize) -> (f32, f32) {
    let turns = f64::from(sight.distance_m[l]) * (2.0 / WAVELENGTH_M);
    ((turns - turns.floor()) as f32, TURNS_PER_M * sight.stretch[l])
}

impl<S: Lanes> Gathered<S> {
    #[inline(always)]
    fn add<const PLANES: usize>(&mut self, s: S, layer: usize, terms: Terms<S>) {
        let Terms { table, turns, amplitude } = terms;
        if PLANES < 3 {
            self.re[layer] = s.mul_add(table[0], amplitude, self.re[layer]);
            if PLANES == 2 {
                self.weights[layer] = s.mul_add(table[1], s.mul(amplitude, amplitude), self.weights[layer]);
            }
            return;
        }
        // z · e^(−j·2π·turns)
        let (cos, sin) = cos_sin(s, turns);
        let (re, im) = (s.mul(table[0], amplitude), s.mul(table[1], amplitude));
        self.re[layer] = s.mul_add(im, sin, s.mul_add(re, cos, self.re[layer]));
        self.im[layer] = s.neg_mul_add(re, sin, s.mul_add(im, cos, self.im[layer]));
        self.weights[layer] = s.mul_add(table[2], s.mul(amplitude, amplitude), self.weights[layer]);
    }

    #[inline(always)]
    fn value<const PLANES: usize>(&self, s: S, layer: usize) -> S::F {
        let (re, im, weights) = (self.re[layer], self.im[layer], self.weights[layer]);
        let some = s.at_most(s.splat(f32::MIN_POSITIVE), weights);
        match PLANES {
            1 => re,
            2 => s.or_zero(some, s.div(re, s.sqrt(weights))),
            _ => s.or_zero(some, s.div(s.sqrt(s.mul_add(re, re, s.mul(im, im))), s.sqrt(weights))),
        }
    }
}

/// cos and sin of 2π·turns, to 1e-5: half turns are taken off and decide the sign, the rest goes through short polynomials.
#[inline(always)]
pub(super) fn cos_sin<S: Lanes>(s: S, turns: S::F) -> (S::F, S::F) {
    let twice = s.add(turns, turns);
    let whole = s.round(twice);
    let f = s.sub(twice, whole);
    // 1 for even half turns, −1 for odd ones: 1 − 2·(whole mod 2).
    let half = s.mul(whole, s.splat(0.5));
    let odd = s.abs(s.sub(half, s.round(half)));
    let sign = s.neg_mul_add(odd, s.splat(4.0), s.splat(1.0));
    let x2 = s.mul(f, f);
    // Chebyshev fits of sin(πf)/f and cos(πf) over |f| ≤ ½.
    let sin = s.mul_add(x2, s.splat(-0.559_462_45), s.splat(2.544_010_5));
    let sin = s.mul_add(x2, sin, s.splat(-5.167_406_7));
    let sin = s.mul_add(x2, sin, s.splat(3.141_590_3));
    let cos = s.mul_add(x2, s.splat(-1.222_031_8), s.splat(4.041_248));
    let cos = s.mul_add(x2, cos, s.splat(-4.933_934_7));
    let cos = s.mul_add(x2, cos, s.splat(0.999_993_25));
    (s.mul(cos, sign), s.mul(s.mul(sin, f), sign))
}

/// A ≈ a0 + Δcos·(a1 + Δcos·a2) about a brick's centre, for each of sixteen sweeps.
struct BeamParabola {
    terms: [[f32; LANES]; 3],
    /// Sweeps for which it is good enough over the whole brick.
    good: u16,
}

impl BeamParabola {
    #[inline(always)]
    fn new<S: Lanes>(s: S, beam: &BeamTable, sight: &Sight, shape: &BrickShape) -> Self {
        if beam.uniform {
            return Self { terms: [[0.0; LANES]; 3], good: u16::MAX };
        }
        // The cosine changes by at most ρ/d, and a little for the bend.
        let distance = s.max(s.load(&sight.pose_distance_m), s.splat(1e-6));
        let width = s.min(s.div(s.splat(shape.radius_m * 1.1), distance), s.splat(0.25));
        let width = s.max(width, s.splat(2.0 / ENTRIES_PER_COS));
        let cos = s.load(&sight.cos);
        // Three points `width` apart, the highest at most 1: near the axis they move to the side that there is.
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
        let seen = sight.inside | sight.edge;
        let centers = s.store(amplitude(s, beam, cos)).into_iter().enumerate();
        let most =
            centers.filter(|(l, _)| seen >> l & 1 == 1).fold(0.0, |most, (_, a)| if a > most { a } else { most });
        let good = s.at_most(s.max(s.abs(off), s.abs(off_far)), s.splat(AMPLITUDE_ERROR * most));
        Self { terms: [s.store(a0), s.store(a1), s.store(a2)], good: s.bits(good) }
    }
}

/// A at some widths below the highest point.
#[inline(always)]
fn below<S: Lanes>(s: S, beam: &BeamTable, cos: S::F, high: S::F, width: S::F, widths: f32) -> S::F {
    amplitude(s, beam, s.add(cos, s.neg_mul_add(width, s.splat(widths), high)))
}

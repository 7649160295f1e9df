//! The beam's amplitude over a brick: a parabola in the cosine to the boresight, expanded to second order about the brick's
//! centre.

use super::super::beam_table::{BeamTable, ENTRIES_PER_COS, amplitude};
use super::super::brick_geometry::{BrickShape, Offsets, Sight};
use super::super::edge_geometry::FromPoses;
use super::super::sweep_stack::Group;
use crate::simd::{LANES, Lanes, lane3, load3, scale3, store3, sub3};

/// Greatest absolute error of the beam's amplitude due to its expansion, and greatest relative
/// error. Choice: below the uncertainty of any beam pattern; smaller errors leave most bricks to
/// separate voxels.
pub(super) const AMPLITUDE_ERROR: f32 = 2e-3;
const AMPLITUDE_ERROR_SHARE: f32 = 2e-2;

/// A about a brick's centre, for each of sixteen sweeps, to second order in a voxel's offset δ from
/// it: A ≈ a0 + g·(a1 + a2·g − a1·q/d) − a1·cos·(|δ|² − q²)/2d², with q along the line of sight and
/// g = δ·(b − cos·u)/d.
pub(super) struct BeamExpansion {
    /// A and its derivatives with respect to the cosine to the boresight.
    pub terms: [[f32; LANES]; 3],
    /// (b − cos·u)/d: the gradient of g.
    pub gradient_per_m: [[f32; LANES]; 3],
    /// Slope of A along z: at the centre, and what it grows by with g and with q.
    slope: [[f32; LANES]; 3],
    /// Part of A of second order in z, in the outer and the inner layers.
    bend: [[f32; LANES]; 2],
    /// −a1/d and −a1·cos/2d².
    along_per_m: [f32; LANES],
    across_per_m2: [f32; LANES],
    /// Cosine to the boresight.
    pub cos: [f32; LANES],
    /// Lanes for which it is accurate enough over the whole brick.
    pub good: u16,
}

impl BeamExpansion {
    /// A = 1.
    pub const FLAT: Self = Self {
        terms: [[1.0; LANES], [0.0; LANES], [0.0; LANES]],
        gradient_per_m: [[0.0; LANES]; 3],
        slope: [[0.0; LANES]; 3],
        bend: [[0.0; LANES]; 2],
        along_per_m: [0.0; LANES],
        across_per_m2: [0.0; LANES],
        cos: [1.0; LANES],
        good: u16::MAX,
    };

    #[inline(always)]
    pub fn new<S: Lanes>(
        s: S,
        beam: &BeamTable,
        sweeps: &Group,
        (sight, poses): (&Sight, &FromPoses<S>),
        shape: &BrickShape,
    ) -> Self {
        if beam.uniform {
            return Self::FLAT;
        }
        let toward = load3(s, &sight.toward);
        let cos = poses.cos;
        let per_m = s.div(s.splat(1.0), s.max(poses.distance, s.splat(1e-6)));
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
        let [outer, inner, ..] = shape.heights();
        Self {
            terms: [s.store(a0), s.store(a1), s.store(a2)],
            gradient_per_m: [s.store(gradient[0]), s.store(gradient[1]), s.store(gradient[2])],
            slope: store3(s, slope),
            bend: [s.store(s.mul(bend, s.splat(outer * outer))), s.store(s.mul(bend, s.splat(inner * inner)))],
            along_per_m: s.store(along),
            across_per_m2: s.store(across),
            cos: s.store(cos),
            good: s.mask_bits(good),
        }
    }
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
    if let Some(polynomial) = &beam.polynomial {
        let (terms, error) = polynomial.parabola(s, cos, turn);
        return (terms, s.at_most(error, tolerance(s, terms[0])));
    }
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
    amplitude(s, beam, s.add(cos, s.neg_mul_add(width, s.splat(widths), high)))
}

/// A over the brick as a polynomial in the layer's height: for each lane what two layers of equal distance from the centre
/// have in common, outer and inner ones, and the slope.
pub(super) struct Amplitudes<S: Lanes> {
    even: [S::F; 2],
    slope: S::F,
}

impl<S: Lanes> Amplitudes<S> {
    /// `flat`, `flat_g`: component along the line of sight, and g, for the layer through the centre.
    #[inline(always)]
    pub fn of(s: S, beam: &BeamExpansion, l: usize, offsets: &Offsets<S>, [flat, flat_g]: [S::F; 2]) -> Self {
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
    pub fn in_layer(&self, s: S, offsets: &Offsets<S>, layer: usize) -> S::F {
        s.mul_add(self.slope, offsets.z[layer], self.even[usize::from(layer == 1 || layer == 2)])
    }
}

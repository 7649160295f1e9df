//! The tables of one leaf over one box.

use super::super::Subaperture;
use super::super::leaf::Leaf;
use super::{ROW_LEN, Scratch};
use crate::PHASE_RAD_PER_M;
use crate::simd::{LANES, Lanes};

/// Tables of one leaf over one box: value, slope and half the second difference at each entry; for
/// the moments, value and slope.
pub(super) struct Tables<S: Lanes> {
    /// The energy less the coherent sum's share of it, abs(sum)² over the number of sweeps. In an echo much stronger than
    /// the noise both are large and nearly equal; interpolated one by one, their difference would be lost.
    pub incoherent: [S::Table; 3],
    pub re: [S::Table; 3],
    pub im: [S::Table; 3],
    pub first: [[S::Table; 2]; 2],
    pub second: [[S::Table; 2]; 2],
}

#[inline(always)]
pub(super) fn tabulate<S: Lanes, const ORDER: usize>(
    s: S,
    block: &Subaperture,
    scratch: &Scratch,
    run: &Leaf,
    offset_m: &[f32],
    cosine_spread: f32,
) -> Tables<S> {
    let rows = &block.rows;
    let zero = s.splat(0.0);
    let (mut energy, mut sum) = (zero, [zero; 2]);
    let (mut first, mut second) = ([zero; 2], [zero; 2]);
    let sweeps = run.first..run.end;
    let turns = scratch.cos[sweeps.clone()].iter().zip(&scratch.sin[sweeps.clone()]);
    let tables = scratch.starts[sweeps.clone()].iter().zip(&scratch.share[sweeps.clone()]);
    for (((&[here, next], &share), (&cos, &sin)), &offset_m) in tables.zip(turns).zip(&offset_m[sweeps]) {
        let (here, next) = (here as usize, next as usize);
        let share = s.splat(share);
        let (from, to) = (s.load_at(&rows.values, here), s.load_at(&rows.values, next));
        let re = s.mul_add(share, s.sub(to, from), from);
        let (from, to) = (s.load_at(&rows.values, here + ROW_LEN), s.load_at(&rows.values, next + ROW_LEN));
        let im = s.mul_add(share, s.sub(to, from), from);
        energy = s.mul_add(re, re, s.mul_add(im, im, energy));
        let (cos, sin) = (s.splat(cos), s.splat(sin));
        // z · e^(−jκd)
        let (re, im) = (s.mul_add(re, cos, s.mul(im, sin)), s.neg_mul_add(re, sin, s.mul(im, cos)));
        sum = [s.add(sum[0], re), s.add(sum[1], im)];
        if ORDER >= 1 {
            // e^(jφ) ≈ 1 + jφ(1 − φm²/8) − ½φ²(1 − φm²/12) for φ within ±φm.
            let phase = PHASE_RAD_PER_M as f32 * offset_m;
            let greatest = phase * cosine_spread;
            let greatest2 = greatest * greatest;
            let linear = s.splat(phase * (1.0 - greatest2 * (1.0 / 8.0)));
            first = [s.neg_mul_add(linear, im, first[0]), s.mul_add(linear, re, first[1])];
            if ORDER >= 2 {
                let square = s.splat(0.5 * phase * phase * (1.0 - greatest2 * (1.0 / 12.0)));
                second = [s.neg_mul_add(square, re, second[0]), s.neg_mul_add(square, im, second[1])];
            }
        }
    }
    let coherent = s.mul(s.mul_add(sum[0], sum[0], s.mul(sum[1], sum[1])), s.splat(run.share()));
    Tables {
        incoherent: quadratics(s, s.sub(energy, coherent)),
        re: quadratics(s, sum[0]),
        im: quadratics(s, sum[1]),
        first: [lines(s, first[0]), lines(s, first[1])],
        second: [lines(s, second[0]), lines(s, second[1])],
    }
}

/// The entries before and after each entry.
#[inline(always)]
fn neighbors<S: Lanes>(s: S, table: S::F) -> (S::F, S::F) {
    (s.permute(table, s.load_int(&LANE_BEFORE)), s.permute(table, s.load_int(&LANE_AFTER)))
}

/// Index of each lane's neighbour, wrapping at the ends.
const LANE_BEFORE: [i32; LANES] = lane_plus(LANES - 1);
const LANE_AFTER: [i32; LANES] = lane_plus(1);

const fn lane_plus(shift: usize) -> [i32; LANES] {
    let (mut lanes, mut l) = ([0; LANES], 0);
    while l < LANES {
        lanes[l] = ((l + shift) % LANES) as i32;
        l += 1;
    }
    lanes
}

/// Value, slope and curvature at each entry: the quartic through five entries, economised to a
/// quadratic within half an entry of the middle one. Next to the tables' ends, where the fifth
/// entry is missing, the cubic through four.
#[inline(always)]
fn quadratics<S: Lanes>(s: S, table: S::F) -> [S::Table; 3] {
    let (before, after) = neighbors(s, table);
    let half = s.splat(0.5);
    let slope = s.mul(s.sub(after, before), half);
    let bend = s.sub(s.mul(s.add(after, before), half), table);
    let (bend_before, bend_after) = neighbors(s, bend);
    let (rise, fall) = (s.sub(bend_after, bend), s.sub(bend, bend_before));
    let third = s.add(s.mul(rise, s.load(&AFTER)), s.mul(fall, s.load(&BEFORE)));
    let fourth = s.mul(s.sub(rise, fall), s.load(&INNER));
    [
        s.table(s.neg_mul_add(fourth, s.splat(1.0 / 1536.0), table)),
        s.table(s.neg_mul_add(third, s.splat(13.0 / 96.0), slope)),
        s.table(s.neg_mul_add(fourth, s.splat(1.0 / 16.0), bend)),
    ]
}

/// Weights of the change of curvature after an entry, before it, and of their difference. Both
/// sides count where an entry has two neighbours on each; otherwise the inner side alone.
const AFTER: [f32; LANES] = [0.0, 2.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0];
const BEFORE: [f32; LANES] = [0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 0.0];
const INNER: [f32; LANES] = [0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0];

#[inline(always)]
fn lines<S: Lanes>(s: S, table: S::F) -> [S::Table; 2] {
    let (before, after) = neighbors(s, table);
    [s.table(table), s.table(s.mul(s.sub(after, before), s.splat(0.5)))]
}

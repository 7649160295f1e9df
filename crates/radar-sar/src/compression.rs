//! Range compression: the matched filter over fast time, tabulated finely enough to interpolate.
//!
//! z(r) = Σ_n x[n] E(r_n − r) / √Σ_n E(r_n − r)². Phase enhancement makes the pulse's phase flat,
//! so the template is real. The table has an entry at least every 10 mm. Cubic interpolation
//! reproduces z to 5e-4 of its peak (profile 1: 3e-3, because its pulse is only four steps wide).
//!
//! Bound: with AVX2, a tap takes eight multiply-adds for thirty-two values of both parts, four cycles on
//! Zen 4, 4750 for a sweep of 321 points and 108 taps. Measured there (`cargo bench -p radar-sar --bench
//! backprojection`, profiled): 4850.

use std::sync::Arc;

use num_complex::Complex32;

use super::cubic;
use crate::simd::{Kernel, LANES, Lanes, on_widest};
use crate::{Observation, SweepGeometry, envelope};

/// Widest table step, metres: slightly above a seventh of the range step of presets for rooms. Choice: a sixteenth of
/// the pulse of profile 3, which cubic interpolation follows; linear leaves errors of 2 to 4 mm. Three steps are the
/// distance between the entries of a box's tables (`subaperture/brick.rs`).
const TABLE_STEP_M: f64 = 0.008_6;
/// Template values below this are omitted from the sum. Choice: −80 dB, below what 16-bit samples
/// resolve; it bounds the taps of a sum.
const NEGLIGIBLE_ENVELOPE: f64 = 1e-4;

/// Taps that the loops of a sum take at once; divides [`LANES`].
const TAPS_AT_ONCE: usize = 4;
type FewTaps = [f32; TAPS_AT_ONCE];

/// Matched filter of one range axis: a polyphase filter with one phase per table entry within a
/// range step.
#[derive(Debug, Clone)]
pub struct RangeCompressor {
    first_m: f64,
    step_m: f64,
    points: usize,
    /// `[phase][tap]`: the template at the surrounding samples, a few taps at once, zeros at the end; the
    /// first tap is `reach` samples before the entry's own.
    taps: Vec<Vec<FewTaps>>,
    reach: usize,
    /// `[entry]`: 1 / √Σ E² over the samples within the axis.
    norms: Vec<f32>,
}

/// z over range for one sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct CompressedSweep {
    /// Range of the first entry, metres.
    pub first_m: f64,
    /// Distance between entries, metres.
    pub step_m: f64,
    /// z in LSB, at least four entries.
    pub z: Vec<Complex32>,
}

impl RangeCompressor {
    /// For sweeps of a geometry, with the default table step.
    pub fn new(geometry: &SweepGeometry) -> Self {
        Self::with_step(geometry, TABLE_STEP_M)
    }

    /// For sweeps of a geometry. The table step is the axis's step divided by an integer, at most
    /// `widest_step_m`.
    pub fn with_step(geometry: &SweepGeometry, widest_step_m: f64) -> Self {
        let axis = &geometry.axis;
        let phases = (axis.step_m / widest_step_m).ceil().max(1.0) as usize;
        let step_m = axis.step_m / phases as f64;
        // Axes of fewer than four points get four entries, because interpolation needs four.
        let entries = (axis.points.saturating_sub(1) * phases + 1).max(4);
        let template =
            |offset_m: f64| Some(envelope(geometry.pulse_fwhm_m, offset_m)).filter(|e| *e >= NEGLIGIBLE_ENVELOPE);
        let reach = (0..axis.points).take_while(|&n| template(n as f64 * axis.step_m).is_some()).count();
        let tap = |phase: usize, tap: usize| {
            let samples = tap as f64 - reach as f64 - phase as f64 / phases as f64;
            template(samples * axis.step_m).unwrap_or(0.0)
        };
        let taps: Vec<Vec<f64>> =
            (0..phases).map(|phase| (0..2 * reach + 2).map(|k| tap(phase, k)).collect()).collect();
        let energies: Vec<Vec<f64>> = taps.iter().map(|taps| sums_of_squares(taps)).collect();
        let norm = |entry: usize| {
            // The taps that meet a sample: the first tap is `reach` samples before the entry's own.
            let (sums, at) = (&energies[entry % phases], entry / phases);
            let first = reach.saturating_sub(at).min(sums.len() - 1);
            let end = (axis.points + reach).saturating_sub(at).min(sums.len() - 1);
            let energy = sums[end.max(first)] - sums[first];
            if energy > 0.0 { (1.0 / energy.sqrt()) as f32 } else { 0.0 }
        };
        Self {
            first_m: axis.first_m,
            step_m,
            points: axis.points,
            norms: (0..entries).map(norm).collect(),
            taps: taps.iter().map(|taps| a_few_at_once(taps)).collect(),
            reach,
        }
    }

    /// Range of the first entry, metres.
    pub fn first_m(&self) -> f64 {
        self.first_m
    }

    /// Distance between entries, metres.
    pub fn step_m(&self) -> f64 {
        self.step_m
    }

    /// Number of table entries.
    pub fn entries(&self) -> usize {
        self.norms.len()
    }

    /// Compresses one sweep; each value is multiplied by `scale` (1 / noise rms makes z
    /// noise-normalised). Missing samples count as zero, samples beyond the axis are ignored.
    pub fn compress(&self, samples: &[Complex32], scale: f32) -> CompressedSweep {
        self.compress_with(samples, scale, &mut CompressionScratch::default())
    }

    fn compress_with(&self, samples: &[Complex32], scale: f32, room: &mut CompressionScratch) -> CompressedSweep {
        self.compress_in(samples, scale, room);
        let z = room.re.iter().zip(&room.im).map(|(re, im)| Complex32::new(*re, *im)).collect();
        CompressedSweep { first_m: self.first_m, step_m: self.step_m, z }
    }

    /// The same, into memory that is reused from sweep to sweep.
    pub(super) fn compress_in(&self, samples: &[Complex32], scale: f32, room: &mut CompressionScratch) {
        let phase_len = self.pad(room);
        on_widest(SplitComplex { samples, points: self.points, reach: self.reach, padded: &mut room.padded });
        self.filter(room);
        for part in [&mut room.re, &mut room.im] {
            part.resize(self.entries(), 0.0);
        }
        for (part, filtered) in [&mut room.re, &mut room.im].into_iter().zip(&room.filtered) {
            on_widest(Interleave { filtered, phase_len, norms: &self.norms, scale, out: part });
        }
    }

    /// Σ_n a[n] E(r_n − r) at every entry, not normalised: convolves real values with the pulse.
    pub(super) fn convolve_in(&self, values: &[f32], room: &mut CompressionScratch) {
        let phase_len = self.pad(room);
        let padded = room.padded[0][self.reach..].iter_mut().take(self.points);
        padded.zip(values).for_each(|(to, from)| *to = *from);
        self.filter(room);
        room.re.clear();
        let phases = self.taps.len();
        room.re.extend((0..self.entries()).map(|n| room.filtered[0][n % phases * phase_len + n / phases]));
    }

    /// Length of one phase's values: three more than the axis's points, rounded up to whole
    /// vectors.
    fn phase_len(&self) -> usize {
        (self.points + 3).next_multiple_of(LANES)
    }

    /// Resizes the buffers and zeroes the samples; returns the length of one phase's values.
    fn pad(&self, room: &mut CompressionScratch) -> usize {
        let phase_len = self.phase_len();
        for padded in &mut room.padded {
            padded.resize(phase_len + 2 * self.reach + 2 + 3 * LANES, 0.0);
            padded.fill(0.0);
        }
        for filtered in &mut room.filtered {
            filtered.resize(phase_len * self.taps.len(), 0.0);
        }
        phase_len
    }

    /// Filters both parts of the padded samples through every phase: `[part][phase · long +
    /// sample]`.
    fn filter(&self, room: &mut CompressionScratch) {
        let phase_len = self.phase_len();
        let (padded, [re, im]) = (&room.padded, &mut room.filtered);
        let of_phases = re.chunks_exact_mut(2 * phase_len).zip(im.chunks_exact_mut(2 * phase_len));
        for ((re, im), taps) in of_phases.zip(self.taps.chunks_exact(2)) {
            let ((re, re_next), (im, im_next)) = (re.split_at_mut(phase_len), im.split_at_mut(phase_len));
            let [taps, taps_next] = taps else { continue };
            on_widest(Filter { samples: padded, taps: [taps, taps_next], out: [[re, im], [re_next, im_next]] });
        }
        if let [taps] = self.taps.chunks_exact(2).remainder() {
            let last = phase_len * (self.taps.len() - 1);
            let (re, im) = (&mut re[last..], &mut im[last..]);
            on_widest(FilterOne { samples: padded, taps, out: [re, im] });
        }
    }
}

/// Scratch memory of the compression; its results are `re` and `im`.
#[derive(Debug, Default)]
pub(super) struct CompressionScratch {
    /// Real and imaginary parts of z, by entry.
    pub(super) re: Vec<f32>,
    pub(super) im: Vec<f32>,
    padded: [Vec<f32>; 2],
    filtered: [Vec<f32>; 2],
}

/// Splits samples into real and imaginary parts.
struct SplitComplex<'a> {
    samples: &'a [Complex32],
    points: usize,
    reach: usize,
    padded: &'a mut [Vec<f32>; 2],
}

impl Kernel for SplitComplex<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) {
        let [re, im] = self.padded;
        let points = self.points.min(self.samples.len());
        let (re, im) = (&mut re[self.reach..][..points], &mut im[self.reach..][..points]);
        for ((sample, re), im) in self.samples[..points].iter().zip(re).zip(im) {
            (*re, *im) = (sample.re, sample.im);
        }
    }
}

/// Interleaves the phases' values, each multiplied by its norm.
struct Interleave<'a> {
    filtered: &'a [f32],
    phase_len: usize,
    norms: &'a [f32],
    scale: f32,
    out: &'a mut [f32],
}

impl Kernel for Interleave<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) {
        let Self { filtered, phase_len, norms, scale, out } = self;
        match filtered.len() / phase_len {
            1 => {
                for ((out, norm), value) in out.iter_mut().zip(norms).zip(filtered) {
                    *out = value * (norm * scale);
                }
            }
            2 => {
                // There are twice as many entries as samples, minus one.
                let (even, odd) = filtered.split_at(phase_len);
                let pairs = out.chunks_exact_mut(2).zip(norms.chunks_exact(2));
                for (((out, norm), even), odd) in pairs.zip(even).zip(odd) {
                    (out[0], out[1]) = (even * (norm[0] * scale), odd * (norm[1] * scale));
                }
                let last = out.len() - 1;
                out[last] = filtered[last % 2 * phase_len + last / 2] * (norms[last] * scale);
            }
            phases => {
                // Indexed loops: stepping iterators would not be compiled for the kernel's
                // instructions.
                for phase in 0..phases {
                    let values = &filtered[phase * phase_len..(phase + 1) * phase_len];
                    let entries = out.len().min(norms.len()).saturating_sub(phase).div_ceil(phases);
                    for (at, value) in values[..entries].iter().enumerate() {
                        let entry = at * phases + phase;
                        out[entry] = value * (norms[entry] * scale);
                    }
                }
            }
        }
    }
}

/// Two phases of the filter over both parts of the samples.
struct Filter<'a> {
    samples: &'a [Vec<f32>; 2],
    taps: [&'a [FewTaps]; 2],
    /// `[phase][part]`.
    out: [[&'a mut [f32]; 2]; 2],
}

impl Kernel for Filter<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) {
        let [mut out, mut out_next] = self.out;
        for at in (0..out[0].len()).step_by(LANES) {
            let [sums, sums_next] = add_both(s, self.samples, at, self.taps, [[s.splat(0.0); 2]; 2]);
            put(s, &mut out, at, sums);
            put(s, &mut out_next, at, sums_next);
        }
    }
}

/// One phase of the filter over both parts of the samples, thirty-two values at once.
struct FilterOne<'a> {
    samples: &'a [Vec<f32>; 2],
    taps: &'a [FewTaps],
    /// `[part]`.
    out: [&'a mut [f32]; 2],
}

impl Kernel for FilterOne<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) {
        let (samples, taps, mut out) = (self.samples, self.taps, self.out);
        let ends = taps.len().min(LANES / TAPS_AT_ONCE);
        let rest = taps.len() - ends;
        for at in (0..out[0].len()).step_by(2 * LANES) {
            // What is loaded for a tap of the first sixteen values serves the second sixteen with the tap
            // sixteen before: loads, not sums, limit the speed.
            let sums = add_one(s, samples, at, &taps[..ends], [s.splat(0.0); 2]);
            let (shared, both) = (at + ends * TAPS_AT_ONCE, [&taps[ends..], &taps[..rest]]);
            let [sums, sums_next] = add_both(s, samples, shared, both, [sums, [s.splat(0.0); 2]]);
            put(s, &mut out, at, sums);
            if at + LANES < out[0].len() {
                let sums_next = add_one(s, samples, at + LANES + rest * TAPS_AT_ONCE, &taps[rest..], sums_next);
                put(s, &mut out, at + LANES, sums_next);
            }
        }
    }
}

/// Adds both parts of the samples from an index on, each times its tap, to a sum.
#[inline(always)]
fn add_one<S: Lanes>(s: S, samples: &[Vec<f32>; 2], at: usize, taps: &[FewTaps], sums: [S::F; 2]) -> [S::F; 2] {
    let [mut a, mut b] = sums;
    for (n, taps) in taps.iter().enumerate() {
        let Some([x, y]) = windows(samples, at + n * TAPS_AT_ONCE) else { break };
        for (k, tap) in taps.iter().enumerate() {
            let tap = s.splat(*tap);
            (a, b) = (s.mul_add(load_from(s, x, k), tap, a), s.mul_add(load_from(s, y, k), tap, b));
        }
    }
    [a, b]
}

/// The same with the taps of two sums.
#[inline(always)]
#[expect(clippy::needless_range_loop, reason = "zipped iterators would be calls")]
fn add_both<S: Lanes>(
    s: S,
    samples: &[Vec<f32>; 2],
    at: usize,
    taps: [&[FewTaps]; 2],
    sums: [[S::F; 2]; 2],
) -> [[S::F; 2]; 2] {
    let [[mut a, mut b], [mut c, mut d]] = sums;
    for n in 0..taps[0].len().min(taps[1].len()) {
        let Some([x, y]) = windows(samples, at + n * TAPS_AT_ONCE) else { break };
        let taps = [&taps[0][n], &taps[1][n]];
        for k in 0..TAPS_AT_ONCE {
            let (x, y) = (load_from(s, x, k), load_from(s, y, k));
            let (tap, tap_next) = (s.splat(taps[0][k]), s.splat(taps[1][k]));
            (a, b) = (s.mul_add(x, tap, a), s.mul_add(y, tap, b));
            (c, d) = (s.mul_add(x, tap_next, c), s.mul_add(y, tap_next, d));
        }
    }
    [[a, b], [c, d]]
}

/// Values that a few taps and sixteen sums need.
type Window = [f32; LANES + TAPS_AT_ONCE];

/// Both parts of the samples from an index on. One comparison for a few taps: their loops do little else.
#[inline(always)]
fn windows(samples: &[Vec<f32>; 2], at: usize) -> Option<[&Window; 2]> {
    Some([samples[0].get(at..)?.first_chunk()?, samples[1].get(at..)?.first_chunk()?])
}

/// Sixteen values of a window from the `k`th on, k < `TAPS_AT_ONCE`.
#[inline(always)]
fn load_from<S: Lanes>(s: S, window: &Window, k: usize) -> S::F {
    window[k..].first_chunk().map_or(s.splat(0.0), |sixteen| s.load(sixteen))
}

/// Writes sixteen values of both parts from an index on, if there is room. Of known size: copying slices
/// would be a call for each.
#[inline(always)]
fn put<S: Lanes>(s: S, out: &mut [&mut [f32]; 2], at: usize, sums: [S::F; 2]) {
    let [re, im] = out;
    let (Some(re), Some(im)) = (re.get_mut(at..), im.get_mut(at..)) else { return };
    let (Some(re), Some(im)) = (re.first_chunk_mut(), im.first_chunk_mut()) else { return };
    (*re, *im) = (s.store(sums[0]), s.store(sums[1]));
}

fn a_few_at_once(taps: &[f64]) -> Vec<FewTaps> {
    let few = |taps: &[f64]| std::array::from_fn(|k| taps.get(k).map_or(0.0, |tap| *tap as f32));
    taps.chunks(TAPS_AT_ONCE).map(few).collect()
}

/// Sums of the squares of the first 0, 1, 2, … values.
fn sums_of_squares(values: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0];
    for value in values {
        sums.push(sums[sums.len() - 1] + value * value);
    }
    sums
}

/// Compresses sweeps, each with its own geometry's filter and its own scale.
pub(super) fn compress_all(observations: &[Observation], scale: impl Fn(&Observation) -> f32) -> Vec<CompressedSweep> {
    let mut compressors: Vec<(Arc<SweepGeometry>, RangeCompressor)> = Vec::new();
    let mut room = CompressionScratch::default();
    let compress = |observation: &Observation| {
        let Observation { geometry, samples, .. } = observation;
        let at = compressors.iter().position(|(known, _)| Arc::ptr_eq(known, geometry)).unwrap_or_else(|| {
            compressors.push((Arc::clone(geometry), RangeCompressor::new(geometry)));
            compressors.len() - 1
        });
        compressors[at].1.compress_with(samples, scale(observation), &mut room)
    };
    observations.iter().map(compress).collect()
}

impl CompressedSweep {
    /// z at a range by cubic interpolation; outside the table the nearest cubic is extrapolated.
    ///
    /// # Panics
    /// `self.z.len() < 4`.
    pub fn at(&self, range_m: f64) -> num_complex::Complex64 {
        let (first, u) = cubic::four_around((range_m - self.first_m) / self.step_m, self.z.len());
        self.weighted(first, cubic::weights(u))
    }

    /// z and dz/dr (per metre) at a range.
    ///
    /// # Panics
    /// `self.z.len() < 4`.
    pub fn value_and_slope(&self, range_m: f64) -> (num_complex::Complex64, num_complex::Complex64) {
        let (first, u) = cubic::four_around((range_m - self.first_m) / self.step_m, self.z.len());
        (self.weighted(first, cubic::weights(u)), self.weighted(first, cubic::weight_slopes(u)) / self.step_m)
    }

    fn weighted(&self, first: usize, weights: [f64; 4]) -> num_complex::Complex64 {
        let four = self.z[first..].iter().zip(weights);
        four.map(|(z, w)| num_complex::Complex64::new(f64::from(z.re) * w, f64::from(z.im) * w)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RangeAxis;
    use crate::oracle::compressed_at;
    use proptest::prelude::*;

    fn geometry(step_m: f64, points: usize, pulse_fwhm_m: f64) -> SweepGeometry {
        let axis = RangeAxis { first_m: 0.2, step_m, points };
        SweepGeometry { subsweep: 0, axis, pulse_fwhm_m, point_period_s: 1e-5 }
    }

    proptest! {
        #[test]
        fn the_table_agrees_with_the_definition(
            step in prop::sample::select(vec![0.0025, 0.01, 0.03, 0.06]),
            samples in prop::collection::vec((-1000.0..1000.0f32, -1000.0..1000.0f32), 50),
            share in 0.0..1.0f64,
        ) {
            let geometry = geometry(step, 50, 0.14);
            let samples: Vec<_> = samples.iter().map(|s| Complex32::new(s.0, s.1)).collect();
            let compressed = RangeCompressor::new(&geometry).compress(&samples, 1.0);
            let range = geometry.axis.first_m + share * (geometry.axis.last_m() - geometry.axis.first_m);
            let exact = compressed_at(&geometry, &samples, range);
            let largest = samples.iter().map(|s| s.norm()).fold(0.0, f32::max);
            prop_assert!((compressed.at(range) - exact).norm() < 2e-3 * f64::from(largest), "{} {}", compressed.at(range), exact);
        }
    }

    #[test]
    fn degenerate_axes_do_not_panic() {
        for points in 1..6 {
            let compressor = RangeCompressor::new(&geometry(0.06, points, 0.04));
            let compressed = compressor.compress(&vec![Complex32::new(1.0, 0.0); points], 1.0);
            assert!(compressed.at(0.2).norm().is_finite() && compressed.at(-5.0).re.is_finite());
        }
    }
}

//! Range compression: the matched filter over fast time, tabulated finely enough to interpolate.
//!
//! z(r) = Σ_n x[n] E(r_n − r) / √Σ_n E(r_n − r)². Phase enhancement makes the pulse's phase flat, so the template is real.
//! The table has a value at least every 10 mm; cubics between its values reproduce z to 5e-4 of its peak (profile 1: 3e-3,
//! its pulse being but four steps wide).

use std::sync::Arc;

use num_complex::Complex32;

use super::cubic;
use crate::radar::{Observation, SweepGeometry, envelope};

/// Widest step of the table, metres (a little above four base steps).
const TABLE_STEP_M: f64 = 0.010_1;
/// Template values below this are left out of the sum.
const NEGLIGIBLE_ENVELOPE: f64 = 1e-4;

/// The matched filter of one range axis, ready to use: a polyphase filter, one phase for each table entry of a step.
#[derive(Debug, Clone)]
pub struct RangeCompressor {
    first_m: f64,
    step_m: f64,
    points: usize,
    /// `[phase][tap]`: the template at the samples around, the first tap `reach` samples before the entry's own.
    taps: Vec<Vec<f32>>,
    reach: usize,
    /// `[entry]`: 1 / √Σ E² over the samples that there are.
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
    /// For sweeps of a geometry, with the default table: a value at least every 10 mm.
    pub fn new(geometry: &SweepGeometry) -> Self {
        Self::with_step(geometry, TABLE_STEP_M)
    }

    /// For sweeps of a geometry; table steps are a whole part of the axis' step, at most `widest_step_m` wide.
    pub fn with_step(geometry: &SweepGeometry, widest_step_m: f64) -> Self {
        let axis = &geometry.axis;
        let phases = (axis.step_m / widest_step_m).ceil().max(1.0) as usize;
        let step_m = axis.step_m / phases as f64;
        // Axes of fewer than four points are tabulated as if they went on: interpolation needs four.
        let entries = (axis.points.saturating_sub(1) * phases + 1).max(4);
        let template = |offset_m: f64| Some(envelope(geometry.profile, offset_m)).filter(|e| *e >= NEGLIGIBLE_ENVELOPE);
        let reach = (0..axis.points).take_while(|&n| template(n as f64 * axis.step_m).is_some()).count();
        let tap = |phase: usize, tap: usize| {
            let samples = tap as f64 - reach as f64 - phase as f64 / phases as f64;
            template(samples * axis.step_m).unwrap_or(0.0) as f32
        };
        let norm = |entry: usize| {
            let range_m = axis.first_m + entry as f64 * step_m;
            let nearby = (entry / phases).saturating_sub(reach)..(entry / phases + reach + 2).min(axis.points);
            let energy: f64 = nearby.filter_map(|n| template(axis.range_m(n) - range_m)).map(|e| e * e).sum();
            if energy > 0.0 { (1.0 / energy.sqrt()) as f32 } else { 0.0 }
        };
        Self {
            first_m: axis.first_m,
            step_m,
            points: axis.points,
            taps: (0..phases).map(|phase| (0..2 * reach + 2).map(|k| tap(phase, k)).collect()).collect(),
            reach,
            norms: (0..entries).map(norm).collect(),
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

    /// Entries of a table.
    pub fn entries(&self) -> usize {
        self.norms.len()
    }

    /// Compresses one sweep, each value times `scale` (1 / noise rms makes it noise-normalised). Samples that are missing
    /// count as zero, those beyond the axis are left out.
    pub fn compress(&self, samples: &[Complex32], scale: f32) -> CompressedSweep {
        let mut z = vec![Complex32::ZERO; self.entries()];
        let (re, im) = (self.filtered(samples, |x| x.re), self.filtered(samples, |x| x.im));
        let phases = self.taps.len();
        for (entry, (value, norm)) in z.iter_mut().zip(&self.norms).enumerate() {
            let at = (entry % phases) * (self.points + 3) + entry / phases;
            *value = Complex32::new(re[at], im[at]) * (norm * scale);
        }
        CompressedSweep { first_m: self.first_m, step_m: self.step_m, z }
    }

    /// Σ_n a[n] E(r_n − r) at every entry, not normalised: real values spread over the pulse.
    pub(super) fn spread(&self, values: &[f32]) -> Vec<f32> {
        let filtered = self.filtered(values, |a| *a);
        let phases = self.taps.len();
        (0..self.entries()).map(|n| filtered[(n % phases) * (self.points + 3) + n / phases]).collect()
    }

    /// One part of the samples through every phase: `[phase][sample]`, three samples longer than the axis.
    fn filtered<T>(&self, samples: &[T], part: impl Fn(&T) -> f32) -> Vec<f32> {
        let long = self.points + 3;
        let mut padded = vec![0.0f32; long + 2 * self.reach + 2];
        for (to, from) in padded[self.reach..].iter_mut().zip(samples.iter().take(self.points)) {
            *to = part(from);
        }
        let mut out = vec![0.0f32; long * self.taps.len()];
        for (out, taps) in out.chunks_exact_mut(long).zip(&self.taps) {
            for (k, tap) in taps.iter().enumerate().filter(|(_, tap)| **tap != 0.0) {
                for (sum, x) in out.iter_mut().zip(&padded[k..]) {
                    *sum += tap * x;
                }
            }
        }
        out
    }
}

/// Compresses sweeps, each by its own geometry's filter and times its own scale.
pub(super) fn compress_all(observations: &[Observation], scale: impl Fn(&Observation) -> f32) -> Vec<CompressedSweep> {
    let mut compressors: Vec<(Arc<SweepGeometry>, RangeCompressor)> = Vec::new();
    let compress = |observation: &Observation| {
        let Observation { geometry, samples, .. } = observation;
        let at = compressors.iter().position(|(known, _)| Arc::ptr_eq(known, geometry)).unwrap_or_else(|| {
            compressors.push((Arc::clone(geometry), RangeCompressor::new(geometry)));
            compressors.len() - 1
        });
        compressors[at].1.compress(samples, scale(observation))
    };
    observations.iter().map(compress).collect()
}

impl CompressedSweep {
    /// z at a range by cubics; outside the table the nearest cubic goes on.
    pub fn at(&self, range_m: f64) -> num_complex::Complex64 {
        let (first, u) = cubic::four_around((range_m - self.first_m) / self.step_m, self.z.len());
        self.weighted(first, cubic::weights(u))
    }

    /// z and dz/dr (per metre) at a range.
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
    use crate::imaging::oracle::compressed_at;
    use crate::radar::{Profile, RangeAxis};
    use proptest::prelude::*;

    fn geometry(step_m: f64, points: usize, profile: Profile) -> SweepGeometry {
        let axis = RangeAxis { first_m: 0.2, step_m, points };
        SweepGeometry { subsweep: 0, axis, profile, point_period_s: 1e-5 }
    }

    proptest! {
        #[test]
        fn the_table_agrees_with_the_definition(
            step in prop::sample::select(vec![0.0025, 0.01, 0.03, 0.06]),
            samples in prop::collection::vec((-1000.0..1000.0f32, -1000.0..1000.0f32), 50),
            share in 0.0..1.0f64,
        ) {
            let geometry = geometry(step, 50, Profile::P3);
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
            let compressor = RangeCompressor::new(&geometry(0.06, points, Profile::P1));
            let compressed = compressor.compress(&vec![Complex32::new(1.0, 0.0); points], 1.0);
            assert!(compressed.at(0.2).norm().is_finite() && compressed.at(-5.0).re.is_finite());
        }
    }
}

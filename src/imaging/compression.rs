//! Range compression: the matched filter over fast time, tabulated finely enough to interpolate.
//!
//! z(r) = Σ_n x[n] E(r_n − r) / √Σ_n E(r_n − r)². Phase enhancement makes the pulse's phase flat, so the template is real.
//! The table has a value at least every 10 mm; cubics between its values reproduce z to 1e-4 of its peak.

use std::sync::Arc;

use num_complex::Complex32;

use super::cubic;
use crate::radar::{Observation, SweepGeometry, envelope};

/// Widest step of the table, metres (a little above four base steps).
const TABLE_STEP_M: f64 = 0.010_1;
/// Template values below this are left out of the sum.
const NEGLIGIBLE_ENVELOPE: f64 = 1e-4;

/// The matched filter of one range axis, ready to use.
#[derive(Debug, Clone)]
pub struct RangeCompressor {
    first_m: f64,
    step_m: f64,
    /// For each table entry: first sample, and the template's values from there, normalised.
    rows: Vec<(usize, Vec<f32>)>,
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
    /// For sweeps of a geometry.
    pub fn new(geometry: &SweepGeometry) -> Self {
        let axis = &geometry.axis;
        let finer = (axis.step_m / TABLE_STEP_M).ceil().max(1.0);
        let step_m = axis.step_m / finer;
        // Axes of fewer than four points are tabulated as if they went on: interpolation needs four.
        let entries = ((axis.points.saturating_sub(1) as f64 * finer) as usize + 1).max(4);
        let row = |entry: usize| {
            let range_m = axis.first_m + entry as f64 * step_m;
            let full: Vec<f64> =
                (0..axis.points).map(|n| envelope(geometry.profile, axis.range_m(n) - range_m)).collect();
            let norm = full.iter().map(|e| e * e).sum::<f64>().sqrt();
            let first = full.iter().position(|&e| e >= NEGLIGIBLE_ENVELOPE).unwrap_or(0);
            let kept = full[first..].iter().take_while(|&&e| e >= NEGLIGIBLE_ENVELOPE);
            (first, kept.map(|e| if norm > 0.0 { (e / norm) as f32 } else { 0.0 }).collect())
        };
        Self { first_m: axis.first_m, step_m, rows: (0..entries).map(row).collect() }
    }

    /// Compresses one sweep, each value times `scale` (1 / noise rms makes it noise-normalised).
    pub fn compress(&self, samples: &[Complex32], scale: f32) -> CompressedSweep {
        let value = |(first, template): &(usize, Vec<f32>)| {
            let tail = samples.get(*first..).unwrap_or_default();
            let sum: Complex32 = tail.iter().zip(template).map(|(x, e)| x * e).sum();
            sum * scale
        };
        CompressedSweep { first_m: self.first_m, step_m: self.step_m, z: self.rows.iter().map(value).collect() }
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

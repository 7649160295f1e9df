//! Every statistic in f64, straight from its formula, one place at a time. Slow on purpose; kept for ever.
//!
//! d = |s − p| with p where the sensor was when the point at that range was sampled; w = D·A; a sweep counts only if
//! r_first ≤ d ≤ r_last and A > 0, and a place at the sensor itself (d = 0) counts for no sweep.

use num_complex::{Complex32, Complex64};

use super::blocks::{BlockSettings, partition, taper};
use super::{Statistic, block_noise_rms, sweep_noise_rms};
use crate::radar::{Beam, Observation, PHASE_RAD_PER_M, SweepGeometry, distance_falloff, envelope, template};

/// z at a range by its definition, LSB.
pub fn compressed_at(geometry: &SweepGeometry, samples: &[Complex32], range_m: f64) -> Complex64 {
    let mut sum = Complex64::ZERO;
    let mut energy = 0.0;
    for (n, sample) in samples.iter().enumerate() {
        let e = envelope(geometry.profile, geometry.axis.range_m(n) - range_m);
        sum += Complex64::new(f64::from(sample.re), f64::from(sample.im)) * e;
        energy += e * e;
    }
    if energy > 0.0 { sum / energy.sqrt() } else { Complex64::ZERO }
}

/// Evaluates any statistic at any place.
#[derive(Debug)]
pub struct Oracle<'a> {
    observations: &'a [Observation],
    beam: &'a Beam,
    noise_rms: Vec<f64>,
    settings: BlockSettings,
    /// Indices of each block's observations, and the block's noise.
    blocks: Vec<(Vec<usize>, f64)>,
}

/// One sweep as a place sees it.
struct Seen {
    distance_m: f64,
    /// w = D·A.
    weight: f64,
    amplitude: f64,
}

impl<'a> Oracle<'a> {
    /// Over the given sweeps.
    pub fn new(observations: &'a [Observation], beam: &'a Beam, settings: &BlockSettings) -> Self {
        let samples = |i: &usize| observations[*i].samples.as_slice();
        let with_noise = |block: Vec<usize>| {
            let noise = block_noise_rms(block.iter().map(samples));
            (block, noise)
        };
        Self {
            noise_rms: observations.iter().map(|o| sweep_noise_rms(&o.samples)).collect(),
            blocks: partition(observations, settings).into_iter().map(with_noise).collect(),
            settings: *settings,
            observations,
            beam,
        }
    }

    fn seen(&self, observation: &Observation, place: glam::DVec3) -> Option<Seen> {
        let distance_m = observation.distance_m(place);
        let amplitude = self.beam.amplitude(observation.cos_off_boresight(place));
        let counts = distance_m > 0.0 && observation.geometry.axis.contains(distance_m) && amplitude > 0.0;
        counts.then(|| Seen { distance_m, weight: distance_falloff(distance_m) * amplitude, amplitude })
    }

    /// The statistic's value at a place, tracking frame, metres.
    pub fn value(&self, statistic: Statistic, place: glam::DVec3) -> f64 {
        match statistic {
            Statistic::Blocks => self.blocks_score(place),
            Statistic::ThesisFull => self.sum(place, |i, seen| self.thesis_full(i, seen)),
            Statistic::Thesis => {
                self.sum(place, |i, seen| f64::from(self.nearest_sample(i, seen).norm()) * seen.weight)
            }
            Statistic::Ls => self.sum(place, |i, seen| self.z(i, seen).norm_sqr()),
            Statistic::Log => {
                self.sum(place, |i, seen| (self.z(i, seen).norm_sqr() / self.noise_rms[i].powi(2)).ln_1p())
            }
            Statistic::Glrt => {
                let sum = self.sum(place, |i, seen| self.z(i, seen).norm() * seen.weight);
                self.over_root_weights(sum, place)
            }
            Statistic::Coherent => {
                let mut sum = Complex64::ZERO;
                self.sum(place, |i, seen| {
                    let back = Complex64::from_polar(seen.weight, -PHASE_RAD_PER_M * seen.distance_m);
                    sum += self.z(i, seen) * back;
                    0.0
                });
                self.over_root_weights(sum.norm(), place)
            }
        }
    }

    fn sum(&self, place: glam::DVec3, mut term: impl FnMut(usize, &Seen) -> f64) -> f64 {
        let each = self.observations.iter().enumerate();
        each.filter_map(|(i, o)| self.seen(o, place).map(|seen| term(i, &seen))).sum()
    }

    fn over_root_weights(&self, sum: f64, place: glam::DVec3) -> f64 {
        let weights = self.sum(place, |_, seen| seen.weight * seen.weight);
        if weights > 0.0 { sum / weights.sqrt() } else { 0.0 }
    }

    fn z(&self, i: usize, seen: &Seen) -> Complex64 {
        let observation = &self.observations[i];
        compressed_at(&observation.geometry, &observation.samples, seen.distance_m)
    }

    fn nearest_sample(&self, i: usize, seen: &Seen) -> Complex32 {
        let observation = &self.observations[i];
        let n = observation.geometry.axis.point_at(seen.distance_m).round().max(0.0) as usize;
        observation.samples.get(n).copied().unwrap_or_default()
    }

    fn thesis_full(&self, i: usize, seen: &Seen) -> f64 {
        let observation = &self.observations[i];
        let geometry = &observation.geometry;
        let each = observation.samples.iter().enumerate().map(|(n, x)| {
            let h = template(geometry.profile, geometry.axis.range_m(n), seen.distance_m, seen.amplitude);
            (Complex64::new(f64::from(x.re), f64::from(x.im)) * h.conj()).norm()
        });
        each.sum()
    }

    /// A/√B over the blocks that had the place in the beam.
    fn blocks_score(&self, place: glam::DVec3) -> f64 {
        let Some(newest_ns) = self.observations.iter().map(|o| o.mid_time_ns).max() else { return 0.0 };
        let (mut a, mut b) = (0.0, 0.0);
        for (block, noise_rms) in &self.blocks {
            let middle = &self.observations[block[block.len() / 2]];
            if !self.settings.sees(&middle.tracking_from_sensor, self.settings.min_cos(self.beam), place) {
                continue;
            }
            let age_s = (newest_ns - middle.mid_time_ns) as f64 * 1e-9;
            let rho = (-age_s / self.settings.memory_s).exp();
            let m = self.coherence(block, *noise_rms, place);
            a += rho * (m.ln_1p() - super::blocks::MEAN_LOG_OF_NOISE);
            b += rho * rho;
        }
        if b > 0.0 { a / b.sqrt() } else { 0.0 }
    }

    /// m of one block: power that adds up in phase against power that does not.
    fn coherence(&self, block: &[usize], noise_rms: f64, place: glam::DVec3) -> f64 {
        let count = block.len() as f64;
        let mut coherent = Complex64::ZERO;
        let mut energy = 0.0;
        for (k, &i) in block.iter().enumerate() {
            let observation = &self.observations[i];
            let distance_m = observation.distance_m(place);
            if !observation.geometry.axis.contains(distance_m) {
                continue;
            }
            let z = compressed_at(&observation.geometry, &observation.samples, distance_m) / noise_rms;
            let w = taper(k, block.len());
            coherent += z * Complex64::from_polar(w, -PHASE_RAD_PER_M * distance_m);
            energy += w * w * z.norm_sqr();
        }
        let power = coherent.norm_sqr() / count;
        power / ((energy - power) / (count - 1.0)).max(1.0)
    }
}

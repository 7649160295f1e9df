//! Reference implementation: every statistic in f64, straight from its formula, one point at a
//! time. Slow on purpose; all fast paths are tested against it.
//!
//! d = |s − p|, with p the sensor position when the point at that range was sampled; w = D·A. A
//! sweep counts only if r_first ≤ d ≤ r_last and A > 0. A point at the sensor itself (d = 0) counts
//! for no sweep.

use num_complex::{Complex32, Complex64};

use super::subaperture::{SubapertureSettings, partition, taper};
use super::{Statistic, subaperture_noise_rms, sweep_noise_rms};
use crate::math;
use crate::{Beam, Observation, PHASE_RAD_PER_M, SweepGeometry, distance_falloff, envelope, template};

/// z at a range by its definition, LSB.
pub fn compressed_at(geometry: &SweepGeometry, samples: &[Complex32], range_m: f64) -> Complex64 {
    let mut sum = Complex64::ZERO;
    let mut energy = 0.0;
    for (n, sample) in samples.iter().enumerate() {
        let e = envelope(geometry.pulse_fwhm_m, geometry.axis.range_m(n) - range_m);
        sum += Complex64::new(f64::from(sample.re), f64::from(sample.im)) * e;
        energy += e * e;
    }
    if energy > 0.0 { sum / energy.sqrt() } else { Complex64::ZERO }
}

/// Evaluates any statistic at any point.
#[derive(Debug)]
pub struct Oracle<'a> {
    observations: &'a [Observation],
    beam: &'a Beam,
    noise_rms: Vec<f64>,
    settings: SubapertureSettings,
    /// Indices of each sub-aperture's observations, and its noise rms.
    blocks: Vec<(Vec<usize>, f64)>,
}

/// One sweep's geometry at a point.
struct PointGeometry {
    distance_m: f64,
    /// w = D·A.
    weight: f64,
    amplitude: f64,
}

impl<'a> Oracle<'a> {
    /// For the given sweeps.
    pub fn new(observations: &'a [Observation], beam: &'a Beam, settings: &SubapertureSettings) -> Self {
        let samples = |i: &usize| observations[*i].samples.as_slice();
        let with_noise = |block: Vec<usize>| {
            let noise = subaperture_noise_rms(block.iter().map(samples));
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

    fn seen(&self, observation: &Observation, place: glam::DVec3) -> Option<PointGeometry> {
        let distance_m = observation.distance_m(place);
        let amplitude = self.beam.amplitude(observation.cos_off_boresight(place));
        let counts = distance_m > 0.0 && observation.geometry.axis.contains(distance_m) && amplitude > 0.0;
        counts.then(|| PointGeometry { distance_m, weight: distance_falloff(distance_m) * amplitude, amplitude })
    }

    /// The statistic's value at a point, tracking frame, metres.
    pub fn value(&self, statistic: Statistic, place: glam::DVec3) -> f64 {
        match statistic {
            Statistic::Subaperture => self.subaperture_score(place),
            Statistic::ThesisFull => self.sum(place, |i, seen| self.thesis_full(i, seen)),
            Statistic::Thesis => self.sum(place, |i, seen| math::norm(self.nearest_sample(i, seen)) * seen.weight),
            Statistic::Ls => self.sum(place, |i, seen| self.z(i, seen).norm_sqr()),
            Statistic::Log => {
                self.sum(place, |i, seen| math::ln_1p(self.z(i, seen).norm_sqr() / self.noise_rms[i].powi(2)))
            }
            Statistic::Glrt => {
                let sum = self.sum(place, |i, seen| math::norm(self.z(i, seen)) * seen.weight);
                self.over_root_weights(sum, place)
            }
            Statistic::Coherent => {
                let mut sum = Complex64::ZERO;
                self.sum(place, |i, seen| {
                    let back = math::from_polar(seen.weight, -PHASE_RAD_PER_M * seen.distance_m);
                    sum += self.z(i, seen) * back;
                    0.0
                });
                self.over_root_weights(math::norm(sum), place)
            }
        }
    }

    fn sum(&self, place: glam::DVec3, mut term: impl FnMut(usize, &PointGeometry) -> f64) -> f64 {
        let each = self.observations.iter().enumerate();
        each.filter_map(|(i, o)| self.seen(o, place).map(|seen| term(i, &seen))).sum()
    }

    fn over_root_weights(&self, sum: f64, place: glam::DVec3) -> f64 {
        let weights = self.sum(place, |_, seen| seen.weight * seen.weight);
        if weights > 0.0 { sum / weights.sqrt() } else { 0.0 }
    }

    fn z(&self, i: usize, seen: &PointGeometry) -> Complex64 {
        let observation = &self.observations[i];
        compressed_at(&observation.geometry, &observation.samples, seen.distance_m)
    }

    fn nearest_sample(&self, i: usize, seen: &PointGeometry) -> Complex64 {
        let observation = &self.observations[i];
        let n = observation.geometry.axis.point_at(seen.distance_m).round().max(0.0) as usize;
        let sample = observation.samples.get(n).copied().unwrap_or_default();
        Complex64::new(f64::from(sample.re), f64::from(sample.im))
    }

    fn thesis_full(&self, i: usize, seen: &PointGeometry) -> f64 {
        let observation = &self.observations[i];
        let geometry = &observation.geometry;
        let each = observation.samples.iter().enumerate().map(|(n, x)| {
            let h = template(geometry.pulse_fwhm_m, geometry.axis.range_m(n), seen.distance_m, seen.amplitude);
            math::norm(Complex64::new(f64::from(x.re), f64::from(x.im)) * h.conj())
        });
        each.sum()
    }

    /// A/√B over the sub-apertures that had the point in the beam.
    fn subaperture_score(&self, place: glam::DVec3) -> f64 {
        let Some(newest_ns) = self.observations.iter().map(|o| o.mid_time_ns).max() else { return 0.0 };
        let (mut a, mut b) = (0.0, 0.0);
        for (block, noise_rms) in &self.blocks {
            let middle = &self.observations[block[block.len() / 2]];
            let settings = self.settings.within(&middle.geometry.axis);
            if !settings.sees(&middle.tracking_from_sensor, self.settings.min_cos(self.beam), place) {
                continue;
            }
            let age_s = (newest_ns - middle.mid_time_ns) as f64 * 1e-9;
            let rho = math::exp(-age_s / self.settings.decay_s);
            let m = self.coherence(block, *noise_rms, place);
            a += rho * (math::ln_1p(m) - super::subaperture::MEAN_LOG_OF_NOISE);
            b += rho * rho;
        }
        if b > 0.0 { a / b.sqrt() } else { 0.0 }
    }

    /// m of one sub-aperture: coherent power over max(1, incoherent power).
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
            coherent += z * math::from_polar(w, -PHASE_RAD_PER_M * distance_m);
            energy += w * w * z.norm_sqr();
        }
        let power = coherent.norm_sqr() / count;
        power / ((energy - power) / (count - 1.0)).max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DQuat, DVec3};

    use super::*;
    use crate::RangeAxis;
    use crate::geometry::Pose;
    use crate::test_data::PULSE_FWHM_M;

    /// Two sweeps of five points, 1 m and 0.8 m from the origin, looking at it; arbitrary samples.
    fn two_sweeps() -> Vec<Observation> {
        let axis = RangeAxis { first_m: 0.7, step_m: 0.1, points: 5 };
        let geometry = Arc::new(SweepGeometry { subsweep: 0, axis, pulse_fwhm_m: PULSE_FWHM_M, point_period_s: 1e-5 });
        let sweep = |z: f64, samples: [(f32, f32); 5]| Observation {
            mid_time_ns: 0,
            tracking_from_sensor: Pose::new(DVec3::Z * z, DQuat::IDENTITY),
            velocity_m_per_s: DVec3::ZERO,
            geometry: Arc::clone(&geometry),
            samples: samples.iter().map(|s| Complex32::new(s.0, s.1)).collect(),
        };
        vec![
            sweep(1.0, [(1.0, 2.0), (-3.0, 0.5), (4.0, -1.0), (10.0, 3.0), (2.0, 2.0)]),
            sweep(0.8, [(0.5, -0.5), (8.0, 1.0), (3.0, 3.0), (-1.0, 2.0), (0.0, 1.0)]),
        ]
    }

    /// z by hand: the matched filter with the Gaussian written out.
    fn z_by_hand(samples: &[Complex32], range_m: f64) -> Complex64 {
        let e = |n: usize| 2f64.powf(-4.0 * ((0.7 + 0.1 * n as f64 - range_m) / 0.14).powi(2));
        let norm = (0..5).map(|n| e(n) * e(n)).sum::<f64>().sqrt();
        let term = |n: usize| Complex64::new(samples[n].re.into(), samples[n].im.into()) * e(n) / norm;
        (0..5).map(term).sum()
    }

    #[test]
    fn every_statistic_matches_its_formula() {
        let sweeps = two_sweeps();
        let beam = Beam::Uniform;
        let oracle = Oracle::new(&sweeps, &beam, &SubapertureSettings::default());
        let value = |statistic| oracle.value(statistic, DVec3::ZERO);
        let close = |statistic: Statistic, expected: f64| {
            let got = value(statistic);
            assert!((got - expected).abs() < 1e-9 * expected.abs().max(1.0), "{}: {got} {expected}", statistic.name());
        };
        let (z1, z2) = (z_by_hand(&sweeps[0].samples, 1.0), z_by_hand(&sweeps[1].samples, 0.8));
        // w = 1/d²
        let (w1, w2) = (1.0f64, 1.0f64 / 0.64);
        close(Statistic::Ls, z1.norm_sqr() + z2.norm_sqr());
        let noise = |n: usize| sweep_noise_rms(&sweeps[n].samples).powi(2);
        close(Statistic::Log, (1.0 + z1.norm_sqr() / noise(0)).ln() + (1.0 + z2.norm_sqr() / noise(1)).ln());
        let root = (w1 * w1 + w2 * w2).sqrt();
        close(Statistic::Glrt, (z1.norm() * w1 + z2.norm() * w2) / root);
        let turn = |d: f64| Complex64::from_polar(1.0, -4.0 * std::f64::consts::PI * d * 60.5e9 / 299_792_458.0);
        close(Statistic::Coherent, (z1 * w1 * turn(1.0) + z2 * w2 * turn(0.8)).norm() / root);
        // Nearest samples: 1.0 m is point 3 of the first sweep, 0.8 m is point 1 of the second.
        close(Statistic::Thesis, 109f64.sqrt() * w1 + 65f64.sqrt() * w2);
        let full = |samples: &[Complex32], d: f64, w: f64| -> f64 {
            let e = |n: usize| 2f64.powf(-4.0 * ((0.7 + 0.1 * n as f64 - d) / 0.14).powi(2));
            (0..5).map(|n| f64::from(samples[n].re).hypot(samples[n].im.into()) * e(n) * w).sum()
        };
        close(Statistic::ThesisFull, full(&sweeps[0].samples, 1.0, w1) + full(&sweeps[1].samples, 0.8, w2));
    }

    #[test]
    fn sweeps_out_of_range_or_beam_do_not_count() {
        let sweeps = two_sweeps();
        let uniform = Beam::Uniform;
        let settings = SubapertureSettings::default();
        let oracle = Oracle::new(&sweeps, &uniform, &settings);
        // 0.15 m behind the origin the second sweep sees 0.95 m; for the first sweep 1.15 m is out
        // of range.
        let only_second = oracle.value(Statistic::Ls, DVec3::Z * -0.15);
        assert!((only_second - z_by_hand(&sweeps[1].samples, 0.95).norm_sqr()).abs() < 1e-9);
        // At the sensor itself everything is finite; far away nothing counts.
        for statistic in Statistic::ALL {
            assert!(oracle.value(statistic, DVec3::Z).is_finite());
            assert_eq!(oracle.value(statistic, DVec3::X * 50.0), 0.0);
        }
        let thesis = Beam::Thesis;
        let narrow = Oracle::new(&sweeps, &thesis, &settings);
        // 50° off the boresight of both sweeps, beyond the cut of the thesis's beam.
        assert_eq!(narrow.value(Statistic::Ls, DVec3::new(0.9, 0.0, 0.3)), 0.0);
    }

    #[test]
    fn coherent_point_scores_high_and_its_surroundings_low() {
        // Twenty sweeps along a slant, a point 1 m ahead, with the sensor's phase.
        let axis = RangeAxis { first_m: 0.7, step_m: 0.06, points: 11 };
        let geometry = Arc::new(SweepGeometry { subsweep: 0, axis, pulse_fwhm_m: PULSE_FWHM_M, point_period_s: 0.0 });
        let target = DVec3::NEG_Z;
        let sweep = |k: usize| {
            let p = DVec3::new(1.0, 0.0, 1.0) * (0.002 * k as f64 - 0.02);
            let d = p.distance(target);
            let sample = |n: usize| {
                let e = envelope(PULSE_FWHM_M, axis.range_m(n) - d) * 100.0;
                let s = Complex64::from_polar(e, PHASE_RAD_PER_M * d);
                // A little receiver noise, different in every sample.
                let noise = ((k * 11 + n) as f64 * 12.9898).sin() * 43758.5453;
                Complex32::new((s.re + noise.fract()) as f32, (s.im - noise.fract()) as f32)
            };
            Observation {
                mid_time_ns: 1_000_000 * k as i64,
                tracking_from_sensor: Pose::from_translation(p),
                velocity_m_per_s: DVec3::ZERO,
                geometry: Arc::clone(&geometry),
                samples: (0..11).map(sample).collect(),
            }
        };
        let sweeps: Vec<_> = (0..20).map(sweep).collect();
        let beam = Beam::Uniform;
        let oracle = Oracle::new(&sweeps, &beam, &SubapertureSettings::default());
        let at_target = oracle.value(Statistic::Subaperture, target);
        let beside = oracle.value(Statistic::Subaperture, target + DVec3::X * 0.2);
        assert!(at_target > 4.0 && at_target > beside + 3.0, "{at_target} {beside}");
        // Conjugated data have the wrong phase direction and score low at the true position.
        let conjugated: Vec<_> = sweeps
            .iter()
            .map(|o| Observation { samples: o.samples.iter().map(|s| s.conj()).collect(), ..o.clone() })
            .collect();
        let wrong =
            Oracle::new(&conjugated, &beam, &SubapertureSettings::default()).value(Statistic::Subaperture, target);
        assert!(wrong < at_target * 0.5, "{wrong} {at_target}");
    }
}

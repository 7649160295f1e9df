//! Power over range, sweep by sweep: what `ls` sums, with ranges that are already explained left out.
//!
//! For a reflector of unknown amplitude and phase in every sweep, Σ |z|²/σ² is the log-likelihood of its place.

use glam::DVec3;
use num_complex::{Complex32, Complex64};
use rayon::prelude::*;

use super::compression::compress_all;
use super::{CompressedSweep, sweep_noise_rms};
use crate::geometry::Plane;
use crate::math;
use crate::{Beam, Observation, PHASE_RAD_PER_M};

/// A stretch of one sweep's range that a known reflector accounts for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaskedRange {
    /// Middle, metres.
    pub middle_m: f64,
    /// Half of its length, metres.
    pub half_m: f64,
}

/// Noise-normalised, range-compressed sweeps.
#[derive(Debug)]
pub struct RangePower<'a> {
    observations: &'a [Observation],
    compressed: Vec<CompressedSweep>,
    beam: &'a Beam,
    min_range_m: f64,
    /// `[sweep]`: what is explained.
    masks: Vec<Vec<MaskedRange>>,
}

/// What one sweep says of a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Index of the sweep.
    pub sweep: usize,
    /// Distance from the sensor, as its point measured it, metres.
    pub distance_m: f64,
    /// |z|²/σ².
    pub power: f64,
    /// Derivative of the power by the distance, per metre.
    pub slope_per_m: f64,
    /// Curvature that the pulse gives to the log-likelihood there, per m²: 8 ln2 · power / FWHM².
    pub curvature_per_m2: f64,
    /// What the phase shows beyond the distance, metres, within ±λ/4 and up to an offset that all sweeps share.
    pub phase_off_m: f64,
}

impl<'a> RangePower<'a> {
    /// Compresses sweeps; places nearer than `min_range_m` are not looked at.
    pub fn new(observations: &'a [Observation], beam: &'a Beam, min_range_m: f64) -> Self {
        let compressed = compress_all(observations, |o| (1.0 / echo_free_noise_rms(o)) as f32);
        let masks = vec![Vec::new(); observations.len()];
        Self { observations, compressed, beam, min_range_m, masks }
    }

    /// The same sweeps with the phase taken out that the sensor's own motion turns, between the points of a sweep, on an echo
    /// from a place: at 1 m/s it is a radian over a pulse of 14 cm. Echoes from near there then have a flat phase.
    pub(super) fn motion_compensated(&self, place: DVec3) -> Self {
        let motion_compensated = self.observations.iter().map(|observation| {
            let from_mid = place - observation.tracking_from_sensor.translation;
            let seen_m = observation.distance_m(place);
            let turned = |(n, sample): (usize, &Complex32)| {
                let moved_m = (from_mid - observation.velocity_m_per_s * observation.point_time_s(n as f64)).length();
                let turn = math::from_polar(1.0, -PHASE_RAD_PER_M * (moved_m - seen_m));
                sample * Complex32::new(turn.re as f32, turn.im as f32)
            };
            Observation { samples: observation.samples.iter().enumerate().map(turned).collect(), ..observation.clone() }
        });
        let motion_compensated: Vec<Observation> = motion_compensated.collect();
        // A turned sample is as loud as before, so the noise is that of the sweep as it came.
        let compressed = compress_all(&motion_compensated, |o| (1.0 / echo_free_noise_rms(o)) as f32);
        Self { compressed, masks: self.masks.clone(), ..*self }
    }

    /// The sweeps it works on.
    pub fn observations(&self) -> &'a [Observation] {
        self.observations
    }

    /// The distance from a sweep to a place, if the sweep counts for it and has it unclaimed.
    fn distance_m(&self, sweep: usize, place: DVec3) -> Option<f64> {
        let observation = &self.observations[sweep];
        let distance_m = observation.distance_m(place);
        let counts = distance_m >= self.min_range_m
            && distance_m > 0.0
            && observation.geometry.axis.contains(distance_m)
            && self.beam.amplitude(observation.cos_off_boresight(place)) > 0.0;
        let claimed = |c: &MaskedRange| (distance_m - c.middle_m).abs() < c.half_m;
        (counts && !self.masks[sweep].iter().any(claimed)).then_some(distance_m)
    }

    /// Sum over sweeps of (|z|²/σ² − 1), which noise keeps around 0 with a variance of the count, and the count.
    pub fn excess(&self, place: DVec3) -> (f64, usize) {
        let each = (0..self.observations.len())
            .filter_map(|sweep| self.distance_m(sweep, place).map(|d| self.compressed[sweep].at(d).norm_sqr() - 1.0));
        each.fold((0.0, 0), |(sum, count), excess| (sum + excess, count + 1))
    }

    /// A sweep's distance to a place, z/σ there and its derivative by the distance, if the sweep counts for it.
    pub(super) fn echo(&self, sweep: usize, place: DVec3) -> Option<(f64, Complex64, Complex64)> {
        let distance_m = self.distance_m(sweep, place)?;
        let (z, slope) = self.compressed[sweep].value_and_slope(distance_m);
        Some((distance_m, z, slope))
    }

    /// What each sweep says of a place.
    pub fn readings(&self, place: DVec3) -> Vec<Reading> {
        let reading = |sweep: usize| {
            let (distance_m, z, slope) = self.echo(sweep, place)?;
            let width_m = self.observations[sweep].geometry.pulse_fwhm_m;
            let power = z.norm_sqr();
            Some(Reading {
                sweep,
                distance_m,
                power,
                slope_per_m: 2.0 * (z.conj() * slope).re,
                curvature_per_m2: 8.0 * std::f64::consts::LN_2 * power / (width_m * width_m),
                phase_off_m: math::arg(z * math::from_polar(1.0, -PHASE_RAD_PER_M * distance_m)) / PHASE_RAD_PER_M,
            })
        };
        (0..self.observations.len()).filter_map(reading).collect()
    }

    /// The excess at many places, in parallel.
    pub fn excess_at(&self, places: &[DVec3]) -> Vec<(f64, usize)> {
        places.par_iter().map(|&place| self.excess(place)).collect()
    }

    /// Marks the ranges that a reflector at a place explains: as far as its pulse stands out of the noise, and 2 cm.
    pub fn mask_point(&mut self, place: DVec3) {
        self.mask_at(|observation| observation.distance_m(place));
    }

    /// Marks the ranges that a mirror explains.
    pub fn mask_plane(&mut self, plane: &Plane) {
        self.mask_at(|observation| plane.distance(observation.tracking_from_sensor.translation));
    }

    fn mask_at(&mut self, distance_m: impl Fn(&Observation) -> f64) {
        for (sweep, observation) in self.observations.iter().enumerate() {
            let middle_m = distance_m(observation);
            let axis = &observation.geometry.axis;
            let clamped = middle_m.clamp(axis.first_m, axis.last_m());
            let power = self.compressed[sweep].at(clamped).norm_sqr();
            let half_width_m = observation.geometry.pulse_fwhm_m * 0.5;
            let half_m = half_width_m * math::log2(1.0 + 20.0 * power).sqrt() + 0.02;
            self.masks[sweep].push(MaskedRange { middle_m, half_m });
        }
    }
}

/// Complex noise rms of a sweep without what echoes in it: the median again, over the points that lie a pulse away from all
/// that stands out of the first one. The plain median while less than half of the points are left.
fn echo_free_noise_rms(observation: &Observation) -> f64 {
    let samples = &observation.samples;
    let plain = sweep_noise_rms(samples);
    // Noise alone exceeds this in one sweep of thirty.
    let loud = ECHO_POWER * plain * plain;
    let geometry = &observation.geometry;
    let near = (geometry.pulse_fwhm_m / geometry.axis.step_m).ceil() as usize;
    let mut last_loud: Option<usize> = None;
    let mut lit = vec![false; samples.len()];
    for (n, sample) in samples.iter().enumerate() {
        if f64::from(sample.norm_sqr()) > loud {
            lit[n.saturating_sub(near)..n].fill(true);
            last_loud = Some(n);
        }
        lit[n] |= last_loud.is_some_and(|last| n - last <= near);
    }
    let quiet: Vec<Complex32> = samples.iter().zip(&lit).filter(|(_, lit)| !**lit).map(|(x, _)| *x).collect();
    if 2 * quiet.len() >= samples.len() { sweep_noise_rms(&quiet) } else { plain }
}

/// Power over noise that noise itself reaches in one of 10 000 points.
const ECHO_POWER: f64 = 9.2;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_data::{Echo, sweeps};

    const AT: DVec3 = DVec3::new(0.1, 0.0, -1.3);

    #[test]
    fn an_echo_does_not_raise_the_noise() {
        // Points every 6 cm: a strong pulse lights a tenth of them. The data's noise is 20 LSB.
        let lit = sweeps(0.2, |_| DVec3::ZERO, &[(Echo::Point(AT), 200.0)], 5);
        let mean = |rms: fn(&Observation) -> f64| lit.iter().map(|o| rms(o).powi(2)).sum::<f64>() / lit.len() as f64;
        let (plain, quiet) = (mean(|o| sweep_noise_rms(&o.samples)).sqrt(), mean(echo_free_noise_rms).sqrt());
        assert!(plain > 21.0 && (quiet / 20.0 - 1.0).abs() < 0.04, "{plain} {quiet}");
    }

    #[test]
    fn motion_compensated_echo_has_a_flat_phase() {
        // 2 m/s towards it: between two points 6 cm apart the sensor moves by 36 µm.
        let fast = sweeps(0.02, |t| DVec3::NEG_Z * 2.0 * t, &[(Echo::Point(AT), 1000.0)], 5);
        let power = RangePower::new(&fast, &Beam::Lensless, 0.15);
        let turning = |power: &RangePower| {
            let (_, z, slope) = power.echo(10, AT).unwrap();
            (slope / z).im
        };
        // Half of k·v·(time a metre): the matched filter sees half of the ramp.
        let expected = 0.5 * PHASE_RAD_PER_M * 2.0 * 1.8e-5 / 0.06;
        assert!((turning(&power).abs() / expected - 1.0).abs() < 0.1, "{} {expected}", turning(&power));
        assert!(turning(&power.motion_compensated(AT)).abs() < 0.1 * expected);
    }
}

//! Sweeps for tests, straight from the signal model: points and planes along a path, with noise.

#![allow(clippy::disallowed_methods)]

use std::sync::Arc;

use glam::DVec3;

use crate::math;
use num_complex::{Complex32, Complex64};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::geometry::{Plane, Pose};
use crate::{Observation, PHASE_RAD_PER_M, RangeAxis, SweepGeometry, envelope};

/// A reflector.
#[derive(Debug, Clone, Copy)]
pub enum Echo {
    /// A point reflector.
    Point(DVec3),
    /// A specular plane.
    Plane(Plane),
}

/// Full width at half maximum of the pulse, metres. Source: A121, profile 3.
pub const PULSE_FWHM_M: f64 = 0.14;
/// Rms of the noise, LSB. Choice: of the order of the sensor's; results depend on ratios only.
const NOISE_RMS: f64 = 20.0;

/// A path through all directions around the origin, looking along −z: a Lissajous figure of 30 cm.
pub fn winding(time_s: f64) -> DVec3 {
    let [x, y, z] = [math::sin(2.1 * time_s), math::cos(3.4 * time_s), math::sin(2.7 * time_s + 0.5)];
    0.15 * DVec3::new(x, y, z)
}

/// A small version of preset d16: 50 points from 0.2 m in steps of 6 cm, 1000 sweeps a second. Each
/// echo has an amplitude SNR.
pub fn sweeps(duration_s: f64, path: impl Fn(f64) -> DVec3, echoes: &[(Echo, f64)], seed: u64) -> Vec<Observation> {
    let axis = RangeAxis { first_m: 0.2, step_m: 0.06, points: 50 };
    let geometry = Arc::new(SweepGeometry { subsweep: 0, axis, pulse_fwhm_m: PULSE_FWHM_M, point_period_s: 1.8e-5 });
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = move || -> f64 { StandardNormal.sample(&mut rng) };
    let sweep = |k: usize| {
        let time_s = k as f64 * 1e-3;
        let mut observation = Observation {
            mid_time_ns: 1_000_000_000 + (time_s * 1e9) as i64,
            tracking_from_sensor: Pose::from_translation(path(time_s)),
            velocity_m_per_s: (path(time_s + 1e-4) - path(time_s - 1e-4)) / 2e-4,
            geometry: Arc::clone(&geometry),
            samples: Vec::new(),
        };
        let samples = (0..geometry.axis.points).map(|n| {
            let from = path(time_s + observation.point_time_s(n as f64));
            let mut sum = Complex64::new(noise(), noise()) * (NOISE_RMS / 2f64.sqrt());
            for (echo, snr) in echoes {
                let distance_m = match echo {
                    Echo::Point(at) => at.distance(from),
                    Echo::Plane(plane) => plane.distance(from),
                };
                let pulse = envelope(geometry.pulse_fwhm_m, geometry.axis.range_m(n) - distance_m);
                sum += math::from_polar(NOISE_RMS * snr * pulse, PHASE_RAD_PER_M * distance_m);
            }
            Complex32::new(sum.re as f32, sum.im as f32)
        });
        observation.samples = samples.collect();
        observation
    };
    (0..(duration_s * 1e3) as usize).map(sweep).collect()
}

/// The same sweeps with conjugated phase, which no real scene produces.
pub fn conjugated(mut observations: Vec<Observation>) -> Vec<Observation> {
    observations.iter_mut().flat_map(|o| &mut o.samples).for_each(|x| *x = x.conj());
    observations
}

/// Runs on a pool of one thread.
///
/// # Panics
/// The system refuses another thread.
pub fn on_one_thread<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(work)
}

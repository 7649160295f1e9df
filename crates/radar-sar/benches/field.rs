//! The sub-aperture field, (voxel, sweep) updates per second: what room imaging spends most on.
//!
//!     cargo bench -p radar-sar --bench field
//!
//! Sub-apertures of 90 ms with 48 sweeps of 3 m at 10 mm, from a turning, moving sensor. Minimum
//! over repetitions on one thread.

use std::sync::Arc;
use std::time::Instant;

use glam::{DQuat, DVec3};
use num_complex::Complex32;
use radar_sar::geometry::Pose;
use radar_sar::subaperture::{Field, Subaperture, SubapertureBuilder, SubapertureSettings};
use radar_sar::{Beam, Observation, RangeAxis, SweepGeometry};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SWEEPS: usize = 48;
const SUBAPERTURES: usize = 6;

fn main() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
    pool.install(|| [0.05, 0.025].into_iter().for_each(job));
}

fn job(voxel_m: f64) {
    let settings = SubapertureSettings { voxel_m, ..SubapertureSettings::default() };
    let all: Vec<Subaperture> = (0..SUBAPERTURES).map(|n| subaperture(settings, n as u64)).collect();
    let (mut least_s, mut updates) = (f64::INFINITY, 0);
    let begin = Instant::now();
    while begin.elapsed().as_secs_f64() < 3.0 {
        let mut field = Field::new(settings, settings.min_cos(&Beam::Lensless));
        all.iter().for_each(|one| field.add(one));
        let start = Instant::now();
        updates = field.updates;
        all.iter().for_each(|one| field.add(one));
        least_s = least_s.min(start.elapsed().as_secs_f64());
    }
    println!("field/{voxel_m}: {:.3} ms, {:.0} M updates/s", least_s * 1e3, updates as f64 / least_s * 1e-6);
}

fn subaperture(settings: SubapertureSettings, seed: u64) -> Subaperture {
    let axis = RangeAxis { first_m: 0.2, step_m: 0.010, points: 300 };
    let geometry = Arc::new(SweepGeometry { subsweep: 0, axis, pulse_fwhm_m: 0.14, point_period_s: 0.0 });
    let (mut rng, mut builder) = (ChaCha8Rng::seed_from_u64(seed), SubapertureBuilder::new(settings));
    for n in 0..SWEEPS {
        let t = n as f64 / SWEEPS as f64 + seed as f64;
        let place = DVec3::new(0.03 * t, 0.01 * (3.0 * t).cos(), 0.02 * (2.0 * t).sin());
        let samples =
            (0..axis.points).map(|_| Complex32::new(rng.random_range(-9.0..9.0), rng.random_range(-9.0..9.0)));
        let observation = Observation {
            mid_time_ns: (t * 0.089e9) as i64,
            tracking_from_sensor: Pose::new(place, DQuat::from_rotation_y(0.1 * t)),
            velocity_m_per_s: DVec3::new(0.3, 0.0, 0.1),
            geometry: Arc::clone(&geometry),
            samples: samples.collect(),
        };
        assert!(builder.push(observation).is_none());
    }
    builder.close().expect("enough sweeps")
}

//! Tables of cases (range axis, pulse, beam, noise, damage to the samples) and of sensor paths.
//! Sweeps are computed directly from the signal model.

use std::sync::Arc;

use a121::Profile;
use glam::{DQuat, DVec3};
use num_complex::{Complex32, Complex64};
use radar_sar::geometry::{Aabb, Pose};
use radar_sar::{Beam, Observation, PHASE_RAD_PER_M, RangeAxis, SweepGeometry, envelope};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::quick_or_long;

/// Noise of a sample, rms, LSB.
pub const NOISE_LSB: f64 = 20.0;
/// Time from sweep to sweep, seconds.
const SWEEP_S: f64 = 1e-3;

/// Damage done to the samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Damage {
    /// Nothing.
    None,
    /// Every ninth sweep is ten thousand times as strong.
    Bursts,
    /// Both parts at the converter's limit.
    Saturated,
    /// So small that f32 has no full precision.
    Denormal,
    /// All samples zero.
    Silent,
    /// Every seventh sweep has a NaN, every eleventh an infinity.
    NotFinite,
    /// Every fifth sweep has a finite sample whose square overflows.
    Huge,
}

/// One row of the table.
#[derive(Debug, Clone)]
pub struct Case {
    pub name: String,
    /// Centre of the path, tracking frame, metres.
    pub origin: DVec3,
    pub axis: RangeAxis,
    pub pulse_fwhm_m: f64,
    pub beam: Beam,
    /// Reflector relative to the path's centre, metres.
    pub target: DVec3,
    /// Power of the echo's greatest sample over the noise, dB.
    pub snr_db: f64,
    pub damage: Damage,
    /// Half edge of the imaged box around the reflector, and edge of its voxels, metres.
    pub half_m: f64,
    pub voxel_m: f64,
}

/// Preset d16's axis.
const D16: RangeAxis = RangeAxis { first_m: 0.2, step_m: 0.06, points: 50 };

impl Case {
    fn new(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            origin: DVec3::ZERO,
            axis: D16,
            pulse_fwhm_m: 0.14,
            beam: Beam::Lensless,
            target: DVec3::new(0.1, 0.0, -1.2),
            snr_db: 20.0,
            damage: Damage::None,
            half_m: 0.13,
            voxel_m: 0.045,
        }
    }

    /// Position of the reflector, tracking frame, metres.
    pub fn at(&self) -> DVec3 {
        self.origin + self.target
    }

    /// The imaged box.
    pub fn region(&self) -> Aabb {
        Aabb { min: self.at() - self.half_m, max: self.at() + self.half_m }
    }
}

/// All cases.
pub fn cases() -> Vec<Case> {
    let mut all: Vec<Case> =
        (-1..=6).map(|n| Case { snr_db: 10.0 * f64::from(n), ..Case::new(format!("{} dB", 10 * n)) }).collect();
    all.push(Case { origin: DVec3::new(100.0, -60.0, 80.0), ..Case::new("100 m from the origin") });
    let far = RangeAxis { first_m: 18.2, step_m: 0.06, points: 40 };
    all.push(Case { axis: far, target: DVec3::new(1.0, 0.5, -19.5), ..Case::new("20 m away") });
    let long = RangeAxis { first_m: 0.2, step_m: 0.06, points: 331 };
    all.push(Case { axis: long, target: DVec3::new(-4.0, 0.0, -18.9), ..Case::new("an axis of 20 m") });
    let near = RangeAxis { first_m: -0.06, step_m: 0.01, points: 50 };
    let touching =
        Case { axis: near, target: DVec3::new(0.0, 0.0, -0.05), half_m: 0.09, voxel_m: 0.03, ..Case::new("") };
    all.push(Case { name: "touching".into(), ..touching.clone() });
    all.push(Case { name: "touching, no beam".into(), beam: Beam::Uniform, ..touching.clone() });
    all.push(Case { name: "touching, coarse voxels".into(), half_m: 0.4, voxel_m: 0.11, ..touching });
    for profile in Profile::ALL {
        let axis = RangeAxis { first_m: 0.8, step_m: 0.01, points: 80 };
        all.push(Case {
            axis,
            pulse_fwhm_m: profile.envelope_fwhm_m(),
            half_m: 0.05,
            voxel_m: 0.012,
            ..Case::new(format!("{profile:?}"))
        });
    }
    for beam in [Beam::Uniform, Beam::Thesis, Beam::Fresnel, Beam::Hyperbolic] {
        let name = format!("beam {beam:?}");
        all.push(Case { beam: beam.clone(), ..Case::new(name.clone()) });
        let off = Case { beam, target: DVec3::new(1.1, 0.1, -0.6), ..Case::new(name + ", far off the boresight") };
        all.push(Case { half_m: 0.05, voxel_m: 0.012, name: off.name.clone() + ", fine", ..off.clone() });
        all.push(off);
    }
    let far_off = DVec3::new(12.0, 3.0, -1.0);
    let off_axis = RangeAxis { first_m: 11.0, step_m: 0.06, points: 50 };
    let skew = Case { beam: Beam::Fresnel, axis: off_axis, target: far_off, ..Case::new("Fresnel, 85° off at 12 m") };
    all.push(skew);
    for damage in [Damage::Bursts, Damage::Saturated, Damage::Denormal, Damage::Silent, Damage::NotFinite, Damage::Huge]
    {
        all.push(Case { damage, ..Case::new(format!("{damage:?}")) });
    }
    all
}

/// A sensor path: position and rotation as functions of the share 0..1 of the path.
pub struct Path {
    pub name: &'static str,
    /// Position relative to the path's centre, metres.
    pub place: fn(f64) -> DVec3,
    pub turn: fn(f64) -> DQuat,
    /// Stated velocity; it need not agree with the positions.
    pub velocity_m_per_s: DVec3,
}

fn straight_on(_: f64) -> DQuat {
    DQuat::IDENTITY
}

fn winding(share: f64) -> DVec3 {
    0.15 * DVec3::new((8.0 * share).sin(), (13.0 * share).cos(), (10.0 * share + 0.5).sin())
}

/// All paths.
pub static PATHS: [Path; 9] = [
    Path { name: "winding", place: winding, turn: straight_on, velocity_m_per_s: DVec3::ZERO },
    Path {
        name: "winding and turning at 3 m/s",
        place: winding,
        turn: |share| DQuat::from_scaled_axis(winding(2.0 * share) * 4.0),
        velocity_m_per_s: DVec3::new(1.0, -2.0, 2.0),
    },
    Path {
        name: "collinear, across",
        place: |share| DVec3::X * (share - 0.5) * 0.3,
        turn: straight_on,
        velocity_m_per_s: DVec3::new(0.3, 0.0, 0.0),
    },
    Path {
        name: "collinear, along the boresight",
        place: |share| DVec3::Z * (share - 0.5) * 0.1,
        turn: straight_on,
        velocity_m_per_s: DVec3::new(0.0, 0.0, 0.3),
    },
    Path {
        name: "coplanar",
        place: |share| DVec3::new((share - 0.5) * 0.3, 0.15 * (21.0 * share).sin(), 0.0),
        turn: straight_on,
        velocity_m_per_s: DVec3::ZERO,
    },
    Path { name: "coincident", place: |_| DVec3::ZERO, turn: straight_on, velocity_m_per_s: DVec3::ZERO },
    Path {
        name: "turning on the spot",
        place: |_| DVec3::ZERO,
        turn: |share| DQuat::from_rotation_y(share * 6.3),
        velocity_m_per_s: DVec3::ZERO,
    },
    Path {
        name: "two places",
        place: |share| DVec3::Y * if share < 0.5 { -0.1 } else { 0.1 },
        turn: straight_on,
        velocity_m_per_s: DVec3::ZERO,
    },
    Path {
        name: "a nanometre",
        place: |share| DVec3::new(1e-9, 2e-9, -1e-9) * share,
        turn: straight_on,
        velocity_m_per_s: DVec3::new(1e-30, 0.0, 0.0),
    },
];

/// Each case along each path; in the quick suite along three of them, such that all paths occur.
pub fn rows(cases: &[Case]) -> Vec<(&Case, &'static Path)> {
    let each = cases.iter().enumerate().flat_map(|(n, case)| PATHS.iter().enumerate().map(move |p| (n, case, p)));
    let taken = each.filter(|(n, _, (p, _))| quick_or_long((n + p) % 3 == 0, true));
    taken.map(|(_, case, (_, path))| (case, path)).collect()
}

/// The sweeps of a case along a path.
pub fn sweeps(case: &Case, path: &Path, count: usize, seed: u64) -> Vec<Observation> {
    sweeps_along(case, path, count, count, seed)
}

/// The same, but only the first `count` of `all` sweeps along the path: slow motion, as
/// sub-apertures need it.
pub fn sweeps_along(case: &Case, path: &Path, count: usize, all: usize, seed: u64) -> Vec<Observation> {
    let geometry = Arc::new(SweepGeometry {
        subsweep: 0,
        axis: case.axis,
        pulse_fwhm_m: case.pulse_fwhm_m,
        point_period_s: 1.8e-5,
    });
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = || -> f64 { StandardNormal.sample(&mut rng) };
    let amplitude = NOISE_LSB * 10f64.powf(case.snr_db / 20.0);
    let mut sweep = |k: usize| {
        let share = k as f64 / all as f64;
        let mut observation = Observation {
            mid_time_ns: 1_000_000_000 + (k as f64 * SWEEP_S * 1e9) as i64,
            tracking_from_sensor: Pose::new(case.origin + (path.place)(share), (path.turn)(share)),
            velocity_m_per_s: path.velocity_m_per_s,
            geometry: Arc::clone(&geometry),
            samples: Vec::new(),
        };
        let distance_m = observation.distance_m(case.at());
        let echo = Complex64::from_polar(amplitude, PHASE_RAD_PER_M * distance_m);
        let mut sample = |n: usize| {
            let pulse = envelope(case.pulse_fwhm_m, case.axis.range_m(n) - distance_m);
            let sum = echo * pulse + Complex64::new(noise(), noise()) * (NOISE_LSB / 2f64.sqrt());
            Complex32::new(sum.re as f32, sum.im as f32)
        };
        observation.samples = (0..case.axis.points).map(&mut sample).collect();
        apply_damage(&mut observation.samples, case.damage, k);
        observation
    };
    (0..count).map(&mut sweep).collect()
}

fn apply_damage(samples: &mut [Complex32], damage: Damage, sweep: usize) {
    let middle = samples.len() / 2;
    match damage {
        Damage::Bursts if sweep % 9 == 4 => samples.iter_mut().for_each(|x| *x *= 1e4),
        Damage::Saturated => samples.iter_mut().for_each(|x| {
            *x = Complex32::new(32767f32.copysign(x.re), 32767f32.copysign(x.im));
        }),
        Damage::Denormal => samples.iter_mut().for_each(|x| *x *= 1e-42),
        Damage::Silent => samples.fill(Complex32::ZERO),
        Damage::NotFinite if sweep % 7 == 3 => samples[middle].im = f32::NAN,
        Damage::NotFinite if sweep % 11 == 5 => samples[middle].re = f32::NEG_INFINITY,
        Damage::Huge if sweep % 5 == 2 => samples[middle].re = f32::MAX,
        _ => {}
    }
}

/// The valid sweeps, which a sum accepts.
pub fn sound(observations: &[Observation]) -> Vec<Observation> {
    let fits = |o: &&Observation| o.samples.iter().all(|x| x.re.abs() <= 1e9 && x.im.abs() <= 1e9);
    observations.iter().filter(fits).cloned().collect()
}

//! Accuracy of a single reflector's position against the Cramér–Rao bound, and consistency of its
//! covariance.
//!
//!     cargo run --release -p lab --example ls_accuracy -- [seeds=FIRST..END] [motion=NAME] \
//!         [sweeps=N] [snr=DB] [without=jitter|wander|rotation|mount|all] [near] [detail]
//!
//! Each row: a motion, the number of sweeps used, SNR at 1 m on the axis. Columns, mm: median and
//! 95th percentile of the distance to the truth; rms; the bound's rms with free phases (ranges
//! only) and with phases of known integers; rms over each. `split`: seeds in which more than one
//! reflector is reported. NEES: normalised squared error dᵀ C⁻¹ d, 3 on average for a consistent
//! covariance, with the 95 % band of its mean for that many seeds.
//!
//! Defaults: seeds 100..120. `without` removes a kind of tracking error. `near` searches 0.8 m
//! around the truth instead of the 3 m cube: faster, with the same positions. `detail` adds the
//! same along each axis of the covariance.

use std::f64::consts::{LN_2, TAU};
use std::ops::Range;

use a121::preset;
use glam::{DMat3, DVec3};
use radar_mapping::{ObserverSettings, observe_all};
use radar_mapping::{Obstacle, ReflectorSettings, find_reflectors};
use radar_sar::HistorySettings;
use radar_sar::geometry::Aabb;
use radar_sar::{Beam, Observation, PHASE_RAD_PER_M, envelope};
use radar_sar::{BoundSight, PositionErrors, cramer_rao_bound, eigen, farthest_points};
use radar_simulation::{Scenario, TrackingErrors};

/// Motion, number of sweeps (0: all), SNR in dB.
const TRIALS: [(&str, usize, f64); 14] = [
    ("sphere-50cm", 50, 20.0),
    ("sphere-50cm", 200, 20.0),
    ("sphere-50cm", 0, 20.0),
    ("sphere-10cm", 50, 20.0),
    ("sphere-10cm", 200, 20.0),
    ("sphere-10cm", 0, 20.0),
    ("sphere-50cm", 50, 10.0),
    ("sphere-50cm", 200, 10.0),
    ("sphere-50cm", 50, 30.0),
    ("sphere-50cm", 200, 30.0),
    ("sphere-10cm", 200, 10.0),
    ("sphere-10cm", 200, 30.0),
    ("x-50cm", 200, 20.0),
    ("approach-1.0", 200, 20.0),
];
/// Maximum number of seeds that the bound is averaged over. With all sweeps it takes a second per
/// seed.
const BOUND_SEEDS: usize = 20;

/// The command line's arguments.
struct Arguments {
    seeds: Range<u64>,
    motion: Option<String>,
    sweeps: Option<usize>,
    snr: Option<f64>,
    without: String,
    near: bool,
    detail: bool,
}

fn arguments() -> Arguments {
    let mut arguments = Arguments {
        seeds: 100..120,
        motion: None,
        sweeps: None,
        snr: None,
        without: String::new(),
        near: false,
        detail: false,
    };
    for argument in std::env::args().skip(1) {
        match argument.split_once('=') {
            Some(("seeds", range)) => {
                let (first, end) = range.split_once("..").expect("seeds=FIRST..END");
                arguments.seeds = first.parse().expect("a seed")..end.parse().expect("a seed");
            }
            Some(("motion", name)) => arguments.motion = Some(name.into()),
            Some(("sweeps", count)) => arguments.sweeps = Some(count.parse().expect("a number of sweeps")),
            Some(("snr", db)) => arguments.snr = Some(db.parse().expect("decibels")),
            Some(("without", what)) => arguments.without = what.into(),
            _ if argument == "near" => arguments.near = true,
            _ if argument == "detail" => arguments.detail = true,
            _ => panic!("{argument}: see the head of this file"),
        }
    }
    arguments
}

fn main() {
    let arguments = arguments();
    println!(
        "motion        sweeps  dB   median    95 %     rms   bound: ranges  ratio   phases  ratio   split   NEES (band)"
    );
    for (motion, sweeps, snr_db) in TRIALS {
        let wanted = arguments.motion.as_ref().is_none_or(|m| m == motion)
            && arguments.sweeps.is_none_or(|n| n == sweeps)
            && arguments.snr.is_none_or(|s| s == snr_db);
        if wanted {
            row(&arguments, motion, sweeps, snr_db);
        }
    }
}

fn row(arguments: &Arguments, motion: &str, sweeps: usize, snr_db: f64) {
    let (mut errors_mm, mut normalised, mut split) = (Vec::new(), Vec::new(), 0);
    let mut by_direction: Vec<[(f64, f64); 3]> = Vec::new();
    let (mut by_ranges, mut by_phases) = (Vec::new(), Vec::new());
    for seed in arguments.seeds.clone() {
        let trial = Trial::new(arguments, motion, snr_db, seed);
        let found = trial.found(arguments, sweeps);
        split += usize::from(found.len() > 1);
        if let Some(best) = found.first() {
            let off = best.position_m - trial.truth;
            errors_mm.push(off.length() * 1e3);
            normalised.push(off.dot(best.covariance_m2.inverse() * off));
            by_direction.push(along_axes(&best.covariance_m2, off));
        }
        if sweeps > 0 || by_ranges.len() < BOUND_SEEDS {
            by_ranges.extend(trial.bound_mm2(sweeps, snr_db, false));
            by_phases.extend(trial.bound_mm2(sweeps, snr_db, true));
        }
    }
    errors_mm.sort_by(f64::total_cmp);
    let count = errors_mm.len() as f64;
    let quantile = |share: f64| errors_mm.get(((count * share) as usize).min(errors_mm.len().saturating_sub(1)));
    let rms = (errors_mm.iter().map(|e| e * e).sum::<f64>() / count).sqrt();
    let bound = |squares: &[f64]| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    let (ranges, phases) = (bound(&by_ranges), bound(&by_phases));
    // Mean of `count` chi-square variables of 3 degrees of freedom: variance 6 / count.
    let half_band = 1.96 * (6.0 / count).sqrt();
    println!(
        "{motion:13} {:>6} {snr_db:>3.0} {:>8.1} {:>7.1} {rms:>7.2}  {ranges:>14.2} {:>6.2} {phases:>8.2} {:>6.2} {split:>4}/{:<4} {:.2} ({:.2}..{:.2})",
        if sweeps == 0 { "all".into() } else { sweeps.to_string() },
        quantile(0.5).unwrap_or(&f64::NAN),
        quantile(0.95).unwrap_or(&f64::NAN),
        rms / ranges,
        rms / phases,
        errors_mm.len(),
        normalised.iter().sum::<f64>() / count,
        3.0 - half_band,
        3.0 + half_band,
    );
    if arguments.detail {
        detail(&by_direction);
    }
}

/// Along each axis of the covariance, widest first: mean normalised square (1 when consistent), rms
/// of 1σ and of the error, mm.
fn detail(seeds: &[[(f64, f64); 3]]) {
    let each = (0..3).map(|axis| {
        let mean =
            |value: fn((f64, f64)) -> f64| seeds.iter().map(|s| value(s[axis])).sum::<f64>() / seeds.len() as f64;
        let square = mean(|(sigma, off)| (off / sigma).powi(2));
        let (sigma, off) = (mean(|(sigma, _)| sigma * sigma).sqrt(), mean(|(_, off)| off * off).sqrt());
        format!("{square:.2} (1σ {:.2}, off {:.2})", sigma * 1e3, off * 1e3)
    });
    println!("              widest to narrowest: {}", each.collect::<Vec<_>>().join(", "));
}

/// 1σ and error along a covariance's axes, widest first, metres.
fn along_axes(covariance_m2: &DMat3, off: DVec3) -> [(f64, f64); 3] {
    let (variances_m2, axes) = eigen(covariance_m2);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| variances_m2[b].total_cmp(&variances_m2[a]));
    order.map(|n| (variances_m2[n].sqrt(), off.dot(axes.col(n))))
}

/// One simulated recording as observations.
struct Trial {
    observations: Vec<Observation>,
    truth: DVec3,
    errors: TrackingErrors,
}

impl Trial {
    fn new(arguments: &Arguments, motion: &str, snr_db: f64, seed: u64) -> Self {
        let config = preset("fine").expect("a preset");
        let mut scenario = Scenario::new("corner-reflector", motion, config, 10.0, seed);
        scenario.snr_db = Some(snr_db);
        match arguments.without.as_str() {
            "all" => scenario.errors = TrackingErrors::none(),
            "mount" => scenario.errors.mount_m = 0.0,
            "wander" => scenario.errors.wander_m = 0.0,
            "rotation" => scenario.errors.rotation_deg = 0.0,
            "jitter" => scenario.errors.jitter_m = 0.0,
            _ => {}
        }
        let simulated = scenario.run().expect("a known scene and motion");
        let observer = ObserverSettings {
            history: HistorySettings::default(),
            head_from_sensor: scenario.head_from_sensor,
            time_offset_s: 0.0,
        };
        let (observations, _) = observe_all(&scenario.config, observer, &simulated.frames, &simulated.poses);
        Self { observations, truth: simulated.truth.obstacles[0].points_m[0], errors: scenario.errors }
    }

    /// Reflectors found, strongest first.
    fn found(&self, arguments: &Arguments, max_sweeps: usize) -> Vec<Obstacle> {
        let (middle, half) = if arguments.near { (self.truth, 0.4) } else { (DVec3::new(0.0, 1.5, -1.5), 1.5) };
        let region = Aabb { min: middle - half, max: middle + half };
        let settings = ReflectorSettings { max_sweeps, ..Default::default() };
        let errors = match arguments.without.as_str() {
            "all" => PositionErrors::none(),
            "mount" => PositionErrors { mount_m: 0.0, ..Default::default() },
            "wander" => PositionErrors { wander_m: 0.0, ..Default::default() },
            "rotation" => PositionErrors { rotation_deg: 0.0, ..Default::default() },
            "jitter" => PositionErrors { jitter_m: 0.0, ..Default::default() },
            _ => PositionErrors::default(),
        };
        find_reflectors(&self.observations, &Beam::Lensless, &region, &settings, &errors)
    }

    /// Trace of the bound for the sweeps that a search chooses, mm².
    fn bound_mm2(&self, max_sweeps: usize, snr_db: f64, phases: bool) -> Option<f64> {
        let positions: Vec<DVec3> = self.observations.iter().map(|o| o.tracking_from_sensor.translation).collect();
        let count = if max_sweeps == 0 { positions.len() } else { max_sweeps };
        let chosen = farthest_points(&positions, count);
        let sights: Vec<BoundSight> =
            chosen.into_iter().map(|n| sight(&self.observations[n], self.truth, snr_db, phases)).collect();
        let bound = cramer_rao_bound(&sights, |apart_s| self.poses_m2(apart_s), self.errors.mount_m.powi(2) / 3.0)?;
        let diagonal = bound.x_axis.x + bound.y_axis.y + bound.z_axis.z;
        Some(diagonal * 1e6)
    }

    /// Covariance of the simulated pose errors in each axis between two times, m²: five sines of
    /// random phase whose frequencies are uniform within 0.8 to 1.25 of their centre; the rotation
    /// error at the end of the mount's arm likewise; jitter after a Savitzky–Golay filter of eleven
    /// poses (1964, table for cubics).
    fn poses_m2(&self, apart_s: f64) -> f64 {
        let line = |hz: f64| {
            let turn = TAU * hz * apart_s;
            if turn < 1e-6 { 1.0 } else { ((1.25 * turn).sin() - (0.8 * turn).sin()) / (0.45 * turn) }
        };
        let slow = [0.05, 0.09, 0.16, 0.28, 0.5].map(line).iter().sum::<f64>() / 5.0;
        let swing_m = self.errors.rotation_deg.to_radians() * 0.104;
        let weights = [-36.0, 9.0, 44.0, 69.0, 84.0, 89.0, 84.0, 69.0, 44.0, 9.0, -36.0].map(|w: f64| w / 429.0);
        let alike = |lag: usize| (0..11usize.saturating_sub(lag)).map(|i| weights[i] * weights[i + lag]).sum::<f64>();
        let lag = apart_s * self.errors.rate_hz;
        let (before, share) = (lag.floor() as usize, lag.fract());
        let jitter = alike(before) * (1.0 - share) + alike(before + 1) * share;
        (self.errors.wander_m.powi(2) + swing_m * swing_m * 2.0 / 3.0) * slow + self.errors.jitter_m.powi(2) * jitter
    }
}

/// Measurement accuracy of a sweep at the truth: the pulse's energy over the noise at its range and
/// angle.
fn sight(observation: &Observation, truth: DVec3, snr_db: f64, phases: bool) -> BoundSight {
    let distance_m = observation.distance_m(truth);
    let axis = &observation.geometry.axis;
    let pulse_fwhm_m = observation.geometry.pulse_fwhm_m;
    let energy: f64 = (0..axis.points).map(|n| envelope(pulse_fwhm_m, axis.range_m(n) - distance_m).powi(2)).sum();
    let amplitude = Beam::Lensless.amplitude(observation.cos_off_boresight(truth)) / (distance_m * distance_m);
    let power = 10f64.powf(snr_db / 10.0) * amplitude * amplitude * energy;
    let width_m = pulse_fwhm_m;
    BoundSight {
        time_s: observation.mid_time_ns as f64 * 1e-9,
        toward: (truth - observation.tracking_from_sensor.translation).normalize(),
        rotation: observation.tracking_from_sensor.rotation,
        range_variance_m2: width_m * width_m / (8.0 * LN_2 * power),
        phase_variance_m2: phases.then_some(0.5 / (power * PHASE_RAD_PER_M * PHASE_RAD_PER_M)),
    }
}

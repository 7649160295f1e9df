//! Accuracy of a single reflector's position against the Cramér–Rao bound, and consistency of its
//! covariance.

use std::f64::consts::{LN_2, LN_10, TAU};
use std::ops::Range;

use a121::preset;
use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::{mean, quantile};
use radar_chaperone::report::Table;
use radar_mapping::{ObserverSettings, observe_all};
use radar_mapping::{Obstacle, ReflectorSettings, find_reflectors};
use radar_sar::HistorySettings;
use radar_sar::geometry::Aabb;
use radar_sar::math;
use radar_sar::{Beam, Observation, PHASE_RAD_PER_M, envelope};
use radar_sar::{BoundSight, PositionErrors, cramer_rao_bound, eigen, farthest_points};
use radar_simulation::{Scenario, TrackingErrors};

/// Recordings of one kind: a corner reflector, a motion, how many sweeps the search uses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReflectorTrial {
    /// The simulated motion, for example `sphere-50cm`.
    pub motion: &'static str,
    /// Maximum number of sweeps used; 0: all.
    pub sweeps: usize,
    /// SNR of a sweep at 1 m on the axis, dB.
    pub snr_db: f64,
}

/// The trials of the documented table.
pub const REFLECTOR_TRIALS: [ReflectorTrial; 14] = [
    trial("sphere-50cm", 50, 20.0),
    trial("sphere-50cm", 200, 20.0),
    trial("sphere-50cm", 0, 20.0),
    trial("sphere-10cm", 50, 20.0),
    trial("sphere-10cm", 200, 20.0),
    trial("sphere-10cm", 0, 20.0),
    trial("sphere-50cm", 50, 10.0),
    trial("sphere-50cm", 200, 10.0),
    trial("sphere-50cm", 50, 30.0),
    trial("sphere-50cm", 200, 30.0),
    trial("sphere-10cm", 200, 10.0),
    trial("sphere-10cm", 200, 30.0),
    trial("x-50cm", 200, 20.0),
    trial("approach-1.0", 200, 20.0),
];

const fn trial(motion: &'static str, sweeps: usize, snr_db: f64) -> ReflectorTrial {
    ReflectorTrial { motion, sweeps, snr_db }
}

/// Maximum number of seeds that the bound is averaged over when all sweeps are used: one takes a
/// second. Choice: at most twenty seconds a trial.
const BOUND_SEEDS: u64 = 20;

/// A kind of tracking error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorKind {
    /// White errors of each pose.
    Jitter,
    /// Slow drift of the position.
    Wander,
    /// Errors of the orientation.
    Rotation,
    /// Error of the sensor's position on the headset.
    Mount,
    /// All of them.
    All,
}

/// What a reflector's table is measured on.
#[derive(Debug, Clone, PartialEq)]
pub struct ReflectorOptions {
    /// Seeds of the recordings.
    pub seeds: Range<u64>,
    /// Tracking errors left out of the recordings and of the stated errors.
    pub without: Option<ErrorKind>,
    /// Search 0.8 m around the truth instead of the 3 m cube: faster, with the same positions.
    pub near: bool,
    /// Adds the consistency along each axis of the covariance.
    pub by_axis: bool,
    /// Slow drift of the tracking that the settings do not know of, metres; `None`: as the settings say.
    pub unknown_wander_m: Option<f64>,
}

/// One row per trial. Lengths in mm.
pub fn reflector_table(trials: &[ReflectorTrial], options: &ReflectorOptions) -> Table {
    let mut head = vec![
        "motion",
        "sweeps",
        "SNR (dB)",
        "median (mm)",
        "95 % (mm)",
        "rms (mm)",
        "bound, ranges (mm)",
        "rms over it",
        "bound, phases (mm)",
        "rms over it",
        "found",
        "split",
        "NEES",
        "consistent within",
    ];
    if options.by_axis {
        head.push("NEES (1σ, rms error in mm) along the axes, widest first");
    }
    Table {
        head: head.into_iter().map(str::to_owned).collect(),
        rows: trials.iter().map(|trial| row(options, *trial)).collect(),
        caption: CAPTION.into(),
    }
}

const CAPTION: &str = "median, 95 %, rms: distance from the reported position to the truth. bound: rms of the \
    Cramér–Rao bound for the same sweeps and errors, with free phases (ranges only) and with phases of known \
    integers. split: recordings in which more than one reflector is reported. NEES: normalised squared error \
    dᵀ C⁻¹ d, 3 on average when covariances are consistent, and the 95 % band of its mean for so many recordings.";

/// Error of a reported position.
#[derive(Clone, Copy)]
struct PositionError {
    /// Distance to the truth, metres.
    distance_m: f64,
    /// Normalised square: dᵀ C⁻¹ d.
    normalised: f64,
    /// 1σ and error along the covariance's axes, widest first, metres.
    along_axes: [(f64, f64); 3],
}

/// Result of one recording.
struct Outcome {
    found: Option<PositionError>,
    is_split: bool,
    /// Traces of the bounds from ranges and from phases, mm².
    bounds_mm2: [Option<f64>; 2],
}

fn outcome(options: &ReflectorOptions, trial: ReflectorTrial, seed: u64) -> Outcome {
    let recording = TrialRecording::new(options, trial, seed);
    let found = recording.found(options, trial.sweeps);
    let error = |best: &Obstacle| {
        let off = best.position_m - recording.truth;
        PositionError {
            distance_m: off.length(),
            normalised: off.dot(best.covariance_m2.inverse() * off),
            along_axes: along_axes(&best.covariance_m2, off),
        }
    };
    let with_bound = trial.sweeps > 0 || seed - options.seeds.start < BOUND_SEEDS;
    let bound = |phases| with_bound.then(|| recording.bound_mm2(trial, phases)).flatten();
    Outcome { found: found.first().map(error), is_split: found.len() > 1, bounds_mm2: [bound(false), bound(true)] }
}

fn row(options: &ReflectorOptions, trial: ReflectorTrial) -> Vec<String> {
    let seeds: Vec<u64> = options.seeds.clone().collect();
    let outcomes: Vec<Outcome> = seeds.par_iter().map(|seed| outcome(options, trial, *seed)).collect();
    let found: Vec<PositionError> = outcomes.iter().filter_map(|outcome| outcome.found).collect();
    let mut errors_mm: Vec<f64> = found.iter().map(|error| error.distance_m * 1e3).collect();
    let rms_mm = mean(errors_mm.iter().map(|error| error * error)).sqrt();
    let bound_mm = |n: usize| mean(outcomes.iter().filter_map(|outcome| outcome.bounds_mm2[n])).sqrt();
    // Mean of chi-square variables of 3 degrees of freedom: variance 6 / count.
    let half_band = 1.96 * (6.0 / found.len() as f64).sqrt();
    let mut cells = vec![
        trial.motion.to_owned(),
        if trial.sweeps == 0 { "all".into() } else { trial.sweeps.to_string() },
        format!("{:.0}", trial.snr_db),
        format!("{:.1}", quantile(&mut errors_mm, 0.5)),
        format!("{:.1}", quantile(&mut errors_mm, 0.95)),
        format!("{rms_mm:.2}"),
        format!("{:.2}", bound_mm(0)),
        format!("{:.2}", rms_mm / bound_mm(0)),
        format!("{:.2}", bound_mm(1)),
        format!("{:.2}", rms_mm / bound_mm(1)),
        format!("{} of {}", found.len(), outcomes.len()),
        outcomes.iter().filter(|outcome| outcome.is_split).count().to_string(),
        format!("{:.2}", mean(found.iter().map(|error| error.normalised))),
        format!("{:.2} to {:.2}", 3.0 - half_band, 3.0 + half_band),
    ];
    if options.by_axis {
        cells.push(by_axis(&found.iter().map(|error| error.along_axes).collect::<Vec<_>>()));
    }
    cells
}

/// Along each axis of the covariance, widest first: mean normalised square (1 when consistent), rms
/// of 1σ and of the error, mm.
fn by_axis(seeds: &[[(f64, f64); 3]]) -> String {
    let each = (0..3).map(|axis| {
        let of_axis = |value: fn((f64, f64)) -> f64| mean(seeds.iter().map(|seed| value(seed[axis])));
        let square = of_axis(|(sigma, off)| (off / sigma).powi(2));
        let (sigma, off) = (of_axis(|(sigma, _)| sigma * sigma).sqrt(), of_axis(|(_, off)| off * off).sqrt());
        format!("{square:.2} ({:.2}, {:.2})", sigma * 1e3, off * 1e3)
    });
    each.collect::<Vec<_>>().join(", ")
}

/// 1σ and error along a covariance's axes, widest first, metres.
fn along_axes(covariance_m2: &DMat3, off: DVec3) -> [(f64, f64); 3] {
    let (variances_m2, axes) = eigen(covariance_m2);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| variances_m2[b].total_cmp(&variances_m2[a]));
    order.map(|n| (variances_m2[n].sqrt(), off.dot(axes.col(n))))
}

/// One simulated recording as observations.
struct TrialRecording {
    observations: Vec<Observation>,
    truth: DVec3,
    errors: TrackingErrors,
}

impl TrialRecording {
    fn new(options: &ReflectorOptions, trial: ReflectorTrial, seed: u64) -> Self {
        let config = preset("fine").expect("a preset");
        let mut scenario = Scenario::new("corner-reflector", trial.motion, config, 10.0, seed);
        scenario.snr_db = Some(trial.snr_db);
        match options.without {
            Some(ErrorKind::All) => scenario.errors = TrackingErrors::none(),
            Some(ErrorKind::Mount) => scenario.errors.mount_m = 0.0,
            Some(ErrorKind::Wander) => scenario.errors.wander_m = 0.0,
            Some(ErrorKind::Rotation) => scenario.errors.rotation_deg = 0.0,
            Some(ErrorKind::Jitter) => scenario.errors.jitter_m = 0.0,
            None => {}
        }
        if let Some(wander_m) = options.unknown_wander_m {
            scenario.errors.wander_m = wander_m;
        }
        let simulated = scenario.run().expect("a known scene and motion");
        let observer = ObserverSettings {
            history: HistorySettings::default(),
            head_from_sensor: scenario.head_from_sensor,
            time_offset_s: 0.0,
            range_bias_m: None,
        };
        let (observations, _) = observe_all(&scenario.config, observer, &simulated.frames, &simulated.poses);
        Self { observations, truth: simulated.truth.obstacles[0].points_m[0], errors: scenario.errors }
    }

    /// Reflectors found, strongest first.
    fn found(&self, options: &ReflectorOptions, max_sweeps: usize) -> Vec<Obstacle> {
        let (middle, half) = if options.near { (self.truth, 0.4) } else { (DVec3::new(0.0, 1.5, -1.5), 1.5) };
        let region = Aabb { min: middle - half, max: middle + half };
        let settings = ReflectorSettings { max_sweeps, ..Default::default() };
        let errors = match options.without {
            Some(ErrorKind::All) => PositionErrors::none(),
            Some(ErrorKind::Mount) => PositionErrors { mount_m: 0.0, ..Default::default() },
            Some(ErrorKind::Wander) => PositionErrors { wander_m: 0.0, ..Default::default() },
            Some(ErrorKind::Rotation) => PositionErrors { rotation_deg: 0.0, ..Default::default() },
            Some(ErrorKind::Jitter) => PositionErrors { jitter_m: 0.0, ..Default::default() },
            None => PositionErrors::default(),
        };
        find_reflectors(&self.observations, &Beam::Lensless, &region, &settings, &errors)
    }

    /// Trace of the bound for the sweeps that a search chooses, mm².
    fn bound_mm2(&self, trial: ReflectorTrial, phases: bool) -> Option<f64> {
        let positions: Vec<DVec3> = self.observations.iter().map(|o| o.tracking_from_sensor.translation).collect();
        let count = if trial.sweeps == 0 { positions.len() } else { trial.sweeps };
        let chosen = farthest_points(&positions, count);
        let sights: Vec<BoundSight> =
            chosen.into_iter().map(|n| sight(&self.observations[n], self.truth, trial.snr_db, phases)).collect();
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
            if turn < 1e-6 { 1.0 } else { (math::sin(1.25 * turn) - math::sin(0.8 * turn)) / (0.45 * turn) }
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
    let power = math::exp(snr_db / 10.0 * LN_10) * amplitude * amplitude * energy;
    let width_m = pulse_fwhm_m;
    BoundSight {
        time_s: observation.mid_time_ns as f64 * 1e-9,
        toward: (truth - observation.tracking_from_sensor.translation).normalize(),
        rotation: observation.tracking_from_sensor.rotation,
        range_variance_m2: width_m * width_m / (8.0 * LN_2 * power),
        phase_variance_m2: phases.then_some(0.5 / (power * PHASE_RAD_PER_M * PHASE_RAD_PER_M)),
    }
}

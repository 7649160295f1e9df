//! A complete simulated recording: scene, motion, sensor, tracking and receiver give frames, poses
//! and truth.

use glam::DVec3;
use num_complex::Complex;
use rayon::prelude::*;

use super::sampler::{Sampler, Surroundings};
use super::sensor::SensorModel;
use super::truth_builder::TruthBuilder;
use super::{LiveScenario, Motion, MotionError, Scene, SceneError, SensorEffects, TrackingErrors, TruePath, scene};
use a121::{ConfigError, Frame, SensorConfig, Subsweep, frame_timing, rcs_dbsm_for_snr};
use radar_sar::Beam;
use radar_sar::PoseSample;
use radar_sar::geometry::Pose;
use radar_sar::truth::Truth;

/// Host time of the start of simulated recordings, nanoseconds. Choice: not 0, so that poses before
/// the first sweep have positive times.
const START_NS: i64 = 1_000_000_000;
/// Poses start before the first sweep and end after the last one by this time, seconds. Choice: the
/// smoothing of the poses and a simulated time offset of 0.1 s need poses on both sides.
pub(super) const POSE_MARGIN_S: f64 = 0.2;

/// Scenario to simulate.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// Name of the scene, see `SCENES`.
    pub scene: String,
    /// Name of the motion, see `MOTIONS`.
    pub motion: String,
    /// Length, seconds.
    pub duration_s: f64,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Configuration of the sensor.
    pub config: SensorConfig,
    /// Beam of the sensor.
    pub beam: Beam,
    /// Assumed pose of the sensor on the head (mount).
    pub head_from_sensor: Pose,
    /// Errors of the tracking.
    pub errors: TrackingErrors,
    /// Imperfections of the sensor.
    pub effects: SensorEffects,
    /// Power SNR of the strongest scatterer on the axis at 1 m, dB; `None`: by the radar equation.
    pub snr_db: Option<f64>,
    /// Time offset of the recording, seconds: time of a sweep's pose minus time of the sweep.
    pub time_offset_s: f64,
    /// Point that the sensor faces at the start of the thesis' motions, tracking frame, metres;
    /// `None`: as in the scene.
    pub look_at_m: Option<DVec3>,
}

/// Why a scenario cannot be simulated.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// Unknown scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Invalid motion.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// The configuration breaks a rule of the sensor.
    #[error("sensor configuration: {0}")]
    Config(#[from] ConfigError),
    /// Duration out of range.
    #[error("a duration of {0} s cannot be simulated: give 0.1 to 3600 s")]
    Duration(f64),
    /// SNR out of range.
    #[error("an SNR of {0} dB cannot be simulated: give −100 to 100 dB")]
    Snr(f64),
    /// Time offset out of range.
    #[error("a time offset of {0} s cannot be simulated: give −10 to 10 s")]
    TimeOffset(f64),
    /// Invalid point to look at.
    #[error("a sensor cannot be turned to {0}: give a finite point other than its own position")]
    LookAt(DVec3),
    /// A strength of an effect out of range.
    #[error("sensor effects {0:?} cannot be simulated: give strengths from 0 to 100")]
    Effects(SensorEffects),
    /// Rate of dropouts out of range.
    #[error("{0} dropouts a minute cannot be simulated: give 0 to 6000")]
    Dropouts(f64),
}

/// A simulated recording.
#[derive(Debug, Clone)]
pub struct Simulated {
    /// Frames by rising time.
    pub frames: Vec<Frame>,
    /// Poses by rising time.
    pub poses: Vec<PoseSample>,
    /// Ground truth.
    pub truth: Truth,
}

impl Scenario {
    /// A scenario with default tracking errors, the default mount (3 cm above and 10 cm in front of
    /// the eyes) and the lensless beam.
    pub fn new(scene: &str, motion: &str, config: SensorConfig, duration_s: f64, seed: u64) -> Self {
        Self {
            scene: scene.into(),
            motion: motion.into(),
            duration_s,
            seed,
            config,
            beam: Beam::Lensless,
            head_from_sensor: default_mount(),
            errors: TrackingErrors::default(),
            effects: SensorEffects::NONE,
            snr_db: None,
            time_offset_s: 0.0,
            look_at_m: None,
        }
    }

    /// Simulates the recording.
    ///
    /// # Errors
    /// An unknown name, a configuration that breaks a rule; a duration, SNR, time offset or dropout
    /// rate out of range; an invalid point to look at.
    pub fn run(&self) -> Result<Simulated, ScenarioError> {
        let prepared = self.prepare()?;
        let head_at = |t: f64| prepared.head_at(t);
        let poses = self.poses(&prepared);
        let frames = self.frames(&prepared);
        let title = format!("{}, {}", self.scene, self.motion);
        let known = TruthBuilder { title, seed: self.seed, duration_s: self.duration_s, beam: &self.beam };
        let mut truth = known.build(&prepared.scene.room, head_at, |t| prepared.sensor_at(t));
        truth.time_offset_s = self.time_offset_s;
        Ok(Simulated { frames, poses, truth })
    }

    /// The same scenario without end; its motion runs forwards and backwards in turn.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn live(&self) -> Result<LiveScenario, ScenarioError> {
        Ok(LiveScenario::new(self.prepare()?))
    }

    /// Only the tracked poses, the same as those of [`Self::run`].
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn tracked(&self) -> Result<Vec<PoseSample>, ScenarioError> {
        Ok(self.poses(&self.prepare()?))
    }

    /// The true path of the head.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn path(&self) -> Result<TruePath, ScenarioError> {
        Ok(TruePath::new(self.prepare()?))
    }

    fn poses(&self, prepared: &PreparedScenario) -> Vec<PoseSample> {
        let span_s = (-POSE_MARGIN_S, self.duration_s + POSE_MARGIN_S);
        self.errors.track(|t| prepared.head_at(t), span_s, host_ns, self.seed)
    }

    fn prepare(&self) -> Result<PreparedScenario, ScenarioError> {
        self.config.validate()?;
        if !(0.1..=3600.0).contains(&self.duration_s) {
            return Err(ScenarioError::Duration(self.duration_s));
        }
        if let Some(snr) = self.snr_db.filter(|snr| !(-100.0..=100.0).contains(snr)) {
            return Err(ScenarioError::Snr(snr));
        }
        if !(-10.0..=10.0).contains(&self.time_offset_s) {
            return Err(ScenarioError::TimeOffset(self.time_offset_s));
        }
        if !self.effects.is_valid() {
            return Err(ScenarioError::Effects(self.effects));
        }
        if !(0.0..=6000.0).contains(&self.errors.dropouts_per_minute) {
            return Err(ScenarioError::Dropouts(self.errors.dropouts_per_minute));
        }
        let mut scene = scene(&self.scene, self.seed)?;
        if let Some(point) = self.look_at_m {
            if !point.is_finite() || point.distance(scene.start_m) < 1e-3 {
                return Err(ScenarioError::LookAt(point));
            }
            scene.look_at_m = point;
        }
        let motion = Motion::from_name(&self.motion, &scene, self.duration_s + POSE_MARGIN_S, self.seed)?;
        let true_mount = self.errors.true_mount(&self.head_from_sensor, self.seed);
        Ok(PreparedScenario { scenario: self.clone(), scene, motion, true_mount })
    }

    fn frames(&self, prepared: &PreparedScenario) -> Vec<Frame> {
        let timing = frame_timing(&self.config);
        let sensor = prepared.sensor_model(&self.config);
        let count = ((self.duration_s - timing.frame_s) / timing.frame_period_s).floor().max(0.0) as usize + 1;
        (0..count)
            .into_par_iter()
            .map(|index| {
                let start_s = index as f64 * timing.frame_period_s;
                let mut samples = Vec::with_capacity(self.config.points_per_frame());
                let sensor_at = |t: f64| prepared.sensor_at(t);
                let data_saturated =
                    prepared.frame(&self.config, &sensor, (index as u64, start_s), sensor_at, &mut samples);
                let end_s = start_s + timing.frame_s;
                Frame {
                    tick: (end_s * 1e6).round() as i64,
                    host_time_ns: host_ns(end_s - self.time_offset_s),
                    temperature_c: sensor.temperature_c(start_s).round() as i16,
                    data_saturated,
                    frame_delayed: false,
                    calibration_needed: false,
                    samples,
                }
            })
            .collect()
    }
}

/// A scenario with its scene and motion generated.
#[derive(Debug, Clone)]
pub(super) struct PreparedScenario {
    pub scenario: Scenario,
    pub scene: Scene,
    motion: Motion,
    true_mount: Pose,
}

impl PreparedScenario {
    pub fn head_at(&self, time_s: f64) -> Pose {
        self.motion.tracking_from_head(time_s, &self.scenario.head_from_sensor)
    }

    pub fn sensor_at(&self, time_s: f64) -> Pose {
        self.head_at(time_s) * self.true_mount
    }

    /// The scenario's sensor with a configuration.
    pub fn sensor_model(&self, config: &SensorConfig) -> SensorModel {
        SensorModel::new(config, self.scenario.effects, self.scenario.seed)
    }

    /// Appends the samples of the frame of a number whose measurement starts at `start_s`; returns
    /// whether a sample saturated.
    pub fn frame(
        &self,
        config: &SensorConfig,
        sensor: &SensorModel,
        (number, start_s): (u64, f64),
        sensor_at: impl Fn(f64) -> Pose,
        samples: &mut Vec<Complex<i16>>,
    ) -> bool {
        let sampler = Sampler { config, beam: &self.scenario.beam, sensor, rcs_offset_db: self.rcs_offset_db(config) };
        let surroundings = |_: f64, _: f64| Surroundings { room: &self.scene.room, moving: Vec::new() };
        sampler.frame(number, start_s, sensor_at, surroundings, samples)
    }

    fn rcs_offset_db(&self, config: &SensorConfig) -> f64 {
        let strongest = self.scene.room.scatterers().map(|s| s.rcs_dbsm).fold(f64::NEG_INFINITY, f64::max);
        match (self.scenario.snr_db, config.subsweeps.first()) {
            (Some(snr), Some(Subsweep { profile, hwaas, .. })) if strongest.is_finite() => {
                rcs_dbsm_for_snr(*profile, *hwaas, snr, 1.0) - strongest
            }
            _ => 0.0,
        }
    }
}

/// Default mount: a sensor at the front of the headset.
pub(super) fn default_mount() -> Pose {
    Pose::from_translation(DVec3::new(0.0, 0.03, -0.10))
}

pub(super) fn host_ns(time_s: f64) -> i64 {
    START_NS + (time_s * 1e9).round() as i64
}

#[cfg(test)]
mod tests {
    use super::*;
    use a121::preset;

    #[test]
    fn same_seed_gives_same_recording_on_any_thread_count() {
        let scenario = Scenario::new("furnished-room", "natural", preset("d16").unwrap(), 0.5, 11);
        let a = scenario.run().unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let b = pool.install(|| scenario.run()).unwrap();
        assert_eq!(a.frames, b.frames);
        assert_eq!(a.poses, b.poses);
        assert_eq!(a.truth, b.truth);
        assert_eq!(a.frames.len(), 33);
        assert_eq!(a.frames[0].samples.len(), 800);
    }

    #[test]
    fn time_offset_shifts_recorded_times() {
        let config = preset("fine").unwrap();
        let mut scenario = Scenario::new("corner-reflector", "stationary", config, 0.3, 1);
        let plain = scenario.run().unwrap();
        scenario.time_offset_s = 0.02;
        let moved = scenario.run().unwrap();
        assert_eq!(plain.frames[3].host_time_ns - moved.frames[3].host_time_ns, 20_000_000);
        assert_eq!(plain.frames[3].samples, moved.frames[3].samples);
    }

    #[test]
    fn sensor_points_at_the_target_and_lens_gain_is_on_axis() {
        let energy = |beam: Beam, at: DVec3| {
            let config = preset("fine").unwrap();
            let scenario = Scenario {
                beam,
                look_at_m: Some(at),
                snr_db: Some(40.0),
                ..Scenario::new("raised-reflector", "stationary", config, 0.1, 1)
            };
            let frames = scenario.run().unwrap().frames;
            frames[0].samples.iter().map(|s| f64::from(s.re).powi(2) + f64::from(s.im).powi(2)).sum::<f64>()
        };
        let (reflector, aside) = (DVec3::new(-0.3, 1.7, -1.0), DVec3::new(0.3, 1.7, -1.0));
        let gain_db = 10.0 * (energy(Beam::Fresnel, reflector) / energy(Beam::Lensless, reflector)).log10();
        assert!((gain_db - Beam::Fresnel.gain_db()).abs() < 0.5, "{gain_db}");
        assert!(energy(Beam::Fresnel, aside) < 0.1 * energy(Beam::Lensless, aside));
    }

    #[test]
    fn invalid_scenarios_give_the_reason() {
        let config = preset("fine").unwrap();
        let mut scenario = Scenario::new("corner-reflector", "moonwalk", config, 1.0, 1);
        assert!(scenario.run().unwrap_err().to_string().contains("moonwalk"));
        scenario.motion = "natural".into();
        scenario.duration_s = f64::NAN;
        assert!(scenario.run().unwrap_err().to_string().contains("0.1 to 3600"));
        (scenario.duration_s, scenario.motion) = (1.0, "stationary".into());
        for nowhere in [DVec3::NAN, DVec3::new(0.0, 1.5, 0.0)] {
            scenario.look_at_m = Some(nowhere);
            assert!(scenario.run().unwrap_err().to_string().contains("other than its own"));
        }
    }
}

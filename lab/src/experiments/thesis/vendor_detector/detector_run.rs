//! A recording processed by the vendor's detector window by window, with the truth, and by ours.

use glam::DVec3;
use num_complex::Complex;

use super::super::SNR_DB;
use super::super::imaging_methods::{chosen, locate};
use super::{MAX_OFF_BORESIGHT_DEG, MIN_SPEED_M_PER_S, RANGE_MATCH_M, SPEED_MATCH_M_PER_S, SWEEPS};
use crate::baselines::{DetectorConfig, DetectorResult, Reflection, VendorDetector};
use crate::experiments::trial_recording::TrialRecording;
use a121::Frame;
use radar_mapping::{ObserverSettings, observe_all};
use radar_sar::HistorySettings;
use radar_sar::Observation;
use radar_sar::math;
use radar_sar::{Refined, Selection};
use radar_simulation::{Scenario, ScenarioError, TrackingErrors};

/// One detector window with the truth.
pub(super) struct WindowWithTruth {
    /// Time since the start of the recording, seconds.
    pub time_s: f64,
    /// True sensor state at the middle of the window, without tracking errors.
    pub sensor: Observation,
    /// Tracked velocity, m/s.
    pub tracked_m_per_s: DVec3,
    pub result: DetectorResult,
}

impl WindowWithTruth {
    pub fn distance_m(&self, point: DVec3) -> f64 {
        point.distance(self.sensor.tracking_from_sensor.translation)
    }

    pub fn toward(&self, point: DVec3) -> DVec3 {
        (point - self.sensor.tracking_from_sensor.translation).normalize_or_zero()
    }

    /// Rate at which the distance to a point grows, m/s.
    pub fn velocity_m_per_s(&self, point: DVec3) -> f64 {
        -self.sensor.velocity_m_per_s.dot(self.toward(point))
    }

    pub fn speed_m_per_s(&self) -> f64 {
        self.sensor.velocity_m_per_s.length()
    }

    /// Angle between the path and a point.
    pub fn angle_deg(&self, point: DVec3) -> f64 {
        angle_deg(self.sensor.velocity_m_per_s, self.toward(point))
    }

    pub fn off_boresight_deg(&self, point: DVec3) -> f64 {
        angle_deg(self.sensor.tracking_from_sensor.forward(), self.toward(point))
    }

    /// The strongest reflection, if it is at the range of a point.
    pub fn found(&self, point: DVec3) -> Option<&Reflection> {
        self.result
            .reflections
            .first()
            .filter(|found| (found.distance_m - self.distance_m(point)).abs() < RANGE_MATCH_M)
    }

    /// Whether a reflection matches a point in range and speed.
    pub fn matches(&self, found: &Reflection, point: DVec3) -> bool {
        (found.distance_m - self.distance_m(point)).abs() < RANGE_MATCH_M
            && (found.velocity_m_per_s - self.velocity_m_per_s(point)).abs() < SPEED_MATCH_M_PER_S
    }
}

pub(super) fn angle_deg(a: DVec3, b: DVec3) -> f64 {
    math::acos(a.normalize_or_zero().dot(b).clamp(-1.0, 1.0)).to_degrees()
}

/// A recording as processed by the detector and by ours.
pub(super) struct DetectorRun {
    seed: u64,
    windows: Vec<WindowWithTruth>,
    /// The sweeps with tracked poses.
    pub recorded: TrialRecording,
    pub things_m: Vec<DVec3>,
    begin_ns: i64,
}

impl DetectorRun {
    pub fn of(
        scene: &str,
        motion: &str,
        config: &DetectorConfig,
        duration_s: f64,
        seed: u64,
    ) -> Result<Self, ScenarioError> {
        let sensor = config.sensor();
        let scenario =
            Scenario { snr_db: Some(SNR_DB), ..Scenario::new(scene, motion, sensor.clone(), duration_s, seed) };
        let simulated = scenario.run()?;
        let exact = TrialRecording::of(&Scenario { errors: TrackingErrors::none(), ..scenario.clone() })?.observations;
        let observer = ObserverSettings {
            history: HistorySettings::default(),
            head_from_sensor: scenario.head_from_sensor,
            time_offset_s: 0.0,
            range_bias_m: None,
        };
        let (observations, _) = observe_all(&sensor, observer, &simulated.frames, &simulated.poses);
        let things_m: Vec<DVec3> = simulated.truth.obstacles.iter().flat_map(|o| o.points_m.clone()).collect();
        let begin_ns = observations.first().map_or(0, |first| first.mid_time_ns);
        let mut detector = VendorDetector::new(config.sampling(), &empty(&scenario)?);
        let back_ns = (0.5 * f64::from(config.sweeps) / config.sweep_rate_hz() * 1e9) as i64;
        let sight = |frame: &Frame| {
            let result = detector.push(&sweeps(frame, sensor.points_per_sweep()))?;
            let middle_ns = frame.host_time_ns - back_ns;
            let at = |all: &[Observation]| all.get(all.partition_point(|o| o.mid_time_ns < middle_ns)).cloned();
            let time_s = (middle_ns - begin_ns) as f64 * 1e-9;
            let tracked_m_per_s = at(&observations)?.velocity_m_per_s;
            Some(WindowWithTruth { time_s, sensor: at(&exact)?, tracked_m_per_s, result })
        };
        let windows = simulated.frames.iter().filter_map(sight).collect();
        let truth_m = things_m.first().copied().unwrap_or(DVec3::NAN);
        Ok(Self {
            seed,
            windows,
            recorded: TrialRecording { seed, observations, truth_m, truth: simulated.truth },
            things_m,
            begin_ns,
        })
    }

    /// Windows in which an object is expected to be seen: within range, in the beam, the sensor
    /// moving.
    pub fn detectable(&self, config: &DetectorConfig, point: DVec3) -> impl Iterator<Item = &WindowWithTruth> {
        let [near_m, far_m] = config.range_m;
        self.windows.iter().filter(move |sight| {
            (near_m..=far_m).contains(&sight.distance_m(point))
                && sight.off_boresight_deg(point) < MAX_OFF_BORESIGHT_DEG
                && sight.speed_m_per_s() > MIN_SPEED_M_PER_S
        })
    }

    /// Our position from the sweeps up to a time.
    pub fn located_until(&self, time_s: f64) -> Option<Refined> {
        let until_ns = self.begin_ns + (time_s * 1e9) as i64;
        let before = self.recorded.observations.iter().filter(|o| o.mid_time_ns <= until_ns);
        let until = TrialRecording { observations: before.cloned().collect(), ..self.recorded.clone() };
        locate(&chosen(&until, SWEEPS, Selection::FarthestPoint), self.seed).0
    }
}

/// Sweeps of an empty space, for the detector's calibration.
fn empty(scenario: &Scenario) -> Result<Vec<Vec<Complex<i16>>>, ScenarioError> {
    let empty = Scenario {
        scene: "nothing".into(),
        motion: "stationary".into(),
        duration_s: 0.5,
        seed: scenario.seed ^ 0xCA11_B8A7,
        ..scenario.clone()
    };
    let frames = empty.run()?.frames;
    Ok(frames.iter().flat_map(|frame| sweeps(frame, scenario.config.points_per_sweep())).collect())
}

fn sweeps(frame: &Frame, points: usize) -> Vec<Vec<Complex<i16>>> {
    frame.samples.chunks_exact(points.max(1)).map(<[_]>::to_vec).collect()
}

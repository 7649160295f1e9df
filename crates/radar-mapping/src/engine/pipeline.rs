//! Frames and poses in, scene out: combines the observer and the engine, for replay, demo and the
//! headset.
//!
//! The time offset between the streams is estimated once a second. When the estimate is accurate
//! and differs from the offset in use, it is applied to later sweeps, and kept observations get new
//! poses.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::offset_guard::OffsetGuard;
use super::{Engine, EngineCounters};
use crate::MappingSettings;
use crate::{HandsM, SavedMap, SavedMapError, Scene};
use crate::{Observer, ObserverCounters, ObserverSettings};
use a121::{Frame, SensorConfig};
use radar_sar::PoseSample;
use radar_sar::geometry::Pose;
use radar_sar::{TimeOffset, TimeOffsetEstimator, TimeOffsetSettings};

/// All counters of the pipeline.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Counters {
    /// Counters of joining the streams.
    pub streams: ObserverCounters,
    /// Counters of the engine.
    pub engine: EngineCounters,
    /// Counters of the time offset.
    pub time_offset: TimeOffsetCounters,
}

/// Counters of the time offset between the streams.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TimeOffsetCounters {
    /// Estimates made.
    pub estimates: u64,
    /// How often the offset in use was changed.
    pub changes: u64,
    /// Tracks used for the last estimate.
    pub tracks: u64,
    /// Tracks excluded from the last estimate: they moved, or contradicted the others.
    pub tracks_left_out: u64,
}

/// The whole path from raw streams to the scene.
#[derive(Debug)]
pub struct Pipeline {
    observer: Observer,
    engine: Engine,
    sensor_path: Vec<(i64, Pose)>,
    estimator: Option<TimeOffsetEstimator>,
    max_sigma_s: f64,
    next_estimate_ns: Option<i64>,
    /// Sweeps from this time on are used for the next estimate.
    listen_from_ns: i64,
    estimate: Option<TimeOffset>,
    /// 1σ of the estimate in use; `None` while the settings' offset is in use.
    applied_sigma_s: Option<f64>,
    offset_guard: OffsetGuard,
    time_offset: TimeOffsetCounters,
    is_deferred: bool,
    is_estimate_due: bool,
    /// Sweeps get their poses before these have their final smoothing.
    poses_are_provisional: bool,
}

/// Interval of the recorded sensor path, nanoseconds. Choice.
const PATH_STEP_NS: i64 = 20_000_000;
/// Interval of estimates, nanoseconds, and the interval while the offset in use is confirmed.
/// Choice.
const ESTIMATE_NS: i64 = 1_000_000_000;
const SETTLED_ESTIMATE_NS: i64 = 10_000_000_000;
/// While it is confirmed, an estimate uses only sweeps of this time before it, nanoseconds. Choice.
const SETTLED_WINDOW_NS: i64 = 2_500_000_000;
/// The offset is changed when it is wrong by this many 1σ and by this many seconds. Choice.
const SIGNIFICANT: f64 = 3.0;
const MIN_CHANGE_S: f64 = 0.5e-3;
/// An estimated offset is also refined once the 1σ has fallen to this share, which bounds the
/// number of changes. Choice.
const SHARPER_SIGMA_RATIO: f64 = 0.5;

impl Pipeline {
    /// For a valid configuration. A mount in the settings has precedence over the one given.
    pub fn new(config: &SensorConfig, head_from_sensor: &Pose, settings: &MappingSettings) -> Self {
        let tracking = &settings.tracking;
        let mut observer = Observer::new(
            config,
            ObserverSettings {
                history: tracking.history,
                head_from_sensor: tracking.mount.unwrap_or(*head_from_sensor),
                time_offset_s: tracking.time_offset_s,
            },
        );
        let engine = Engine::new(config, settings);
        let estimator = tracking.estimate_time_offset.then(|| {
            observer.keep_poses_s(engine.pose_retention_s());
            TimeOffsetEstimator::new(TimeOffsetSettings { middle_s: tracking.time_offset_s, errors: tracking.errors })
        });
        Self {
            observer,
            engine,
            sensor_path: Vec::new(),
            estimator,
            max_sigma_s: tracking.max_time_offset_sigma_s,
            next_estimate_ns: None,
            listen_from_ns: i64::MIN,
            estimate: None,
            applied_sigma_s: None,
            offset_guard: OffsetGuard::default(),
            time_offset: TimeOffsetCounters::default(),
            is_deferred: false,
            is_estimate_due: false,
            poses_are_provisional: tracking.history.is_early(),
        }
    }

    /// From now on poses and frames are only stored, so that the stream is never delayed for long,
    /// and [`work`](Self::work) processes them. The scene is the same, except that time-offset
    /// estimates may come later.
    pub fn defer(&mut self) {
        self.is_deferred = true;
        self.engine.defer();
    }

    /// Does a part of the deferred work; false when nothing is left.
    pub fn work(&mut self) -> bool {
        if self.engine.work() {
            return true;
        }
        let is_due = std::mem::take(&mut self.is_estimate_due);
        if is_due {
            self.estimate_time_offset();
            self.schedule_estimate(self.observer.newest_pose_ns().unwrap_or(i64::MIN));
        }
        is_due
    }

    /// Whether [`work`](Self::work) has something to do.
    pub fn has_work(&self) -> bool {
        self.engine.has_work() || self.is_estimate_due
    }

    /// Takes a head pose.
    pub fn push_pose(&mut self, sample: &PoseSample) {
        self.observer.push_pose(sample);
        self.process_ready(false);
        let Some(now_ns) = self.observer.newest_pose_ns() else { return };
        // A wrong time that was taken back must not delay the next estimate.
        self.next_estimate_ns.take_if(|next_ns| next_ns.saturating_sub(now_ns) > SETTLED_ESTIMATE_NS);
        if self.next_estimate_ns.is_none_or(|next_ns| now_ns >= next_ns) {
            // The first estimate has no data yet; a leap in time must not trigger a burst of
            // estimates.
            let first = self.next_estimate_ns.is_none();
            self.is_estimate_due |= self.is_deferred && !first;
            if !first && !self.is_deferred {
                self.estimate_time_offset();
            }
            self.schedule_estimate(now_ns);
        }
    }

    fn schedule_estimate(&mut self, now_ns: i64) {
        let settled = self.is_settled();
        let next_ns = now_ns.saturating_add(if settled { SETTLED_ESTIMATE_NS } else { ESTIMATE_NS });
        self.listen_from_ns = if settled { next_ns.saturating_sub(SETTLED_WINDOW_NS) } else { i64::MIN };
        self.next_estimate_ns = Some(next_ns);
    }

    /// Takes the positions of the wearer's hands, tracking frame, `None` for an untracked one:
    /// detections there are not furniture.
    pub fn push_hands(&mut self, time_ns: i64, hands_m: HandsM) {
        self.engine.push_hands(time_ns, hands_m);
    }

    /// The map for saving.
    pub fn saved_map(&self) -> SavedMap {
        self.engine.saved_map()
    }

    /// Restores a saved map, in the tracking frame, as provisional.
    ///
    /// # Errors
    /// Numbers that are not valid for a room; nothing is restored then.
    pub fn restore(&mut self, remembered: &SavedMap) -> Result<(), SavedMapError> {
        self.engine.restore(remembered)
    }

    /// Takes a frame.
    pub fn push_frame(&mut self, frame: Frame) {
        self.observer.push_frame(frame);
    }

    /// Processes frames that arrived after the poses they needed. Not necessary when events are
    /// pushed in time order.
    pub fn process_late(&mut self) {
        self.process_ready(false);
    }

    /// Clears the recorded sensor path, for long runs that do not draw it.
    pub fn forget_sensor_path(&mut self) {
        self.sensor_path.clear();
    }

    /// Ends both streams.
    pub fn finish(&mut self) {
        self.process_ready(true);
        self.estimate_time_offset();
        self.engine.finish();
    }

    fn process_ready(&mut self, rest: bool) {
        let path = self.observer.take_path();
        let observations = if rest { self.observer.take_rest() } else { self.observer.take_ready() };
        if let Some(estimator) = &mut self.estimator {
            for sensor in path {
                estimator.push_path(sensor.time_ns, sensor.tracking_from_sensor.translation, sensor.velocity_m_per_s);
            }
            let listened = observations.iter().filter(|observation| observation.mid_time_ns >= self.listen_from_ns);
            listened.for_each(|observation| estimator.push_sweep(observation));
        }
        for observation in observations {
            let time_ns = observation.mid_time_ns;
            if self.sensor_path.last().is_none_or(|last| time_ns.saturating_sub(last.0) >= PATH_STEP_NS) {
                self.sensor_path.push((time_ns, observation.tracking_from_sensor));
            }
            if self.poses_are_provisional {
                let observer = &self.observer;
                let sensor_at = |sweep_ns: i64| -> Option<(Pose, DVec3)> {
                    let sensor = observer.smoothed_sensor_at(sweep_ns, time_ns).ok()?;
                    Some((sensor.tracking_from_sensor, sensor.velocity_m_per_s))
                };
                self.engine.update_poses_before(&observation, sensor_at);
            }
            self.engine.push(observation);
        }
    }

    fn estimate_time_offset(&mut self) {
        let Some(estimator) = &mut self.estimator else { return };
        self.estimate = estimator.estimate();
        self.time_offset.estimates += 1;
        let Some(estimate) = self.estimate else { return };
        self.time_offset.tracks = estimate.tracks as u64;
        self.time_offset.tracks_left_out = estimate.tracks_left_out as u64;
        let now_ns = self.observer.newest_pose_ns().unwrap_or(i64::MIN);
        let is_known = estimate.observable && estimate.sigma_s <= self.max_sigma_s;
        let invalidates_map = self.engine.is_invalidated_by(estimate.offset_s - self.observer.time_offset_s());
        if self.offset_guard.allows(now_ns, is_known, invalidates_map) && self.is_better(&estimate) {
            self.apply(&estimate);
        }
    }

    /// Whether the last estimate is accurate and agrees with the offset in use, so that estimates
    /// can be less frequent.
    fn is_settled(&self) -> bool {
        let agrees = |estimate: &TimeOffset| {
            let wrong_s = (estimate.offset_s - self.observer.time_offset_s()).abs();
            estimate.observable
                && estimate.sigma_s <= 0.5 * self.max_sigma_s
                && wrong_s <= MIN_CHANGE_S.max(estimate.sigma_s)
        };
        self.estimate.as_ref().is_some_and(agrees)
    }

    /// Whether an estimate should replace the offset in use.
    fn is_better(&self, estimate: &TimeOffset) -> bool {
        let wrong_s = (estimate.offset_s - self.observer.time_offset_s()).abs();
        let sharper = self.applied_sigma_s.is_some_and(|sigma_s| estimate.sigma_s <= SHARPER_SIGMA_RATIO * sigma_s);
        estimate.observable
            && estimate.sigma_s <= self.max_sigma_s
            && wrong_s >= MIN_CHANGE_S
            && (wrong_s >= SIGNIFICANT * estimate.sigma_s || sharper)
    }

    /// Applies the estimate to later sweeps and to those that the engine keeps.
    fn apply(&mut self, estimate: &TimeOffset) {
        let change_s = estimate.offset_s - self.observer.time_offset_s();
        self.observer.set_time_offset_s(estimate.offset_s);
        self.applied_sigma_s = Some(estimate.sigma_s);
        self.offset_guard = OffsetGuard::default();
        self.time_offset.changes += 1;
        let offset_ns = (estimate.offset_s * 1e9).round() as i64;
        let sensor_at = |time_ns: i64| -> Option<(Pose, DVec3)> {
            let sensor = self.observer.sensor_at(time_ns.saturating_add(offset_ns)).ok()?;
            Some((sensor.tracking_from_sensor, sensor.velocity_m_per_s))
        };
        self.engine.repose(change_s, sensor_at);
    }

    /// The engine.
    pub fn engine(&self) -> &Engine {
        &self.engine
    }

    /// The time offset in use: time of a sweep's pose minus time of the sweep, seconds.
    pub fn time_offset_s(&self) -> f64 {
        self.observer.time_offset_s()
    }

    /// The last estimate of the time offset, applied or not; `None` when there was none.
    pub fn time_offset_estimate(&self) -> Option<TimeOffset> {
        self.estimate
    }

    /// The newest valid head pose and its time.
    pub fn head(&self) -> Option<(i64, Pose)> {
        self.observer.head()
    }

    /// The sensor path, every 20 ms: time and `tracking_from_sensor`.
    pub fn sensor_path(&self) -> &[(i64, Pose)] {
        &self.sensor_path
    }

    /// The obstacles, walls and moving targets found so far.
    pub fn scene(&self) -> Scene {
        self.engine.scene()
    }

    /// All counters so far.
    pub fn counters(&self) -> Counters {
        Counters { streams: *self.observer.counters(), engine: self.engine.counters(), time_offset: self.time_offset }
    }
}

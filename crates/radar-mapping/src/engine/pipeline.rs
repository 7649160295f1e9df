//! Frames and poses in, scene out: the observer and the engine in one, as replay, demo and the headset use them.
//!
//! Once a second the time offset between the streams is estimated. When it is known well and differs, sweeps from then on
//! get their poses by it, and what the engine keeps gets new poses.

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

/// Everything that was taken, left out and done.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Counters {
    /// Joining the streams.
    pub streams: ObserverCounters,
    /// The engine.
    pub engine: EngineCounters,
    /// The time between the streams.
    pub time_offset: TimeOffsetCounters,
}

/// What was done about the time between the streams.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TimeOffsetCounters {
    /// Estimates made.
    pub estimates: u64,
    /// Times that the offset in force was changed.
    pub changes: u64,
    /// Tracks that the last estimate rests on, and tracks that it left out.
    pub tracks: u64,
    /// Tracks left out of the last estimate: they moved, or contradicted the others.
    pub tracks_left_out: u64,
}

/// The whole way from raw streams to the scene.
#[derive(Debug)]
pub struct Pipeline {
    observer: Observer,
    engine: Engine,
    sensor_path: Vec<(i64, Pose)>,
    estimator: Option<TimeOffsetEstimator>,
    max_sigma_s: f64,
    next_estimate_ns: Option<i64>,
    /// Sweeps from then on are listened to for the next estimate.
    listen_from_ns: i64,
    estimate: Option<TimeOffset>,
    /// 1σ of the estimate that is in force; `None`: the settings' offset is.
    applied_sigma_s: Option<f64>,
    offset_guard: OffsetGuard,
    time_offset: TimeOffsetCounters,
    is_deferred: bool,
    is_estimate_due: bool,
    /// Sweeps have their poses before these are as smooth as they will be.
    poses_are_provisional: bool,
}

/// Time between two noted places of the sensor, nanoseconds.
const PATH_STEP_NS: i64 = 20_000_000;
/// Time between two estimates of the offset, nanoseconds; and while the one in force holds good.
const ESTIMATE_NS: i64 = 1_000_000_000;
const SETTLED_ESTIMATE_NS: i64 = 10_000_000_000;
/// Then only the sweeps of so long before an estimate are listened to.
const SETTLED_WINDOW_NS: i64 = 2_500_000_000;
/// The offset is changed when it is wrong by this many 1σ, and by this much, seconds.
const SIGNIFICANT: f64 = 3.0;
const MIN_CHANGE_S: f64 = 0.5e-3;
/// An offset in force is also sharpened once its 1σ has fallen to this share: a bounded number of times.
const SHARPER_SIGMA_RATIO: f64 = 0.5;

impl Pipeline {
    /// For a sound configuration. The settings' mount goes before the one given.
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

    /// From now on poses and frames are only taken, so that the stream is never held up for long; what they set off is left
    /// to [`work`](Self::work). The scene comes to the same, but for estimates of the time offset, which may come later.
    pub fn defer(&mut self) {
        self.is_deferred = true;
        self.engine.defer();
    }

    /// Does a part of what poses and frames set off; false when nothing is left to do.
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

    /// Takes a pose of the head.
    pub fn push_pose(&mut self, sample: &PoseSample) {
        self.observer.push_pose(sample);
        self.process_ready(false);
        let Some(now_ns) = self.observer.newest_pose_ns() else { return };
        // A time that was taken back, being wrong, must not put the next estimate off.
        self.next_estimate_ns.take_if(|next_ns| next_ns.saturating_sub(now_ns) > SETTLED_ESTIMATE_NS);
        if self.next_estimate_ns.is_none_or(|next_ns| now_ns >= next_ns) {
            // The first one has nothing to go by; a leap in time does not bring a burst of them.
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

    /// Takes where the player's own hands are, tracking frame, `None` for one that is not tracked: what is there is no furniture.
    pub fn push_hands(&mut self, time_ns: i64, hands_m: HandsM) {
        self.engine.push_hands(time_ns, hands_m);
    }

    /// What is known of the room, to be kept.
    pub fn saved_map(&self) -> SavedMap {
        self.engine.saved_map()
    }

    /// Takes up what is remembered of this room, in the tracking frame, as provisional.
    ///
    /// # Errors
    /// Numbers that are none of a room; nothing is taken up then.
    pub fn restore(&mut self, remembered: &SavedMap) -> Result<(), SavedMapError> {
        self.engine.restore(remembered)
    }

    /// Takes a frame.
    pub fn push_frame(&mut self, frame: Frame) {
        self.observer.push_frame(frame);
    }

    /// Works off frames that came after the poses they waited for. Who pushes in the order of time needs it not.
    pub fn process_late(&mut self) {
        self.process_ready(false);
    }

    /// Forgets where the sensor was up to now: for who runs for hours and does not draw it.
    pub fn forget_sensor_path(&mut self) {
        self.sensor_path.clear();
    }

    /// Both streams have ended.
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

    /// Whether the last estimate is well known and agrees with the offset in force: it need not be looked at so often then.
    fn is_settled(&self) -> bool {
        let agrees = |estimate: &TimeOffset| {
            let wrong_s = (estimate.offset_s - self.observer.time_offset_s()).abs();
            estimate.observable
                && estimate.sigma_s <= 0.5 * self.max_sigma_s
                && wrong_s <= MIN_CHANGE_S.max(estimate.sigma_s)
        };
        self.estimate.as_ref().is_some_and(agrees)
    }

    /// Whether an estimate should replace the offset in force.
    fn is_better(&self, estimate: &TimeOffset) -> bool {
        let wrong_s = (estimate.offset_s - self.observer.time_offset_s()).abs();
        let sharper = self.applied_sigma_s.is_some_and(|sigma_s| estimate.sigma_s <= SHARPER_SIGMA_RATIO * sigma_s);
        estimate.observable
            && estimate.sigma_s <= self.max_sigma_s
            && wrong_s >= MIN_CHANGE_S
            && (wrong_s >= SIGNIFICANT * estimate.sigma_s || sharper)
    }

    /// Sweeps from now on, and those that the engine keeps, get their poses by the estimate.
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

    /// The time offset in force: time of a sweep's pose minus time of the sweep, seconds.
    pub fn time_offset_s(&self) -> f64 {
        self.observer.time_offset_s()
    }

    /// The last estimate of the time offset, in force or not; `None` when the data told nothing or nobody asked.
    pub fn time_offset_estimate(&self) -> Option<TimeOffset> {
        self.estimate
    }

    /// The newest valid pose of the head and its time.
    pub fn head(&self) -> Option<(i64, Pose)> {
        self.observer.head()
    }

    /// Where the sensor was, every 20 ms: time and `tracking_from_sensor`.
    pub fn sensor_path(&self) -> &[(i64, Pose)] {
        &self.sensor_path
    }

    /// What stands in the room, as far as seen.
    pub fn scene(&self) -> Scene {
        self.engine.scene()
    }

    /// What was taken, left out and done so far.
    pub fn counters(&self) -> Counters {
        Counters { streams: *self.observer.counters(), engine: self.engine.counters(), time_offset: self.time_offset }
    }
}

//! The mapper: frames, poses and hands in, scene out.
//!
//! The observer gives each sweep the sensor's pose at its own time; the search maps the sweeps; the
//! calibration control corrects the time between the streams and the sensor's mount. There is no clock, no I/O and no
//! randomness: the same events and settings give the same scene, byte for byte.
//!
//! What goes in and comes out is in the tracking frame of its time. Inside, the map is in the map frame, which does not follow
//! jumps of the tracking frame; so the room stays where it is to the head, whatever the tracking does.

use a121::SensorConfig;
use glam::DVec3;
use radar_sar::geometry::Pose;
use radar_sar::{Observation, TimeOffset};
use serde::{Deserialize, Serialize};

use super::calibration_control::{CalibrationChange, CalibrationControl, MountCounters, TimeOffsetCounters};
use super::search::Search;
use super::{
    Accepted, CalibrationInUse, Event, Evidence, HandsSample, MapperKind, MappingSettings, MountInUse, Observer,
    ObserverCounters, ObserverSettings, Refusal, RoomMapperCounters, SavedMap, SavedMapError, Scene, ScoredCandidate,
};

/// First interval of the recorded sensor path, nanoseconds. Choice: a head at 1 m/s moves 2 cm.
const PATH_STEP_NS: i64 = 20_000_000;
/// Poses of the recorded path; when there are as many, every second is dropped and the interval doubled. Choice: 20 minutes at the
/// first interval, 4 MB.
const MAX_PATH: usize = 60_000;

/// All counters of the mapper.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MapperCounters {
    /// Counters of joining the streams.
    pub streams: ObserverCounters,
    /// Counters of the search.
    pub engine: SearchCounters,
    /// Counters of the time offset.
    pub time_offset: TimeOffsetCounters,
    /// Counters of the mount.
    #[serde(default)]
    pub mount: MountCounters,
}

/// Counters of the search.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SearchCounters {
    /// How it maps.
    pub search: MapperKind,
    /// Observations taken.
    pub observations: u64,
    /// Observations dropped to bound memory (single reflectors only).
    pub observations_thinned: u64,
    /// Observations that got a new pose from a new time offset or mount.
    pub observations_reposed: u64,
    /// Observations for which that gives no pose.
    pub observations_lost: u64,
    /// How often the room mapper imaged the sweeps of its window again, because their poses had been wrong.
    pub searches_begun_again: u64,
    /// Counters of the room mapper.
    pub rooms: RoomMapperCounters,
}

impl SearchCounters {
    /// Why nothing of a room can be found, and what to do, where no sub-aperture had enough sweeps.
    pub fn no_subaperture(&self) -> Option<&'static str> {
        let has_none =
            self.search == MapperKind::Rooms && self.rooms.blocks == 0 && self.rooms.sweeps_without_block > 0;
        has_none.then_some(
            "no sub-aperture had rooms.subapertures.min_sweeps sweeps: lower it, or set processing.mode = \"auto\"",
        )
    }
}

/// Maps the surroundings of one sensor from its frames and the poses of the head.
///
/// Push events in order of time, then poll the scene. A wrong input is refused with its reason and
/// counted; nothing of it reaches the map.
#[derive(Debug)]
pub struct Mapper {
    settings: MappingSettings,
    observer: Observer,
    search: Search,
    calibration: CalibrationControl,
    /// Time and `tracking_from_sensor`, every 20 ms.
    sensor_path: Vec<(i64, Pose)>,
    path_step_ns: i64,
    /// Time of the newest observation, and the end of its sweep.
    newest_ns: Option<(i64, i64)>,
    counts: Counts,
    /// Map updates and jumps of the tracking frame at the last poll.
    polled: (u64, u64),
    is_deferred: bool,
    is_estimate_due: bool,
}

/// What happened to observations.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    observations: u64,
    reposed: u64,
    lost: u64,
    restarts: u64,
}

impl Mapper {
    /// For a valid configuration. `head_from_sensor`: the mount; one in the settings has precedence.
    pub fn new(config: &SensorConfig, head_from_sensor: &Pose, settings: &MappingSettings) -> Self {
        let observer_settings = ObserverSettings::new(settings, head_from_sensor);
        let (mut observer, search) = (Observer::new(config, observer_settings), Search::new(config, settings));
        let assumed_mount = &observer_settings.head_from_sensor;
        let calibration = CalibrationControl::new(&settings.tracking, &settings.radar.beam, assumed_mount);
        if calibration.is_active() {
            observer.keep_poses_s(search.pose_retention_s(settings));
        }
        Self {
            settings: settings.clone(),
            observer,
            search,
            calibration,
            sensor_path: Vec::new(),
            path_step_ns: PATH_STEP_NS,
            newest_ns: None,
            counts: Counts::default(),
            polled: (0, 0),
            is_deferred: false,
            is_estimate_due: false,
        }
    }

    /// From now on [`push`](Self::push) only stores sweeps, so that the stream is never delayed for
    /// long, and [`work`](Self::work) processes them. The scene is the same, except that
    /// time-offset estimates may come later.
    pub fn defer(&mut self) {
        self.is_deferred = true;
    }

    /// Does a part of the deferred work; false when nothing is left.
    pub fn work(&mut self) -> bool {
        if self.search.work() {
            return true;
        }
        let is_due = std::mem::take(&mut self.is_estimate_due);
        if is_due {
            self.update_calibration();
            self.calibration.schedule(self.observer.newest_pose_ns().unwrap_or(i64::MIN));
        }
        is_due
    }

    /// Whether [`work`](Self::work) has something to do.
    pub fn has_work(&self) -> bool {
        self.search.has_work() || self.is_estimate_due
    }

    /// Takes an event. Events should come in order of time: see [`in_time_order`](super::in_time_order).
    ///
    /// # Errors
    /// Why the event was left out. Later events are not affected.
    pub fn push(&mut self, event: Event) -> Result<Accepted, Refusal> {
        match event {
            Event::Frame(frame) => self.observer.push_frame(frame).map(|()| Accepted::default()),
            Event::Hands(hands) => {
                let map_from_tracking = self.observer.map_from_tracking();
                let hands_m = hands.hands_m.map(|hand| hand.map(|at_m| map_from_tracking.transform_point(at_m)));
                self.search.push_hands(&HandsSample { hands_m, ..hands });
                Ok(Accepted::default())
            }
            Event::Pose(pose) => {
                let jumps = self.tracking_jumps();
                let pushed = self.observer.push_pose(&pose);
                if let Some(jump) = self.observer.last_jump().filter(|_| self.tracking_jumps() > jumps) {
                    self.search.follow(&jump);
                }
                let observations = self.process_ready(false);
                self.schedule_calibration();
                pushed.map(|()| Accepted { observations })
            }
        }
    }

    /// Takes all events and ends the input. Refused events are counted.
    pub fn push_all(&mut self, events: impl IntoIterator<Item = Event>) {
        for event in events {
            let _ = self.push(event);
        }
        self.finish();
    }

    /// Processes frames that arrived after the poses they needed. Not necessary when events are
    /// pushed in time order.
    pub fn process_late(&mut self) {
        self.process_ready(false);
    }

    /// Ends the input: what waits is processed.
    pub fn finish(&mut self) {
        self.process_ready(true);
        self.update_calibration();
        self.search.finish();
    }

    /// Processes the observations whose poses are complete, all of them with `rest`; returns how
    /// many.
    fn process_ready(&mut self, rest: bool) -> usize {
        let path = self.observer.take_path();
        let observations = if rest { self.observer.take_rest() } else { self.observer.take_ready() };
        self.calibration.push(&path, &observations);
        let count = observations.len();
        for observation in observations {
            self.map(observation);
        }
        count
    }

    /// Records the sensor's path in bounded memory.
    fn extend_path(&mut self, time_ns: i64, tracking_from_sensor: &Pose) {
        if self.sensor_path.last().is_some_and(|last| time_ns.saturating_sub(last.0) < self.path_step_ns) {
            return;
        }
        if self.sensor_path.len() >= MAX_PATH {
            let mut index = 0;
            self.sensor_path.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.path_step_ns = self.path_step_ns.saturating_mul(2);
        }
        self.sensor_path.push((time_ns, *tracking_from_sensor));
    }

    fn map(&mut self, observation: Observation) {
        let time_ns = observation.mid_time_ns;
        self.extend_path(time_ns, &observation.tracking_from_sensor);
        // Sweeps may get their poses before these have their final smoothing.
        if self.settings.tracking.history.is_early() {
            let observer = &self.observer;
            let sensor_at = |sweep_ns: i64| -> Option<(Pose, DVec3)> {
                let sensor = observer.smoothed_sensor_at(sweep_ns, time_ns).ok()?;
                Some((sensor.tracking_from_sensor, sensor.velocity_m_per_s))
            };
            self.search.update_poses_before(&observation, sensor_at);
        }
        self.counts.observations += 1;
        self.newest_ns = Some((time_ns, observation.end_ns()));
        self.search.push(observation);
        while !self.is_deferred && self.search.work() {}
    }

    fn schedule_calibration(&mut self) {
        let Some(now_ns) = self.observer.newest_pose_ns() else { return };
        if !self.calibration.is_due(now_ns) {
            return;
        }
        // The first time there are no data yet.
        let has_data = self.calibration.is_scheduled();
        self.is_estimate_due |= self.is_deferred && has_data;
        if has_data && !self.is_deferred {
            self.update_calibration();
        }
        self.calibration.schedule(now_ns);
    }

    fn update_calibration(&mut self) {
        let now_ns = self.observer.newest_pose_ns().unwrap_or(i64::MIN);
        let change = self.calibration.update(now_ns);
        if let Some(drift_m) = self.calibration.drift_m() {
            self.search.set_errors(self.settings.tracking.errors.with_slow_error_m(drift_m));
        }
        if let Some(change) = change {
            self.apply(&change);
        }
    }

    /// Forgets what was estimated of time offset and mount: those of the settings are in use again, until estimates differ.
    /// The map stays.
    pub fn forget_calibration(&mut self) {
        let (offset_s, mount) = (self.calibration.in_use_s(), self.calibration.mount());
        self.is_estimate_due = false;
        let Self { settings, .. } = self;
        self.calibration = CalibrationControl::new(&settings.tracking, &settings.radar.beam, &mount.assumed);
        self.search.set_errors(settings.tracking.errors);
        let change = CalibrationChange {
            time_offset_s: self.calibration.in_use_s() - offset_s,
            mount_m: mount.is_corrected().then(|| mount.correction_m()),
        };
        self.apply(&change);
    }

    /// Takes the calibration in use for what comes, and for what is kept.
    fn apply(&mut self, change: &CalibrationChange) {
        self.observer.set_time_offset_s(self.calibration.in_use_s());
        self.observer.set_mount(self.calibration.mount().in_use);
        self.repose(change);
    }

    /// Gives the search's observations the poses of the changed calibration.
    fn repose(&mut self, change: &CalibrationChange) {
        let offset_ns = (self.calibration.in_use_s() * 1e9).round() as i64;
        let (observer, counts) = (&self.observer, &mut self.counts);
        let repose = |observation: &mut Observation| {
            let sensor = observer.sensor_at(observation.mid_time_ns.saturating_add(offset_ns)).ok();
            if let Some(sensor) = sensor {
                observation.tracking_from_sensor = sensor.tracking_from_sensor;
                observation.velocity_m_per_s = sensor.velocity_m_per_s;
            }
            counts.reposed += u64::from(sensor.is_some());
            counts.lost += u64::from(sensor.is_none());
            sensor.is_some()
        };
        if self.search.repose(change, repose) {
            self.counts.restarts += 1;
            while !self.is_deferred && self.search.work() {}
        }
    }

    /// The scene after a new map update or a jump of the tracking frame, once for each; `None` when there was none since the
    /// last call. Single reflectors have no updates: they are searched by [`scene`](Self::scene).
    pub fn poll_scene(&mut self) -> Option<Scene> {
        let state = (self.search.updates(), self.tracking_jumps());
        let is_new = state != self.polled;
        self.polled = state;
        // Before the first update there is nothing that a jump could move.
        (is_new && state.0 > 0).then(|| self.scene())
    }

    /// How often the tracking frame has jumped. From a jump on the scene has other coordinates.
    pub fn tracking_jumps(&self) -> u64 {
        self.observer.counters().tracking_jumps
    }

    /// The obstacles, walls and moving targets found so far, in the tracking frame of the newest pose. For single reflectors
    /// this does the search.
    pub fn scene(&self) -> Scene {
        let scene = self.search.scene(self.newest_ns.map_or(0, |(time_ns, _)| time_ns));
        match self.tracking_from_map() {
            Some(tracking_from_map) => scene.moved(&tracking_from_map),
            None => scene,
        }
    }

    /// Transforms from the map frame to the tracking frame of the newest pose; `None` when they are the same.
    fn tracking_from_map(&self) -> Option<Pose> {
        let map_from_tracking = self.observer.map_from_tracking();
        (map_from_tracking != Pose::IDENTITY).then(|| map_from_tracking.inverse())
    }

    /// How it maps.
    pub fn kind(&self) -> MapperKind {
        self.search.kind()
    }

    /// End of the newest sweep taken, host nanoseconds.
    pub fn newest_sweep_ns(&self) -> Option<i64> {
        self.newest_ns.map(|(_, end_ns)| end_ns)
    }

    /// End of the newest sweep contained in [`scene`](Self::scene), host nanoseconds: of the last
    /// map update, or of the newest sweep for single reflectors.
    pub fn evidence_ns(&self) -> Option<i64> {
        self.search.evidence_ns(self.newest_sweep_ns())
    }

    /// The `most` strongest voxels with evidence: sub-aperture scores from 2 on, which noise
    /// reaches; for single reflectors the excess over noise.
    pub fn evidence(&self, most: usize) -> Evidence {
        let evidence = self.search.evidence(most);
        match self.tracking_from_map() {
            Some(tracking_from_map) => evidence.moved(&tracking_from_map),
            None => evidence,
        }
    }

    /// Candidates scored in the last map update, for training the classifier.
    pub fn scored_candidates(&self) -> Vec<ScoredCandidate> {
        let to_from = self.observer.map_from_tracking().inverse();
        let moved = |candidate: &ScoredCandidate| {
            let position_m = to_from.transform_point(candidate.position_m);
            ScoredCandidate { position_m, ..candidate.clone() }
        };
        self.search.scored_candidates().iter().map(moved).collect()
    }

    /// The map for saving; empty for single reflectors.
    pub fn saved_map(&self) -> SavedMap {
        let saved = self.search.saved_map();
        match self.tracking_from_map() {
            Some(tracking_from_map) => saved.moved(&tracking_from_map),
            None => saved,
        }
    }

    /// Restores a saved map, in the tracking frame, as provisional; ignored for single reflectors.
    ///
    /// # Errors
    /// Numbers that are not valid for a room; nothing is restored then.
    pub fn restore(&mut self, saved: &SavedMap) -> Result<(), SavedMapError> {
        match self.tracking_from_map() {
            Some(tracking_from_map) => self.search.restore(&saved.moved(&tracking_from_map.inverse())),
            None => self.search.restore(saved),
        }
    }

    /// The time offset in use: time of a sweep's pose minus time of the sweep, seconds.
    pub fn time_offset_s(&self) -> f64 {
        self.calibration.in_use_s()
    }

    /// The last estimate of the time offset, applied or not; `None` when there was none.
    pub fn time_offset_estimate(&self) -> Option<TimeOffset> {
        self.calibration.estimate()
    }

    /// Everything that sweeps and poses are corrected by.
    pub fn calibration(&self) -> CalibrationInUse {
        CalibrationInUse {
            time_offset_s: self.time_offset_s(),
            time_offset_estimate: self.time_offset_estimate(),
            mount: self.mount(),
            drift_m: self.calibration.drift_m(),
            range_bias_m: self.observer.range_bias_m(),
        }
    }

    /// The mount in use, and its last estimate.
    pub fn mount(&self) -> MountInUse {
        self.calibration.mount()
    }

    /// Begins from the mount that an earlier session had in use. Ignored when another one is assumed now, or when
    /// estimates are not applied.
    pub fn resume_mount(&mut self, earlier: &MountInUse) {
        self.calibration.resume_mount(earlier);
        self.observer.set_mount(self.calibration.mount().in_use);
    }

    /// The newest valid head pose and its time.
    pub fn head(&self) -> Option<(i64, Pose)> {
        self.observer.head()
    }

    /// The sensor path, every 20 ms: time and `tracking_from_sensor`, in the frame of the scene.
    pub fn sensor_path(&self) -> impl Iterator<Item = (i64, Pose)> {
        let to_from = self.tracking_from_map().unwrap_or(Pose::IDENTITY);
        self.sensor_path.iter().map(move |(time_ns, sensor)| (*time_ns, to_from * *sensor))
    }

    /// Clears the recorded sensor path, for long runs that do not draw it.
    pub fn clear_sensor_path(&mut self) {
        self.sensor_path.clear();
    }

    /// All counters so far.
    pub fn counters(&self) -> MapperCounters {
        let engine = SearchCounters {
            search: self.search.kind(),
            observations: self.counts.observations,
            observations_thinned: self.search.thinned(),
            observations_reposed: self.counts.reposed,
            observations_lost: self.counts.lost,
            searches_begun_again: self.counts.restarts,
            rooms: self.search.room_counters(),
        };
        let Self { observer, calibration, .. } = self;
        let (time_offset, mount) = (calibration.counters(), calibration.mount_counters());
        MapperCounters { streams: *observer.counters(), engine, time_offset, mount }
    }
}

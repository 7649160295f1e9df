//! The reconstruction's thread: takes poses and frames, processes them, publishes the map.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use super::{Input, PublishedMap, Shared, lock};
use crate::app::handover::OfEpoch;
use crate::app::latency_tracker::LatencyTracker;
use crate::app::queue::Queue;
use crate::app::{Latency, Received, correction_text, now_ns, thread_cpu_ns};
use crate::settings::Settings;
use a121::SensorConfig;
use radar_mapping::{CalibrationInUse, Event, Mapper, MapperKind, MountInUse, Scene};
use radar_sar::geometry::Pose;

/// Longest wait for input: bounds the reaction time to stop and reset. Choice: shorter than one
/// perceives, twenty wake-ups a second without input.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Interval of the shared counters, nanoseconds. Choice: as often as the panel is drawn.
const COUNTERS_INTERVAL_NS: i64 = 100_000_000;
/// Interval of the shared map for saving, nanoseconds. Choice: a fraction of the 30 s between
/// saves, and a copy a second costs little.
const SAVED_MAP_INTERVAL_NS: i64 = 1_000_000_000;
/// A search for single reflectors covers everything kept: at most once a second, and at most a
/// fifth of the time. Choice: a search takes up to seconds, and sweeps must not wait in the queue
/// meanwhile.
const MIN_REFLECTORS_INTERVAL_NS: i64 = 1_000_000_000;
const REFLECTORS_IDLE_RATIO: i64 = 4;

/// What a new mapper is built from.
pub(super) struct MapperSpec {
    pub config: SensorConfig,
    pub head_from_sensor: Pose,
    pub settings: Settings,
    /// What an earlier mapper or session had in use.
    pub known_mount: Option<MountInUse>,
}

impl MapperSpec {
    /// A new mapper that defers its work until no input waits.
    pub fn mapper(&self) -> Mapper {
        let mut mapper = Mapper::new(&self.config, &self.head_from_sensor, &self.settings.mapping());
        if let Some(known) = &self.known_mount {
            mapper.resume_mount(known);
        }
        mapper.defer();
        mapper
    }
}

/// State of the thread.
pub(super) struct Worker {
    mapper: Mapper,
    spec: MapperSpec,
    shared: Arc<Shared>,
    queue: Arc<Queue<Input, 3>>,
    epoch: u64,
    published: PublishedMap,
    /// End of the newest sweep in the published scene, host nanoseconds.
    evidence_ns: Option<i64>,
    /// Jumps of the tracking frame before the published scene.
    tracking_jumps: u64,
    next_reflectors_ns: i64,
    latencies: LatencyTracker,
    step: Latency,
    outdated: u64,
    scenes: u64,
    start_ns: i64,
    counters_ns: i64,
    saved_map_ns: i64,
}

impl Worker {
    pub fn new(mapper: Mapper, spec: MapperSpec, shared: Arc<Shared>, queue: Arc<Queue<Input, 3>>) -> Self {
        let now_ns = now_ns();
        Self {
            mapper,
            spec,
            shared,
            queue,
            epoch: 0,
            published: PublishedMap::nothing(0),
            evidence_ns: None,
            tracking_jumps: 0,
            next_reflectors_ns: now_ns,
            latencies: LatencyTracker::default(),
            step: Latency::default(),
            outdated: 0,
            scenes: 0,
            start_ns: now_ns,
            counters_ns: now_ns,
            saved_map_ns: now_ns,
        }
    }

    /// Runs until asked to stop or the queue is closed. Call it inside the pool.
    pub fn run(mut self) {
        while !self.shared.stop.load(Ordering::SeqCst) && !self.is_late() {
            // Input has precedence over deferred work: a map update delays no sweep.
            let received = self.queue.receive(if self.mapper.has_work() { Duration::ZERO } else { POLL_INTERVAL });
            self.apply_epoch();
            self.restore_map();
            self.forget_calibration();
            match received {
                Received::Event(input) => self.take(input),
                Received::TimedOut => self.work(),
                Received::Closed => break,
            }
            self.publish_counters(COUNTERS_INTERVAL_NS);
            self.publish_saved_map(SAVED_MAP_INTERVAL_NS);
        }
        if !self.shared.stop.load(Ordering::SeqCst) {
            self.apply_epoch();
            self.mapper.finish();
            self.publish(true);
        }
        self.publish_counters(0);
        self.publish_saved_map(0);
    }

    fn is_late(&self) -> bool {
        now_ns() as u64 >= self.shared.finish_by_ns.load(Ordering::SeqCst)
    }

    /// Starts a new mapper after a reset.
    fn apply_epoch(&mut self) {
        let epoch = self.shared.map.epoch();
        if epoch == self.epoch {
            return;
        }
        self.epoch = epoch;
        if let Some(settings) = lock(&self.shared.next_settings).take() {
            self.spec.settings = settings;
        }
        // The sensor stays where it is on the head, wherever the room is.
        self.spec.known_mount = Some(self.mapper.mount());
        self.mapper = self.spec.mapper();
        self.latencies.reset();
        (self.evidence_ns, self.tracking_jumps) = (None, 0);
        self.publish_map(PublishedMap { number: self.published.number, ..PublishedMap::nothing(epoch) });
    }

    /// Forgets the calibration if that was requested.
    fn forget_calibration(&mut self) {
        if self.shared.forget_calibration.swap(false, Ordering::SeqCst) {
            log::info!("the calibration is forgotten: the sensor is where it is set, until it is found elsewhere");
            self.mapper.forget_calibration();
            self.publish(false);
        }
    }

    /// Restores a pending saved map; it is part of the scene at once.
    fn restore_map(&mut self) {
        let shared = Arc::clone(&self.shared);
        // The lock is held until the shared map contains it, so that nobody saves the map without
        // it.
        let mut waiting = lock(&shared.pending_map);
        let Some((_, saved_map)) = waiting.take_if(|(epoch, _)| *epoch <= self.epoch).filter(|(e, _)| *e == self.epoch)
        else {
            return;
        };
        if let Err(error) = self.mapper.restore(&saved_map) {
            log::warn!("the saved map of the room is ignored: {error}");
        }
        self.publish_saved_map(0);
        if self.mapper.kind() == MapperKind::Rooms {
            let scene = Arc::new(self.mapper.scene());
            self.scenes += 1;
            self.publish_map(PublishedMap { scene, ..self.published.clone() });
        }
    }

    /// Publishes the map for saving when the published one is older than this.
    fn publish_saved_map(&mut self, age_ns: i64) {
        let now_ns = now_ns();
        if now_ns.saturating_sub(self.saved_map_ns) < age_ns {
            return;
        }
        self.saved_map_ns = now_ns;
        let saved_map = Some((self.epoch, Arc::new(self.mapper.saved_map())));
        let before = std::mem::replace(&mut *lock(&self.shared.saved_map), saved_map);
        // Dropped after the lock is released.
        drop(before);
    }

    fn take(&mut self, input: Input) {
        let (begin_ns, without_pose) = (now_ns(), self.without_pose());
        if input.epoch != self.epoch {
            return self.outdated += 1;
        }
        self.push(input);
        self.latencies.drop_oldest(self.without_pose() - without_pose);
        self.publish(false);
        self.step.push(now_ns().saturating_sub(begin_ns));
    }

    /// Does a part of the deferred work.
    fn work(&mut self) {
        let begin_ns = now_ns();
        if self.mapper.work() {
            self.publish(false);
            self.step.push(now_ns().saturating_sub(begin_ns));
        }
    }

    fn push(&mut self, input: Input) {
        let frame_end_ns = if let Event::Frame(frame) = &input.event { Some(frame.host_time_ns) } else { None };
        match (self.mapper.push(input.event), frame_end_ns) {
            (Ok(_), Some(end_ns)) => self.latencies.frame_accepted(end_ns, input.arrived_ns),
            (Ok(_), None) => {}
            (Err(refusal), _) => log::debug!("left out: {refusal}"),
        }
        if frame_end_ns.is_some() {
            self.mapper.process_late();
        }
    }

    /// Frames for which no pose was found.
    fn without_pose(&self) -> u64 {
        self.mapper.counters().streams.frames_without_pose
    }

    /// Publishes what has changed.
    fn publish(&mut self, is_last: bool) {
        let newest_sweep_ns = self.mapper.newest_sweep_ns().unwrap_or(0);
        let scene = self.new_scene(is_last);
        if newest_sweep_ns == self.published.newest_sweep_ns && scene.is_none() {
            return;
        }
        self.mapper.clear_sensor_path();
        self.scenes += u64::from(scene.is_some());
        self.publish_map(PublishedMap {
            number: self.published.number,
            tracking_jumps: if scene.is_some() { self.tracking_jumps } else { self.published.tracking_jumps },
            scene: scene.map_or_else(|| Arc::clone(&self.published.scene), Arc::new),
            newest_sweep_ns,
            calibration: Some(self.new_calibration()),
            epoch: self.epoch,
        });
        let now_ns = now_ns();
        self.latencies.processed_until(newest_sweep_ns, now_ns);
        if let Some(evidence_ns) = self.evidence_ns {
            self.latencies.published_until(evidence_ns, now_ns);
        }
    }

    /// The calibration; logs the mount when it has changed.
    fn new_calibration(&self) -> CalibrationInUse {
        let calibration = self.mapper.calibration();
        let mount = &calibration.mount;
        if self.published.calibration.as_ref().is_some_and(|before| before.mount.in_use != mount.in_use) {
            let [x, y, z] = mount.in_use.translation.to_array();
            let correction = correction_text(mount);
            log::info!("the sensor is at ({x:.3}, {y:.3}, {z:.3}) m on the head, {correction} from where it is set");
        }
        calibration
    }

    fn publish_map(&mut self, published: PublishedMap) {
        self.published = PublishedMap { number: published.number + 1, ..published };
        self.shared.map.publish(self.published.clone());
    }

    /// The scene, when it may have changed.
    fn new_scene(&mut self, is_last: bool) -> Option<Scene> {
        let evidence_ns = self.mapper.evidence_ns();
        let begin_ns = now_ns();
        let is_due = self.mapper.kind() == MapperKind::Rooms || begin_ns >= self.next_reflectors_ns;
        let tracking_jumps = self.mapper.tracking_jumps();
        let is_new = evidence_ns != self.evidence_ns || tracking_jumps != self.tracking_jumps;
        if !(is_last || is_new && is_due) {
            return None;
        }
        let scene = self.mapper.scene();
        let end_ns = now_ns();
        self.next_reflectors_ns = end_ns + MIN_REFLECTORS_INTERVAL_NS.max(REFLECTORS_IDLE_RATIO * (end_ns - begin_ns));
        (self.evidence_ns, self.tracking_jumps) = (evidence_ns, tracking_jumps);
        self.publish_evidence();
        Some(scene)
    }

    /// Publishes the evidence behind a scene, if requested.
    fn publish_evidence(&self) {
        let most = self.shared.evidence_wanted.load(Ordering::Relaxed);
        if most > 0 {
            let evidence = Arc::new(self.mapper.evidence(most));
            let before = lock(&self.shared.evidence).replace(evidence);
            // Dropped after the lock is released.
            drop(before);
        }
    }

    /// Updates the shared counters when they are older than this.
    fn publish_counters(&mut self, age_ns: i64) {
        let now_ns = now_ns();
        if now_ns.saturating_sub(self.counters_ns) < age_ns {
            return;
        }
        self.counters_ns = now_ns;
        let cpu_s = rayon::broadcast(|_| thread_cpu_ns()).into_iter().sum::<i64>() as f64 * 1e-9;
        let mut counters = lock(&self.shared.counters);
        counters.mapper = self.mapper.counters();
        counters.epoch = self.epoch;
        counters.outdated = self.outdated;
        counters.published = self.published.number;
        counters.scenes = self.scenes;
        counters.processed = self.latencies.processed();
        counters.evidence_age = self.latencies.evidence_age();
        counters.step = self.step.report();
        counters.cpu_s = cpu_s;
        counters.running_s = now_ns.saturating_sub(self.start_ns) as f64 * 1e-9;
    }
}

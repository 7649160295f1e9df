//! The reconstruction: a mapper in its own thread and thread pool, at lower priority than the
//! frame loop.
//!
//! Inputs: poses, hands and frames, from any thread, each stream in its own order. Output: the
//! newest scene on request. Pushing and reading never wait for work, not even for a lock held by a
//! thread of lower priority: a push that finds the queue locked goes in with the next one, and a
//! read that finds the newest scene locked returns the previous one. The queue is bounded; the
//! oldest messages are dropped and counted.

mod worker;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{Builder, JoinHandle};

use super::handover::{NewestOfEpoch, OfEpoch};
use super::queue::{MapperInput, Queue};
use super::{LatencyReport, lower_priority_of_this_thread, now_ns};
use crate::settings::Settings;
use a121::SensorConfig;
use radar_mapping::MapperCounters;
use radar_mapping::{CalibrationInUse, Event, Evidence, MountInUse, SavedMap, Scene};
use radar_sar::geometry::Pose;
use worker::{MapperSpec, Worker};

/// Channels of the queue.
const FRAMES: usize = 0;
const POSES: usize = 1;
const HANDS: usize = 2;
/// Bound of the channel of hand samples: about two seconds. Choice: at 100 samples a second longer
/// than the frames wait, so a sweep has its hands.
const MAX_HANDS: usize = 256;

/// Options of the reconstruction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReconstructionOptions {
    /// Threads of its pool; `None`: all processors but one, at least one.
    pub threads: Option<usize>,
    /// Steps of `nice` by which its threads are lowered below the starting thread.
    pub nice: u8,
    /// Bound of waiting frames; beyond, the oldest are dropped and counted.
    pub max_frames: usize,
    /// Bound of waiting poses; as for frames.
    pub max_poses: usize,
    /// Upper limit of how long after a sweep its poses may arrive, seconds; see
    /// [`HistorySettings::max_ahead_s`](radar_sar::HistorySettings::max_ahead_s).
    pub max_ahead_s: f64,
}

impl Default for ReconstructionOptions {
    /// Bounds of about four seconds of the default preset and of poses. Sweeps wait for the next
    /// pose only.
    fn default() -> Self {
        Self { threads: None, nice: 5, max_frames: 256, max_poses: 1024, max_ahead_s: 0.0 }
    }
}

/// Why the reconstruction cannot start.
#[derive(Debug, thiserror::Error)]
pub enum ReconstructionError {
    /// The thread pool cannot be created.
    #[error("cannot start the {threads} threads of the reconstruction: {source}")]
    Pool {
        /// Number of threads requested.
        threads: usize,
        /// Error of the system.
        source: rayon::ThreadPoolBuildError,
    },
    /// The thread cannot be created.
    #[error("cannot start the reconstruction's thread: {0}")]
    Thread(std::io::Error),
}

/// What the reconstruction publishes to the frame loop.
#[derive(Debug, Clone)]
pub struct PublishedMap {
    /// Increases with every publication.
    pub number: u64,
    /// The map's scene. The same `Arc` until it changes.
    pub scene: Arc<Scene>,
    /// How often the tracking frame had jumped: scenes of different numbers have different frames.
    pub tracking_jumps: u64,
    /// End of the newest processed sweep, host nanoseconds; 0 before the first.
    pub newest_sweep_ns: i64,
    /// What sweeps and poses are corrected by; `None` before the first frame.
    pub calibration: Option<CalibrationInUse>,
    /// Number of resets before it.
    pub epoch: u64,
}

impl OfEpoch for PublishedMap {
    /// An empty map.
    fn nothing(epoch: u64) -> Self {
        Self {
            number: 0,
            scene: Arc::new(Scene::default()),
            tracking_jumps: 0,
            newest_sweep_ns: 0,
            calibration: None,
            epoch,
        }
    }

    fn epoch(&self) -> u64 {
        self.epoch
    }
}

/// Counters of the reconstruction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReconstructionCounters {
    /// The mapper's counters since the last reset.
    pub mapper: MapperCounters,
    /// Number of resets.
    pub epoch: u64,
    /// Frames dropped because the queue was full.
    pub frames_dropped: u64,
    /// Poses dropped because the queue was full.
    pub poses_dropped: u64,
    /// Frames and poses discarded because they were from before a reset.
    pub outdated: u64,
    /// Number of publications.
    pub published: u64,
    /// Scenes among them.
    pub scenes: u64,
    /// From a frame's arrival until its sweeps have their poses, are part of the map's evidence and
    /// that is published. Includes the wait for the next pose and for earlier work.
    pub processed: LatencyReport,
    /// From a frame's end to the first published scene that contains it. Evidence is added in
    /// sub-apertures and the map is updated four times a second, so the length of a sub-aperture
    /// and the update interval come on top of the above.
    pub evidence_age: LatencyReport,
    /// Duration of a work step (a frame, a pose or a part of what they trigger), during which the
    /// next input waits.
    pub step: LatencyReport,
    /// Processor time of all its threads, seconds.
    pub cpu_s: f64,
    /// Running time, seconds.
    pub running_s: f64,
}

/// A message to the thread, with the epoch in which it was pushed.
struct Input {
    epoch: u64,
    event: Event,
    /// Host nanoseconds.
    arrived_ns: i64,
}

/// State shared by both sides.
struct Shared {
    map: NewestOfEpoch<PublishedMap>,
    counters: Mutex<ReconstructionCounters>,
    /// A saved map to restore, and its epoch.
    pending_map: Mutex<Option<(u64, SavedMap)>>,
    /// The current map for saving, and its epoch.
    saved_map: Mutex<Option<(u64, Arc<SavedMap>)>>,
    /// Number of evidence voxels requested, and those of the newest scene.
    evidence_wanted: AtomicUsize,
    evidence: Mutex<Option<Arc<Evidence>>>,
    /// Settings for the next mapper, where they have changed.
    next_settings: Mutex<Option<Settings>>,
    forget_calibration: AtomicBool,
    is_alive: AtomicBool,
    /// Discard everything and stop.
    stop: AtomicBool,
    /// Process what waits until this host time at the latest, then stop.
    finish_by_ns: AtomicU64,
}

/// The reconstruction. Dropping it discards waiting input and ends its threads.
pub struct Reconstruction {
    shared: Arc<Shared>,
    queue: Arc<Queue<Input, 3>>,
    frames: MapperInput<Input, 3>,
    poses: MapperInput<Input, 3>,
    hands: MapperInput<Input, 3>,
    max_ahead_s: f64,
    thread: Option<JoinHandle<()>>,
}

/// Longest time that [`Reconstruction::finish`] processes waiting input, nanoseconds. Choice: the
/// map keeps its last sweeps, and the program still ends well within SteamVR's 5 s.
const MAX_FINISH_NS: u64 = 500_000_000;

impl Reconstruction {
    /// Starts it for a valid configuration. A mount in the settings has precedence over the one
    /// given. `known_mount`: what an earlier session had in use.
    ///
    /// # Errors
    /// The system provides no threads.
    pub fn start(
        config: &SensorConfig,
        head_from_sensor: &Pose,
        known_mount: Option<MountInUse>,
        settings: &Settings,
        options: &ReconstructionOptions,
    ) -> Result<Self, ReconstructionError> {
        let settings = with_max_ahead(settings, options.max_ahead_s);
        let begin = MapperSpec { config: config.clone(), head_from_sensor: *head_from_sensor, settings, known_mount };
        let mapper = begin.mapper();
        let shared = Arc::new(Shared::new(mapper.counters()));
        let queue = Arc::new(Queue::new([options.max_frames, options.max_poses, MAX_HANDS]));
        let pool = pool(options)?;
        let worker = Worker::new(mapper, begin, Arc::clone(&shared), Arc::clone(&queue));
        let (for_guard, nice) = (Arc::clone(&shared), options.nice);
        let run = move || {
            lower_priority_of_this_thread(nice);
            run_guarded(&for_guard, || pool.install(|| worker.run()));
        };
        let thread = Builder::new().name("reconstruction".into()).spawn(run).map_err(ReconstructionError::Thread)?;
        Ok(Self {
            max_ahead_s: options.max_ahead_s,
            frames: MapperInput::new(&queue, FRAMES),
            poses: MapperInput::new(&queue, POSES),
            hands: MapperInput::new(&queue, HANDS),
            shared,
            queue,
            thread: Some(thread),
        })
    }

    /// Takes an event of any stream, hands and poses in the same frame; never waits: what finds the queue
    /// locked is handed over with the stream's next event. When a stream's channel is full, its oldest
    /// messages are dropped and counted.
    pub fn push(&self, event: Event) {
        let channel = match &event {
            Event::Frame(_) => &self.frames,
            Event::Pose(_) => &self.poses,
            Event::Hands(_) => &self.hands,
        };
        channel.push(Input { epoch: self.epoch(), event, arrived_ns: now_ns() });
    }

    /// The newest map; never waits for work.
    pub fn latest(&self) -> Arc<PublishedMap> {
        self.shared.map.latest()
    }

    /// Resets the map at once, because the next poses are in another frame of reference. Frames and
    /// poses pushed before are discarded. Returns the new epoch.
    pub fn reset(&self) -> u64 {
        self.shared.map.reset()
    }

    /// Resets the map and starts again with other settings. Returns the new epoch.
    pub fn restart_with(&self, settings: &Settings) -> u64 {
        *lock(&self.shared.next_settings) = Some(with_max_ahead(settings, self.max_ahead_s));
        self.reset()
    }

    /// Forgets the estimated time offset and mount: those of the settings are in use again. The map stays.
    pub fn forget_calibration(&self) {
        self.shared.forget_calibration.store(true, Ordering::SeqCst);
    }

    /// Restores a saved map, in the frame of the poses of that epoch.
    pub fn restore(&self, epoch: u64, saved: SavedMap) {
        *lock(&self.shared.pending_map) = Some((epoch, saved));
    }

    /// The current map for saving and its epoch, at most a second old; `None` before there is one
    /// and while a restore is pending. May wait for a moment: not for the frame loop.
    pub fn saved_map(&self) -> Option<(u64, Arc<SavedMap>)> {
        let waiting = lock(&self.shared.pending_map);
        if waiting.is_some() {
            return None;
        }
        lock(&self.shared.saved_map).clone()
    }

    /// Requests the evidence behind each scene: this many of the strongest voxels; 0, the default:
    /// none.
    pub fn request_evidence(&self, most: usize) {
        self.shared.evidence_wanted.store(most, Ordering::Relaxed);
    }

    /// The newest evidence, if it was requested and is newer than the last one taken. May wait for
    /// a moment: not for the frame loop.
    pub fn take_evidence(&self) -> Option<Arc<Evidence>> {
        lock(&self.shared.evidence).take()
    }

    /// Number of resets.
    pub fn epoch(&self) -> u64 {
        self.shared.map.epoch()
    }

    /// Whether it is running: false after a panic, which leaves the last scene in place.
    pub fn is_alive(&self) -> bool {
        self.shared.is_alive.load(Ordering::SeqCst)
    }

    /// MapperCounters, at most 0.1 s old. May wait for a moment: not for the frame loop.
    pub fn counters(&self) -> ReconstructionCounters {
        let [frames, poses, _] = self.queue.dropped();
        ReconstructionCounters {
            frames_dropped: frames + self.frames.dropped(),
            poses_dropped: poses + self.poses.dropped(),
            ..*lock(&self.shared.counters)
        }
    }

    /// Hands over the newest events that [`Self::push`] would hand over with the next ones. May wait for a
    /// moment: for the end of a stream, not for the frame loop.
    pub fn flush(&self) {
        self.frames.flush();
        self.poses.flush();
        self.hands.flush();
    }

    /// Processes waiting input for at most half a second, updates the map a last time, and stops.
    pub fn finish(mut self) -> (ReconstructionCounters, Arc<Scene>) {
        self.shared.finish_by_ns.store((now_ns() as u64).saturating_add(MAX_FINISH_NS), Ordering::SeqCst);
        self.flush();
        self.end();
        (self.counters(), Arc::clone(&self.latest().scene))
    }

    fn end(&mut self) {
        self.queue.end();
        if let Some(thread) = self.thread.take() {
            // Its panics are caught inside.
            let _ = thread.join();
        }
    }
}

impl Drop for Reconstruction {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::SeqCst);
        self.end();
    }
}

impl Shared {
    fn new(mapper: MapperCounters) -> Self {
        let counters = ReconstructionCounters {
            mapper,
            epoch: 0,
            frames_dropped: 0,
            poses_dropped: 0,
            outdated: 0,
            published: 0,
            scenes: 0,
            processed: LatencyReport::default(),
            evidence_age: LatencyReport::default(),
            step: LatencyReport::default(),
            cpu_s: 0.0,
            running_s: 0.0,
        };
        Self {
            map: NewestOfEpoch::new(),
            counters: Mutex::new(counters),
            pending_map: Mutex::new(None),
            saved_map: Mutex::new(None),
            evidence_wanted: AtomicUsize::new(0),
            evidence: Mutex::default(),
            next_settings: Mutex::new(None),
            forget_calibration: AtomicBool::new(false),
            is_alive: AtomicBool::new(true),
            stop: AtomicBool::new(false),
            finish_by_ns: AtomicU64::new(u64::MAX),
        }
    }
}

/// The settings with this limit on the wait for poses.
fn with_max_ahead(settings: &Settings, max_ahead_s: f64) -> Settings {
    let mut settings = settings.clone();
    let history = &mut settings.tracking.history;
    history.max_ahead_s = history.max_ahead_s.min(max_ahead_s);
    settings
}

/// Runs the work and marks the end, however it ended. A panic has been printed by then.
fn run_guarded(shared: &Shared, work: impl FnOnce()) {
    if catch_unwind(AssertUnwindSafe(work)).is_err() {
        log::error!("the reconstruction failed: the map stays as it is and is not updated any more");
    }
    shared.is_alive.store(false, Ordering::SeqCst);
}

fn pool(options: &ReconstructionOptions) -> Result<rayon::ThreadPool, ReconstructionError> {
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = options.threads.unwrap_or(processors - 1).max(1);
    let nice = options.nice;
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|n| format!("reconstruct {n}"))
        .start_handler(move |_| lower_priority_of_this_thread(nice))
        .build()
        .map_err(|source| ReconstructionError::Pool { threads, source })
}

/// The data are consistent at any time, even after a panic.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use radar_mapping::MappingSettings;

    use super::*;
    use a121::preset;
    use radar_mapping::Mapper;

    #[test]
    fn panic_ends_only_the_reconstruction() {
        let config = preset("fine").unwrap();
        let shared = Shared::new(Mapper::new(&config, &Pose::IDENTITY, &MappingSettings::default()).counters());
        let pool = pool(&ReconstructionOptions { threads: Some(1), ..Default::default() }).unwrap();
        run_guarded(&shared, || pool.install(|| panic!("on purpose")));
        assert!(!shared.is_alive.load(Ordering::SeqCst));
        assert_eq!(shared.map.latest().epoch, 0);
    }
}

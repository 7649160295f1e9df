//! The reconstruction beside the frame loop: a thread and a pool of its own, at lower priority, around a pipeline.
//!
//! Streams in: poses and frames, from any threads, each in its own order. Out: the newest scene, whenever asked. Whoever pushes
//! or asks never waits for work, not even for a lock that a thread of lower priority holds: what finds the queue locked goes
//! in with the next push, and who finds the newest scene locked is given the one before. The queue is bounded; its oldest go
//! and are counted.

mod worker;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::thread::{Builder, JoinHandle};

use super::queue::{MapperInput, Queue};
use super::{LatencyReport, lower_priority_of_this_thread, now_ns};
use crate::settings::Settings;
use a121::{Frame, SensorConfig};
use radar_mapping::Counters;
use radar_mapping::{Evidence, HandsSample, SavedMap, Scene};
use radar_sar::PoseSample;
use radar_sar::geometry::Pose;
use worker::{PipelineSpec, Worker};

/// Shelves of the queue.
const FRAMES: usize = 0;
const POSES: usize = 1;
const HANDS: usize = 2;
/// Hands that wait at most: some two seconds.
const MAX_HANDS: usize = 256;

/// How the reconstruction is run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReconstructionOptions {
    /// Threads of its pool; `None`: the processors but one, and at least one.
    pub threads: Option<usize>,
    /// Steps of `nice` by which its threads stand back behind the one that starts it.
    pub nice: u8,
    /// Frames that wait at most; beyond, the oldest are dropped and counted.
    pub max_frames: usize,
    /// Poses that wait at most; the same.
    pub max_poses: usize,
    /// How long after a sweep its poses may come, seconds, where the settings would wait longer: see
    /// [`HistorySettings::max_ahead_s`](radar_sar::HistorySettings::max_ahead_s).
    pub max_ahead_s: f64,
}

impl Default for ReconstructionOptions {
    /// Some four seconds of the default preset and of poses; sweeps wait for the next pose alone.
    fn default() -> Self {
        Self { threads: None, nice: 5, max_frames: 256, max_poses: 1024, max_ahead_s: 0.0 }
    }
}

/// Why no reconstruction begins.
#[derive(Debug, thiserror::Error)]
pub enum ReconstructionError {
    /// No pool.
    #[error("cannot start the {threads} threads of the reconstruction: {source}")]
    Pool {
        /// How many were wanted.
        threads: usize,
        /// What the system says.
        source: rayon::ThreadPoolBuildError,
    },
    /// No thread.
    #[error("cannot start the reconstruction's thread: {0}")]
    Thread(std::io::Error),
}

/// What the reconstruction tells the frame loop.
#[derive(Debug, Clone)]
pub struct PublishedMap {
    /// Rises with everything published.
    pub number: u64,
    /// What stands in the room. The same `Arc` until it changes.
    pub scene: Arc<Scene>,
    /// End of the newest sweep worked off, host nanoseconds; 0 before the first.
    pub newest_sweep_ns: i64,
    /// The time offset in force: time of a sweep's pose minus time of the sweep, seconds.
    pub time_offset_s: f64,
    /// 1σ of the last estimate of the time offset, where the data tell it.
    pub time_offset_sigma_s: Option<f64>,
    /// How often everything was forgotten before.
    pub epoch: u64,
}

impl PublishedMap {
    /// Nothing seen yet.
    fn nothing(epoch: u64) -> Self {
        let scene = Arc::new(Scene::default());
        Self { number: 0, scene, newest_sweep_ns: 0, time_offset_s: 0.0, time_offset_sigma_s: None, epoch }
    }
}

/// What the reconstruction has been through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReconstructionCounters {
    /// The pipeline's, since everything was last forgotten.
    pub pipeline: Counters,
    /// How often everything was forgotten.
    pub epoch: u64,
    /// Frames and poses that nobody had time for.
    pub frames_dropped: u64,
    /// See `frames_dropped`.
    pub poses_dropped: u64,
    /// Frames and poses from before everything was forgotten.
    pub outdated: u64,
    /// Times that something was published.
    pub published: u64,
    /// Scenes among it.
    pub scenes: u64,
    /// From a frame's arrival until its sweeps have their poses and are part of the search, and that is published: the wait for
    /// the pose after them and for the work before them.
    pub processed: LatencyReport,
    /// From a frame's end to the first published scene that rests on it: evidence is taken in by blocks and looked at four times
    /// a second, so this is bounded by a block's length and the time between two looks, on top of the above.
    pub evidence_age: LatencyReport,
    /// How long a frame or pose, or a part of what they set off, kept the next from being taken.
    pub step: LatencyReport,
    /// Processor time of all its threads, seconds.
    pub cpu_s: f64,
    /// How long it has been running, seconds.
    pub running_s: f64,
}

/// What one thread hands to the other, with the epoch in which it was pushed.
enum Input {
    Pose(u64, PoseSample),
    Hands(u64, HandsSample),
    /// And when it arrived, host nanoseconds.
    Frame(u64, Frame, i64),
}

/// What both sides hold.
struct Shared {
    newest: Mutex<Arc<PublishedMap>>,
    counters: Mutex<ReconstructionCounters>,
    epoch: AtomicU64,
    /// What is to be taken up, and in which epoch.
    pending_map: Mutex<Option<(u64, SavedMap)>>,
    /// What is known of the room, and in which epoch.
    saved_map: Mutex<Option<(u64, Arc<SavedMap>)>>,
    /// How many voxels of evidence are wanted; and those of the newest scene.
    evidence_wanted: AtomicUsize,
    evidence: Mutex<Option<Arc<Evidence>>>,
    /// Settings for whatever begins next, where they are to be others.
    next_settings: Mutex<Option<Settings>>,
    is_alive: AtomicBool,
    /// Leave everything and end.
    stop: AtomicBool,
    /// Work off what waits, but not beyond this host time, and end.
    finish_by_ns: AtomicU64,
}

/// The reconstruction. Dropping it leaves what waits and ends its threads.
pub struct Reconstruction {
    shared: Arc<Shared>,
    queue: Arc<Queue<Input, 3>>,
    frames: MapperInput<Input, 3>,
    poses: MapperInput<Input, 3>,
    hands: MapperInput<Input, 3>,
    /// What was last given out.
    last_given: Mutex<Arc<PublishedMap>>,
    max_ahead_s: f64,
    thread: Option<JoinHandle<()>>,
}

/// Longest that [`Reconstruction::finish`] works off what waits, nanoseconds.
const MAX_FINISH_NS: u64 = 500_000_000;

impl Reconstruction {
    /// Begins, for a sound configuration. The settings' mount goes before the one given.
    ///
    /// # Errors
    /// The system gives no threads.
    pub fn start(
        config: &SensorConfig,
        head_from_sensor: &Pose,
        settings: &Settings,
        options: &ReconstructionOptions,
    ) -> Result<Self, ReconstructionError> {
        let settings = with_max_ahead(settings, options.max_ahead_s);
        let begin = PipelineSpec { config: config.clone(), head_from_sensor: *head_from_sensor, settings };
        let pipeline = begin.pipeline();
        let shared = Arc::new(Shared::new(pipeline.counters()));
        let queue = Arc::new(Queue::new([options.max_frames, options.max_poses, MAX_HANDS]));
        let pool = pool(options)?;
        let worker = Worker::new(pipeline, begin, Arc::clone(&shared), Arc::clone(&queue));
        let (told, nice) = (Arc::clone(&shared), options.nice);
        let run = move || {
            lower_priority_of_this_thread(nice);
            run_guarded(&told, || pool.install(|| worker.run()));
        };
        let last_given = Mutex::new(Arc::clone(&*lock(&shared.newest)));
        let thread = Builder::new().name("reconstruction".into()).spawn(run).map_err(ReconstructionError::Thread)?;
        Ok(Self {
            max_ahead_s: options.max_ahead_s,
            frames: MapperInput::new(&queue, FRAMES),
            poses: MapperInput::new(&queue, POSES),
            hands: MapperInput::new(&queue, HANDS),
            last_given,
            shared,
            queue,
            thread: Some(thread),
        })
    }

    /// Takes a pose of the head; never waits.
    pub fn push_pose(&self, sample: PoseSample) {
        self.poses.push(Input::Pose(self.epoch(), sample));
    }

    /// Takes where the player's hands are, in the frame of the poses; never waits. What nobody has time for goes.
    pub fn push_hands(&self, hands: HandsSample) {
        self.hands.push(Input::Hands(self.epoch(), hands));
    }

    /// Takes a frame that arrived now; never waits.
    pub fn push_frame(&self, frame: Frame) {
        self.frames.push(Input::Frame(self.epoch(), frame, now_ns()));
    }

    /// The newest there is; never waits for work.
    pub fn latest(&self) -> Arc<PublishedMap> {
        let mut last_given = lock(&self.last_given);
        let newest = match self.shared.newest.try_lock() {
            Ok(newest) => Some(Arc::clone(&newest)),
            Err(TryLockError::Poisoned(poisoned)) => Some(Arc::clone(&poisoned.into_inner())),
            Err(TryLockError::WouldBlock) => None,
        };
        // What was found before everything was forgotten is never given out after.
        if let Some(newest) = newest.filter(|newest| newest.epoch == self.epoch()) {
            *last_given = newest;
        }
        Arc::clone(&last_given)
    }

    /// Forgets everything, at once: the poses to come are those of another frame of reference. Frames and poses pushed before do
    /// not count any more, nor does what was found. Gives the epoch that begins.
    pub fn reset(&self) -> u64 {
        let mut last_given = lock(&self.last_given);
        let epoch = self.shared.epoch.fetch_add(1, Ordering::SeqCst) + 1;
        *last_given = Arc::new(PublishedMap::nothing(epoch));
        epoch
    }

    /// Begins anew with other settings: what was found with those of before is forgotten, see [`Self::forget`].
    pub fn restart_with(&self, settings: &Settings) -> u64 {
        *lock(&self.shared.next_settings) = Some(with_max_ahead(settings, self.max_ahead_s));
        self.reset()
    }

    /// Has it take up what is remembered of the room, in the frame of the poses of that epoch.
    pub fn restore(&self, epoch: u64, remembered: SavedMap) {
        *lock(&self.shared.pending_map) = Some((epoch, remembered));
    }

    /// What is known of the room and in which epoch, as of a second ago at most; `None` before there is anything, and while something is
    /// still to be taken up. May wait for a moment: not for the frame loop.
    pub fn saved_map(&self) -> Option<(u64, Arc<SavedMap>)> {
        let waiting = lock(&self.shared.pending_map);
        if waiting.is_some() {
            return None;
        }
        lock(&self.shared.saved_map).clone()
    }

    /// Has it tell of the evidence behind scenes, so many voxels at most, the strongest; 0, as at first: none.
    pub fn request_evidence(&self, most: usize) {
        self.shared.evidence_wanted.store(most, Ordering::Relaxed);
    }

    /// The newest evidence, where it is watched and there is a newer one than was last taken. May wait for a moment: not for the frame loop.
    pub fn take_evidence(&self) -> Option<Arc<Evidence>> {
        lock(&self.shared.evidence).take()
    }

    /// How often everything was forgotten.
    pub fn epoch(&self) -> u64 {
        self.shared.epoch.load(Ordering::SeqCst)
    }

    /// Whether it still works: false after a panic of its own, which leaves the last scene as it was.
    pub fn is_alive(&self) -> bool {
        self.shared.is_alive.load(Ordering::SeqCst)
    }

    /// What it has been through, as of a tenth of a second ago at most. May wait for a moment: not for the frame loop.
    pub fn counters(&self) -> ReconstructionCounters {
        let [frames, poses, _] = self.queue.dropped();
        ReconstructionCounters {
            frames_dropped: frames + self.frames.dropped(),
            poses_dropped: poses + self.poses.dropped(),
            ..*lock(&self.shared.counters)
        }
    }

    /// Works off what waits, for half a second at most, looks a last time, and ends.
    pub fn finish(mut self) -> (ReconstructionCounters, Arc<Scene>) {
        self.shared.finish_by_ns.store((now_ns() as u64).saturating_add(MAX_FINISH_NS), Ordering::SeqCst);
        self.frames.flush();
        self.poses.flush();
        self.hands.flush();
        self.end();
        (self.counters(), Arc::clone(&self.latest().scene))
    }

    fn end(&mut self) {
        self.queue.end();
        if let Some(thread) = self.thread.take() {
            // Its panics are caught within.
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
    fn new(pipeline: Counters) -> Self {
        let counters = ReconstructionCounters {
            pipeline,
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
            newest: Mutex::new(Arc::new(PublishedMap::nothing(0))),
            counters: Mutex::new(counters),
            epoch: AtomicU64::new(0),
            pending_map: Mutex::new(None),
            saved_map: Mutex::new(None),
            evidence_wanted: AtomicUsize::new(0),
            evidence: Mutex::default(),
            next_settings: Mutex::new(None),
            is_alive: AtomicBool::new(true),
            stop: AtomicBool::new(false),
            finish_by_ns: AtomicU64::new(u64::MAX),
        }
    }
}

/// The settings, with sweeps that wait for their poses no longer than that.
fn with_max_ahead(settings: &Settings, max_ahead_s: f64) -> Settings {
    let mut settings = settings.clone();
    let history = &mut settings.tracking.history;
    history.max_ahead_s = history.max_ahead_s.min(max_ahead_s);
    settings
}

/// Works, and tells when it is over, however it ended. A panic has been printed by the time that it arrives here.
fn run_guarded(shared: &Shared, work: impl FnOnce()) {
    if catch_unwind(AssertUnwindSafe(work)).is_err() {
        log::error!("the reconstruction ended by a fault of its own: what was found so far stays, nothing is added");
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

/// What is in there is whole at any time.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use radar_mapping::MappingSettings;

    use super::*;
    use a121::preset;
    use radar_mapping::Pipeline;

    #[test]
    fn panic_ends_only_the_reconstruction() {
        let config = preset("fine").unwrap();
        let shared = Shared::new(Pipeline::new(&config, &Pose::IDENTITY, &MappingSettings::default()).counters());
        let pool = pool(&ReconstructionOptions { threads: Some(1), ..Default::default() }).unwrap();
        run_guarded(&shared, || pool.install(|| panic!("on purpose")));
        assert!(!shared.is_alive.load(Ordering::SeqCst));
        assert_eq!(lock(&shared.newest).epoch, 0);
    }

    #[test]
    fn latest_never_waits_for_the_lock() {
        let config = preset("fine").unwrap();
        let options = ReconstructionOptions { threads: Some(1), ..Default::default() };
        let reconstruction = Reconstruction::start(&config, &Pose::IDENTITY, &Settings::default(), &options).unwrap();
        let held = Arc::clone(&reconstruction.shared);
        let lock = lock(&held.newest);
        assert_eq!(reconstruction.latest().epoch, 0);
        assert_eq!((reconstruction.reset(), reconstruction.latest().epoch), (1, 1));
        drop(lock);
    }
}

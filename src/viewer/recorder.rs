//! Stores the state of a mapper in the history. Call it after every event; the mapper does not
//! depend on it. Callers whose mapper runs elsewhere can store its published state.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::history::{Health, History, VOXELS};
use super::recording_info::RecordingInfo;
use radar_mapping::{Evidence, Scene};
use radar_mapping::{Mapper, MapperKind};
use radar_sar::geometry::Pose;

/// Search modes without map updates: the first image is made after this time, nanoseconds, and the
/// next whenever the recording is longer by the factor. Each image is a search over all data.
/// Choice: the searches' total time stays at most eleven times that of the last one.
const FIRST_UPDATE_NS: i64 = 1_000_000_000;
const UPDATE_GROWTH: f64 = 1.1;
/// A frame whose time differs by more than this from the newest pose is ignored, nanoseconds.
/// Choice: longer than poses run late, so only a wrong time stamp is ignored, which would stretch
/// the timeline.
const MAX_FRAME_POSE_GAP_NS: i64 = 1_000_000_000;

/// The history, shared by both threads.
#[derive(Debug, Clone)]
pub struct SharedHistory(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    history: Mutex<History>,
    /// New recording information, if it changed.
    about: Mutex<Option<RecordingInfo>>,
    is_closed: AtomicBool,
}

impl SharedHistory {
    /// For a recording with this announced duration, seconds.
    pub fn new(expected_s: f64) -> Self {
        let history = Mutex::new(History::new(expected_s));
        Self(Arc::new(Shared { history, about: Mutex::default(), is_closed: AtomicBool::new(false) }))
    }

    /// Locks the history. Hold the lock only briefly.
    pub fn lock(&self) -> MutexGuard<'_, History> {
        self.0.history.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// New recording information, if it changed since the last call.
    pub fn take_info(&self) -> Option<RecordingInfo> {
        self.0.about.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Marks the view as closed.
    pub fn close(&self) {
        self.0.is_closed.store(true, Ordering::Relaxed);
    }

    /// Whether the view is closed.
    pub fn is_closed(&self) -> bool {
        self.0.is_closed.load(Ordering::Relaxed)
    }
}

/// Stores the state of a mapper.
#[derive(Debug)]
pub struct Recorder {
    history: SharedHistory,
    start_ns: Option<i64>,
    next_ns: i64,
}

impl Recorder {
    /// Stores into this history.
    pub fn new(history: &SharedHistory) -> Self {
        Self { history: history.clone(), start_ns: None, next_ns: i64::MIN }
    }

    /// Whether the view is closed.
    pub fn is_closed(&self) -> bool {
        self.history.is_closed()
    }

    /// Call after every event of the mapper. `scene`: of a new map update; `frame_ns`: time of the frame, if the event was one.
    pub fn record(&mut self, mapper: &Mapper, scene: Option<Scene>, frame_ns: Option<i64>) {
        let Some((now_ns, head)) = mapper.head() else { return };
        {
            let mut history = self.history.lock();
            history.push_head(now_ns, head);
            if let Some(frame_ns) =
                frame_ns.filter(|&frame_ns| frame_ns.abs_diff(now_ns) <= MAX_FRAME_POSE_GAP_NS as u64)
            {
                history.push_frame(frame_ns);
            }
        }
        let scene = scene.or_else(|| {
            let is_due = mapper.kind() == MapperKind::Reflectors && self.is_due(now_ns);
            is_due.then(|| mapper.scene())
        });
        if let Some(scene) = scene {
            self.record_now(mapper, scene, now_ns);
        }
    }

    /// Replaces the recording information.
    pub fn record_info(&self, about: RecordingInfo) {
        *self.history.0.about.lock().unwrap_or_else(PoisonError::into_inner) = Some(about);
    }

    /// Stores a head pose, and the end of the sensor's newest frame, host nanoseconds.
    pub fn record_head(&self, now_ns: i64, head: Pose, frame_ns: Option<i64>) {
        let mut history = self.history.lock();
        history.push_head(now_ns, head);
        if let Some(frame_ns) = frame_ns {
            history.push_frame(frame_ns);
        }
    }

    /// Stores a scene, with evidence if there is new evidence.
    pub fn record_update(&self, now_ns: i64, scene: Scene, health: Health, evidence: Option<Arc<Evidence>>) {
        let mut history = self.history.lock();
        history.push_update(now_ns, scene, health);
        if let Some(evidence) = evidence {
            history.push_evidence(now_ns, evidence);
        }
    }

    /// For search modes without map updates.
    fn is_due(&mut self, now_ns: i64) -> bool {
        let start_ns = *self.start_ns.get_or_insert(now_ns);
        if self.next_ns == i64::MIN {
            self.next_ns = start_ns.saturating_add(FIRST_UPDATE_NS);
        }
        let is_due = now_ns >= self.next_ns;
        if is_due {
            let longer_ns = (now_ns.saturating_sub(start_ns) as f64 * UPDATE_GROWTH) as i64;
            self.next_ns = start_ns.saturating_add(longer_ns).max(now_ns.saturating_add(FIRST_UPDATE_NS));
        }
        is_due
    }

    fn record_now(&mut self, mapper: &Mapper, scene: Scene, now_ns: i64) {
        let evidence = mapper.evidence(VOXELS);
        let health = Health {
            counters: mapper.counters(),
            time_offset_s: mapper.time_offset_s(),
            estimate: mapper.time_offset_estimate(),
        };
        let mut history = self.history.lock();
        history.push_update(now_ns, scene, health);
        history.push_evidence(now_ns, evidence);
    }

    /// Call when the mapper has finished.
    pub fn finish(&mut self, mapper: &Mapper, scene: Scene) {
        if let Some((now_ns, _)) = mapper.head() {
            self.record_now(mapper, scene, mapper.newest_sweep_ns().unwrap_or(now_ns).max(now_ns));
        }
    }
}

/// Marks the history as complete, also if the work ended with an error.
impl Drop for Recorder {
    fn drop(&mut self) {
        self.history.lock().complete();
    }
}

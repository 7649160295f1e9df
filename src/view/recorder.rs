//! Writes into the history what a pipeline knows, as it goes. To be asked after every event; the pipeline need not know. Who has no
//! pipeline at hand, since it works elsewhere, notes what that one tells.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::history::{Health, History, VOXELS};
use super::recording_info::RecordingInfo;
use radar_mapping::{Evidence, Scene};
use radar_mapping::{MapperKind, Pipeline};
use radar_sar::geometry::Pose;

/// Where there is no look of its own, the first is taken after so long, and the next when the recording is so much longer:
/// each is a search through everything.
const FIRST_UPDATE_NS: i64 = 1_000_000_000;
const UPDATE_GROWTH: f64 = 1.1;
/// A frame whose time is farther than this from the newest pose's is not noted, nanoseconds.
const MAX_FRAME_POSE_GAP_NS: i64 = 1_000_000_000;

/// The history, as both threads have it.
#[derive(Debug, Clone)]
pub struct SharedHistory(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    history: Mutex<History>,
    /// What holds for all of it, where that became known, or another, only now.
    about: Mutex<Option<RecordingInfo>>,
    is_closed: AtomicBool,
}

impl SharedHistory {
    /// Of a recording that says it is so long, seconds.
    pub fn new(expected_s: f64) -> Self {
        let history = Mutex::new(History::new(expected_s));
        Self(Arc::new(Shared { history, about: Mutex::default(), is_closed: AtomicBool::new(false) }))
    }

    /// The history, for a short while.
    pub fn lock(&self) -> MutexGuard<'_, History> {
        self.0.history.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What holds for all of it, when that is another than before.
    pub fn take_info(&self) -> Option<RecordingInfo> {
        self.0.about.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Nobody looks any more.
    pub fn close(&self) {
        self.0.is_closed.store(true, Ordering::Relaxed);
    }

    /// Whether nobody looks any more.
    pub fn is_closed(&self) -> bool {
        self.0.is_closed.load(Ordering::Relaxed)
    }
}

/// Notes what a pipeline knows.
#[derive(Debug)]
pub struct Recorder {
    history: SharedHistory,
    updates: u64,
    start_ns: Option<i64>,
    next_ns: i64,
}

impl Recorder {
    /// Into this history.
    pub fn new(history: &SharedHistory) -> Self {
        Self { history: history.clone(), updates: 0, start_ns: None, next_ns: i64::MIN }
    }

    /// Whether nobody looks any more.
    pub fn is_closed(&self) -> bool {
        self.history.is_closed()
    }

    /// The pipeline took an event; `frame_ns`: the time of the frame, if it was one.
    pub fn record(&mut self, pipeline: &Pipeline, frame_ns: Option<i64>) {
        let Some((now_ns, head)) = pipeline.head() else { return };
        {
            let mut history = self.history.lock();
            history.push_head(now_ns, head);
            if let Some(frame_ns) =
                frame_ns.filter(|&frame_ns| frame_ns.abs_diff(now_ns) <= MAX_FRAME_POSE_GAP_NS as u64)
            {
                history.push_frame(frame_ns);
            }
        }
        let is_new = match pipeline.engine().search() {
            MapperKind::Rooms => pipeline.engine().counters().rooms.looks != self.updates,
            MapperKind::Reflectors => self.is_due(now_ns),
        };
        if is_new {
            self.record_now(pipeline, now_ns);
        }
    }

    /// What holds for all of it is this from now on.
    pub fn record_info(&self, about: RecordingInfo) {
        *self.history.0.about.lock().unwrap_or_else(PoisonError::into_inner) = Some(about);
    }

    /// The head is here, and the sensor's newest frame ended then, host nanoseconds.
    pub fn record_head(&self, now_ns: i64, head: Pose, frame_ns: Option<i64>) {
        let mut history = self.history.lock();
        history.push_head(now_ns, head);
        if let Some(frame_ns) = frame_ns {
            history.push_frame(frame_ns);
        }
    }

    /// This is known now; `evidence` where there is new one.
    pub fn record_update(&self, now_ns: i64, scene: Scene, health: Health, evidence: Option<Arc<Evidence>>) {
        let mut history = self.history.lock();
        history.push_update(now_ns, scene, health);
        if let Some(evidence) = evidence {
            history.push_evidence(now_ns, evidence);
        }
    }

    /// For searches that have no looks of their own.
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

    fn record_now(&mut self, pipeline: &Pipeline, now_ns: i64) {
        self.updates = pipeline.engine().counters().rooms.looks;
        let scene = pipeline.scene();
        let evidence = pipeline.engine().evidence(VOXELS);
        let health = Health {
            counters: pipeline.counters(),
            time_offset_s: pipeline.time_offset_s(),
            estimate: pipeline.time_offset_estimate(),
        };
        let mut history = self.history.lock();
        history.push_update(now_ns, scene, health);
        history.push_evidence(now_ns, evidence);
    }

    /// The pipeline has finished.
    pub fn finish(&mut self, pipeline: &Pipeline) {
        if let Some((now_ns, _)) = pipeline.head() {
            self.record_now(pipeline, pipeline.engine().newest_sweep_ns().unwrap_or(now_ns).max(now_ns));
        }
    }
}

/// Nothing more will come, be it that the work is done or that it broke off.
impl Drop for Recorder {
    fn drop(&mut self) {
        self.history.lock().complete();
    }
}

//! The sensor's side of `run`: a thread that finds the board, takes its frames, passes them to the
//! reconstruction and records them. A missing board is waited for.

use std::cell::{Cell, RefCell};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, SyncSender};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

use anyhow::{Context, Result};

use super::frame_intake::{ChosenSensor, FrameIntake, Until};
use super::headset::{FrameReport, HeadsetStatus};
use super::mount_memory::MountMemory;
use super::record_file::{PoseSource, RecordFile};
use super::{FrameLossCounter, Reconstruction, ReconstructionOptions, SensorCount};
use crate::settings::Settings;
use a121::{Frame, frame_timing};
use radar_mapping::{Event, MountInUse};
use radar_recording::Header;
use radar_sar::PoseSample;

/// Interval of searches for a board. Choice: a plugged-in board is used within two seconds, and
/// listing the ports costs little.
const RETRY_INTERVAL: Duration = Duration::from_secs(2);
/// Reaction time to a stop while waiting. Choice: shorter than one perceives.
const STOP_POLL_INTERVAL: Duration = Duration::from_millis(50);

/// State shared between the sensor's thread and the frame loop.
pub struct SensorSupervisor {
    /// Set once there is a sensor.
    reconstruction: OnceLock<Reconstruction>,
    /// Settings of the reconstruction.
    settings: Mutex<Settings>,
    /// Configuration, port and mount, once there is a sensor.
    sensor: OnceLock<Header>,
    sensor_period_ns: AtomicI64,
    /// End of the newest frame, host nanoseconds, and the newest head pose, for the view.
    newest_frame_ns: AtomicI64,
    newest_pose: Mutex<Option<PoseSample>>,
    /// Whether the port is open, and the sweeps received and lost.
    is_connected: AtomicBool,
    sweeps: AtomicU64,
    sweeps_lost: AtomicU64,
    /// Ends the thread.
    pub stop: AtomicBool,
    /// Status of the frame loop.
    pub status: Mutex<HeadsetStatus>,
    /// Why the sensor does not measure.
    trouble: Mutex<Option<String>>,
    /// Channel of poses for the recording.
    recorded_poses: Option<SyncSender<Event>>,
    mount_memory: Option<MountMemory>,
    /// The mount that was kept last.
    kept_mount: Mutex<Option<MountInUse>>,
}

/// Finds the sensor, or states what is missing.
pub type ChooseSensor = Arc<dyn Fn() -> Result<ChosenSensor> + Send + Sync>;

/// Parameters of the thread.
pub struct SupervisorPlan {
    choose_sensor: ChooseSensor,
    record: Option<PathBuf>,
    poses: Option<Receiver<Event>>,
    mount_memory: Option<MountMemory>,
}

impl SupervisorPlan {
    /// `record`: file that frames and poses are recorded into.
    pub fn new(choose_sensor: ChooseSensor, record: Option<PathBuf>, mount_memory: Option<MountMemory>) -> Self {
        Self { choose_sensor, record, poses: None, mount_memory }
    }
}

impl SensorSupervisor {
    /// Starts the thread; the receiver gets its result at the end.
    ///
    /// # Errors
    /// The system provides no thread.
    pub fn start(mut plan: SupervisorPlan, settings: &Settings) -> Result<(Arc<Self>, Receiver<Result<()>>)> {
        let mut recorded_poses = None;
        if plan.record.is_some() {
            let (sender, receiver) = mpsc::sync_channel(super::record_file::MAX_WAITING_POSES);
            (recorded_poses, plan.poses) = (Some(sender), Some(receiver));
        }
        let supervisor = Arc::new(Self {
            reconstruction: OnceLock::new(),
            settings: Mutex::new(settings.clone()),
            sensor: OnceLock::new(),
            sensor_period_ns: AtomicI64::new(0),
            newest_frame_ns: AtomicI64::new(0),
            newest_pose: Mutex::default(),
            is_connected: AtomicBool::new(false),
            sweeps: AtomicU64::new(0),
            sweeps_lost: AtomicU64::new(0),
            stop: AtomicBool::new(false),
            status: Mutex::default(),
            trouble: Mutex::default(),
            recorded_poses,
            mount_memory: plan.mount_memory.take(),
            kept_mount: Mutex::default(),
        });
        let (over, is_over) = mpsc::sync_channel(1);
        let own = Arc::clone(&supervisor);
        let work = move || drop(over.send(own.run(plan)));
        std::thread::Builder::new().name("sensor supervisor".into()).spawn(work).context("cannot start a thread")?;
        Ok((supervisor, is_over))
    }

    /// The reconstruction, once there is a sensor.
    pub fn reconstruction(&self) -> Option<&Reconstruction> {
        self.reconstruction.get()
    }

    /// Restarts the reconstruction with other settings, or stores them until there is a sensor.
    pub fn restart_with(&self, settings: &Settings) {
        let mut held = self.settings.lock().unwrap_or_else(PoisonError::into_inner);
        *held = settings.clone();
        if let Some(reconstruction) = self.reconstruction() {
            reconstruction.restart_with(settings);
        }
    }

    /// Keeps the mount in use for the next session with this headset, if it has been estimated, or the kept one forgotten. Accesses
    /// a file.
    pub fn keep_mount(&self) {
        let newest =
            self.reconstruction().and_then(|reconstruction| Some(reconstruction.latest().calibration.as_ref()?.mount));
        let (Some(memory), Some(mount)) = (&self.mount_memory, newest) else { return };
        let mut kept = self.kept_mount.lock().unwrap_or_else(PoisonError::into_inner);
        let is_applied = self.settings.lock().unwrap_or_else(PoisonError::into_inner).tracking.estimate_mount;
        let is_forgotten = kept.is_some_and(|kept| kept.assumed == mount.assumed);
        let is_new = kept.is_none_or(|kept| kept.in_use != mount.in_use);
        if is_applied && is_new && (mount.estimate.is_some() || is_forgotten) {
            *kept = Some(mount);
            if let Err(error) = memory.keep(&mount) {
                log::warn!("the sensor's place on the headset is not kept: {error:#}");
            }
        }
    }

    /// Length of a sensor frame, nanoseconds.
    pub fn sensor_period_ns(&self) -> i64 {
        self.sensor_period_ns.load(Ordering::Relaxed)
    }

    /// Why the sensor does not measure, while it does not.
    pub fn sensor_trouble(&self) -> Option<String> {
        self.trouble.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn set_trouble(&self, trouble: Option<String>) {
        *self.trouble.lock().unwrap_or_else(PoisonError::into_inner) = trouble;
    }

    /// What the sensor has sent so far; `None` while it is disconnected.
    pub fn sensor_count(&self) -> Option<SensorCount> {
        let [sweeps, lost] = [&self.sweeps, &self.sweeps_lost].map(|count| count.load(Ordering::Relaxed));
        self.is_connected.load(Ordering::Relaxed).then_some(SensorCount { sweeps, lost })
    }

    /// Configuration, port and mount, once there is a sensor.
    pub fn sensor(&self) -> Option<&Header> {
        self.sensor.get()
    }

    /// The newest pose, and the end of the newest frame, host nanoseconds.
    pub fn newest(&self) -> (Option<PoseSample>, Option<i64>) {
        let pose = *self.newest_pose.lock().unwrap_or_else(PoisonError::into_inner);
        let frame_ns = self.newest_frame_ns.load(Ordering::Relaxed);
        (pose, (frame_ns != 0).then_some(frame_ns))
    }

    /// Takes a head pose or the positions of the wearer's hands; never waits.
    pub fn push(&self, event: Event) {
        // A reader that holds the lock gets the next pose.
        if let (Event::Pose(sample), Ok(mut newest)) = (&event, self.newest_pose.try_lock()) {
            *newest = Some(*sample);
        }
        if let Some(reconstruction) = self.reconstruction() {
            reconstruction.push(event.clone());
        }
        if let Some(recorded) = &self.recorded_poses {
            // A disk that is four seconds behind loses poses, but does not delay the frame loop.
            let _ = recorded.try_send(event);
        }
    }

    fn run(&self, mut plan: SupervisorPlan) -> Result<()> {
        let Some(sensor) = self.retry_until(|| (plan.choose_sensor)(), "no sensor yet") else { return Ok(()) };
        sensor.print()?;
        let reconstruction = self.begin(&sensor)?;
        let sweeps_per_frame = u64::from(sensor.config()?.sweeps_per_frame);
        let source = plan.poses.take().map_or(PoseSource::None, PoseSource::Live);
        let mut file = plan.record.as_deref().map(|path| RecordFile::new(path, source));
        let mut recorded = Ok(());
        while let Some(stream) = self.open(&sensor) {
            let (losses, lost_before) =
                (RefCell::new(FrameLossCounter::default()), self.sweeps_lost.load(Ordering::Relaxed));
            let is_troubled = Cell::new(true);
            let on_frame = |frame: &Frame| {
                if is_troubled.replace(false) {
                    self.set_trouble(None);
                }
                losses.borrow_mut().push(frame.tick);
                self.sweeps.fetch_add(sweeps_per_frame, Ordering::Relaxed);
                self.sweeps_lost.store(lost_before + losses.borrow().lost() * sweeps_per_frame, Ordering::Relaxed);
                self.newest_frame_ns.store(frame.host_time_ns, Ordering::Relaxed);
                reconstruction.push(Event::Frame(frame.clone()));
            };
            // A recording ends with the stream with which it began.
            let is_recording = file.is_some();
            let on_trouble = |trouble: &str| {
                is_troubled.set(true);
                self.set_trouble(Some(trouble.to_owned()));
            };
            let mut intake = FrameIntake::new(&sensor, file.take(), &on_frame)
                .with_presence(&self.is_connected)
                .with_troubles(&on_trouble);
            let taken = intake.run(&stream, &self.stop, Until::Stopped, &|| self.status_text());
            let done = intake.end(stream, taken);
            self.is_connected.store(false, Ordering::Relaxed);
            if self.stop.load(Ordering::Relaxed) {
                return recorded.and(done);
            }
            let why = done.as_ref().err().map_or("it ended".to_owned(), |error| format!("{error:#}"));
            self.set_trouble(Some(why.clone()));
            let rest_s = RETRY_INTERVAL.as_secs();
            if is_recording {
                log::error!("the recording has ended: {why}. The stream restarts without recording in {rest_s} s");
                // Reported once more at the end.
                recorded = done;
            } else {
                log::warn!("the sensor's stream: {why}. It restarts in {rest_s} s");
            }
            self.pause();
        }
        recorded
    }

    fn begin(&self, sensor: &ChosenSensor) -> Result<&Reconstruction> {
        // Held until the reconstruction exists, so that no change is lost in between.
        let settings = self.settings.lock().unwrap_or_else(PoisonError::into_inner);
        let threads = Some(settings.headset.threads).filter(|threads| *threads > 0);
        let options = ReconstructionOptions { threads, ..Default::default() };
        let known_mount = self.mount_memory.as_ref().and_then(MountMemory::recall);
        *self.kept_mount.lock().unwrap_or_else(PoisonError::into_inner) = known_mount;
        let reconstruction =
            Reconstruction::start(sensor.config()?, &sensor.mount(), known_mount, &settings, &options)?;
        let _ = self.sensor.set(Header::new(sensor.place(), sensor.config()?.clone(), sensor.mount()));
        let period_s = frame_timing(sensor.config()?).frame_period_s;
        self.sensor_period_ns.store((period_s * 1e9) as i64, Ordering::Relaxed);
        Ok(self.reconstruction.get_or_init(|| reconstruction))
    }

    fn open(&self, sensor: &ChosenSensor) -> Option<super::SensorStream> {
        self.retry_until(|| sensor.open(), "the sensor's line does not open yet")
    }

    /// Retries until it succeeds or the program ends; logs what is missing once.
    fn retry_until<T>(&self, attempt: impl Fn() -> Result<T>, missing: &str) -> Option<T> {
        let mut logged = String::new();
        while !self.stop.load(Ordering::Relaxed) {
            match attempt() {
                Ok(found) => {
                    self.set_trouble(None);
                    return Some(found);
                }
                Err(error) => {
                    let text = format!("{error:#}");
                    self.set_trouble(Some(text.clone()));
                    if text != logged {
                        log::warn!("{missing}: {text}. Retrying every {} s", RETRY_INTERVAL.as_secs());
                        logged = text;
                    }
                }
            }
            self.pause();
        }
        None
    }

    /// Waits for the next attempt or the end.
    fn pause(&self) {
        let mut waited = Duration::ZERO;
        while waited < RETRY_INTERVAL && !self.stop.load(Ordering::Relaxed) {
            std::thread::sleep(STOP_POLL_INTERVAL);
            waited += STOP_POLL_INTERVAL;
        }
    }

    /// Status of the frame loop, for the progress line.
    fn status_text(&self) -> String {
        let status = *self.status.lock().unwrap_or_else(PoisonError::into_inner);
        let tracked = if status.is_tracked { "" } else { "  head not tracked" };
        let nearest = status.nearest_m.map_or(String::new(), |m| format!("  nearest {m:.2} m"));
        let FrameReport { frames, missed_by_loop, missed_waiting_for_core, missed_elsewhere, .. } = status.frames;
        let missed = missed_by_loop + missed_waiting_for_core + missed_elsewhere;
        format!("  {frames} display frames, {missed} missed{tracked}{nearest}")
    }
}

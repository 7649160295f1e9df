//! `run --view`: the window on the desktop, and the thread that updates it. It polls; nothing waits
//! for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Result, anyhow};

use super::sensor_supervisor::SensorSupervisor;
use super::{PublishedMap, Reconstruction, SettingsStore};
use crate::settings::Settings;
use crate::viewer;
use crate::viewer::{Health, Recorder, RecordingInfo, VOXELS, ViewError};
use a121::preset;
use radar_mapping::MapperKind;
use radar_recording::Header;
use radar_sar::geometry::Pose;

/// Interval of updates of the head pose. Choice: 30 a second, the rate at which the window moves
/// smoothly; it takes no time from the headset.
const UPDATE_INTERVAL: Duration = Duration::from_millis(33);
/// Source and preset shown before there is a sensor.
const NO_SENSOR: &str = "waiting for the sensor";
const PRESET: &str = "d16";

/// Runs the work in its own thread and shows its state, until the window is closed or the work
/// ends. Closing the window does not end the work; where no window can be opened, the work is asked
/// to stop.
pub fn show(stop: &AtomicBool, work: impl FnOnce(Recorder) -> Result<()> + Send) -> Result<()> {
    let config = preset(PRESET).ok_or_else(|| anyhow!("there is no preset {PRESET}"))?;
    let header = Header::new(NO_SENSOR, config, Pose::IDENTITY);
    let about = RecordingInfo::live(&header, &Settings::default(), MapperKind::Rooms);
    let shown = viewer::show_with_cancel(about, work, || stop.store(true, Ordering::Relaxed));
    shown.map_err(|error| match error {
        ViewError::NoDesktop(cause) => {
            anyhow!("no window can be opened: {cause}. Warnings need none: run without --view")
        }
        other => other.into(),
    })?
}

/// Updates the view of a session until it ends or the window is closed.
pub fn update_view(view: &Recorder, supervisor: &SensorSupervisor, store: &SettingsStore, is_over: &AtomicBool) {
    let mut updater = ViewUpdater { view, supervisor, store, version: 0, shown: None };
    while !is_over.load(Ordering::Relaxed) && !view.is_closed() {
        updater.update();
        std::thread::sleep(UPDATE_INTERVAL);
    }
    if let Some(reconstruction) = supervisor.reconstruction() {
        reconstruction.request_evidence(0);
    }
}

struct ViewUpdater<'w> {
    view: &'w Recorder,
    supervisor: &'w SensorSupervisor,
    store: &'w SettingsStore,
    /// Version of the settings that the view has.
    version: u64,
    shown: Option<Arc<PublishedMap>>,
}

impl ViewUpdater<'_> {
    fn update(&mut self) {
        let (Some(header), Some(reconstruction)) = (self.supervisor.sensor(), self.supervisor.reconstruction()) else {
            return;
        };
        let search = reconstruction.counters().mapper.engine.search;
        if let Some(settings) = self.store.newer_than(&mut self.version) {
            self.view.record_info(RecordingInfo::live(header, &settings, search));
            reconstruction.request_evidence(VOXELS);
        }
        let (pose, frame_ns) = self.supervisor.newest();
        let head = pose.and_then(|pose| Some((pose.time_ns, pose.tracking_from_head().ok()?)));
        let Some((now_ns, head)) = head else { return };
        self.view.record_head(now_ns, head, frame_ns);
        let published = reconstruction.latest();
        let is_new = !self.shown.as_ref().is_some_and(|shown| Arc::ptr_eq(&shown.scene, &published.scene));
        if is_new {
            let (health, evidence) = (health(&published, reconstruction), reconstruction.take_evidence());
            self.view.record_update(now_ns, (*published.scene).clone(), health, evidence);
            self.shown = Some(published);
        }
    }
}

fn health(published: &PublishedMap, reconstruction: &Reconstruction) -> Health {
    let calibration = published.calibration.as_ref();
    Health {
        counters: reconstruction.counters().mapper,
        time_offset_s: calibration.map_or(0.0, |calibration| calibration.time_offset_s),
        estimate: calibration.and_then(|calibration| calibration.time_offset_estimate),
    }
}

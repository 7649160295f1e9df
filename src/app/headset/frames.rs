//! The frame loop; see the parent module's documentation.

use crate::app::SensorSupervisor;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError};
use std::time::Duration;

use super::anchor::{Anchor, AnchorChange, LeapDetector};
use super::cue_output::CueOutput;
use super::dashboard::{Dashboard, Facts, PanelSources, PanelWorker};
use super::display::{ShowError, Viewpoint, WarningDisplay};
use super::graphics::{DrawFaults, Graphics, LostDevices, Retry};
use super::map_autosave::{MapAutosave, MapStore};
use super::meter::{FrameMeter, FrameTimes};
use super::pose_thread::{RoomFrame, SharedFrame, read_poses};
use super::runtime_monitor::RuntimeMonitor;
use super::samples::{HandSampler, poses_now, sample, wearer};
use super::status::{Ending, HeadsetError, HeadsetReport, HeadsetStatus};
use crate::app::{CoreWait, Reconstruction, SettingsStore, now_ns, thread_cpu_ns};
use crate::openvr::{DisplayTiming, Hands, Poses, Runtime, RuntimeEvent, Universe};
use crate::render::RenderError;
use crate::settings::Settings;
use crate::warning::WarningTracker;
use radar_mapping::{Event, Scene};
use radar_sar::geometry::Pose;

/// Interval of checks of the standing universe, nanoseconds; an event triggers one at once. Choice.
const CHECK_INTERVAL_NS: i64 = 100_000_000;
/// Longest age of a head pose for drawing, nanoseconds. Choice: panels are fixed in the room.
const MAX_HEAD_AGE_NS: i64 = 1_000_000_000;
/// Interval of the shared status, nanoseconds. Choice.
const STATUS_INTERVAL_NS: i64 = 250_000_000;

/// Pictures and devices that must outlive the session, because the runtime may copy from them until
/// then.
pub struct RetainedGraphics {
    _pictures: Vec<Arc<wgpu::Texture>>,
    _graphics: Option<Graphics>,
    _lost: LostDevices,
}

/// Inputs and outputs of the loop.
pub struct FrameLoop<'a> {
    /// The session.
    pub runtime: &'a Arc<Runtime>,
    /// The sensor and the reconstruction.
    pub supervisor: &'a SensorSupervisor,
    /// Where maps are saved from one start to the next; `None`: nowhere.
    pub maps: Option<&'a MapStore>,
    /// Settings, which may change at any time.
    pub settings: &'a SettingsStore,
    /// Ends the loop.
    pub stop: &'a AtomicBool,
}

impl FrameLoop<'_> {
    /// Runs until asked to end, or SteamVR quits or is gone. All overlays are destroyed when it
    /// returns; the caller drops the returned graphics device after the session.
    ///
    /// # Errors
    /// There is no graphics device that the runtime accepts, or no overlays: another instance may
    /// have them.
    pub fn run(&self) -> Result<(HeadsetReport, RetainedGraphics), HeadsetError> {
        let graphics = Graphics::open(self.runtime)?;
        log::info!("drawing on {}", graphics.device.name);
        let frame = SharedFrame::new(None);
        let done = AtomicBool::new(false);
        let (mut state, panel) = LoopState::new(self, graphics, &frame)?;
        let poses_hz = state.settings.headset.poses_hz;
        std::thread::scope(|scope| {
            let _done = DoneGuard(&done);
            let &Self { settings: store, supervisor, .. } = self;
            // It ends with the state.
            scope.spawn(move || panel.run(&PanelSources { store, supervisor }));
            if poses_hz > 0.0 {
                let (runtime, frame, done) = (self.runtime, &frame, &done);
                let sink = |event| supervisor.push(event);
                scope.spawn(move || read_poses(runtime, frame, poses_hz, &sink, done));
            }
            if let Some(maps) = self.maps {
                let keeper = MapAutosave { maps, frame: &frame, supervisor, settings: store };
                let done = &done;
                scope.spawn(move || keeper.run(done));
            }
            let ending = state.run();
            let (status, rest) = state.end();
            Ok((HeadsetReport { ending, status }, rest))
        })
    }
}

/// Ends the helper threads when the loop ends for any reason.
struct DoneGuard<'d>(&'d AtomicBool);

impl Drop for DoneGuard<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

struct LoopState<'s, 'a> {
    with: &'s FrameLoop<'a>,
    dashboard: Dashboard,
    /// `None` while the device is lost.
    graphics: Option<Graphics>,
    retry: Retry,
    faults: DrawFaults,
    lost: LostDevices,
    shown: WarningDisplay,
    /// Pictures of the previous display mode.
    released: Vec<Arc<wgpu::Texture>>,
    shared_frame: &'s SharedFrame,
    anchor: Option<Anchor>,
    leap: LeapDetector,
    /// How often the raw universe has leapt.
    leaps: u64,
    /// How often the user requested a map reset.
    map_resets: u64,
    checked_ns: i64,
    monitor: RuntimeMonitor,
    settings: Arc<Settings>,
    settings_version: u64,
    timing: DisplayTiming,
    hands: Hands,
    hand_sampler: HandSampler,
    /// Last head pose in the standing universe, and its time.
    head: Option<(i64, Pose)>,
    scene: PlacedScene,
    cues: CueOutput,
    meter: FrameMeter,
    status: HeadsetStatus,
    status_ns: i64,
}

impl<'s, 'a> LoopState<'s, 'a> {
    fn new(
        with: &'s FrameLoop<'a>,
        graphics: Graphics,
        shared_frame: &'s SharedFrame,
    ) -> Result<(Self, PanelWorker), HeadsetError> {
        let timing = with.runtime.display_timing();
        let mut settings_version = 0;
        let settings = with.settings.newer_than(&mut settings_version).unwrap_or_else(|| with.settings.newest());
        let (dashboard, panel) = Dashboard::new(with.runtime);
        let state = Self {
            with,
            dashboard,
            graphics: Some(graphics),
            retry: Retry::default(),
            faults: DrawFaults::default(),
            lost: LostDevices::default(),
            shown: WarningDisplay::new(with.runtime, &settings)?,
            released: Vec::new(),
            shared_frame,
            anchor: None,
            leap: LeapDetector::default(),
            leaps: 0,
            map_resets: 0,
            checked_ns: i64::MIN,
            monitor: RuntimeMonitor::default(),
            settings,
            settings_version,
            timing,
            hands: with.runtime.hands(),
            hand_sampler: HandSampler::default(),
            head: None,
            scene: PlacedScene::default(),
            cues: CueOutput::default(),
            meter: FrameMeter::new(timing.frame_hz),
            status: HeadsetStatus::default(),
            status_ns: 0,
        };
        Ok((state, panel))
    }

    fn run(&mut self) -> Ending {
        let period = Duration::from_secs_f64(1.0 / self.timing.frame_hz);
        let core_wait = CoreWait::of_this_thread();
        let (mut last_ns, mut last_waited_ns) = (now_ns(), core_wait.total_ns());
        loop {
            self.wait(period, last_ns);
            let (start_ns, cpu_ns, start_waited_ns) = (now_ns(), thread_cpu_ns(), core_wait.total_ns());
            last_ns = start_ns;
            if self.with.stop.load(Ordering::Relaxed) {
                return Ending::Asked;
            }
            if self.take_events() {
                return Ending::SteamVrQuit;
            }
            if self.monitor.is_due(start_ns) && self.monitor.record(start_ns, self.shown.exist()) {
                return Ending::SteamVrGone;
            }
            self.take_settings();
            self.take_poses(start_ns);
            self.reset_map_if_requested();
            self.show(start_ns);
            self.update_dashboard(start_ns);
            let (end_ns, end_waited_ns) = (now_ns(), core_wait.total_ns());
            self.meter.frame(FrameTimes {
                start_ns,
                end_ns,
                cpu_ns: thread_cpu_ns() - cpu_ns,
                waited_ns: end_waited_ns - start_waited_ns,
                waited_before_ns: start_waited_ns - last_waited_ns,
            });
            last_waited_ns = end_waited_ns;
            self.publish_status(end_ns);
        }
    }

    /// Waits for the next frame; uses our own clock where the runtime does not report it.
    fn wait(&self, period: Duration, last_ns: i64) {
        if !self.with.runtime.wait_frame(2 * period) {
            let since_ns = now_ns().saturating_sub(last_ns).max(0);
            std::thread::sleep(period.saturating_sub(Duration::from_nanos(since_ns as u64)));
        }
    }

    /// Takes events; returns whether SteamVR quits.
    fn take_events(&mut self) -> bool {
        while let Some(event) = self.with.runtime.next_event() {
            match event {
                RuntimeEvent::Quit => {
                    self.with.runtime.acknowledge_quit();
                    return true;
                }
                RuntimeEvent::UniverseMoved => {
                    self.checked_ns = i64::MIN;
                    // The play area may have changed.
                    self.with.settings.recompose();
                }
                RuntimeEvent::ChaperoneChanged => self.with.settings.recompose(),
                RuntimeEvent::DevicesChanged => self.hands = self.with.runtime.hands(),
                RuntimeEvent::Standby | RuntimeEvent::Awake | RuntimeEvent::Other => {}
            }
        }
        false
    }

    /// Applies changed settings to this frame.
    fn take_settings(&mut self) {
        let Some(settings) = self.with.settings.newer_than(&mut self.settings_version) else { return };
        let before = std::mem::replace(&mut self.settings, settings);
        let (was, is) = (&before.headset, &self.settings.headset);
        if (was.display, was.projection_matrix) != (is.display, is.projection_matrix) {
            // The runtime may still copy from these pictures; those of the previous switch are
            // done.
            self.released = self.shown.switch(self.with.runtime, &self.settings, &before);
        }
    }

    fn take_poses(&mut self, now_ns: i64) {
        if now_ns.saturating_sub(self.checked_ns) >= CHECK_INTERVAL_NS {
            self.checked_ns = now_ns;
            self.update_anchor();
        }
        let Some((time_ns, poses)) = poses_now(self.with.runtime, self.hands) else {
            self.status.poses_untimed += 1;
            return;
        };
        self.watch_for_leaps(time_ns, &poses);
        let Some(anchor) = self.anchor else { return };
        if self.settings.headset.poses_hz <= 0.0 {
            self.with.supervisor.push(Event::Pose(sample(time_ns, &poses.head, &anchor.session_from_raw())));
        }
        if let Some(hands) = self.hand_sampler.next(time_ns, &poses, &anchor.session_from_raw()) {
            self.with.supervisor.push(Event::Hands(hands));
        }
        self.status.is_tracked = poses.head.valid_pose().is_some();
    }

    /// Checks the standing universe.
    fn update_anchor(&mut self) {
        let runtime = self.with.runtime;
        let Some(standing_from_raw) = runtime.standing_from_raw() else { return };
        let universe = runtime.universe_id();
        let Some(anchor) = &mut self.anchor else {
            let anchor = Anchor::new(standing_from_raw, universe);
            self.share_frame(&anchor);
            self.anchor = Some(anchor);
            return;
        };
        let before = anchor.universe();
        match anchor.update(standing_from_raw, universe) {
            AnchorChange::Unchanged => {
                // The room's id may have become known only now.
                if anchor.universe() != before {
                    let anchor = *anchor;
                    self.share_frame(&anchor);
                }
            }
            AnchorChange::Recentred => {
                self.status.recentred += 1;
                let anchor = *anchor;
                self.share_frame(&anchor);
            }
            AnchorChange::NewUniverse => {
                let anchor = *anchor;
                self.reset_map(&anchor, "the tracking system reports another room");
            }
        }
    }

    fn watch_for_leaps(&mut self, time_ns: i64, poses: &Poses) {
        match poses.head.valid_pose() {
            None => self.leap.lost(),
            Some(head) if self.leap.push(time_ns, head) => {
                let Some(anchor) = &mut self.anchor else { return };
                anchor.rebase();
                let anchor = *anchor;
                self.leaps += 1;
                self.reset_map(&anchor, "the origin of the tracking system has moved");
            }
            Some(_) => {}
        }
    }

    /// Resets the map: all earlier positions are invalid.
    fn reset_map(&mut self, anchor: &Anchor, why: &str) {
        log::warn!("{why}: the map is reset");
        // No pose of the new frame may reach the old map, and none of the old frame the new map:
        // the pose thread holds this lock until its pose has been pushed.
        let mut frame = self.shared_frame.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(reconstruction) = self.with.supervisor.reconstruction() {
            self.scene.epoch = reconstruction.reset();
        }
        *frame = Some(self.room_frame(anchor));
        drop(frame);
        self.scene.clear();
        self.meter.reset_sweep_age();
        self.head = None;
        self.status.forgotten += 1;
    }

    fn share_frame(&self, anchor: &Anchor) {
        // Written a few times a session; the reader holds it while it reads a pose.
        let shared = self.room_frame(anchor);
        *self.shared_frame.lock().unwrap_or_else(PoisonError::into_inner) = Some(shared);
    }

    fn room_frame(&self, anchor: &Anchor) -> RoomFrame {
        RoomFrame {
            session_from_raw: anchor.session_from_raw(),
            standing_from_raw: anchor.standing_from_raw(),
            universe: anchor.universe(),
            leaps: self.leaps,
            map_resets: self.map_resets,
        }
    }

    /// Resets the map if the user requested it in the panel.
    fn reset_map_if_requested(&mut self) {
        if let Some(anchor) = self.anchor.filter(|_| self.dashboard.take_reset_request()) {
            self.map_resets += 1;
            self.reset_map(&anchor, "the panel's button to forget the room was pressed");
        }
    }

    fn show(&mut self, now_ns: i64) {
        let Some(anchor) = self.anchor else { return };
        let newest = self.take_scene(&anchor);
        let shown = self.show_warnings(now_ns, &anchor);
        if let Err(error) = shown {
            self.status.refused += 1;
            if self.status.refused == 1 {
                log::warn!("{error}");
            }
        }
        if let Some((newest_sweep_ns, sensor_period_ns)) = newest {
            self.meter.shown(newest_sweep_ns, self::now_ns(), sensor_period_ns);
        }
    }

    /// Takes the newest scene in the standing universe; returns the end of its newest sweep and the
    /// length of a sensor frame.
    fn take_scene(&mut self, anchor: &Anchor) -> Option<(i64, i64)> {
        let published = self.with.supervisor.reconstruction()?.latest();
        self.scene.place(&published.scene, published.epoch, &anchor.standing_from_session());
        (published.newest_sweep_ns > 0).then(|| (published.newest_sweep_ns, self.with.supervisor.sensor_period_ns()))
    }

    fn show_warnings(&mut self, now_ns: i64, anchor: &Anchor) -> Result<(), ShowError> {
        let ahead_s = self.with.runtime.time_to_photons_s(&self.timing);
        let poses = self.with.runtime.poses(Universe::Raw, ahead_s, self.hands);
        if let Some(raw_from_head) = poses.head.valid_pose() {
            self.head = Some((now_ns, anchor.raw_from_standing().inverse() * raw_from_head));
        }
        let head = self.head.filter(|(seen_ns, _)| now_ns.saturating_sub(*seen_ns) < MAX_HEAD_AGE_NS);
        let Some((_, standing_from_head)) = head else { return Ok(self.shown.hide()?) };
        if !self.settings.headset.warnings {
            self.status.nearest_m = None;
            return Ok(self.shown.hide()?);
        }
        let wearer = wearer(now_ns, standing_from_head, &poses, &anchor.raw_from_standing());
        let warnings = self.scene.tracker.warn(&wearer, &self.settings.warning);
        self.cues.output(self.with.runtime, self.hands, &warnings, &wearer, &self.settings);
        self.status.nearest_m = warnings.panels.iter().map(|panel| panel.distance_m).min_by(f64::total_cmp);
        if warnings.panels.is_empty() && warnings.footprints.is_empty() {
            return Ok(self.shown.hide()?);
        }
        self.open_graphics(now_ns);
        let Some(graphics) = &mut self.graphics else { return Ok(self.shown.hide()?) };
        let from = Viewpoint { standing_from_head, raw_from_standing: anchor.raw_from_standing() };
        let shown = self.shown.show(graphics, &self.scene.tracker, &warnings, &self.settings, &from);
        self.status.most_picture_bytes = self.status.most_picture_bytes.max(graphics.renderer.texture_bytes());
        if let Err(ShowError::Render(error)) = &shown {
            // The shown pictures stay, except on a lost device.
            return if self.faults.is_lost(now_ns, error) { self.lose_device(error) } else { Ok(()) };
        }
        self.faults.drawn();
        self.status.pictures += shown?;
        Ok(())
    }

    /// The dashboard's part of a frame.
    fn update_dashboard(&mut self, now_ns: i64) {
        if self.dashboard.needs_graphics() {
            self.open_graphics(now_ns);
        }
        let facts = Facts {
            standing_from_head: self.head.map(|(_, head)| head),
            standing_from_session: self.anchor.map(|anchor| anchor.standing_from_session()),
            is_tracked: self.status.is_tracked,
            sensor: self.with.supervisor.sensor_count(),
            is_alive: self.with.supervisor.reconstruction().map(Reconstruction::is_alive),
            may_notify: self.settings.headset.warnings && self.settings.headset.notices,
        };
        if let Err(error) = self.dashboard.update(now_ns, self.graphics.as_ref(), &facts)
            && self.faults.is_lost(now_ns, &error)
            && let Err(error) = self.lose_device(&error)
        {
            log::debug!("{error}");
        }
    }

    /// Reopens a lost device when a retry is due.
    fn open_graphics(&mut self, now_ns: i64) {
        if self.graphics.is_none() && self.retry.is_due(now_ns) {
            match Graphics::open(self.with.runtime) {
                Ok(graphics) => {
                    log::info!("drawing on {}", graphics.device.name);
                    self.graphics = Some(graphics);
                }
                Err(error) => self.retry.failed(&error),
            }
        }
    }

    fn lose_device(&mut self, error: &RenderError) -> Result<(), ShowError> {
        log::warn!("{error}; reopening the graphics device");
        self.status.devices_lost += 1;
        self.shown.drop_pictures();
        self.dashboard.drop_pictures();
        if let Some(lost) = self.graphics.take() {
            self.lost.keep(lost);
        }
        Ok(self.shown.hide()?)
    }

    fn publish_status(&mut self, now_ns: i64) {
        if now_ns.saturating_sub(self.status_ns) < STATUS_INTERVAL_NS {
            return;
        }
        // A reader that holds the lock gets the next update.
        if let Ok(mut seen) = self.with.supervisor.status.try_lock() {
            self.status_ns = now_ns;
            *seen = self.status_now();
        }
    }

    fn status_now(&self) -> HeadsetStatus {
        HeadsetStatus { frames: self.meter.report(), overlays_shown: self.shown.count(), ..self.status }
    }

    /// Destroys the overlays now; pictures and device must outlive the session.
    fn end(self) -> (HeadsetStatus, RetainedGraphics) {
        let status = self.status_now();
        let Self { mut shown, mut released, dashboard, graphics, lost, .. } = self;
        // A runtime that is gone refuses; there is nothing to hide then.
        let _ = shown.hide();
        released.extend(dashboard.end());
        released.extend(shown.end());
        (status, RetainedGraphics { _pictures: released, _graphics: graphics, _lost: lost })
    }
}

/// Tracks the warnings of the newest scene in the current standing universe; transforms the scene
/// only when one of the two changes.
#[derive(Default)]
struct PlacedScene {
    from: Option<(Arc<Scene>, Pose)>,
    tracker: WarningTracker,
    /// Scenes of earlier epochs belong to a map that was reset.
    epoch: u64,
}

impl PlacedScene {
    fn place(&mut self, scene: &Arc<Scene>, epoch: u64, standing_from_session: &Pose) {
        if epoch < self.epoch {
            return;
        }
        if epoch > self.epoch {
            // After a reset, ids belong to other obstacles.
            self.tracker.reset();
        }
        self.epoch = epoch;
        if let Some((placed, by)) = &self.from {
            if Arc::ptr_eq(placed, scene) && by == standing_from_session {
                return;
            }
            if by != standing_from_session {
                // The tracked positions have moved in the play area.
                self.tracker.change_frame();
            }
        }
        self.tracker.update(&scene.moved(standing_from_session));
        self.from = Some((Arc::clone(scene), *standing_from_session));
    }

    fn clear(&mut self) {
        (self.from, self.tracker) = (None, WarningTracker::new());
    }
}

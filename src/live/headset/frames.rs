//! The frame loop. See the room's head (`mod.rs`).

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use super::anchor::{Anchor, AnchorChange, LeapDetector};
use super::cue_output::CueOutput;
use super::dashboard::{Dashboard, Facts, PanelSources, PanelWorker, SensorCount};
use super::display::{ShowError, Viewpoint, WarningDisplay};
use super::graphics::{DrawFaults, Graphics, GraphicsError, LostDevices, Retry};
use super::map_autosave::{MapAutosave, MapStore};
use super::meter::{FrameMeter, FrameReport, FrameTimes};
use super::pose_thread::{RoomFrame, SharedFrame, read_poses};
use super::runtime_monitor::RuntimeMonitor;
use super::samples::{HandSampler, poses_now, sample, wearer};
use crate::live::{CoreWait, Reconstruction, SettingsStore, now_ns, thread_cpu_ns};
use crate::openvr::{DisplayTiming, Event, Hands, OpenVrError, Poses, Runtime, Universe};
use crate::render::RenderError;
use crate::settings::Settings;
use crate::warning::WarningTracker;
use radar_mapping::{HandsSample, Scene};
use radar_sar::PoseSample;
use radar_sar::geometry::Pose;

/// Takes every pose of the head, in the session's frame; must not wait for anything.
pub type PoseSink<'a> = &'a (dyn Fn(&PoseSample) + Sync);

/// Takes where the player's hands are, in the session's frame; must not wait for anything.
pub type HandSink<'a> = &'a (dyn Fn(&HandsSample) + Sync);

/// Between two looks at where the standing universe is, nanoseconds; events bring one forward.
const CHECK_INTERVAL_NS: i64 = 100_000_000;
/// Where the head was last is good for drawing for so long, nanoseconds; what stands in the room stays where it is.
const MAX_HEAD_AGE_NS: i64 = 1_000_000_000;
/// Between two renewals of what others see of the loop, nanoseconds.
const STATUS_INTERVAL_NS: i64 = 250_000_000;

/// Why the loop ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// This program was asked to end.
    Asked,
    /// SteamVR ends.
    SteamVrQuit,
    /// SteamVR went away without a word.
    SteamVrGone,
}

/// Why there is no loop.
#[derive(Debug, thiserror::Error)]
pub enum HeadsetError {
    /// SteamVR.
    #[error(transparent)]
    SteamVr(#[from] OpenVrError),
    /// The graphics device.
    #[error(transparent)]
    Graphics(#[from] GraphicsError),
}

/// What the loop is doing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HeadsetStatus {
    /// Frames and what they cost.
    pub frames: FrameReport,
    /// Whether the head is tracked.
    pub is_tracked: bool,
    /// Overlays shown.
    pub overlays_shown: usize,
    /// To the nearest obstacle that is warned of, metres.
    pub nearest_m: Option<f64>,
    /// Pictures handed over so far.
    pub pictures: u64,
    /// Most memory that pictures of panels took, bytes.
    pub most_picture_bytes: u64,
    /// Times that the user recentred.
    pub recentred: u64,
    /// Times that everything was forgotten: the room was another, or the user wanted it.
    pub forgotten: u64,
    /// Times that the graphics device was lost.
    pub devices_lost: u64,
    /// Calls that the runtime refused.
    pub refused: u64,
    /// Poses that took too long to read to tell when they were.
    pub poses_untimed: u64,
}

/// The loop when it has ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadsetReport {
    /// Why it ended.
    pub ending: Ending,
    /// What it did.
    pub status: HeadsetStatus,
}

/// What was drawn and drawn with: to be dropped when the session is over, since the runtime may copy from it until then.
pub struct RetainedGraphics {
    _pictures: Vec<Arc<wgpu::Texture>>,
    _graphics: Option<Graphics>,
    _lost: LostDevices,
}

/// What the loop works with.
pub struct FrameLoop<'a> {
    /// The session.
    pub runtime: &'a Arc<Runtime>,
    /// The reconstruction, once there is one.
    pub reconstruction: &'a (dyn Fn() -> Option<&'a Reconstruction> + Sync),
    /// Length of a sensor's frame, nanoseconds, for the age of sweeps.
    pub sensor_period_ns: &'a (dyn Fn() -> i64 + Sync),
    /// What came from the sensor so far, once there is one.
    pub sensor: &'a (dyn Fn() -> Option<SensorCount> + Sync),
    /// Where poses go.
    pub pose_sink: PoseSink<'a>,
    /// Where the hands' places go.
    pub hand_sink: HandSink<'a>,
    /// Where maps are kept from one start to the next; `None`: nowhere.
    pub maps: Option<&'a MapStore>,
    /// Settings, which may change at any time.
    pub settings: &'a SettingsStore,
    /// Ends the loop.
    pub stop: &'a AtomicBool,
    /// What others see; renewed four times a second.
    pub status: &'a Mutex<HeadsetStatus>,
}

impl FrameLoop<'_> {
    /// Runs until asked to end, or SteamVR ends or is gone. All overlays are gone when it returns; the graphics device is given back, for the
    /// caller to drop it after the session.
    ///
    /// # Errors
    /// No graphics device that the runtime accepts, no overlays: another instance may have them.
    pub fn run(&self) -> Result<(HeadsetReport, RetainedGraphics), HeadsetError> {
        let graphics = Graphics::open(self.runtime)?;
        log::info!("drawing on {}", graphics.device.name);
        let frame = SharedFrame::new(None);
        let done = AtomicBool::new(false);
        let (mut state, panel) = LoopState::new(self, graphics, &frame)?;
        let poses_hz = state.settings.headset.poses_hz;
        std::thread::scope(|scope| {
            let _done = DoneGuard(&done);
            let &Self { settings: store, reconstruction, .. } = self;
            // It ends when the state does.
            scope.spawn(move || panel.run(&PanelSources { store, reconstruction }));
            if poses_hz > 0.0 {
                let (runtime, frame, sink, done) = (self.runtime, &frame, self.pose_sink, &done);
                scope.spawn(move || read_poses(runtime, frame, poses_hz, sink, done));
            }
            if let Some(maps) = self.maps {
                let keeper = MapAutosave { maps, frame: &frame, reconstruction, settings: store };
                let done = &done;
                scope.spawn(move || keeper.run(done));
            }
            let ending = state.run();
            let (status, rest) = state.end();
            Ok((HeadsetReport { ending, status }, rest))
        })
    }
}

/// Ends the thread that reads poses, however the loop ends.
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
    /// Pictures of a display that was left.
    released: Vec<Arc<wgpu::Texture>>,
    shared_frame: &'s SharedFrame,
    anchor: Option<Anchor>,
    leap: LeapDetector,
    /// Times that the raw universe has leapt.
    leaps: u64,
    /// Times that the user wanted the map to begin anew.
    map_resets: u64,
    checked_ns: i64,
    monitor: RuntimeMonitor,
    settings: Arc<Settings>,
    settings_version: u64,
    timing: DisplayTiming,
    hands: Hands,
    hand_sampler: HandSampler,
    /// Where the head was last, in the standing universe, and when.
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

    /// Until the next frame begins; by our own clock where the runtime does not say.
    fn wait(&self, period: Duration, last_ns: i64) {
        if !self.with.runtime.wait_frame(2 * period) {
            let since_ns = now_ns().saturating_sub(last_ns).max(0);
            std::thread::sleep(period.saturating_sub(Duration::from_nanos(since_ns as u64)));
        }
    }

    /// Whether SteamVR ends.
    fn take_events(&mut self) -> bool {
        while let Some(event) = self.with.runtime.next_event() {
            match event {
                Event::Quit => {
                    self.with.runtime.acknowledge_quit();
                    return true;
                }
                Event::UniverseMoved => {
                    self.checked_ns = i64::MIN;
                    // The play area may be another.
                    self.with.settings.recompose();
                }
                Event::ChaperoneChanged => self.with.settings.recompose(),
                Event::DevicesChanged => self.hands = self.with.runtime.hands(),
                Event::Standby | Event::Awake | Event::Other => {}
            }
        }
        false
    }

    /// What has changed is in force with this frame.
    fn take_settings(&mut self) {
        let Some(settings) = self.with.settings.newer_than(&mut self.settings_version) else { return };
        let before = std::mem::replace(&mut self.settings, settings);
        let (was, is) = (&before.headset, &self.settings.headset);
        if (was.display, was.projection_matrix) != (is.display, is.projection_matrix) {
            // The runtime may still copy from them for a moment; those of the change before are long done with.
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
            (self.with.pose_sink)(&sample(time_ns, &poses.head, &anchor.session_from_raw()));
        }
        if let Some(hands) = self.hand_sampler.next(time_ns, &poses, &anchor.session_from_raw()) {
            (self.with.hand_sink)(&hands);
        }
        self.status.is_tracked = poses.head.valid_pose().is_some();
    }

    /// Where the standing universe is now.
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
                // The room's name may have been told only now.
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
                self.reset_map(&anchor, "this is another room for the tracking system");
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
                self.reset_map(&anchor, "the tracking system has moved the room");
            }
            Some(_) => {}
        }
    }

    /// The places of before mean nothing any more.
    fn reset_map(&mut self, anchor: &Anchor, why: &str) {
        log::warn!("{why}: the map begins anew");
        // No pose of the new frame may reach what is forgotten, none of the old one what begins: the thread that reads poses holds the
        // frame until its pose has gone where it belongs.
        let mut frame = self.shared_frame.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(reconstruction) = (self.with.reconstruction)() {
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
        // Written a few times a session; its reader holds it for as long as a pose is read.
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

    /// The user wants it in the panel.
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

    /// The newest scene in the standing universe; gives the end of the newest sweep behind it.
    fn take_scene(&mut self, anchor: &Anchor) -> Option<(i64, i64)> {
        let published = (self.with.reconstruction)()?.latest();
        self.scene.place(&published.scene, published.epoch, &anchor.standing_from_session());
        (published.newest_sweep_ns > 0).then(|| (published.newest_sweep_ns, (self.with.sensor_period_ns)()))
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
            // What is shown stays as it is, but of a lost device nothing can.
            return if self.faults.is_lost(now_ns, error) { self.lose_device(error) } else { Ok(()) };
        }
        self.faults.drawn();
        self.status.pictures += shown?;
        Ok(())
    }

    /// The panel in the dashboard: its part of a frame.
    fn update_dashboard(&mut self, now_ns: i64) {
        if self.dashboard.needs_graphics() {
            self.open_graphics(now_ns);
        }
        let facts = Facts {
            standing_from_head: self.head.map(|(_, head)| head),
            standing_from_session: self.anchor.map(|anchor| anchor.standing_from_session()),
            is_tracked: self.status.is_tracked,
            sensor: (self.with.sensor)(),
            is_alive: (self.with.reconstruction)().map(Reconstruction::is_alive),
            may_notify: self.settings.headset.warnings && self.settings.headset.notices,
        };
        if let Err(error) = self.dashboard.update(now_ns, self.graphics.as_ref(), &facts)
            && self.faults.is_lost(now_ns, &error)
            && let Err(error) = self.lose_device(&error)
        {
            log::debug!("{error}");
        }
    }

    /// Opens what draws again when it was lost and it is time.
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
        log::warn!("{error}; the graphics device is opened again");
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
        // Whoever reads it right now will see the next.
        if let Ok(mut seen) = self.with.status.try_lock() {
            self.status_ns = now_ns;
            *seen = self.status_now();
        }
    }

    fn status_now(&self) -> HeadsetStatus {
        HeadsetStatus { frames: self.meter.report(), overlays_shown: self.shown.count(), ..self.status }
    }

    /// Overlays go now; pictures and device after the session, which may still copy from them.
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

/// The newest scene as it is watched, in the standing universe of now; moved again only when either changes.
#[derive(Default)]
struct PlacedScene {
    from: Option<(Arc<Scene>, Pose)>,
    tracker: WarningTracker,
    /// Scenes of before are of another room.
    epoch: u64,
}

impl PlacedScene {
    fn place(&mut self, scene: &Arc<Scene>, epoch: u64, standing_from_session: &Pose) {
        if epoch < self.epoch {
            return;
        }
        if epoch > self.epoch {
            // Begun anew: things that were known are others now.
            self.tracker.reset();
        }
        self.epoch = epoch;
        if let Some((placed, by)) = &self.from {
            if Arc::ptr_eq(placed, scene) && by == standing_from_session {
                return;
            }
            if by != standing_from_session {
                // What it holds on to stands elsewhere in the play area now.
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

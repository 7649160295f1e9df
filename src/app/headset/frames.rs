//! The frame loop; see the parent module's documentation.

use crate::app::SensorSupervisor;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::Builder;
use std::time::Duration;

use super::anchor::{Anchor, AnchorChange};
use super::cue_output::CueOutput;
use super::dashboard::{Dashboard, Facts, PanelSources, PanelWorker};
use super::display::{ShowError, Viewpoint, WarningDisplay};
use super::display_monitor::{DisplayChange, DisplayMonitor};
use super::graphics::{DrawDevice, Graphics, LostDevices};
use super::map_autosave::{MapAutosave, MapStore};
use super::meter::{FrameMeter, FrameTimes};
use super::pose_thread::{SharedFrame, read_poses};
use super::runtime_monitor::RuntimeMonitor;
use super::samples::{HandSampler, poses_now, sample, wearer};
use super::session_frame::SessionFrame;
use super::status::{Ending, HeadsetError, HeadsetReport, HeadsetStatus};
use crate::app::watchdog::Heartbeat;
use crate::app::{CoreWait, PublishedMap, Reconstruction, SettingsStore, now_ns, thread_cpu_ns};
use crate::openvr::{DisplayTiming, Hands, Runtime, RuntimeEvent, Universe, time_in_runtime_ns};
use crate::render::RenderError;
use crate::settings::{Display, Settings};
use crate::warning::WarningTracker;
use radar_mapping::{Event, Scene};
use radar_sar::geometry::Pose;

/// Longest age of a head pose for drawing, nanoseconds. Choice: panels are fixed in the room.
const MAX_HEAD_AGE_NS: i64 = 1_000_000_000;
/// Interval of the shared status, nanoseconds. Choice: the panel's numbers change no faster than
/// one reads, and the lock is rarely taken.
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
    /// Whether the notice of the first session is due.
    pub welcome: bool,
    /// Shows that the loop runs.
    pub heartbeat: &'a Heartbeat,
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
        let poses_hz = state.settings.now.headset.poses_hz;
        std::thread::scope(|scope| {
            let _done = DoneGuard(&done);
            let &Self { settings: store, supervisor, .. } = self;
            // It ends with the state.
            named("dashboard panel").spawn_scoped(scope, move || panel.run(&PanelSources { store, supervisor }))?;
            if poses_hz > 0.0 {
                let (runtime, frame, done) = (self.runtime, &frame, &done);
                let sink = |event| supervisor.push(event);
                named("head poses").spawn_scoped(scope, move || read_poses(runtime, frame, poses_hz, &sink, done))?;
            }
            if let Some(maps) = self.maps {
                let autosave = MapAutosave { maps, frame: &frame, supervisor, settings: store };
                let done = &done;
                named("map autosave").spawn_scoped(scope, move || autosave.run(done))?;
            }
            let ending = state.run();
            let (status, rest) = state.end();
            Ok((HeadsetReport { ending, status }, rest))
        })
    }
}

/// A thread of this name.
fn named(name: &str) -> Builder {
    Builder::new().name(name.to_owned())
}

/// Ends the helper threads when the loop ends for any reason.
struct DoneGuard<'d>(&'d AtomicBool);

impl Drop for DoneGuard<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// State of the loop: one part for each of its concerns.
struct LoopState<'s, 'a> {
    with: &'s FrameLoop<'a>,
    dashboard: Dashboard,
    device: DrawDevice,
    shown: WarningDisplay,
    display: DisplayMonitor,
    frame: SessionFrame<'s>,
    monitor: RuntimeMonitor,
    settings: CurrentSettings,
    timing: DisplayTiming,
    hands: Hands,
    hand_sampler: HandSampler,
    /// Last head pose in the standing universe, and its time.
    head: Option<(i64, Pose)>,
    scene: PlacedScene,
    cues: CueOutput,
    status: StatusReport,
}

/// Settings of this frame.
struct CurrentSettings {
    now: Arc<Settings>,
    version: u64,
}

impl CurrentSettings {
    fn new(store: &SettingsStore) -> Self {
        let mut version = 0;
        Self { now: store.newer_than(&mut version).unwrap_or_else(|| store.newest()), version }
    }

    /// Takes changed settings; returns those of before.
    fn update(&mut self, store: &SettingsStore) -> Option<Arc<Settings>> {
        let newer = store.newer_than(&mut self.version)?;
        Some(std::mem::replace(&mut self.now, newer))
    }
}

/// Status of the loop and when it was last published.
struct StatusReport {
    meter: FrameMeter,
    now: HeadsetStatus,
    published_ns: i64,
}

impl StatusReport {
    fn current(&self, overlays_shown: usize) -> HeadsetStatus {
        HeadsetStatus { frames: self.meter.report(), overlays_shown, ..self.now }
    }
}

impl<'s, 'a> LoopState<'s, 'a> {
    fn new(
        with: &'s FrameLoop<'a>,
        graphics: Graphics,
        shared_frame: &'s SharedFrame,
    ) -> Result<(Self, PanelWorker), HeadsetError> {
        let timing = with.runtime.display_timing();
        let settings = CurrentSettings::new(with.settings);
        let (dashboard, panel) = Dashboard::new(with.runtime, with.welcome);
        let (meter, now) = (FrameMeter::new(timing.frame_hz), HeadsetStatus::default());
        let shown = WarningDisplay::new(with.runtime, &settings.now)?;
        let state = Self {
            with,
            dashboard,
            device: DrawDevice::new(graphics),
            display: DisplayMonitor::new(shown.mode() == settings.now.headset.display),
            shown,
            frame: SessionFrame::new(shared_frame),
            monitor: RuntimeMonitor::default(),
            settings,
            timing,
            hands: with.runtime.hands(),
            hand_sampler: HandSampler::default(),
            head: None,
            scene: PlacedScene::default(),
            cues: CueOutput::default(),
            status: StatusReport { meter, now, published_ns: 0 },
        };
        Ok((state, panel))
    }

    fn run(&mut self) -> Ending {
        self.with.settings.set_game(self.with.runtime.shown_game());
        let period = Duration::from_secs_f64(1.0 / self.timing.frame_hz);
        let core_wait = CoreWait::of_this_thread();
        let (mut last_ns, mut last_waited_ns) = (now_ns(), core_wait.total_ns());
        loop {
            self.wait(period, last_ns);
            let (start_ns, cpu_ns, start_waited_ns) = (now_ns(), thread_cpu_ns(), core_wait.total_ns());
            let runtime_ns = time_in_runtime_ns();
            last_ns = start_ns;
            self.with.heartbeat.beat(start_ns);
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
            self.status.meter.frame(FrameTimes {
                start_ns,
                end_ns,
                cpu_ns: thread_cpu_ns() - cpu_ns,
                in_runtime_ns: time_in_runtime_ns() - runtime_ns,
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
                    self.frame.check_soon();
                    // The play area may have changed.
                    self.with.settings.recompose();
                }
                RuntimeEvent::ChaperoneChanged => self.with.settings.recompose(),
                RuntimeEvent::GameChanged => self.with.settings.set_game(self.with.runtime.shown_game()),
                RuntimeEvent::DevicesChanged => self.hands = self.with.runtime.hands(),
                RuntimeEvent::Standby | RuntimeEvent::Awake | RuntimeEvent::Other => {}
            }
        }
        false
    }

    /// Applies changed settings to this frame.
    fn take_settings(&mut self) {
        let Some(before) = self.settings.update(self.with.settings) else { return };
        let (was, is) = (&before.headset, &self.settings.now.headset);
        if (was.display, was.projection_matrix) != (is.display, is.projection_matrix) {
            self.shown.switch(self.with.runtime, &self.settings.now);
            self.display = DisplayMonitor::new(self.shown.mode() == self.settings.now.headset.display);
        }
    }

    fn take_poses(&mut self, now_ns: i64) {
        match self.frame.check(self.with.runtime, now_ns) {
            AnchorChange::Unchanged => {}
            AnchorChange::Recentred => self.status.now.recentred += 1,
            AnchorChange::NewUniverse => self.reset_map("the tracking system reports another room"),
        }
        let Some((time_ns, poses)) = poses_now(self.with.runtime, self.hands) else {
            self.status.now.poses_untimed += 1;
            return;
        };
        if self.frame.has_leapt(time_ns, &poses) {
            self.reset_map("the origin of the tracking system has moved");
        }
        let Some(anchor) = self.frame.anchor() else { return };
        if self.settings.now.headset.poses_hz <= 0.0 {
            self.with.supervisor.push(Event::Pose(sample(time_ns, &poses.head, &anchor.session_from_raw())));
        }
        if let Some(hands) = self.hand_sampler.next(time_ns, &poses, &anchor.session_from_raw()) {
            self.with.supervisor.push(Event::Hands(hands));
        }
        self.status.now.is_tracked = poses.head.valid_pose().is_some();
    }

    /// Resets the map: all earlier positions are invalid.
    fn reset_map(&mut self, why: &str) {
        log::warn!("{why}: the map is reset");
        let mut shared = self.frame.lock();
        if let Some(reconstruction) = self.with.supervisor.reconstruction() {
            self.scene.epoch = reconstruction.reset();
        }
        *shared = self.frame.room_frame();
        drop(shared);
        self.scene.clear();
        self.status.meter.reset_sweep_age();
        self.head = None;
        self.status.now.forgotten += 1;
    }

    /// Resets the map if the user requested it in the panel.
    fn reset_map_if_requested(&mut self) {
        if self.frame.anchor().is_some() && self.dashboard.take_reset_request() {
            self.frame.count_map_reset();
            self.reset_map("the panel's button to forget the room was pressed");
        }
    }

    fn show(&mut self, now_ns: i64) {
        let Some(anchor) = self.frame.anchor() else { return };
        let newest = self.take_scene(&anchor);
        if let Err(error) = self.show_warnings(now_ns, &anchor) {
            self.count_refusal(&error);
        }
        if let Some((newest_sweep_ns, sensor_period_ns)) = newest {
            self.status.meter.shown(newest_sweep_ns, self::now_ns(), sensor_period_ns);
        }
    }

    /// Takes the newest scene in the standing universe; returns the end of its newest sweep and the
    /// length of a sensor frame.
    fn take_scene(&mut self, anchor: &Anchor) -> Option<(i64, i64)> {
        let published = self.with.supervisor.reconstruction()?.latest();
        self.scene.place(&published, &anchor.standing_from_session());
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
        if !self.settings.now.headset.warnings {
            self.status.now.nearest_m = None;
            return Ok(self.shown.hide()?);
        }
        let wearer = wearer(now_ns, standing_from_head, &poses, &anchor.raw_from_standing());
        let warnings = self.scene.tracker.warn(&wearer, &self.settings.now.warning);
        let cues = self.display.cues(&self.settings.now.cues);
        self.cues.output(
            self.with.runtime,
            self.hands,
            &warnings,
            &wearer,
            self.settings.now.warning.brightness,
            &cues,
        );
        self.status.now.nearest_m = warnings.panels.iter().map(|panel| panel.distance_m).min_by(f64::total_cmp);
        if warnings.panels.is_empty() && warnings.footprints.is_empty() {
            return Ok(self.shown.hide()?);
        }
        self.device.reopen(self.with.runtime, now_ns);
        let Some(graphics) = self.device.get_mut() else { return Ok(self.shown.hide()?) };
        let from = Viewpoint { standing_from_head, raw_from_standing: anchor.raw_from_standing() };
        let shown = self.shown.show(graphics, &self.scene.tracker, &warnings, &self.settings.now, &from);
        self.status.now.most_picture_bytes = self.status.now.most_picture_bytes.max(graphics.renderer.texture_bytes());
        if let Err(ShowError::Render(error)) = &shown {
            // The shown pictures stay, except on a lost device.
            return if self.device.is_lost(now_ns, error) { self.lose_device(error) } else { Ok(()) };
        }
        self.device.drawn();
        self.follow_refusals(now_ns, shown.as_ref().err());
        self.status.now.pictures += shown?;
        Ok(())
    }

    /// Falls back to another way to warn if the runtime refuses this one for good.
    fn follow_refusals(&mut self, now_ns: i64, refusal: Option<&ShowError>) {
        let why = refusal.map_or(String::new(), ToString::to_string);
        match self.display.frame(now_ns, refusal.is_some(), self.shown.mode() == Display::Panels) {
            DisplayChange::None => {}
            DisplayChange::ToPanels => {
                log::warn!("{why}. Panels are shown instead of the display mode of the settings");
                self.shown.switch_to_panels(self.with.runtime, &self.settings.now);
            }
            DisplayChange::ToCues => {
                log::error!("no warnings can be shown: {why}. Tones and pulses warn instead; restart SteamVR");
            }
            DisplayChange::ToDisplay => log::info!("the VR runtime shows warnings again"),
        }
    }

    fn count_refusal(&mut self, error: &ShowError) {
        self.status.now.refused += 1;
        if self.status.now.refused == 1 {
            log::warn!("{error}");
        }
    }

    /// The dashboard's part of a frame.
    fn update_dashboard(&mut self, now_ns: i64) {
        if self.dashboard.needs_graphics() {
            self.device.reopen(self.with.runtime, now_ns);
        }
        self.status.now.output = self.display.output();
        let facts = Facts {
            standing_from_head: self.head.map(|(_, head)| head),
            standing_from_session: self.frame.anchor().map(|anchor| anchor.standing_from_session()),
            is_tracked: self.status.now.is_tracked,
            sensor: self.with.supervisor.sensor_count(),
            is_alive: self.with.supervisor.reconstruction().map(Reconstruction::is_alive),
            output: self.status.now.output,
            may_notify: self.settings.now.headset.warnings && self.settings.now.headset.notices,
        };
        if let Err(error) = self.dashboard.update(now_ns, self.device.get(), &facts)
            && self.device.is_lost(now_ns, &error)
            && let Err(error) = self.lose_device(&error)
        {
            log::debug!("{error}");
        }
    }

    fn lose_device(&mut self, error: &RenderError) -> Result<(), ShowError> {
        log::warn!("{error}; reopening the graphics device");
        self.status.now.devices_lost += 1;
        self.shown.drop_pictures();
        self.dashboard.drop_pictures();
        self.device.lose();
        Ok(self.shown.hide()?)
    }

    fn publish_status(&mut self, now_ns: i64) {
        if now_ns.saturating_sub(self.status.published_ns) < STATUS_INTERVAL_NS {
            return;
        }
        // A reader that holds the lock gets the next update.
        if let Ok(mut seen) = self.with.supervisor.status.try_lock() {
            self.status.published_ns = now_ns;
            *seen = self.status.current(self.shown.count());
        }
    }

    /// Destroys the overlays now; pictures and device must outlive the session.
    fn end(self) -> (HeadsetStatus, RetainedGraphics) {
        let is_welcomed = self.dashboard.has_welcomed();
        let status = HeadsetStatus { is_welcomed, ..self.status.current(self.shown.count()) };
        let Self { mut shown, dashboard, device, .. } = self;
        // A runtime that is gone refuses; there is nothing to hide then.
        let _ = shown.hide();
        let pictures = [dashboard.end(), shown.end()].concat();
        let (graphics, lost) = device.end();
        (status, RetainedGraphics { _pictures: pictures, _graphics: graphics, _lost: lost })
    }
}

/// Tracks the warnings of the newest scene in the current standing universe; transforms the scene
/// only when one of the two changes. `from`: the scene, how often its frame had jumped, and the transform.
#[derive(Default)]
struct PlacedScene {
    from: Option<(Arc<Scene>, u64, Pose)>,
    tracker: WarningTracker,
    /// Scenes of earlier epochs belong to a map that was reset.
    epoch: u64,
}

impl PlacedScene {
    fn place(&mut self, published: &PublishedMap, standing_from_session: &Pose) {
        let PublishedMap { scene, epoch, tracking_jumps, .. } = published;
        if *epoch < self.epoch {
            return;
        }
        if *epoch > self.epoch {
            // After a reset, ids belong to other obstacles.
            self.tracker.reset();
        }
        self.epoch = *epoch;
        if let Some((placed, jumps, by)) = &self.from {
            if Arc::ptr_eq(placed, scene) && by == standing_from_session {
                return;
            }
            if by != standing_from_session || jumps != tracking_jumps {
                // The tracked positions have moved in the play area.
                self.tracker.change_frame();
            }
        }
        self.tracker.update(&scene.moved(standing_from_session));
        self.from = Some((Arc::clone(scene), *tracking_jumps, *standing_from_session));
    }

    fn clear(&mut self) {
        (self.from, self.tracker) = (None, WarningTracker::new());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::handover::OfEpoch;
    use crate::warning::{WarningSettings, Wearer};
    use glam::{DMat3, DQuat, DVec3};
    use radar_mapping::{Observed, Obstacle};

    /// A column before the wearer.
    fn scene() -> Scene {
        let shape = (0..200).map(|i| (DVec3::new(f64::from(i % 10) * 0.05, f64::from(i / 10) * 0.05, -0.8), 1.0));
        let column = Obstacle {
            id: 1,
            position_m: DVec3::new(0.25, 0.5, -0.8),
            covariance_m2: DMat3::IDENTITY * 1e-6,
            observed: Observed::Position,
            extent_m: DVec3::ZERO,
            evidence: 10.0,
            shape: shape.collect(),
            provisional: false,
            first_seen_ns: 0,
            last_seen_ns: 0,
        };
        Scene { obstacles: vec![column], ..Scene::default() }
    }

    /// How bright the warning is after the wearer has stood still for four seconds, and 0.3 s after the tracking frame has jumped.
    fn brightness(jumps: u64) -> [f64; 2] {
        let jump = Pose::new(DVec3::new(0.08, -0.02, 0.06), DQuat::from_rotation_y(0.087));
        let mut placed = PlacedScene::default();
        let mut warn = |published: &PublishedMap, head: &Pose, frame: i64| {
            placed.place(published, &Pose::IDENTITY);
            let warnings =
                placed.tracker.warn(&Wearer::head_only(frame * 11_000_000, *head), &WarningSettings::default());
            f64::from(warnings.panels[0].alpha)
        };
        let head = Pose::from_translation(DVec3::new(0.0, 1.6, 0.0));
        let before = PublishedMap { scene: Arc::new(scene()), ..PublishedMap::nothing(0) };
        let first = (1..400).map(|frame| warn(&before, &head, frame)).last().unwrap();
        let after = PublishedMap { scene: Arc::new(scene().moved(&jump)), tracking_jumps: jumps, ..before };
        [first, (400..430).map(|frame| warn(&after, &(jump * head), frame)).last().unwrap()]
    }

    #[test]
    fn a_jump_of_the_tracking_frame_does_not_change_warnings() {
        let [before, after] = brightness(1);
        assert!((after / before - 1.0).abs() < 0.02, "{before} {after}");
        let [before, moved] = brightness(0);
        assert!((moved / before - 1.0).abs() > 0.05, "what moved itself is another warning: {before} {moved}");
    }
}

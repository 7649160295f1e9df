//! Sessions with SteamVR: connects, starts the sensor's thread and the frame loop, and reports.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::Builder;
use std::time::Duration;

use anyhow::{Result, anyhow, bail};
use radar_recording::MapFolder;

use super::folders::user_folder;
use super::instance::Instance;
use super::mount_memory::MountMemory;
use super::platform::exit_now;
use super::registration::check_registration;
use super::sensor_supervisor::{ChooseSensor, SensorSupervisor, SupervisorPlan};
use super::session_report::{SessionReport, print_report};
use super::session_view;
use super::stop::stop_flag;
use super::watchdog::{Hang, Heartbeat};
use super::welcome;
use super::{Ending, FrameLoop, HeadsetReport, MapStore, SettingsStore, now_ns};
use super::{raise_priority_of_this_thread, refine_timers};
use crate::openvr::{Chaperone, OpenVrError, Role, Runtime, RuntimePaths};
use crate::settings::Settings;
use crate::viewer::Recorder;

/// Interval of checks for SteamVR. Choice: each check connects as a background application, which
/// loads the runtime's library.
const RETRY_INTERVAL: Duration = Duration::from_secs(1);
/// A runtime that still accepts connections after this time does not close, nanoseconds. Choice: SteamVR kills programs that have
/// not ended 5 s after its request, and then ends itself; with reserve.
const MAX_CLOSING_NS: i64 = 20_000_000_000;
/// Reaction time to a stop while waiting. Choice: shorter than one perceives.
const STOP_POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Longest wait for a board to stop when nothing is recorded. Choice: a sensor that does not answer
/// must not delay the end of the program that SteamVR waits for.
const MAX_STOP: Duration = Duration::from_millis(600);
/// Longest wait for the end of a recording. Choice: the stream's 30 s without events and the
/// board's 5 s fit; a recording that is abandoned lacks its index.
const MAX_RECORDING_STOP: Duration = Duration::from_secs(40);

/// Result of the sensor's thread, once it is over.
type SensorEnd = Mutex<Receiver<Result<()>>>;

/// What a run with SteamVR does.
pub struct SessionOptions {
    /// Waits for SteamVR if it does not run yet, and again after it has ended.
    pub wait: bool,
    /// Records frames and poses into this file.
    pub record: Option<PathBuf>,
    /// Writes counters and costs when it ends.
    pub report: Option<PathBuf>,
    /// Removes the saved maps of the rooms in which it runs.
    pub forget: bool,
    /// Shows the map in a window on the desktop.
    pub view: bool,
    /// Settings file that is followed while it runs; it need not exist.
    pub settings_file: Option<PathBuf>,
    /// Settings that override the file, as `name=value`.
    pub overrides: Vec<String>,
    /// Finds the sensor.
    pub choose_sensor: ChooseSensor,
}

impl SessionOptions {
    /// Runs sessions until asked to stop, or until SteamVR ends.
    ///
    /// # Errors
    /// Another instance runs, SteamVR is missing or was lost, or a session fails.
    pub fn run(&self) -> Result<()> {
        let _instance = Instance::claim()?;
        let stop = stop_flag()?;
        refine_timers();
        match self.view {
            true => session_view::show(&stop, |recorder| self.sessions(&stop, Some(&recorder))),
            false => self.sessions(&stop, None),
        }
    }

    /// Runs sessions until the end.
    fn sessions(&self, stop: &AtomicBool, view: Option<&Recorder>) -> Result<()> {
        let folder = user_folder("XDG_DATA_HOME", ".local/share").map(|folder| MapFolder::new(folder.join("maps")));
        let maps = folder.map(|folder| MapStore::new(folder, self.forget));
        let mut closing = None;
        loop {
            let Some(runtime) = self.connect(stop, closing)? else { return Ok(()) };
            let ending = self.run_session(runtime, stop, view, maps.as_ref())?;
            // A recording covers one session.
            let is_again = self.wait && self.record.is_none() && ending != Ending::Asked;
            closing = Some(Closing::begin(now_ns()));
            match ending {
                _ if is_again => outln!("SteamVR has ended: waiting for it")?,
                Ending::SteamVrGone => bail!("SteamVR exited unexpectedly: it was killed or has crashed"),
                Ending::SteamVrQuit => return outln!("SteamVR has ended"),
                Ending::Asked => return Ok(()),
            }
        }
    }

    /// Connects to SteamVR; `None`: asked to stop while waiting. Never starts SteamVR, which a
    /// session that draws would do, and leaves one in peace that is `closing`.
    fn connect(&self, stop: &AtomicBool, mut closing: Option<Closing>) -> Result<Option<Runtime>> {
        let mut printed = None;
        while !stop.load(Ordering::Relaxed) {
            let paths = RuntimePaths::find()?;
            let there = Runtime::start(&paths, Role::Background).map(drop);
            let is_closing = closing.as_mut().is_some_and(|closing| closing.is_still(now_ns(), there.is_ok()));
            match there
                .and_then(|()| if is_closing { Ok(None) } else { Runtime::start(&paths, Role::Overlay).map(Some) })
            {
                Ok(Some(runtime)) => return Ok(Some(runtime)),
                Ok(None) => {}
                Err(error) if !(self.wait && is_transient(&error)) => return Err(error.into()),
                Err(error) if printed.as_ref() != Some(&error) => {
                    outln!("Waiting for SteamVR: {error}")?;
                    printed = Some(error);
                }
                Err(_) => {}
            }
            let mut waited = Duration::ZERO;
            while waited < RETRY_INTERVAL && !stop.load(Ordering::Relaxed) {
                std::thread::sleep(STOP_POLL_INTERVAL);
                waited += STOP_POLL_INTERVAL;
            }
        }
        Ok(None)
    }

    /// Runs one session. Order of the shutdown: overlays, session, graphics, sensor.
    fn run_session(
        &self,
        runtime: Runtime,
        stop: &AtomicBool,
        view: Option<&Recorder>,
        maps: Option<&MapStore>,
    ) -> Result<Ending> {
        outln!("{}, {}", runtime.name_and_version(), runtime.headset_name())?;
        check_registration(&runtime);
        let runtime = Arc::new(runtime);
        let session = Arc::clone(&runtime);
        let compose = move |text: &str, changes: &[String], game: Option<&str>| {
            compose(&session.chaperone(), text, changes, game)
        };
        let (store, work) =
            SettingsStore::new(self.settings_file.clone(), &self.overrides, &compose).map_err(|why| anyhow!(why))?;
        let memory = MountMemory::new(&runtime.headset_name());
        let tracking = &store.newest().tracking;
        if tracking.mount.is_none() && !tracking.estimate_mount {
            log::warn!(
                "no mount is given and none is estimated: the sensor is assumed at the middle of the headset's front, and obstacles \
                 are displaced by any difference. Give --mount x,y,z, or set tracking.estimate_mount = true"
            );
        }
        let plan = SupervisorPlan::new(Arc::clone(&self.choose_sensor), self.record.clone(), memory);
        let (supervisor, sensor_end) = SensorSupervisor::start(plan, &store.newest())?;
        let sensor_end = Mutex::new(sensor_end);
        let on_new = |before: &Settings, new: &Settings| apply_settings(&supervisor, before, new);
        let no_more = AtomicBool::new(false);
        let heartbeat = Heartbeat::default();
        let done: Result<_> = std::thread::scope(|watched| {
            let _watch = WatchGuard(&heartbeat);
            let watch = || {
                if let Some(hang) = heartbeat.watch(stop) {
                    self.abandon(hang, &supervisor, &sensor_end)
                }
            };
            Builder::new().name("watchdog".into()).spawn_scoped(watched, watch)?;
            let done = std::thread::scope(|scope| {
                let _end = EndGuard(&store, &no_more);
                let (store, supervisor, is_over) = (&store, &*supervisor, &no_more);
                Builder::new()
                    .name("settings".into())
                    .spawn_scoped(scope, move || work.run(store, &compose, &on_new))?;
                if let Some(view) = view {
                    let update = move || session_view::update_view(view, supervisor, store, is_over);
                    Builder::new().name("desktop view".into()).spawn_scoped(scope, update)?;
                }
                let (runtime, settings, heartbeat) = (&runtime, store, &heartbeat);
                let welcome = !welcome::is_done();
                // This thread runs the frame loop.
                raise_priority_of_this_thread();
                let frames = FrameLoop { runtime, supervisor, maps, settings, stop, welcome, heartbeat };
                let done = frames.run();
                heartbeat.begin_end();
                Ok(done?)
            });
            supervisor.stop.store(true, Ordering::Relaxed);
            // The session ends before the graphics that it may still copy from are dropped.
            drop(runtime);
            done
        });
        let (report, drawn) = done?;
        drop(drawn);
        self.end(&supervisor, &sensor_end, report)
    }

    /// Ends the program although something hangs: completes the recording and leaves the rest.
    fn abandon(&self, hang: Hang, supervisor: &SensorSupervisor, sensor_end: &SensorEnd) -> ! {
        supervisor.stop.store(true, Ordering::Relaxed);
        if let Err(error) = self.wait_for_sensor(sensor_end) {
            log::error!("{error:#}");
        }
        log::error!("{hang}: exiting without it");
        exit_now(1)
    }

    /// Waits until the sensor's thread is over, within limits; its result.
    fn wait_for_sensor(&self, sensor_end: &SensorEnd) -> Result<()> {
        let patience = if self.record.is_some() { MAX_RECORDING_STOP } else { MAX_STOP };
        let sensor_end = sensor_end.lock().unwrap_or_else(PoisonError::into_inner);
        sensor_end.recv_timeout(patience).unwrap_or_else(|_| {
            log::warn!("the sensor does not stop and is abandoned");
            Ok(())
        })
    }

    /// Stops the sensor and reports.
    fn end(&self, supervisor: &SensorSupervisor, sensor_end: &SensorEnd, done: HeadsetReport) -> Result<Ending> {
        let supervised = self.wait_for_sensor(sensor_end);
        if done.status.is_welcomed
            && let Err(error) = welcome::set_done()
        {
            log::warn!("the welcome will be shown again: {error:#}");
        }
        let report = SessionReport::new(&done, supervisor.reconstruction());
        print_report(&report)?;
        if let Some(path) = &self.report {
            report.write(path)?;
        }
        supervised.map(|()| done.ending)
    }
}

/// A runtime that has asked its programs to quit. For some seconds it still accepts connections, and one that draws may start it
/// again.
#[derive(Debug, Clone, Copy)]
struct Closing {
    since_ns: i64,
    is_over: bool,
}

impl Closing {
    fn begin(now_ns: i64) -> Self {
        Self { since_ns: now_ns, is_over: false }
    }

    /// Whether a runtime that accepts connections is the one that closes.
    fn is_still(&mut self, now_ns: i64, accepts: bool) -> bool {
        self.is_over |= !accepts || now_ns.saturating_sub(self.since_ns) >= MAX_CLOSING_NS;
        !self.is_over
    }
}

/// Ends the helper threads when the session ends for any reason.
struct EndGuard<'d>(&'d SettingsStore, &'d AtomicBool);

impl Drop for EndGuard<'_> {
    fn drop(&mut self) {
        self.0.end();
        self.1.store(true, Ordering::Relaxed);
    }
}

/// Ends the watch when no call of the runtime follows.
struct WatchGuard<'h>(&'h Heartbeat);

impl Drop for WatchGuard<'_> {
    fn drop(&mut self) {
        self.0.end();
    }
}

/// The user's settings over those of SteamVR's chaperone.
fn compose(chaperone: &Chaperone, text: &str, changes: &[String], game: Option<&str>) -> Result<Settings, String> {
    let over = |below| Settings::for_game(below, text, changes, game).map_err(|error| error.to_string());
    let own = over(toml::Table::new())?;
    if own.headset.follow_chaperone { over(chaperone_settings(chaperone, &own)) } else { Ok(own) }
}

/// Applies changed settings where they are not read every frame.
fn apply_settings(supervisor: &SensorSupervisor, before: &Settings, new: &Settings) {
    let searched = |settings: &Settings| {
        let Settings { radar, tracking, processing, rooms, reflectors, .. } = settings.clone();
        Settings { radar, tracking, processing, rooms, reflectors, ..Settings::default() }
    };
    if searched(before) != searched(new) {
        log::info!("settings of the mapper have changed: it restarts from the saved map of the room");
        supervisor.restart_with(new);
    }
    let fixed = |settings: &Settings| (settings.headset.poses_hz, settings.headset.threads);
    if fixed(before) != fixed(new) {
        log::warn!("headset.poses_hz and headset.threads apply at the next start");
    }
}

/// Default fade distance of SteamVR's chaperone, metres. Source: SteamVR's default settings,
/// collisionBounds.CollisionBoundsFadeDistance.
const CHAPERONE_FADE_M: f64 = 0.7;
/// A smaller fade distance of the chaperone does not reduce the warnings' below this, metres.
/// Choice: a walker at 1.2 m/s covers half of it before the next foot is down.
const MIN_FADE_M: f64 = 1.2;
/// A larger one does not increase it beyond this, metres. Choice: the range of the map.
const MAX_FADE_M: f64 = 3.0;

/// SteamVR's chaperone as settings. Its fade distance starts at its bounds, which are drawn inside
/// of the furniture; a warning's starts at the furniture itself. So it scales ours, by the user's
/// change of its default, within safe limits.
fn chaperone_settings(chaperone: &Chaperone, own: &Settings) -> toml::Table {
    let mut warning = toml::Table::new();
    if let Some(color) = chaperone.color {
        warning.insert("color".into(), color.map(i64::from).to_vec().into());
    }
    if let Some(fade_m) = chaperone.fade_distance_m {
        let least_m = own.warning.fade_distance_m.min(MIN_FADE_M);
        let fade_m = (own.warning.fade_distance_m * fade_m / CHAPERONE_FADE_M)
            .max(least_m)
            .min(MAX_FADE_M.max(own.warning.fade_distance_m));
        warning.insert("fade_distance_m".into(), fade_m.into());
        warning.insert("full_distance_m".into(), own.warning.full_distance_m.min(fade_m / 2.0).into());
    }
    if let Some([x, z]) = chaperone.play_area_m {
        warning.insert("play_area_m".into(), vec![x, z].into());
    }
    toml::Table::from_iter([("warning".to_owned(), warning.into())])
}

/// Whether waiting may help.
fn is_transient(error: &OpenVrError) -> bool {
    matches!(error, OpenVrError::NotRunning | OpenVrError::NoHeadset | OpenVrError::Refused { .. })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fade_m(chaperone_m: Option<f64>, own: &Settings) -> Option<f64> {
        let chaperone = Chaperone { fade_distance_m: chaperone_m, ..Default::default() };
        let table = chaperone_settings(&chaperone, own);
        table["warning"].get("fade_distance_m").and_then(toml::Value::as_float)
    }

    #[test]
    fn a_closing_runtime_is_left_in_peace() {
        const S: i64 = 1_000_000_000;
        let mut closing = Closing::begin(0);
        assert!(closing.is_still(0, true) && closing.is_still(5 * S, true));
        assert!(
            !closing.is_still(6 * S, false) && !closing.is_still(7 * S, true),
            "it has ended, and is another one now"
        );
        let mut closing = Closing::begin(0);
        assert!(closing.is_still(19 * S, true) && !closing.is_still(20 * S, true), "it does not close");
    }

    #[test]
    fn chaperone_fade_distance_scales_ours_within_limits() {
        let own = Settings::default();
        assert_eq!(fade_m(None, &own), None);
        assert!((fade_m(Some(0.7), &own).unwrap() - 1.5).abs() < 1e-9, "SteamVR's default changes nothing");
        assert!((fade_m(Some(1.0), &own).unwrap() - 1.5 / 0.7).abs() < 1e-9);
        assert_eq!((fade_m(Some(0.1), &own), fade_m(Some(9.0), &own)), (Some(1.2), Some(3.0)));
        let mut near = Settings::default();
        near.warning.fade_distance_m = 0.9;
        assert_eq!(fade_m(Some(0.1), &near), Some(0.9), "a smaller setting of the user stays");
    }
}

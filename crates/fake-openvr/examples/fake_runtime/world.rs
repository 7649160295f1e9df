//! All state behind the function tables, under one lock, from Init to Cleanup.

use std::collections::BTreeMap;
use std::fs::File;
use std::sync::{Mutex, MutexGuard, PoisonError};

use glam::DQuat;
use radar_sar::geometry::Pose;

use crate::clock::{Frames, now_ns};
use crate::commands::{Command, RecenterTarget, TimedCommand};
use crate::config::Config;
use crate::events::{Events, event, universe_changed};
use crate::housekeeper;
use crate::overlay::Overlays;
use crate::paths::Paths;
use crate::report::{Report, write_whole};
use crate::server::Server;
use crate::settings::Settings;
use crate::sys;
use crate::table::Failure;
use crate::track::Track;
use crate::universes::Universes;

/// Limit of scheduled commands. Choice: bounds memory; scripts of tests have dozens.
const MAX_SCRIPT_COMMANDS: usize = 10_000;

static WORLD: Mutex<Option<World>> = Mutex::new(None);

/// State between Init and Cleanup, and afterwards the report.
pub struct World {
    pub running: bool,
    pub paths: Paths,
    pub config: Config,
    pub start_ns: i64,
    pub frames: Frames,
    /// The last frame for which WaitFrameSync returned.
    pub last_frame: Option<i64>,
    pub report: Report,
    pub universes: Universes,
    pub devices: Vec<Track>,
    pub invalid_until_ns: i64,
    pub standby: bool,
    pub events: Events,
    pub overlays: Overlays,
    pub settings: Settings,
    pub server: Server,
    script: Vec<TimedCommand>,
    failures: BTreeMap<String, u32>,
    /// Time of the last pulse of each controller, nanoseconds.
    pub pulsed_ns: BTreeMap<u32, i64>,
    /// Held, shared, while the client is connected.
    clients_lock: File,
    housekeeper: Option<housekeeper::Handle>,
}

/// Locks the state. A panic elsewhere leaves only counters and plain values, which stay usable.
pub fn lock() -> MutexGuard<'static, Option<World>> {
    WORLD.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs a call of the client: counts it, rejects it before Init and after Cleanup, and makes it
/// fail if a script says so.
pub fn call<R: Failure>(name: &'static str, code: u32, body: impl FnOnce(&mut World) -> R) -> R {
    let mut guard = lock();
    let Some(world) = guard.as_mut() else {
        eprintln!("fake runtime: violation: {name} called before Init");
        return R::failure(code);
    };
    world.report.called(name);
    if !world.running {
        world.report.violation("called after Cleanup", name);
        world.write_report();
        return R::failure(code);
    }
    if world.fails(name) { R::failure(code) } else { body(world) }
}

/// Records a call of an unsupported function.
pub fn unsupported(name: &'static str) {
    if let Some(world) = lock().as_mut() {
        world.report.called(name);
        world.report.violation(&format!("not in the fake runtime: {name}"), name);
    } else {
        eprintln!("fake runtime: violation: {name} called before Init");
    }
}

/// Whether a client is connected.
pub fn is_running() -> bool {
    lock().as_ref().is_some_and(|world| world.running)
}

/// Connects.
///
/// # Errors
/// The error of Init, and a description.
pub fn init(application_type: u32) -> Result<(), (sys::EVRInitError, String)> {
    let mut guard = lock();
    if let Some(world) = guard.as_mut().filter(|world| world.running) {
        world.report.violation("Init without Cleanup", format!("as application type {application_type}"));
        return Err((sys::EVRInitError_VRInitError_Init_Internal, "Init without Cleanup".into()));
    }
    // Earlier counts are kept, whether this succeeds or not.
    let before = guard.as_ref().map(|world| world.report.clone()).unwrap_or_default();
    let mut world = World::connect(application_type, before)?;
    world.housekeeper = Some(housekeeper::start(world.paths.clone()));
    *guard = Some(world);
    Ok(())
}

/// Disconnects: waits for the GPU and for queued images, and writes the report.
pub fn cleanup() {
    let asked_ns = now_ns();
    let Some(housekeeper) = begin_cleanup(asked_ns) else {
        return;
    };
    // Outside the lock, which the housekeeper needs.
    housekeeper.finish();
    let mut guard = lock();
    if let Some(world) = guard.as_mut() {
        world.overlays.free();
        let _ = world.clients_lock.unlock();
        world.report.ending.cleanup_took_s = Some((now_ns() - asked_ns) as f64 * 1e-9);
        world.write_report();
    }
}

fn begin_cleanup(asked_ns: i64) -> Option<housekeeper::Handle> {
    let mut guard = lock();
    let Some(world) = guard.as_mut().filter(|world| world.running) else {
        match guard.as_mut() {
            Some(world) => world.report.violation("Cleanup without Init", ""),
            None => eprintln!("fake runtime: violation: Cleanup before Init"),
        }
        return None;
    };
    world.running = false;
    world.report.ending.left_at_cleanup = Some(world.overlays.len());
    world.report.ending.cleanup_s = Some(world.seconds(asked_ns));
    world.housekeeper.take()
}

impl World {
    fn connect(application_type: u32, mut report: Report) -> Result<Self, (sys::EVRInitError, String)> {
        let now_ns = now_ns();
        let no_path = |why| (sys::EVRInitError_VRInitError_Init_NoConfigPath, why);
        let place = Paths::find().map_err(no_path)?;
        let config = Config::read(&place.config()).map_err(no_path)?;
        let mut server = Server::find(&place.server_lock(), now_ns).ok_or_else(|| no_server(application_type))?;
        // Utilities, which register applications, need no server.
        let is_utility = application_type == sys::EVRApplicationType_VRApplication_Utility;
        if !is_utility && !server.alive(now_ns) {
            return Err(no_server(application_type));
        }
        let clients_lock = connect_client(&place).map_err(|error| {
            (sys::EVRInitError_VRInitError_Init_Internal, format!("{}: {error}", place.clients_lock().display()))
        })?;
        let devices = read_tracks(&config).map_err(no_path)?;
        report.pid = std::process::id();
        report.application_type = application_type;
        report.inits += 1;
        report.ending = Default::default();
        report.urgent = true;
        let mut script = config.events.clone();
        script.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        script.reverse();
        Ok(Self {
            running: true,
            start_ns: now_ns,
            frames: Frames::new(now_ns, config.display.frequency_hz),
            last_frame: None,
            report,
            universes: Universes::new(&config),
            devices,
            invalid_until_ns: i64::MIN,
            standby: false,
            events: Events::default(),
            overlays: Overlays::default(),
            settings: Settings::new(&config.settings),
            server,
            script,
            failures: BTreeMap::new(),
            pulsed_ns: BTreeMap::new(),
            clients_lock,
            housekeeper: None,
            paths: place,
            config,
        })
    }

    /// Seconds since Init.
    pub fn seconds(&self, time_ns: i64) -> f64 {
        (time_ns - self.start_ns) as f64 * 1e-9
    }

    /// Whether a script makes this call fail.
    fn fails(&mut self, name: &str) -> bool {
        let name = name.rsplit("::").next().unwrap_or(name);
        match self.failures.get_mut(name) {
            Some(left) if *left > 0 => {
                *left -= 1;
                true
            }
            _ => false,
        }
    }

    /// Sends an event.
    pub fn send(&mut self, event: sys::VREvent_t) {
        if !self.events.push(now_ns(), event) {
            self.report.events_dropped += 1;
        }
    }

    /// The commands of the script that are due, in order.
    pub fn due(&mut self, time_ns: i64) -> Vec<Command> {
        let seconds = self.seconds(time_ns);
        let mut due = Vec::new();
        while self.script.last().is_some_and(|next| next.at_s <= seconds) {
            due.extend(self.script.pop().map(|next| next.command));
        }
        due
    }

    /// Schedules a command; at once if its time has passed.
    pub fn schedule(&mut self, command: TimedCommand) {
        if self.script.len() >= MAX_SCRIPT_COMMANDS {
            return eprintln!(
                "fake runtime: more than {MAX_SCRIPT_COMMANDS} commands are scheduled: {command:?} is dropped"
            );
        }
        let place = self.script.partition_point(|other| other.at_s > command.at_s);
        self.script.insert(place, command);
    }

    /// Executes a command. Images are handled by the housekeeper.
    pub fn perform(&mut self, command: &Command, time_ns: i64) {
        const NO_DEVICE: u32 = u32::MAX;
        match command {
            Command::Shot { .. } | Command::TabShot { .. } => {}
            Command::Dashboard { open } => self.open_dashboard(*open),
            Command::Mouse { action, x, y } => self.touch(*action, *x, *y),
            Command::Recenter { x, z, yaw_deg, universe } => self.recenter([*x, *z], *yaw_deg, *universe),
            Command::Universe => {
                self.universes.change(self.config.universe_change.pose());
                self.send(universe_changed(self.universes.id));
            }
            Command::Invalid { for_s } => self.invalid_until_ns = time_ns.saturating_add((for_s * 1e9) as i64),
            Command::Quit => {
                let seconds = self.seconds(time_ns);
                self.report.ending.quit_asked_s.get_or_insert(seconds);
                self.send(event(sys::EVREventType_VREvent_Quit, NO_DEVICE));
            }
            Command::Fail { function, count } => {
                self.failures.insert(function.clone(), *count);
            }
            Command::Standby => self.stand_by(true),
            Command::Wake => self.stand_by(false),
            Command::Color { r, g, b, a } => {
                self.settings.set_bounds_color([*r, *g, *b, *a]);
                self.send(event(sys::EVREventType_VREvent_ChaperoneSettingsHaveChanged, NO_DEVICE));
            }
            Command::PlayArea { x, z } => {
                self.config.chaperone.size_m = Some([*x, *z]);
                self.send(event(sys::EVREventType_VREvent_ChaperoneDataHasChanged, NO_DEVICE));
            }
            Command::Setting { section, key, value } => {
                self.settings.set(section, key, value.clone());
                self.send(event(sys::EVREventType_VREvent_ChaperoneSettingsHaveChanged, NO_DEVICE));
            }
        }
    }

    fn recenter(&mut self, [x, z]: [f64; 2], yaw_deg: f64, universe: RecenterTarget) {
        let turn = DQuat::from_rotation_y(yaw_deg.to_radians());
        let seated = universe == RecenterTarget::Seated;
        self.universes.recenter(seated, Pose::new(glam::DVec3::new(x, 0.0, z), turn));
        if seated {
            self.send(event(sys::EVREventType_VREvent_SeatedZeroPoseReset, 0));
        } else {
            self.send(event(sys::EVREventType_VREvent_StandingZeroPoseReset, 0));
            self.send(universe_changed(self.universes.id));
        }
    }

    fn stand_by(&mut self, standby: bool) {
        let kind = match standby {
            true => sys::EVREventType_VREvent_EnterStandbyMode,
            false => sys::EVREventType_VREvent_LeaveStandbyMode,
        };
        self.standby = standby;
        self.send(event(kind, 0));
    }

    /// The report to be written.
    pub fn report_json(&mut self, time_ns: i64) -> Vec<u8> {
        self.report.running_s = self.seconds(time_ns);
        self.report.server_alive = self.server.alive(time_ns);
        self.report.overlays = self.overlays.len();
        self.report.visible = self.overlays.visible().count();
        self.report.urgent = false;
        self.report.to_json()
    }

    /// Path of the report. Background and utility clients have their own.
    pub fn report_path(&self) -> std::path::PathBuf {
        self.paths.report(match self.report.application_type {
            sys::EVRApplicationType_VRApplication_Background => "report_background.json",
            sys::EVRApplicationType_VRApplication_Utility => "report_utility.json",
            _ => "report.json",
        })
    }

    /// Whether the client may use applications without a server.
    pub fn is_utility(&self) -> bool {
        self.report.application_type == sys::EVRApplicationType_VRApplication_Utility
    }

    /// Whether the client is an overlay application. Only such a client is drawn and asked to quit.
    pub fn is_overlay_client(&self) -> bool {
        self.report.application_type == sys::EVRApplicationType_VRApplication_Overlay
    }

    fn write_report(&mut self) {
        let json = self.report_json(now_ns());
        if let Err(error) = write_whole(&self.report_path(), &json) {
            eprintln!("fake runtime: {}: {error}", self.report_path().display());
        }
    }
}

fn no_server(application_type: u32) -> (sys::EVRInitError, String) {
    let code = match application_type {
        sys::EVRApplicationType_VRApplication_Background => sys::EVRInitError_VRInitError_Init_NoServerForBackgroundApp,
        // SteamVR would be started for these; the fake runtime starts nothing.
        _ => sys::EVRInitError_VRInitError_IPC_ServerInitFailed,
    };
    (code, "the server of the fake runtime is not running".into())
}

fn connect_client(place: &Paths) -> std::io::Result<File> {
    let file = File::options().create(true).truncate(false).write(true).open(place.clients_lock())?;
    file.lock_shared()?;
    Ok(file)
}

fn read_tracks(config: &Config) -> Result<Vec<Track>, String> {
    let head = match &config.track {
        Some(path) => Track::read(path, config.track_loops)?,
        None => Track::at_rest(Pose::from_translation(glam::DVec3::new(0.0, 1.6, 0.0))),
    };
    let controllers = config.controllers.iter().map(|path| Track::read(path, config.track_loops));
    std::iter::once(Ok(head)).chain(controllers).collect()
}

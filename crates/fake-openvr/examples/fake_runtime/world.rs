//! All state behind the function tables, under one lock, from Init to Cleanup.

use std::sync::{Mutex, MutexGuard, PoisonError};

use glam::DQuat;
use radar_sar::geometry::Pose;

use crate::clock::{Frames, now_ns};
use crate::commands::{Command, RecenterTarget};
use crate::config::{Config, Defect};
use crate::connection::Connection;
use crate::devices::Devices;
use crate::events::{Events, event, universe_changed};
use crate::housekeeper;
use crate::older_tables::Sdk;
use crate::overlay::Overlays;
use crate::paths::Paths;
use crate::report::{Report, write_whole};
use crate::script::Script;
use crate::server::Server;
use crate::settings::Settings;
use crate::sys;
use crate::table::Failure;
use crate::universes::Universes;

static WORLD: Mutex<Option<World>> = Mutex::new(None);

/// State between Init and Cleanup, and afterwards the report.
pub struct World {
    connection: Connection,
    pub paths: Paths,
    pub config: Config,
    pub start_ns: i64,
    pub frames: Frames,
    pub report: Report,
    pub universes: Universes,
    pub devices: Devices,
    pub standby: bool,
    /// Application key of the game that is shown.
    pub game: Option<String>,
    /// Until then no frame begins, and waiting for one does not return.
    pub hangs_until_ns: i64,
    pub events: Events,
    pub overlays: Overlays,
    pub settings: Settings,
    pub server: Server,
    pub script: Script,
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
    if !world.connection.is_running() {
        world.report.violation("called after Cleanup", name);
        world.write_report();
        return R::failure(code);
    }
    if world.script.fails(name) { R::failure(code) } else { body(world) }
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
    lock().as_ref().is_some_and(|world| world.connection.is_running())
}

/// The SDK of this runtime; before Init the newest.
pub fn sdk() -> Sdk {
    lock().as_ref().map(|world| world.config.sdk).unwrap_or_default()
}

/// Connects.
///
/// # Errors
/// The error of Init, and a description.
pub fn init(application_type: u32) -> Result<(), (sys::EVRInitError, String)> {
    let mut guard = lock();
    if let Some(world) = guard.as_mut().filter(|world| world.connection.is_running()) {
        world.report.violation("Init without Cleanup", format!("as application type {application_type}"));
        return Err((sys::EVRInitError_VRInitError_Init_Internal, "Init without Cleanup".into()));
    }
    // Earlier counts are kept, whether this succeeds or not.
    let before = guard.as_ref().map(|world| world.report.clone()).unwrap_or_default();
    let mut world = World::connect(application_type, before)?;
    world.connection.start_housekeeper(world.paths.clone());
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
        world.connection.release();
        world.report.ending.cleanup_took_s = Some((now_ns() - asked_ns) as f64 * 1e-9);
        world.write_report();
    }
}

fn begin_cleanup(asked_ns: i64) -> Option<housekeeper::Handle> {
    let mut guard = lock();
    let Some(world) = guard.as_mut().filter(|world| world.connection.is_running()) else {
        match guard.as_mut() {
            Some(world) => world.report.violation("Cleanup without Init", ""),
            None => eprintln!("fake runtime: violation: Cleanup before Init"),
        }
        return None;
    };
    world.report.ending.left_at_cleanup = Some(world.overlays.len());
    world.report.ending.cleanup_s = Some(world.seconds(asked_ns));
    world.connection.begin_cleanup()
}

impl World {
    fn connect(application_type: u32, mut report: Report) -> Result<Self, (sys::EVRInitError, String)> {
        let now_ns = now_ns();
        let no_path = |why| (sys::EVRInitError_VRInitError_Init_NoConfigPath, why);
        let place = Paths::find().map_err(no_path)?;
        let config = Config::read(&place.config()).map_err(no_path)?;
        if config.has(Defect::AbortsInInit) {
            std::process::abort();
        }
        let mut server = Server::find(&place.server_lock(), now_ns).ok_or_else(|| no_server(application_type))?;
        // Utilities, which register applications, need no server.
        let is_utility = application_type == sys::EVRApplicationType_VRApplication_Utility;
        if !is_utility && !server.alive(now_ns) {
            return Err(no_server(application_type));
        }
        let connection = Connection::open(&place).map_err(|error| {
            (sys::EVRInitError_VRInitError_Init_Internal, format!("{}: {error}", place.clients_lock().display()))
        })?;
        let devices = Devices::new(&config, now_ns).map_err(no_path)?;
        report.pid = std::process::id();
        report.application_type = application_type;
        report.inits += 1;
        report.ending = Default::default();
        report.urgent = true;
        Ok(Self {
            connection,
            start_ns: now_ns,
            frames: Frames::new(now_ns, config.display.frequency_hz),
            report,
            universes: Universes::new(&config),
            devices,
            standby: false,
            game: None,
            hangs_until_ns: i64::MIN,
            events: Events::default(),
            overlays: Overlays::default(),
            settings: Settings::new(&config.settings),
            server,
            script: Script::new(config.events.clone()),
            paths: place,
            config,
        })
    }

    /// Seconds since Init.
    pub fn seconds(&self, time_ns: i64) -> f64 {
        (time_ns - self.start_ns) as f64 * 1e-9
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
        self.script.due(seconds)
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
            Command::Invalid { for_s } => {
                self.devices.lose_tracking(time_ns.saturating_add((for_s * 1e9) as i64));
            }
            Command::Quit => {
                let seconds = self.seconds(time_ns);
                self.report.ending.quit_asked_s.get_or_insert(seconds);
                self.send(event(sys::EVREventType_VREvent_Quit, NO_DEVICE));
            }
            Command::Fail { function, count } => self.script.fail(function, *count),
            Command::Hang { for_s } => self.hangs_until_ns = time_ns.saturating_add((for_s * 1e9) as i64),
            Command::Game { key } => {
                self.game = key.clone();
                self.send(event(sys::EVREventType_VREvent_SceneApplicationChanged, NO_DEVICE));
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

//! The fake runtime, a simulated sensor, and the program, with their own working and home folders.

use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::sleep;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};

/// Limit of all waits. Choice: generous for slow machines; a wait ends as soon as its state is there, so only a test that
/// fails takes as long.
pub const TIMEOUT: Duration = Duration::from_secs(240);
/// Limit of the program's exit. Choice: fifty times as long as it may take on an idle machine.
const EXIT_TIMEOUT: Duration = Duration::from_secs(50);

static EXCLUSIVE: Mutex<()> = Mutex::new(());

pub struct Rig {
    folder: PathBuf,
    steamvr: Option<Child>,
    sensor: Option<Child>,
    /// Additional environment variables of the program.
    environment: Vec<(String, PathBuf)>,
    _exclusive: MutexGuard<'static, ()>,
}

/// The running program.
pub struct Program {
    child: Child,
    out: PathBuf,
    err: PathBuf,
}

/// The program after its exit.
#[derive(Debug)]
pub struct Ended {
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
}

impl Rig {
    /// Named after the test.
    pub fn new(test: &str) -> Self {
        let alone = EXCLUSIVE.lock().unwrap_or_else(PoisonError::into_inner);
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("beside").join(test);
        let _ = fs::remove_dir_all(&folder);
        let data = folder.join(DATA);
        fs::create_dir_all(&data).unwrap();
        // This user has seen the welcome.
        fs::write(data.join("welcomed"), "").unwrap();
        Self { folder, steamvr: None, sensor: None, environment: Vec::new(), _exclusive: alone }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// A command in its own environment: the user's files are neither read nor written.
    pub fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new(program);
        command.current_dir(&self.folder).stdin(Stdio::null()).env("HOME", self.path("home"));
        for variable in ["XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME", "VR_OVERRIDE", "RUST_LOG"] {
            command.env_remove(variable);
        }
        // Graphics libraries print errors if this variable is missing.
        command.env("XDG_RUNTIME_DIR", &self.folder);
        command.env("VR_PATHREG_OVERRIDE", self.path("vr/openvrpaths.vrpath"));
        command.envs(self.environment.iter().map(|(name, value)| (name, value)));
        command
    }

    /// Sets an environment variable for commands started from now on.
    pub fn set(&mut self, name: &str, value: &str) {
        self.environment.push((name.to_owned(), value.into()));
    }

    /// Adds the layer that loses devices to commands started from now on. Returns the control file
    /// of the layer.
    pub fn with_devices_to_lose(&mut self) -> PathBuf {
        let library = examples().join("liblost_device_layer.so");
        assert!(library.is_file(), "{} is not built", library.display());
        let layer = json!({"file_format_version": "1.2.0", "layer": {
            "name": "VK_LAYER_CHAPERONE_lost_device", "type": "GLOBAL", "library_path": library, "api_version": "1.3.0",
            "implementation_version": "1", "description": "loses devices",
        }});
        fs::create_dir_all(self.path("layers")).unwrap();
        fs::write(self.path("layers/lost_device.json"), layer.to_string()).unwrap();
        let file = self.path("lose");
        self.environment = vec![
            ("VK_LAYER_PATH".to_owned(), self.path("layers")),
            ("VK_INSTANCE_LAYERS".to_owned(), "VK_LAYER_CHAPERONE_lost_device".into()),
            ("LOST_DEVICE_FILE".to_owned(), file.clone()),
        ];
        file
    }

    fn spawn(&self, program: impl AsRef<std::ffi::OsStr>, arguments: &[&str], log: &str) -> Child {
        let log = File::create(self.path(log)).unwrap();
        let mut command = self.command(program);
        command.args(arguments).stdout(log.try_clone().unwrap()).stderr(log).spawn().unwrap()
    }

    /// Starts the fake runtime. `configuration` is its configuration; with `has_track`, the head
    /// moves like the simulated sensor.
    pub fn start_steamvr(&mut self, configuration: &Value, has_track: bool) {
        self.start_steamvr_with(configuration, if has_track { &["--track", "track.tum"] } else { &[] });
    }

    pub fn start_steamvr_with(&mut self, configuration: &Value, more: &[&str]) {
        fs::write(self.path("fake.json"), configuration.to_string()).unwrap();
        let _ = fs::remove_file(self.path("vr/report.json"));
        let arguments = [&["--dir", "vr", "--config", "fake.json"], more].concat();
        let server = examples().join("fake_server");
        assert!(server.is_file(), "{} is not built: cargo test builds it, --test alone does not", server.display());
        self.steamvr = Some(self.spawn(server, &arguments, "steamvr.log"));
        self.wait_for("the fake runtime", || {
            fs::read_to_string(self.path("steamvr.log")).ok().filter(|log| !log.is_empty())
        });
    }

    /// Ends it as a user does.
    pub fn end_steamvr(&mut self) {
        if let Some(mut child) = self.steamvr.take() {
            signal(&child, Signal::INT);
            wait(&mut child, EXIT_TIMEOUT);
        }
    }

    /// Kills it.
    pub fn kill_steamvr(&mut self) {
        if let Some(mut child) = self.steamvr.take() {
            child.kill().unwrap();
            child.wait().unwrap();
        }
    }

    /// Serves the sensor. The head's track is written first.
    pub fn start_sensor(&mut self, scene: &str, motion: &str, seed: u64, duration_s: u32) {
        let (seed, duration) = (seed.to_string(), duration_s.to_string());
        let arguments = [
            "simulate",
            scene,
            "--motion",
            motion,
            "--seed",
            &seed,
            "--duration-s",
            &duration,
            "--serve",
            "pty:sensor",
            "--track-out",
            "track.tum",
        ];
        self.sensor = Some(self.spawn(env!("CARGO_BIN_EXE_radar-chaperone"), &arguments, "sensor.log"));
        self.wait_for("the sensor", || self.path("sensor").exists().then_some(()));
        self.wait_for("the track", || fs::metadata(self.path("track.tum")).ok().filter(|m| m.len() > 0));
    }

    /// Stops the simulated sensor, as if it hung, or continues it.
    pub fn hold_sensor(&self, is_held: bool) {
        let signal = if is_held { Signal::STOP } else { Signal::CONT };
        kill_process(Pid::from_child(self.sensor.as_ref().unwrap()), signal).unwrap();
    }

    /// Unplugs the sensor.
    pub fn unplug_sensor(&mut self) {
        let mut child = self.sensor.take().unwrap();
        child.kill().unwrap();
        child.wait().unwrap();
        fs::remove_file(self.path("sensor")).unwrap();
    }

    /// Starts the program.
    pub fn start(&self, arguments: &[&str]) -> Program {
        static NUMBER: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
        let number = NUMBER.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let [out, err] = ["out", "err"].map(|stream| self.path(&format!("{number}.{stream}")));
        let mut command = self.command(env!("CARGO_BIN_EXE_radar-chaperone"));
        command.args(arguments).stdout(File::create(&out).unwrap()).stderr(File::create(&err).unwrap());
        Program { child: command.spawn().unwrap(), out, err }
    }

    /// Starts `run` with the simulated sensor.
    pub fn start_run(&self, more: &[&str]) -> Program {
        let arguments = ["run", "--port", "sensor", "--preset", "d16", "--mount", MOUNT];
        self.start(&[&arguments[..], more].concat())
    }

    /// Runs the program to its end.
    pub fn run(&self, arguments: &[&str]) -> Ended {
        self.start(arguments).ended()
    }

    /// Sends a command to the fake runtime.
    pub fn send_command(&self, what: &Value) {
        let mut file = OpenOptions::new().create(true).append(true).open(self.path("vr/commands.jsonl")).unwrap();
        writeln!(file, "{what}").unwrap();
    }

    /// The report of the fake runtime.
    pub fn report(&self) -> Value {
        self.wait_for("the report of the fake runtime", || {
            serde_json::from_slice(&fs::read(self.path("vr/report.json")).ok()?).ok()
        })
    }

    /// Waits until the report of the fake runtime meets a condition.
    pub fn wait_report(&self, what: &str, is_there: impl Fn(&Value) -> bool) -> Value {
        self.wait_for(what, || Some(self.report()).filter(&is_there))
    }

    /// Waits until the program has shown that many more frames: its own time, which passes slowly on a
    /// machine whose cores are taken. The program shows 90 a second.
    pub fn wait_frames(&self, count: u64) -> Value {
        let frames = |report: &Value| report["frames"].as_u64().unwrap();
        let begin = frames(&self.report());
        self.wait_report("frames", |report| frames(report) >= begin + count)
    }

    /// Takes a shot of both eyes now.
    pub fn shoot(&self, name: &str) -> Value {
        self.send_command(&json!({"do": "shot", "name": name}));
        self.shot(name)
    }

    /// A shot of both eyes, when it exists.
    pub fn shot(&self, name: &str) -> Value {
        let path = self.path(&format!("vr/shots/{name}.json"));
        self.wait_for("the picture", || serde_json::from_slice(&fs::read(&path).ok()?).ok())
    }

    /// Takes shots until one is as wanted. Commands count only once the program draws frames.
    pub fn wait_shot(&self, name: &str, is_wanted: impl Fn(&Value) -> bool) -> Value {
        self.wait_report("frames", |report| report["frames"].as_u64() > Some(0));
        let number = std::cell::Cell::new(0);
        self.wait_for(name, || {
            number.set(number.get() + 1);
            Some(self.shoot(&format!("{name}{}", number.get()))).filter(&is_wanted)
        })
    }

    pub fn wait_for<T>(&self, what: &str, there: impl Fn() -> Option<T>) -> T {
        let begin = Instant::now();
        loop {
            if let Some(found) = there() {
                return found;
            }
            assert!(begin.elapsed() < TIMEOUT, "{what} did not come; look into {}", self.folder.display());
            sleep(Duration::from_millis(10));
        }
    }
}

/// The program's folder of the user's files.
pub const DATA: &str = "home/.local/share/radar-chaperone";

/// Position of the simulated sensor on the head.
pub const MOUNT: &str = "0,0.03,-0.10";

impl Drop for Rig {
    fn drop(&mut self) {
        for child in [&mut self.steamvr, &mut self.sensor].into_iter().flatten() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

impl Program {
    /// Interrupts it (Ctrl-C) and waits for its end.
    pub fn interrupt(self) -> Ended {
        signal(&self.child, Signal::INT);
        self.ended()
    }

    /// As [`Self::interrupt`], with the time it took to end.
    pub fn interrupt_timed(self) -> (Ended, Duration) {
        let begin = Instant::now();
        let ended = self.interrupt();
        (ended, begin.elapsed())
    }

    pub fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Waits for its end.
    pub fn ended(mut self) -> Ended {
        let code = wait(&mut self.child, TIMEOUT);
        Ended { code, out: self.out(), err: self.err() }
    }

    pub fn out(&self) -> String {
        fs::read_to_string(&self.out).unwrap()
    }

    pub fn err(&self) -> String {
        fs::read_to_string(&self.err).unwrap()
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn examples() -> PathBuf {
    // Tests are in target/PROFILE/deps.
    std::env::current_exe().unwrap().parent().unwrap().parent().unwrap().join("examples")
}

fn signal(child: &Child, which: Signal) {
    kill_process(Pid::from_child(child), which).unwrap();
}

fn wait(child: &mut Child, patience: Duration) -> Option<i32> {
    let begin = Instant::now();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return status.code();
        }
        if begin.elapsed() > patience {
            child.kill().unwrap();
            panic!("does not end");
        }
        sleep(Duration::from_millis(2));
    }
}

//! A server with its folder, and a test in its own process: the library has one state per process,
//! and finds it through the environment.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

const TEST: &str = "FAKE_TEST";
const FOLDER: &str = "FAKE_FOLDER";
const SERVER: &str = "FAKE_SERVER";
/// Limit of all waits, generous for busy machines.
const TIMEOUT: Duration = Duration::from_secs(60);

/// Environment of a test's process.
pub struct Rig {
    pub folder: PathBuf,
    server: i32,
}

/// A server that ends when dropped.
pub struct Server {
    child: Child,
    pub folder: PathBuf,
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// A program built by `cargo test` beside this one.
fn example(name: &str) -> PathBuf {
    let deps = std::env::current_exe().unwrap();
    let path = deps.parent().unwrap().parent().unwrap().join("examples").join(name);
    assert!(path.exists(), "{} is missing: cargo build --release --examples", path.display());
    path
}

/// An empty folder of that name.
pub fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("fake-{}-{}", std::process::id(), name.replace(':', "-")));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// The server's command, for a folder.
pub fn server_command(folder: &Path) -> Command {
    let mut command = Command::new(example("fake_server"));
    command.arg("--dir").arg(folder);
    command
}

impl Server {
    /// Starts a server with that configuration. Its entry `files` (texts by name) is written beside
    /// it.
    pub fn start(folder: PathBuf, config: &Value, arguments: &[&str]) -> Self {
        let mut config = config.clone();
        for (name, text) in config["files"].take().as_object().into_iter().flatten() {
            std::fs::write(folder.join(name), text.as_str().unwrap()).unwrap();
        }
        config.as_object_mut().unwrap().remove("files");
        let file = folder.join("given.json");
        std::fs::write(&file, serde_json::to_vec(&config).unwrap()).unwrap();
        let mut command = server_command(&folder);
        command.arg("--config").arg(&file).args(arguments).stdout(Stdio::piped());
        let mut server = Self { child: command.spawn().unwrap(), folder };
        let mut line = String::new();
        BufReader::new(server.child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        assert_eq!(line.trim(), format!("VR_PATHREG_OVERRIDE={}", server.registry().display()));
        server
    }

    fn registry(&self) -> PathBuf {
        self.folder.canonicalize().unwrap().join("openvrpaths.vrpath")
    }
}

/// Runs a test's body in its own process, with a server with that configuration. `name` is the full
/// name of the test.
pub fn alone(name: &str, config: &Value, body: fn(&Rig)) {
    if std::env::var(TEST).is_ok_and(|running| running == name) {
        let folder = PathBuf::from(std::env::var_os(FOLDER).unwrap());
        let server = std::env::var(SERVER).unwrap().parse().unwrap();
        body(&Rig { folder: folder.clone(), server });
        return std::fs::write(folder.join("done"), name).unwrap();
    }
    let server = Server::start(folder(name), config, &[]);
    let run = Command::new(std::env::current_exe().unwrap())
        .args([name, "--exact", "--nocapture"])
        .env(TEST, name)
        .env(FOLDER, &server.folder)
        .env(SERVER, server.child.id().to_string())
        .env("VR_PATHREG_OVERRIDE", server.registry())
        .output()
        .unwrap();
    let said = format!("{}{}", String::from_utf8_lossy(&run.stdout), String::from_utf8_lossy(&run.stderr));
    assert!(run.status.success(), "{name} in a process of its own: {}\n{said}", run.status);
    // With a wrong name, the process would run nothing and succeed.
    assert!(server.folder.join("done").exists(), "{name} did not run:\n{said}");
}

/// Waits until `look` returns a value.
pub fn until<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let begun = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(begun.elapsed() < TIMEOUT, "{what} did not come");
        std::thread::sleep(Duration::from_millis(5));
    }
}

impl Rig {
    /// Sends the server a signal.
    fn signal(&self, signal: rustix::process::Signal) {
        let server = rustix::process::Pid::from_raw(self.server).unwrap();
        rustix::process::kill_process(server, signal).unwrap();
    }

    /// Kills the server, and waits until its lock is free.
    pub fn kill_server(&self) {
        self.signal(rustix::process::Signal::KILL);
        let lock = std::fs::File::open(self.folder.join("runtime/server.lock")).unwrap();
        until("the lock", || lock.try_lock_shared().ok());
        lock.unlock().unwrap();
    }

    /// Asks the server to exit.
    pub fn end_server(&self) {
        self.signal(rustix::process::Signal::TERM);
    }

    /// Sends the library a command.
    pub fn command(&self, command: &Value) {
        let path = self.folder.join("commands.jsonl");
        let mut file = std::fs::File::options().create(true).append(true).open(path).unwrap();
        writeln!(file, "{command}").unwrap();
    }

    /// The library's report about this process.
    pub fn report(&self) -> Value {
        self.try_report().unwrap()
    }

    /// As [`Self::report`], if it was written yet.
    pub fn try_report(&self) -> Option<Value> {
        let path = self.folder.join("report.json");
        path.exists().then(|| read_json(&path))
    }

    /// Takes a shot and reads its metadata and images.
    pub fn shot(&self, name: &str) -> (Value, [image::RgbImage; 2]) {
        self.command(&serde_json::json!({ "do": "shot", "name": name }));
        let shots = self.folder.join("shots");
        let json = shots.join(format!("{name}.json"));
        until("the picture", || {
            if let Some(report) = self.try_report() {
                assert_eq!(report["shots_failed"], 0, "{report:#}");
            }
            json.exists().then_some(())
        });
        let eye = |side: &str| image::open(shots.join(format!("{name}_{side}.png"))).unwrap().to_rgb8();
        (read_json(&json), [eye("left"), eye("right")])
    }
}

/// Reads a JSON file.
pub fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

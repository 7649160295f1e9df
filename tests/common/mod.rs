//! Runs the program as a user does, each test in its own folder, and checks what every run must
//! satisfy: it ends by itself and never panics.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;

/// A run that takes longer counts as a hang: many times what the longest takes on an idle machine, for
/// one whose cores are taken. Choice.
const RUN_TIMEOUT: Duration = Duration::from_secs(600);

/// An empty folder for one test. Command lines name the files in it without a path.
pub struct Folder {
    path: PathBuf,
    runs: AtomicU32,
}

impl Folder {
    /// Named after the test; files of an earlier run are removed.
    pub fn new(test: &str) -> Self {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("program").join(test);
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(path.join("streams")).unwrap();
        Self { path, runs: AtomicU32::new(0) }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        fs::write(self.path(name), bytes).unwrap();
    }

    pub fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    pub fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&self.read(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// Copies one of the vendor's recordings here.
    pub fn copy_real(&self, name: &str) {
        self.write(name, fs::read(real_recording(name)).unwrap());
    }

    /// Runs the program; arguments are separated by blanks.
    pub fn run(&self, line: &str) -> Outcome {
        self.run_with(line, &[])
    }

    /// The same with additional environment variables.
    pub fn run_with(&self, line: &str, environment: &[(&str, &str)]) -> Outcome {
        let out = self.stream("out");
        let outcome = self.run_into(File::create(&out).unwrap().into(), line, environment);
        Outcome { out: text(&out), ..outcome }
    }

    /// Runs the program with a closed standard output, as in `… | true`.
    pub fn run_unread(&self, line: &str) -> Outcome {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        self.run_into(writer.into(), line, &[])
    }

    fn run_into(&self, out: Stdio, line: &str, environment: &[(&str, &str)]) -> Outcome {
        let err = self.stream("err");
        let child = Command::new(crate::PROGRAM)
            .args(line.split_whitespace())
            .current_dir(&self.path)
            .env_remove("RUST_LOG")
            .envs(environment.iter().copied())
            .stdin(Stdio::null())
            .stdout(out)
            .stderr(File::create(&err).unwrap())
            .spawn()
            .unwrap();
        let code = wait_for_exit(child, line).code();
        let outcome = Outcome { line: line.to_owned(), code, out: String::new(), err: text(&err) };
        assert!(!outcome.err.contains("panicked"), "a panic: {outcome:#?}");
        assert!(outcome.code.is_some(), "ended by a signal: {outcome:#?}");
        outcome
    }

    /// A new file for a run's output.
    fn stream(&self, name: &str) -> PathBuf {
        let number = self.runs.fetch_add(1, Ordering::Relaxed);
        self.path.join(format!("streams/{number}.{name}"))
    }
}

/// Path of one of the vendor's recordings, which may not be distributed with the program.
pub fn real_recording(name: &str) -> PathBuf {
    let path = Path::new(crate::RECORDINGS).join(name);
    assert!(path.is_file(), "{} is missing: this test needs the vendor's recordings", path.display());
    path
}

fn text(path: &Path) -> String {
    String::from_utf8(fs::read(path).unwrap()).unwrap()
}

/// Waits for the end; kills the process on timeout.
fn wait_for_exit(mut child: Child, line: &str) -> ExitStatus {
    let start = Instant::now();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return status;
        }
        if start.elapsed() > RUN_TIMEOUT {
            child.kill().unwrap();
            child.wait().unwrap();
            panic!("`{line}` did not end within {RUN_TIMEOUT:?}");
        }
        sleep(Duration::from_millis(3));
    }
}

/// Result of a run of the program.
#[derive(Debug)]
pub struct Outcome {
    pub line: String,
    /// `None`: ended by a signal.
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
}

impl Outcome {
    /// Asserts success without an error message.
    pub fn succeeds(self) -> Self {
        assert_eq!(self.code, Some(0), "{self:#?}");
        assert!(!self.err.contains("error:"), "`{}`: {self:#?}", self.line);
        self
    }

    /// Asserts failure with this text in the error message.
    pub fn fails_with(self, message: &str) -> Self {
        assert!(!self.succeeded(), "should be refused: {self:#?}");
        assert!(self.err.contains(message), "should print \"{message}\": {self:#?}");
        self
    }

    /// Whether the run succeeded; on failure asserts that there is an error message.
    pub fn succeeded(&self) -> bool {
        let well = self.code == Some(0);
        assert!(well || self.err.starts_with("error: ") || self.err.contains("\nerror: "), "no error: {self:#?}");
        well
    }

    /// Asserts that standard output contains this text.
    pub fn prints(self, text: &str) -> Self {
        assert!(self.out.contains(text), "should print \"{text}\": {self:#?}");
        self
    }
}

//! The fake runtime's own thread: executes the script and the commands, requests images, and writes
//! the report.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::clock::now_ns;
use crate::commands::{Command, TimedCommand};
use crate::painter::{Painter, is_name};
use crate::paths::Paths;
use crate::report::write_whole;
use crate::world::{World, lock};

/// Period of the thread. Choice: a command takes effect within some frames, without load when
/// nothing happens.
const TICK: Duration = Duration::from_millis(20);
/// Interval of report writes if nothing is urgent, nanoseconds. Choice: a killed client loses at
/// most the last second's report.
const REPORT_NS: i64 = 1_000_000_000;
/// Ticks between two reads of the command file. Choice: 0.1 s, below what a test waits for.
const COMMANDS_TICKS: u64 = 5;
/// Limit of one read of the command file, bytes. Choice: bounds memory; a line is a short command.
const MAX_READ_BYTES: u64 = 1 << 20;

/// Handle of the thread.
pub struct Handle {
    stop: Sender<()>,
    thread: JoinHandle<()>,
}

impl Handle {
    /// Stops the thread after its current work.
    pub fn finish(self) {
        let _ = self.stop.send(());
        if self.thread.join().is_err() {
            eprintln!("fake runtime: the housekeeper thread panicked");
        }
    }
}

/// Starts the thread.
pub fn start(place: Paths) -> Handle {
    let (stop, stopped) = channel();
    // Opened here, so that a command given right after Init is not skipped as an old one.
    let commands = CommandTail::new(place.commands());
    let thread = std::thread::spawn(move || run(&place, commands, &stopped));
    Handle { stop, thread }
}

fn run(place: &Paths, mut commands: CommandTail, stopped: &Receiver<()>) {
    let painter = Painter::start(place.shots());
    let mut report_due_ns = i64::MIN;
    for tick in 0u64.. {
        if stopped.recv_timeout(TICK) != Err(RecvTimeoutError::Timeout) {
            break;
        }
        let lines = if tick % COMMANDS_TICKS == 0 { commands.new_lines() } else { Vec::new() };
        let chore = lock().as_mut().and_then(|world| work(world, &painter, &lines, &mut report_due_ns));
        chore.into_iter().for_each(ReportWrite::write);
    }
    painter.finish();
}

/// A file write that is done outside the lock.
struct ReportWrite {
    path: PathBuf,
    bytes: Vec<u8>,
}

impl ReportWrite {
    fn write(self) {
        if let Err(error) = write_whole(&self.path, &self.bytes) {
            eprintln!("fake runtime: {}: {error}", self.path.display());
        }
    }
}

fn work(world: &mut World, painter: &Painter, lines: &[String], report_due_ns: &mut i64) -> Option<ReportWrite> {
    let now_ns = now_ns();
    for line in lines {
        match TimedCommand::parse(line) {
            Ok(command) => {
                world.report.commands += 1;
                world.report.urgent = true;
                world.script.schedule(command);
            }
            Err(error) => eprintln!("fake runtime: commands.jsonl: {error}"),
        }
    }
    if world.server.alive(now_ns) {
        for command in world.due(now_ns) {
            match &command {
                // A client that shows nothing has no image.
                Command::Shot { name } if world.is_overlay_client() => take_picture(world, painter, name, now_ns),
                Command::TabShot { name } if world.is_overlay_client() => take_tab_picture(world, painter, name),
                other => world.perform(other, now_ns),
            }
        }
    }
    let due = world.report.urgent || now_ns >= *report_due_ns;
    due.then(|| {
        *report_due_ns = now_ns + REPORT_NS;
        ReportWrite { path: world.report_path(), bytes: world.report_json(now_ns) }
    })
}

fn take_picture(world: &mut World, painter: &Painter, name: &str, now_ns: i64) {
    let taken = match is_name(name) {
        true => world.snapshot(name, now_ns).and_then(|snapshot| painter.draw(snapshot)),
        false => Err(format!("{name:?} cannot be a file's name: letters, digits, '-', '_' and '.'")),
    };
    if let Err(why) = taken {
        world.report.shot_failed(why);
    }
}

fn take_tab_picture(world: &mut World, painter: &Painter, name: &str) {
    let taken = match is_name(name) {
        true => world.tab_picture(name).and_then(|picture| painter.write(picture)),
        false => Err(format!("{name:?} cannot be a file's name")),
    };
    if let Err(why) = taken {
        world.report.shot_failed(why);
    }
}

/// Lines appended to the command file from now on.
struct CommandTail {
    path: PathBuf,
    read_to: u64,
    /// An incomplete last line.
    rest: Vec<u8>,
}

impl CommandTail {
    fn new(path: PathBuf) -> Self {
        let read_to = std::fs::metadata(&path).map_or(0, |metadata| metadata.len());
        Self { path, read_to, rest: Vec::new() }
    }

    fn new_lines(&mut self) -> Vec<String> {
        let length = std::fs::metadata(&self.path).map_or(0, |metadata| metadata.len());
        if length < self.read_to {
            // The file was truncated.
            self.read_to = 0;
            self.rest.clear();
        }
        if length > self.read_to {
            match self.read() {
                Ok(read) => self.read_to += read as u64,
                Err(error) => eprintln!("fake runtime: {}: {error}", self.path.display()),
            }
        }
        self.take_lines()
    }

    fn read(&mut self) -> std::io::Result<usize> {
        let mut file = File::open(&self.path)?;
        file.seek(SeekFrom::Start(self.read_to))?;
        file.take(MAX_READ_BYTES).read_to_end(&mut self.rest)
    }

    fn take_lines(&mut self) -> Vec<String> {
        let Some(end) = self.rest.iter().rposition(|byte| *byte == b'\n') else {
            if self.rest.len() as u64 > MAX_READ_BYTES {
                self.rest.clear();
            }
            return Vec::new();
        };
        let whole: Vec<u8> = self.rest.drain(..=end).collect();
        let text = String::from_utf8_lossy(&whole);
        text.lines().filter(|line| !line.trim().is_empty()).map(str::to_owned).collect()
    }
}

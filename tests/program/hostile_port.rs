//! At the end of a serial line may be anything: a modem, a broken board, something that means harm. `record` and `doctor` end
//! there with a message, within bounds of time and memory, and what was recorded until then is whole.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

use crate::PROGRAM;
use crate::common::Folder;
use crate::tiny_board::TinyBoard;

/// Address space of the program, KiB. Choice: what reading any file may take (300 MB), and 100 MB of code and stacks.
const LIMIT_KIB: usize = 400 << 10;

/// What the peer does once it no longer behaves as a board.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Harm {
    Silence,
    Noise,
    LineWithoutEnd,
    NestedJson,
    HugePayload,
    NegativeNumbers,
    TerminalEscapes,
    Echo,
    HangUp,
    OneByteAtATime,
    SameResultAgain,
}

impl Harm {
    const ALL: [Self; 11] = [
        Self::Silence,
        Self::Noise,
        Self::LineWithoutEnd,
        Self::NestedJson,
        Self::HugePayload,
        Self::NegativeNumbers,
        Self::TerminalEscapes,
        Self::Echo,
        Self::HangUp,
        Self::OneByteAtATime,
        Self::SameResultAgain,
    ];

    /// Some of what it says by itself.
    fn bytes(self, random: &mut ChaCha8Rng) -> Vec<u8> {
        match self {
            Self::Silence | Self::Echo | Self::HangUp | Self::OneByteAtATime | Self::SameResultAgain => Vec::new(),
            Self::Noise => (0..4096).map(|_| random.random()).collect(),
            Self::LineWithoutEnd => vec![b'{'; 4096],
            Self::NestedJson => format!("{{\"status\":{}\n", "[".repeat(60_000)).into_bytes(),
            Self::HugePayload => {
                let head = "{\"status\":\"ok\",\"result_info\":[[{\"tick\":1,\"data_saturated\":false,\"temperature\":2,\
                            \"calibration_needed\":false,\"frame_delayed\":false}]],\"payload_size\":4294967280}\n";
                [head.as_bytes(), &[0; 4096]].concat()
            }
            Self::NegativeNumbers => b"{\"status\":\"ok\",\"system_info\":{\"rss_version\":\"a121-v1.12.0\",\"sensor\":\
                \"a121\",\"sensor_count\":-1,\"ticks_per_second\":-1e300,\"hw\":\"\"},\"tick_period\":-5,\"metadata\":[[\
                {\"frame_data_length\":-8,\"sweep_data_length\":1e18,\"base_step_length_m\":-0.0}]],\"payload_size\":-4}\n"
                .to_vec(),
            Self::TerminalEscapes => {
                b"{\"status\":\"error\",\"message\":\"\\u001b]0;taken\\u0007\\u001b[2J\\u202e\"}\n".to_vec()
            }
        }
    }
}

/// A pseudo-terminal with a peer that answers some commands as a board does, and then does harm.
struct Peer {
    path: PathBuf,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Peer {
    fn start(honest_answers: u32, harm: Harm, seed: u64) -> Self {
        let ours: OwnedFd = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&ours).unwrap();
        unlockpt(&ours).unwrap();
        let path = PathBuf::from(ptsname(&ours, Vec::new()).unwrap().into_string().unwrap());
        // Held open: without a program at the other end, reading would fail.
        let other_end = OpenOptions::new().read(true).write(true).open(&path).unwrap();
        let mut modes = rustix::termios::tcgetattr(&other_end).unwrap();
        modes.make_raw();
        rustix::termios::tcsetattr(&other_end, rustix::termios::OptionalActions::Now, &modes).unwrap();
        rustix::io::ioctl_fionbio(&ours, true).unwrap();
        let is_over = Arc::new(AtomicBool::new(false));
        let ends = Arc::clone(&is_over);
        let thread = spawn(move || {
            let mut held = Some(other_end);
            Talk::new(File::from(ours), honest_answers, harm, seed).run(&ends, &mut held);
        });
        Self { path, is_over, thread: Some(thread) }
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
    }
}

struct Talk {
    port: File,
    honest_left: u32,
    harm: Harm,
    random: ChaCha8Rng,
    board: TinyBoard,
    line: Vec<u8>,
    /// What the line does not yet take.
    unsent: Vec<u8>,
    last_result: Vec<u8>,
}

impl Talk {
    fn new(port: File, honest_left: u32, harm: Harm, seed: u64) -> Self {
        let random = ChaCha8Rng::seed_from_u64(seed);
        let board = TinyBoard::default();
        Self { port, honest_left, harm, random, board, line: Vec::new(), unsent: Vec::new(), last_result: Vec::new() }
    }

    fn run(mut self, is_over: &AtomicBool, other_end: &mut Option<File>) {
        while !is_over.load(Ordering::Relaxed) {
            self.hear();
            let streams = self.board.is_streaming();
            if self.honest_left > 0 {
                if let Some(result) = self.board.result() {
                    self.unsent.extend(&result);
                    self.last_result = result;
                    self.honest_left -= 1;
                }
            } else if self.harm == Harm::HangUp {
                other_end.take();
                return;
            } else if self.harm == Harm::SameResultAgain && streams && self.unsent.is_empty() {
                self.unsent.extend(&self.last_result);
            } else if self.unsent.len() < 4096 {
                let more = self.harm.bytes(&mut self.random);
                self.unsent.extend(more);
            }
            self.say();
        }
    }

    /// Reads commands, and answers them.
    fn hear(&mut self) {
        let mut buffer = [0; 4096];
        match self.port.read(&mut buffer) {
            Ok(read) if self.honest_left == 0 && self.harm == Harm::Echo => self.unsent.extend(&buffer[..read]),
            Ok(read) => self.line.extend(&buffer[..read]),
            Err(error) if error.kind() == ErrorKind::WouldBlock => sleep(Duration::from_millis(1)),
            Err(_) => sleep(Duration::from_millis(5)),
        }
        while let Some(end) = self.line.iter().position(|byte| *byte == b'\n') {
            let command: Vec<u8> = self.line.drain(..=end).collect();
            let slowly = self.harm == Harm::OneByteAtATime;
            if self.honest_left > 0 || slowly {
                self.honest_left = self.honest_left.saturating_sub(1);
                let answer = self.board.answer(&command);
                self.unsent.extend(answer);
            }
        }
    }

    fn say(&mut self) {
        let slowly = self.honest_left == 0 && self.harm == Harm::OneByteAtATime;
        let most = if slowly { 1.min(self.unsent.len()) } else { self.unsent.len() };
        if let Ok(written) = self.port.write(&self.unsent[..most]) {
            self.unsent.drain(..written);
        }
        if slowly {
            sleep(Duration::from_millis(20));
        }
    }
}

/// Runs a command with bounds; returns what it printed.
fn bounded(folder: &Folder, line: &str) -> (bool, String) {
    let limited = format!("ulimit -v {LIMIT_KIB}; exec {PROGRAM} {line}");
    let mut shell = Command::new("sh");
    shell.env("MALLOC_ARENA_MAX", "1").env("RAYON_NUM_THREADS", "2").current_dir(folder.path("."));
    let output = shell.args(["-c", &limited]).output().unwrap();
    let text = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.code().is_some() && !text.contains("panicked"), "{line}: {:?} {text}", output.status);
    assert!(!text.contains(['\x1b', '\x07', '\u{202e}']), "{line} passes on what a terminal obeys: {text:?}");
    (output.status.success(), text)
}

#[test]
fn whatever_is_at_the_port_a_recording_ends_and_is_whole() {
    let folder = Folder::new("hostile_port");
    std::thread::scope(|scope| {
        for (n, harm) in Harm::ALL.into_iter().enumerate() {
            // At once; after the board was recognised; in the middle of the stream.
            for honest_answers in [0, 2, 60] {
                let folder = &folder;
                scope.spawn(move || recorded_from(folder, n, harm, honest_answers));
            }
        }
    });
}

fn recorded_from(folder: &Folder, n: usize, harm: Harm, honest_answers: u32) {
    let peer = Peer::start(honest_answers, harm, n as u64);
    let out = format!("{n}_{honest_answers}.mcap");
    let port = peer.path.display();
    let (succeeded, text) = bounded(folder, &format!("record --port {port} --out {out} --duration-s 3"));
    assert!(succeeded || text.contains("error: "), "{harm:?} after {honest_answers}: {text}");
    let speaks = matches!(harm, Harm::Noise | Harm::LineWithoutEnd | Harm::NestedJson);
    assert!(!speaks || honest_answers == 60 || text.contains("bytes that are no message"), "{harm:?}: {text}");
    assert!(harm != Harm::TerminalEscapes || honest_answers == 60 || text.contains("]0;taken"), "{text}");
    if folder.path(&out).exists() {
        folder.run(&format!("info {out}")).succeeds().prints("Damage     none");
    }
    assert!(folder.path(&out).exists() || honest_answers < 60, "{harm:?}: what was recorded is lost");
}

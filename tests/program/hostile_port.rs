//! At the end of a serial line may be anything: a modem, a broken board, something that means harm. `record` and `doctor` end
//! there with a message, within bounds of time and memory, and what was recorded until then is whole.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::{Pid, Signal, kill_process};
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

/// Longest wait for the program, however busy the machine is.
const PATIENCE: Duration = Duration::from_secs(240);
/// How long the peer does harm before the program is interrupted, ms of the peer's own pauses: on a busy machine they last
/// longer. Choice: the program asks silent boards again after a second.
const HARM_MS: u64 = 2500;

/// Recordings that run at once. Choice: with all at once on two busy cores the program waits too long for honest answers.
const TOGETHER: usize = 4;

/// A pseudo-terminal with a peer that answers some commands as a board does, and then does harm.
struct Peer {
    path: PathBuf,
    is_over: Arc<AtomicBool>,
    harm_ms: Arc<AtomicU64>,
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
        let harm_ms = Arc::new(AtomicU64::new(0));
        let (ends, harmed_ms) = (Arc::clone(&is_over), Arc::clone(&harm_ms));
        let thread = spawn(move || {
            let mut held = Some(other_end);
            Talk::new(File::from(ours), honest_answers, harm, seed, &harmed_ms).run(&ends, &mut held);
            // It has hung up.
            while !ends.load(Ordering::Relaxed) {
                sleep(Duration::from_millis(1));
                harmed_ms.fetch_add(1, Ordering::Relaxed);
            }
        });
        Self { path, is_over, harm_ms, thread: Some(thread) }
    }

    fn has_done_harm(&self) -> bool {
        self.harm_ms.load(Ordering::Relaxed) >= HARM_MS
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
    }
}

struct Talk<'h> {
    port: File,
    harm_ms: &'h AtomicU64,
    /// The program has opened the port.
    was_asked: bool,
    honest_left: u32,
    harm: Harm,
    random: ChaCha8Rng,
    board: TinyBoard,
    line: Vec<u8>,
    /// What the line does not yet take.
    unsent: Vec<u8>,
    last_result: Vec<u8>,
}

impl<'h> Talk<'h> {
    fn new(port: File, honest_left: u32, harm: Harm, seed: u64, harm_ms: &'h AtomicU64) -> Self {
        let (random, board) = (ChaCha8Rng::seed_from_u64(seed), TinyBoard::default());
        let (line, unsent, last_result) = (Vec::new(), Vec::new(), Vec::new());
        Self { port, harm_ms, was_asked: false, honest_left, harm, random, board, line, unsent, last_result }
    }

    fn pause(&self, ms: u64) {
        sleep(Duration::from_millis(ms));
        if self.honest_left == 0 && self.was_asked {
            self.harm_ms.fetch_add(ms, Ordering::Relaxed);
        }
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
        let read = self.port.read(&mut buffer);
        self.was_asked |= read.is_ok();
        match read {
            Ok(read) if self.honest_left == 0 && self.harm == Harm::Echo => self.unsent.extend(&buffer[..read]),
            Ok(read) => self.line.extend(&buffer[..read]),
            Err(error) if error.kind() == ErrorKind::WouldBlock => self.pause(1),
            Err(_) => self.pause(5),
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
            self.pause(20);
        }
    }
}

/// Runs a command with bounds until the peer has done its harm or the command ends; returns what it printed.
fn bounded(folder: &Folder, line: &str, name: &str, peer: &Peer) -> (bool, String) {
    let limited = format!("ulimit -v {LIMIT_KIB}; exec {PROGRAM} {line} >{name}.txt 2>&1");
    let mut shell = Command::new("sh");
    shell.env("MALLOC_ARENA_MAX", "1").env("RAYON_NUM_THREADS", "2").current_dir(folder.path("."));
    let mut child = shell.args(["-c", &limited]).spawn().unwrap();
    let mut ended = None;
    let begin = Instant::now();
    while ended.is_none() && !peer.has_done_harm() {
        assert!(begin.elapsed() < PATIENCE, "{line}: the program does not speak to the port");
        sleep(Duration::from_millis(10));
        ended = child.try_wait().unwrap();
    }
    // A silent board is waited for as long as was asked, and no longer.
    if ended.is_none() && !line.contains("--duration-s") {
        kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    }
    let begin = Instant::now();
    let status = loop {
        if let Some(status) = ended {
            break status;
        }
        assert!(begin.elapsed() < PATIENCE, "{line}: it does not end");
        sleep(Duration::from_millis(10));
        ended = child.try_wait().unwrap();
    };
    let text = String::from_utf8_lossy(&std::fs::read(folder.path(&format!("{name}.txt"))).unwrap()).into_owned();
    assert!(status.code().is_some() && !text.contains("panicked"), "{line}: {status:?} {text}");
    assert!(!text.contains(['\x1b', '\x07', '\u{202e}']), "{line} passes on what a terminal obeys: {text:?}");
    (status.success(), text)
}

#[test]
fn whatever_is_at_the_port_a_recording_ends_and_is_whole() {
    let folder = Folder::new("hostile_port");
    // At once; after the board was recognised; in the middle of the stream.
    let cases: Vec<_> = [0, 2, 60].into_iter().flat_map(|honest| Harm::ALL.map(|harm| (harm, honest))).collect();
    for (batch, together) in cases.chunks(TOGETHER).enumerate() {
        std::thread::scope(|scope| {
            for (n, &(harm, honest_answers)) in together.iter().enumerate() {
                let folder = &folder;
                scope.spawn(move || recorded_from(folder, batch * TOGETHER + n, harm, honest_answers));
            }
        });
    }
}

fn recorded_from(folder: &Folder, n: usize, harm: Harm, honest_answers: u32) {
    let peer = Peer::start(honest_answers, harm, n as u64);
    let name = format!("{n}_{honest_answers}");
    let (out, port) = (format!("{name}.mcap"), peer.path.display());
    let until = if harm == Harm::Silence && honest_answers < 60 { "--duration-s 3" } else { "" };
    let (succeeded, text) = bounded(folder, &format!("record --port {port} --out {out} {until}"), &name, &peer);
    assert!(succeeded || text.contains("error: "), "{harm:?} after {honest_answers}: {text}");
    let speaks = matches!(harm, Harm::Noise | Harm::LineWithoutEnd | Harm::NestedJson);
    assert!(!speaks || honest_answers == 60 || text.contains("bytes that are no message"), "{harm:?}: {text}");
    assert!(harm != Harm::TerminalEscapes || honest_answers == 60 || text.contains("]0;taken"), "{text}");
    if folder.path(&out).exists() {
        folder.run(&format!("info {out}")).succeeds().prints("Damage     none");
    }
    assert!(folder.path(&out).exists() || honest_answers < 60, "{harm:?}: what was recorded is lost");
}

//! Simulated board: the server's side of the protocol, with fault injection. Pure, except for
//! [`Server`], which has a clock and a port: takes bytes and host times, returns bytes with the
//! times at which they reach the reader.
//!
//! Based on the protocol and on the known behaviour of boards. Assumptions where nothing is known:
//! replies take 2 ms and a calibration 200 ms; while streaming, a board refuses all commands except
//! the stop command; a board keeps two results and starts the next measurement late if the line has
//! not taken the older one by then.
//!
//! The caller passes bytes from the host to [`Device::receive`] and [`Device::receive_break`],
//! calls [`Device::poll`] at [`Device::next_ns`], and passes the returned bytes on.
//!
//! [`Device`] is the board's state machine; the other files of this module are its parts, each of
//! which owns its state.

mod board;
mod endpoint;
mod faults;
mod line;
mod outgoing;
mod output;
mod protocol;
mod samples;
mod sensors;
mod serve;
mod stream;
mod transmitter;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

pub use board::Board;
pub use endpoint::{ServeAddress, ServeError};
pub use faults::{Fault, FaultPlan, FaultPlanError, MAX_FAULTS_PER_MINUTE};
pub use output::{DeviceCounters, Output, SentResult};
pub use samples::{FrameRequest, SampleSource, TickSeededNoise};
pub use serve::Server;
pub use stream::SentInfo;

use board::BoardClock;
use faults::{Faults, random_ns};
use line::AfterSent;
use outgoing::Outgoing;
use protocol::BoardSetup;
use sensors::{Request, Sensors};
use stream::{Measured, Stream};
use transmitter::Transmitter;

/// Baud rate after a break. Source: the exploration protocol.
const FIRST_BAUD: u32 = 115_200;
/// Longest command, bytes. Choice: a set-up of five sensors with calibrations takes some kilobytes;
/// it bounds memory when a line's end is lost.
const MAX_COMMAND_BYTES: usize = 64 << 10;
/// Time for a reply, for calibrating a sensor, and from power-on until the board listens,
/// nanoseconds. Choice: below the session's timeouts by an order of magnitude; real boards were not
/// measured.
const ANSWER_NS: i64 = 2_000_000;
const CALIBRATING_NS: i64 = 200_000_000;
const BOOT_NS: i64 = 300_000_000;
/// Shortest time from the end of a measurement until its result is sent, nanoseconds: readout and
/// formatting. Choice: a third of what a free-running XC120 leaves between frames.
pub const READING_NS: i64 = 300_000;
/// Mean of the additional time for that, nanoseconds. Choice: no board was measured; it is the part
/// of a delay that the session cannot know.
const READING_JITTER_NS: f64 = 50_000.0;
/// Pauses between log lines while streaming, seconds. Choice: often enough that every trial meets a
/// log line between results.
const LOG_PAUSE_S: (f64, f64) = (1.0, 10.0);

/// State of the board.
enum State {
    /// Unplugged or starting; the board receives nothing until then.
    Off {
        until_ns: i64,
        unplugged: bool,
    },
    Idle,
    Streaming(Box<Stream>),
}

/// A simulated board. See the head of this file.
pub struct Device {
    board: Board,
    seed: u64,
    sensors: Sensors,
    transmitter: Transmitter,
    faults: Faults,
    rng: ChaCha8Rng,
    state: State,
    setup: Option<BoardSetup>,
    /// The beginning of a command.
    command: Vec<u8>,
    sent: Option<Vec<SentResult>>,
    counters: DeviceCounters,
}

impl Device {
    /// Creates a board that was switched on some time ago.
    pub fn new(board: Board, source: Box<dyn SampleSource + Send>, plan: FaultPlan, seed: u64, now_ns: i64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0xB0A2D);
        let on_for_ns = (rng.random_range(2.0..2000.0) * 1e9) as i64;
        let clock = BoardClock::new(board, seed, now_ns.saturating_sub(on_for_ns));
        Self {
            board,
            seed,
            sensors: Sensors::new(clock, source),
            transmitter: Transmitter::new(board.max_baudrate().map(|_| FIRST_BAUD)),
            faults: Faults::new(plan, seed, now_ns),
            rng,
            state: State::Idle,
            setup: None,
            command: Vec::new(),
            sent: None,
            counters: DeviceCounters::default(),
        }
    }

    /// Starts recording what is sent, for [`Self::take_sent`].
    pub fn record_sent(&mut self) {
        self.sent.get_or_insert_default();
    }

    /// Returns what was sent since the last call.
    pub fn take_sent(&mut self) -> Vec<SentResult> {
        self.sent.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// Baud rate of the board's side; `None` if the line has no baud rate.
    pub fn baud(&self) -> Option<u32> {
        self.transmitter.line.baud
    }

    /// Whether the board streams.
    pub fn is_streaming(&self) -> bool {
        matches!(self.state, State::Streaming(_))
    }

    /// The counters.
    pub fn counters(&self) -> DeviceCounters {
        DeviceCounters { faults: self.faults.counts().clone(), ..self.counters.clone() }
    }

    /// When [`Self::poll`] is due, host nanoseconds.
    pub fn next_ns(&self) -> i64 {
        let own_ns = match &self.state {
            State::Off { until_ns, .. } => *until_ns,
            State::Streaming(stream) if self.transmitter.has_room() => stream.next.end_ns.min(stream.next_log_ns),
            State::Streaming(stream) => stream.next_log_ns,
            State::Idle => i64::MAX,
        };
        own_ns.min(self.transmitter.line.next_ns()).min(self.faults.next_ns())
    }

    /// Flow control: whether the reader accepts no bytes.
    pub fn set_blocked(&mut self, is_blocked: bool, now_ns: i64) {
        self.transmitter.line.set_blocked(is_blocked, now_ns);
    }

    /// Performs what is due at a host time and appends what reaches the reader.
    pub fn poll(&mut self, now_ns: i64, out: &mut Vec<Output>) {
        loop {
            while let Some((baud, bytes)) = self.transmitter.line.arrive(now_ns) {
                out.push(Output::Bytes { bytes, baud });
            }
            if let Some(fault) = self.faults.take(now_ns) {
                self.inject(fault, now_ns, out);
            } else if let Some((left_ns, then)) = self.transmitter.leave(now_ns) {
                if let AfterSent::Fault(fault) = then {
                    self.go_off(fault, left_ns, out);
                }
            } else if !self.step(now_ns, out) {
                return;
            }
        }
    }

    /// Performs one step of the board; returns false if nothing is due.
    fn step(&mut self, now_ns: i64, out: &mut Vec<Output>) -> bool {
        match &mut self.state {
            State::Off { until_ns, unplugged } if *until_ns <= now_ns => {
                if *unplugged {
                    out.push(Output::Plugged);
                    self.state = State::Off { until_ns: until_ns.saturating_add(BOOT_NS), unplugged: false };
                } else {
                    self.state = State::Idle;
                }
                true
            }
            State::Streaming(stream) if stream.next_log_ns <= now_ns => {
                stream.next_log_ns = now_ns.saturating_add(log_pause_ns(&mut self.rng));
                self.send_log("still streaming", now_ns);
                true
            }
            State::Streaming(stream) if stream.next.end_ns <= now_ns && self.transmitter.has_room() => {
                self.finish_result();
                true
            }
            _ => false,
        }
    }

    /// Receives a break, which ends the current session.
    pub fn receive_break(&mut self) {
        if matches!(self.state, State::Off { .. }) {
            return;
        }
        self.transmitter.line.clear(false);
        self.reset_session();
        self.state = State::Idle;
    }

    fn reset_session(&mut self) {
        self.transmitter.line.baud = self.board.max_baudrate().map(|_| FIRST_BAUD);
        self.setup = None;
        self.command.clear();
    }

    /// Receives bytes from the host.
    pub fn receive(&mut self, bytes: &[u8], now_ns: i64) {
        if matches!(self.state, State::Off { .. }) {
            return;
        }
        for &byte in bytes {
            match byte {
                b'\n' => {
                    let command = std::mem::take(&mut self.command);
                    self.execute(&command, now_ns);
                }
                _ if self.command.len() < MAX_COMMAND_BYTES => self.command.push(byte),
                _ => {}
            }
        }
    }

    fn execute(&mut self, line: &[u8], now_ns: i64) {
        self.counters.commands += 1;
        let command: Value = match serde_json::from_slice(line) {
            Ok(command) if line.len() < MAX_COMMAND_BYTES => command,
            _ => return self.answer(protocol::error("not a command"), now_ns),
        };
        let name = command["cmd"].as_str().unwrap_or_default().to_owned();
        if std::mem::take(&mut self.faults.effects.refuses) {
            return self.answer(protocol::error("out of order"), now_ns);
        }
        if self.is_streaming() && name != "stop_streaming" {
            return self.answer(protocol::error("streaming"), now_ns);
        }
        match name.as_str() {
            "get_system_info" => self.answer(protocol::system_info(self.board), now_ns),
            "get_sensor_info" => self.answer(protocol::sensor_info(self.board), now_ns),
            "set_uart_baudrate" => self.set_baud(&command, now_ns),
            "setup" => self.set_up(command, now_ns),
            "start_streaming" => self.start(now_ns),
            "stop_streaming" => self.stop(now_ns),
            _ => self.answer(protocol::error("unknown command"), now_ns),
        }
    }

    fn set_baud(&mut self, command: &Value, now_ns: i64) {
        let asked = command["baudrate"].as_u64().and_then(|baud| u32::try_from(baud).ok());
        match (asked, self.board.max_baudrate()) {
            (Some(baud), Some(max)) if (FIRST_BAUD..=max).contains(&baud) => {
                self.send(line_of(&serde_json::json!({"status": "ok"})), now_ns + ANSWER_NS, AfterSent::Baud(baud));
            }
            _ => self.answer(protocol::error("invalid baudrate"), now_ns),
        }
    }

    fn set_up(&mut self, command: Value, now_ns: i64) {
        match protocol::set_up(command, self.board, self.seed) {
            Ok((setup, reply)) => {
                let taken_ns = if setup.calibrated { CALIBRATING_NS } else { ANSWER_NS };
                if setup.calibrated {
                    self.faults.effects.asks_for_calibration = false;
                    self.send_log("sensors calibrated", now_ns + taken_ns);
                }
                self.send(line_of(&reply), now_ns + taken_ns, AfterSent::Nothing);
                self.setup = Some(setup);
            }
            Err(message) => self.answer(protocol::error(&message), now_ns),
        }
    }

    fn start(&mut self, now_ns: i64) {
        let Some(setup) = self.setup.clone() else {
            return self.answer(protocol::error("not set up"), now_ns);
        };
        if std::mem::take(&mut self.faults.effects.wraps) {
            let after_s = self.faults.rng.random_range(0.2..2.0);
            self.sensors.clock.wrap_after(now_ns, after_s);
        }
        self.answer(serde_json::json!({"status": "start"}), now_ns);
        let start_s = self.sensors.clock.board_s(now_ns + 2 * ANSWER_NS);
        let next = self.measure(&setup, 0, start_s, false);
        let next_log_ns = now_ns.saturating_add(log_pause_ns(&mut self.rng));
        self.state = State::Streaming(Box::new(Stream { setup, index: 0, next, next_log_ns }));
    }

    fn stop(&mut self, now_ns: i64) {
        if !self.is_streaming() {
            return self.answer(protocol::error("not streaming"), now_ns);
        }
        // The set-up is kept for another start.
        self.state = State::Idle;
        self.answer(serde_json::json!({"status": "stop"}), now_ns);
    }

    /// Measures a result that starts at this board time.
    fn measure(&mut self, setup: &BoardSetup, index: u64, start_s: f64, is_late: bool) -> Measured {
        let saturates = std::mem::take(&mut self.faults.effects.saturates);
        let calibration_needed = self.faults.effects.asks_for_calibration;
        let request = Request { setup, index, start_s, is_late, saturates, calibration_needed };
        self.sensors.measure(&request, &mut self.rng)
    }

    /// Reads out and sends the measured result, and measures the next one.
    fn finish_result(&mut self) {
        let State::Streaming(mut stream) = std::mem::replace(&mut self.state, State::Idle) else { return };
        let (read_ns, is_lost) = self.transmitter.read_ns(stream.next.end_ns);
        match is_lost {
            true => self.counters.lost += 1,
            false => self.send_result(&stream, read_ns),
        }
        let (start_s, is_late) = stream.next_start_s(self.sensors.clock.board_s(read_ns));
        stream.index += 1;
        stream.next = self.measure(&stream.setup, stream.index, start_s, is_late);
        self.state = State::Streaming(stream);
    }

    fn send_result(&mut self, stream: &Stream, now_ns: i64) {
        let result = &stream.next;
        let (bytes, line_bytes) = stream::result_bytes(&stream.setup.groups, result);
        let jitter_ns = -READING_JITTER_NS * libm::log(1.0 - self.rng.random_range(0.0f64..1.0));
        self.counters.results += 1;
        self.counters.delayed += u64::from(result.infos.iter().any(|info| info.frame_delayed));
        let from_ns = now_ns + READING_NS + jitter_ns as i64;
        let faults = self.dispatch(bytes, from_ns, true, AfterSent::Nothing);
        if let Some(sent) = &mut self.sent {
            sent.push(SentResult {
                infos: result.infos.clone(),
                ends_ns: result.ends_ns.clone(),
                samples: result.samples.clone(),
                line_bytes,
                faults,
            });
        }
    }

    fn answer(&mut self, answer: Value, now_ns: i64) {
        let jitter_ns = self.rng.random_range(0..ANSWER_NS / 2);
        self.send(line_of(&answer), now_ns + ANSWER_NS + jitter_ns, AfterSent::Nothing);
    }

    fn send_log(&mut self, text: &str, now_ns: i64) {
        let milliseconds = (self.sensors.clock.board_s(now_ns) * 1e3) as u64;
        let log = serde_json::json!({
            "status": "log", "level": "info", "timestamp": milliseconds, "module": "server", "log": text,
        });
        self.send(line_of(&log), now_ns, AfterSent::Nothing);
    }

    fn send(&mut self, bytes: Vec<u8>, from_ns: i64, then: AfterSent) {
        self.dispatch(bytes, from_ns, false, then);
    }

    /// Puts a message on the line and applies its faults; returns them as (offset, kind).
    fn dispatch(&mut self, bytes: Vec<u8>, from_ns: i64, ends_result: bool, then: AfterSent) -> Vec<(usize, Fault)> {
        self.counters.bytes += bytes.len() as u64;
        let struck = self.faults.of_message(bytes.len());
        let mut message = Outgoing::new(bytes);
        for &(at, fault) in &struck {
            self.faults.count(fault);
            message.strike(fault, at, &mut self.faults.rng);
            self.affect(fault, from_ns);
        }
        self.transmitter.put(message, from_ns, ends_result, then);
        struck
    }

    /// Applies a fault that affects neither a message nor the power, from this time on; no other
    /// has an effect.
    fn affect(&mut self, fault: Fault, from_ns: i64) {
        let effects = &mut self.faults.effects;
        match fault {
            Fault::Saturate => effects.saturates = true,
            Fault::Calibrate => effects.asks_for_calibration = true,
            Fault::Refuse => effects.refuses = true,
            Fault::Wrap => effects.wraps = true,
            Fault::Jump => self.sensors.clock.jump(self.faults.rng.random_range(1000..u32::MAX - 1000)),
            Fault::Burst => self.transmitter.burst(from_ns),
            _ => {}
        }
    }

    /// Injects a fault now, or into the next message.
    pub fn inject(&mut self, fault: Fault, now_ns: i64, out: &mut Vec<Output>) {
        let is_idle = !self.is_streaming();
        match fault {
            _ if fault.corrupts_bytes() => return self.faults.defer(fault),
            // Equally likely in the middle of a message and between two.
            Fault::Unplug | Fault::Reboot if !is_idle && self.faults.rng.random_bool(0.5) => {
                return self.faults.defer(fault);
            }
            Fault::Unplug | Fault::Reboot => self.go_off(fault, now_ns, out),
            Fault::Error => self.send(line_of(&protocol::error("sensor error")), now_ns, AfterSent::Nothing),
            Fault::Banner => self.send(banner(self.board), now_ns, AfterSent::Nothing),
            _ => self.affect(fault, now_ns),
        }
        self.faults.count(fault);
    }

    /// Unplugs or restarts the board; it loses its state.
    fn go_off(&mut self, fault: Fault, now_ns: i64, out: &mut Vec<Output>) {
        if matches!(self.state, State::Off { .. }) {
            return;
        }
        let unplugged = fault == Fault::Unplug;
        let lasts_ns = if unplugged { random_ns(0.1, 3.0, &mut self.faults.rng) } else { BOOT_NS };
        let until_ns = now_ns.saturating_add(lasts_ns);
        if unplugged {
            out.push(Output::Unplugged);
        }
        self.counters.lost += u64::from(self.is_streaming());
        self.transmitter.restart(unplugged);
        self.reset_session();
        self.faults.effects.asks_for_calibration = false;
        self.sensors.clock.restart(if unplugged { until_ns } else { now_ns });
        self.state = State::Off { until_ns, unplugged };
    }
}

fn log_pause_ns(rng: &mut ChaCha8Rng) -> i64 {
    random_ns(LOG_PAUSE_S.0, LOG_PAUSE_S.1, rng)
}

/// Start-up banner of a board; not part of the protocol.
fn banner(board: Board) -> Vec<u8> {
    format!("\r\n*** {} ***\r\nExploration server [a121] {{ready}}\r\n", board.hardware()).into_bytes()
}

fn line_of(value: &Value) -> Vec<u8> {
    let mut line = value.to_string().into_bytes();
    line.push(b'\n');
    line
}

#[cfg(test)]
#[path = "device_tests.rs"]
mod tests;

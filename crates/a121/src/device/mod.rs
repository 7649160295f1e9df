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
//! Longer than other files: the board is one state machine, whose commands, results and faults share
//! its state.

mod board;
#[cfg(unix)]
mod endpoint;
mod faults;
mod line;
mod protocol;
mod samples;
#[cfg(unix)]
mod serve;
mod stream;

use std::collections::BTreeMap;

use num_complex::Complex;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

pub use board::Board;
#[cfg(unix)]
pub use endpoint::{ServeAddress, ServeError};
pub use faults::{Fault, FaultPlan, FaultPlanError, MAX_FAULTS_PER_MINUTE};
pub use samples::{FrameRequest, SampleSource, TickSeededNoise};
#[cfg(unix)]
pub use serve::{Server, monotonic_ns};
pub use stream::SentInfo;

use board::BoardClock;
use faults::Schedule;
use line::{AfterSent, Line, Transmission};
use protocol::BoardSetup;
use stream::{Measured, Stream, Timing};

/// Baud rate after a break.
const FIRST_BAUD: u32 = 115_200;
/// Longest command, bytes. Choice.
const MAX_COMMAND_BYTES: usize = 64 << 10;
/// Time for a reply, for calibrating a sensor, and from power-on until the board listens,
/// nanoseconds. Choice.
const ANSWER_NS: i64 = 2_000_000;
const CALIBRATING_NS: i64 = 200_000_000;
const BOOT_NS: i64 = 300_000_000;
/// Shortest time from the end of a measurement until its result is sent, nanoseconds: readout and
/// formatting. Choice.
pub const READING_NS: i64 = 300_000;
/// Mean of the additional time for that, and largest interrupt latency, nanoseconds. Choice.
const READING_JITTER_NS: f64 = 50_000.0;
const LATENCY_NS: i64 = 8_000;
/// Results that a board can hold. Choice.
const KEPT_RESULTS: usize = 2;
/// Pauses between log lines while streaming, seconds. Choice.
const LOG_PAUSE_S: (f64, f64) = (1.0, 10.0);
/// Duration of the burst fault and interval of its bursts, nanoseconds. Choice.
const BURST_NS: (i64, i64) = (1_000_000_000, 30_000_000);

/// Output of a board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Output {
    /// Bytes reach the reader.
    Bytes {
        /// The bytes.
        bytes: Vec<u8>,
        /// Their baud rate; a reader at another rate gets noise. `None` if the line has no baud
        /// rate.
        baud: Option<u32>,
    },
    /// The board was unplugged.
    Unplugged,
    /// The board was plugged in again.
    Plugged,
}

/// A result as the board sent it, for comparison with what arrives.
#[derive(Debug, Clone, PartialEq)]
pub struct SentResult {
    /// One per sensor, by group.
    pub infos: Vec<SentInfo>,
    /// True end of each sensor's measurement, host nanoseconds.
    pub ends_ns: Vec<i64>,
    /// Samples of all sensors, by group.
    pub samples: Vec<Complex<i16>>,
    /// Size of its JSON line.
    pub line_bytes: usize,
    /// Faults that hit it, as (offset, kind).
    pub faults: Vec<(usize, Fault)>,
}

/// Counters of a board.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct DeviceCounters {
    /// Results sent.
    pub results: u64,
    /// Results that were later than requested.
    pub delayed: u64,
    /// Results never sent, because the board hung or restarted.
    pub lost: u64,
    /// Bytes sent.
    pub bytes: u64,
    /// Commands received.
    pub commands: u64,
    /// Faults by kind.
    pub faults: BTreeMap<Fault, u64>,
}

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
    clock: BoardClock,
    line: Line,
    schedule: Schedule,
    rng: ChaCha8Rng,
    source: Box<dyn SampleSource + Send>,
    state: State,
    setup: Option<BoardSetup>,
    command: Vec<u8>,
    /// Faults for the next message.
    pending_faults: Vec<Fault>,
    refuses_next: bool,
    saturates_next: bool,
    asks_for_calibration: bool,
    wraps_next: bool,
    /// The board hangs until this host time.
    hung_until_ns: i64,
    next_log_ns: i64,
    /// Since when there is room for another result, host nanoseconds.
    slot_free_since_ns: i64,
    sent: Option<Vec<SentResult>>,
    counters: DeviceCounters,
}

impl Device {
    /// Creates a board that was switched on some time ago.
    pub fn new(board: Board, source: Box<dyn SampleSource + Send>, plan: FaultPlan, seed: u64, now_ns: i64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0xB0A2D);
        let on_for_ns = (rng.random_range(2.0..2000.0) * 1e9) as i64;
        Self {
            board,
            seed,
            clock: BoardClock::new(board, seed, now_ns.saturating_sub(on_for_ns)),
            line: Line::new(board.max_baudrate().map(|_| FIRST_BAUD)),
            schedule: Schedule::new(plan, seed, now_ns),
            rng,
            source,
            state: State::Idle,
            setup: None,
            command: Vec::new(),
            pending_faults: Vec::new(),
            refuses_next: false,
            saturates_next: false,
            asks_for_calibration: false,
            wraps_next: false,
            hung_until_ns: i64::MIN,
            next_log_ns: i64::MAX,
            slot_free_since_ns: i64::MIN,
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
        self.line.baud
    }

    /// Whether the board streams.
    pub fn is_streaming(&self) -> bool {
        matches!(self.state, State::Streaming(_))
    }

    /// The counters.
    pub fn counters(&self) -> DeviceCounters {
        DeviceCounters { faults: self.schedule.counts.clone(), ..self.counters.clone() }
    }

    /// When [`Self::poll`] is due, host nanoseconds.
    pub fn next_ns(&self) -> i64 {
        let own_ns = match &self.state {
            State::Off { until_ns, .. } => *until_ns,
            State::Streaming(stream) if self.line.results() < KEPT_RESULTS => stream.next.end_ns.min(self.next_log_ns),
            State::Streaming(_) => self.next_log_ns,
            State::Idle => i64::MAX,
        };
        own_ns.min(self.line.next_ns()).min(self.schedule.next_ns())
    }

    /// Flow control: whether the reader accepts no bytes.
    pub fn set_blocked(&mut self, is_blocked: bool, now_ns: i64) {
        self.line.set_blocked(is_blocked, now_ns);
    }

    /// Performs what is due at a host time and appends what reaches the reader.
    pub fn poll(&mut self, now_ns: i64, out: &mut Vec<Output>) {
        loop {
            while let Some((baud, bytes)) = self.line.arrive(now_ns) {
                out.push(Output::Bytes { bytes, baud });
            }
            if let Some(fault) = self.schedule.take(now_ns) {
                self.inject(fault, now_ns, out);
            } else if let Some((left_ns, then)) = self.leave(now_ns) {
                if let AfterSent::Fault(fault) = then {
                    self.go_off(fault, left_ns, out);
                }
            } else if !self.step(now_ns, out) {
                return;
            }
        }
    }

    fn leave(&mut self, now_ns: i64) -> Option<(i64, AfterSent)> {
        let was_full = self.line.results() >= KEPT_RESULTS;
        let left = self.line.leave(now_ns)?;
        if was_full && self.line.results() < KEPT_RESULTS {
            self.slot_free_since_ns = left.0;
        }
        Some(left)
    }

    /// Performs one step of the board; returns false if nothing is due.
    fn step(&mut self, now_ns: i64, out: &mut Vec<Output>) -> bool {
        match &self.state {
            State::Off { until_ns, unplugged } if *until_ns <= now_ns => {
                if *unplugged {
                    out.push(Output::Plugged);
                    self.state = State::Off { until_ns: until_ns.saturating_add(BOOT_NS), unplugged: false };
                } else {
                    self.state = State::Idle;
                }
                true
            }
            State::Streaming(_) if self.next_log_ns <= now_ns => {
                self.next_log_ns = now_ns.saturating_add(self.log_pause_ns());
                self.send_log("still streaming", now_ns);
                true
            }
            State::Streaming(stream) if stream.next.end_ns <= now_ns && self.line.results() < KEPT_RESULTS => {
                let read_ns = stream.next.end_ns.max(self.slot_free_since_ns);
                self.finish_result(read_ns);
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
        self.line.clear(false);
        self.reset_session();
        self.state = State::Idle;
    }

    fn reset_session(&mut self) {
        self.line.baud = self.board.max_baudrate().map(|_| FIRST_BAUD);
        self.setup = None;
        self.command.clear();
        self.next_log_ns = i64::MAX;
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
        if std::mem::take(&mut self.refuses_next) {
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
                    self.asks_for_calibration = false;
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
        if std::mem::take(&mut self.wraps_next) {
            let after_s = self.schedule.rng.random_range(0.2..2.0);
            self.clock.wrap_after(now_ns, after_s);
        }
        self.answer(serde_json::json!({"status": "start"}), now_ns);
        let start_s = self.clock.board_s(now_ns + 2 * ANSWER_NS);
        let next = self.measure(&setup, 0, start_s, false);
        self.next_log_ns = now_ns.saturating_add(self.log_pause_ns());
        self.state = State::Streaming(Box::new(Stream { setup, index: 0, next }));
    }

    fn stop(&mut self, now_ns: i64) {
        if !self.is_streaming() {
            return self.answer(protocol::error("not streaming"), now_ns);
        }
        // The set-up is kept for another start.
        (self.state, self.next_log_ns) = (State::Idle, i64::MAX);
        self.answer(serde_json::json!({"status": "stop"}), now_ns);
    }

    /// Measures a result that starts at this board time. The samples are made at once, before the
    /// measurement ends.
    fn measure(&mut self, setup: &BoardSetup, index: u64, start_s: f64, is_late: bool) -> Measured {
        let saturates = std::mem::take(&mut self.saturates_next);
        let temperature = 30 + libm::sin(start_s / 20.0).round() as i16;
        let (mut ends_ns, mut infos, mut samples) = (Vec::new(), Vec::new(), Vec::new());
        for (entry, end_s) in setup.ends_s() {
            let end_ns = self.clock.host_ns(start_s + end_s);
            let tick = self.clock.tick(end_ns + self.rng.random_range(0..LATENCY_NS));
            let first = samples.len();
            let request = FrameRequest { sensor_id: entry.sensor_id, config: &entry.config, index, tick, end_ns };
            let mut data_saturated = self.source.frame(&request, &mut samples);
            samples.resize(first + entry.config.points_per_frame(), Complex::default());
            if saturates {
                data_saturated = true;
                samples[first..].iter_mut().for_each(|s| *s = Complex::new(clamped(s.re), clamped(s.im)));
            }
            ends_ns.push(end_ns);
            infos.push(SentInfo {
                tick,
                data_saturated,
                temperature,
                calibration_needed: self.asks_for_calibration,
                frame_delayed: is_late,
            });
        }
        let end_ns = self.clock.host_ns(start_s + setup.timing.whole_s);
        Measured { start_s, end_ns, ends_ns, infos, samples }
    }

    /// Reads out and sends the measured result, and measures the next one.
    fn finish_result(&mut self, mut read_ns: i64) {
        let State::Streaming(mut stream) = std::mem::replace(&mut self.state, State::Idle) else { return };
        if read_ns < self.hung_until_ns {
            self.counters.lost += 1;
            read_ns = self.hung_until_ns;
        } else {
            self.send_result(&stream, read_ns);
        }
        let (start_s, is_late) = stream.next_start_s(self.clock.board_s(read_ns));
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
        let milliseconds = (self.clock.board_s(now_ns) * 1e3) as u64;
        let log = serde_json::json!({
            "status": "log", "level": "info", "timestamp": milliseconds, "module": "server", "log": text,
        });
        self.send(line_of(&log), now_ns, AfterSent::Nothing);
    }

    fn log_pause_ns(&mut self) -> i64 {
        (self.rng.random_range(LOG_PAUSE_S.0..LOG_PAUSE_S.1) * 1e9) as i64
    }

    fn send(&mut self, bytes: Vec<u8>, from_ns: i64, then: AfterSent) {
        self.dispatch(bytes, from_ns, false, then);
    }

    /// Puts a message on the line and applies its faults; returns them as (offset, kind).
    fn dispatch(
        &mut self,
        mut bytes: Vec<u8>,
        from_ns: i64,
        ends_result: bool,
        then: AfterSent,
    ) -> Vec<(usize, Fault)> {
        let mut faults = self.schedule.at_bytes(bytes.len());
        for fault in std::mem::take(&mut self.pending_faults) {
            faults.push((self.schedule.rng.random_range(0..bytes.len()), fault));
        }
        self.counters.bytes += bytes.len() as u64;
        let (mut parcel_ends, mut hold_ns, mut stall_ns, mut ending) = (None, 0, 0, None);
        for &(at, fault) in &faults {
            // Earlier faults may have removed bytes.
            let at = at.min(bytes.len() - 1);
            *self.schedule.counts.entry(fault).or_default() += 1;
            match fault {
                Fault::Drop => drop(bytes.remove(at)),
                Fault::Double => bytes.insert(at, bytes[at]),
                Fault::Flip => bytes[at] ^= 1 << self.schedule.rng.random_range(0..8),
                Fault::Garbage => {
                    let count = self.schedule.rng.random_range(1..=64);
                    let noise: Vec<u8> = (0..count).map(|_| self.schedule.rng.random::<u8>()).collect();
                    drop(bytes.splice(at..at, noise));
                }
                Fault::Stall => (parcel_ends, stall_ns) = (Some(at), self.schedule.seconds(0.05, 5.0)),
                Fault::Delay => (parcel_ends, hold_ns) = (Some(at), self.schedule.seconds(1e-3, 0.2)),
                Fault::Unplug | Fault::Reboot => (parcel_ends, ending) = (Some(at), Some(AfterSent::Fault(fault))),
                // These faults do not affect a byte but the next result.
                Fault::Saturate => self.saturates_next = true,
                Fault::Calibrate => self.asks_for_calibration = true,
                Fault::Refuse => self.refuses_next = true,
                Fault::Wrap => self.wraps_next = true,
                Fault::Jump => self.jump(),
                Fault::Burst => self.line.burst_until(from_ns + BURST_NS.0, BURST_NS.1),
                Fault::Error | Fault::Banner => {}
            }
        }
        let rest = parcel_ends.map(|at: usize| bytes.split_off(at.min(bytes.len())));
        let whole = Transmission { bytes, from_ns, hold_ns: 0, ends_result, then };
        let Some(rest) = rest else {
            self.line.put(whole);
            return faults;
        };
        self.line.put(Transmission { ends_result: false, then: ending.unwrap_or(AfterSent::Nothing), ..whole });
        let from_ns = from_ns.saturating_add(stall_ns);
        if stall_ns > 0 {
            self.hung_until_ns = from_ns;
        }
        if ending.is_none() {
            self.line.put(Transmission { bytes: rest, from_ns, hold_ns, ends_result, then });
        }
        faults
    }

    fn jump(&mut self) {
        let ticks = self.schedule.rng.random_range(1000..u32::MAX - 1000);
        self.clock.jump(ticks);
    }

    /// Injects a fault now, or into the next message.
    pub fn inject(&mut self, fault: Fault, now_ns: i64, out: &mut Vec<Output>) {
        let is_idle = !self.is_streaming();
        match fault {
            _ if fault.corrupts_bytes() => return self.pending_faults.push(fault),
            // Equally likely in the middle of a message and between two.
            Fault::Unplug | Fault::Reboot if !is_idle && self.schedule.rng.random_bool(0.5) => {
                return self.pending_faults.push(fault);
            }
            Fault::Unplug | Fault::Reboot => self.go_off(fault, now_ns, out),
            Fault::Saturate => self.saturates_next = true,
            Fault::Calibrate => self.asks_for_calibration = true,
            Fault::Refuse => self.refuses_next = true,
            Fault::Wrap => self.wraps_next = true,
            Fault::Jump => self.jump(),
            Fault::Burst => self.line.burst_until(now_ns + BURST_NS.0, BURST_NS.1),
            Fault::Error => self.send(line_of(&protocol::error("sensor error")), now_ns, AfterSent::Nothing),
            Fault::Banner => self.send(banner(self.board), now_ns, AfterSent::Nothing),
            _ => {}
        }
        *self.schedule.counts.entry(fault).or_default() += 1;
    }

    /// Unplugs or restarts the board; it loses its state.
    fn go_off(&mut self, fault: Fault, now_ns: i64, out: &mut Vec<Output>) {
        if matches!(self.state, State::Off { .. }) {
            return;
        }
        let unplugged = fault == Fault::Unplug;
        let lasts_ns = if unplugged { self.schedule.seconds(0.1, 3.0) } else { BOOT_NS };
        let until_ns = now_ns.saturating_add(lasts_ns);
        if unplugged {
            out.push(Output::Unplugged);
        }
        self.counters.lost += u64::from(self.is_streaming());
        self.line.clear(unplugged);
        self.reset_session();
        self.asks_for_calibration = false;
        self.clock.restart(if unplugged { until_ns } else { now_ns });
        self.state = State::Off { until_ns, unplugged };
        self.hung_until_ns = i64::MIN;
    }
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

/// The converter's limit with the sign of the sample.
fn clamped(value: i16) -> i16 {
    if value < 0 { i16::MIN } else { i16::MAX }
}

#[cfg(test)]
#[path = "device_tests.rs"]
mod tests;

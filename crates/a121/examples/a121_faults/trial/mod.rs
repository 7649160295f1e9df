//! One fault, at a random time of one session with a simulated board, in simulated time. What
//! arrives is compared with what was sent.

use std::collections::VecDeque;

use a121::device::{Board, Device, Fault, FaultPlan, Output, READING_NS, SentResult, TickSeededNoise};
use a121::{Action, Event, Link, SensorFrame, SensorSetup, Session, SessionCounters, Setup};
use a121::{SensorConfig, Subsweep, frame_timing, preset};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const S: i64 = 1_000_000_000;
/// Length of a result's line that the session assumes, bytes per sensor. With it goes the part of
/// the delay that the session subtracts.
const LINE_BYTES: i64 = 170;
/// Time after which a session that has not recovered counts as failed, nanoseconds. Choice.
const RECOVERY_TIMEOUT_NS: i64 = 120 * S;
/// A session has recovered when no frame was missed for this long, nanoseconds. Choice.
const STABLE_NS: i64 = 2 * S;
/// Accuracy required of times. After `SETTLED_S` seconds of frames: the greater of `SIGMAS` stated
/// standard deviations and one tick, plus `BOARD_DELAY_S` seconds for differences between the
/// board's own delays. Before: `UNSETTLED_TOLERANCE_S` seconds, the longest delay that is
/// simulated.
const SETTLED_S: f64 = 2.0;
const SIGMAS: f64 = 5.0;
const BOARD_DELAY_S: f64 = 0.1e-3;
const UNSETTLED_TOLERANCE_S: f64 = 0.25;
/// A flipped digit of a tick is detected when it moves the tick by more than this share of the
/// period.
const UNDETECTED_TICK_SHARE: f64 = 0.03;

/// Time of the fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Before streaming: with the reply to one of the commands.
    Opening,
    /// While frames are streamed.
    Streaming,
    /// While the session stops.
    Stopping,
}

/// Result of a trial.
#[derive(Debug, Clone)]
pub struct Outcome {
    pub phase: Phase,
    /// Time from the fault to the frame after which none was missed, to the first frame, or to the
    /// end, seconds.
    pub recovery_s: f64,
    /// Frames missed.
    pub lost: u64,
    /// Frames accepted; and, of them, frames with a flipped bit that cannot be detected.
    pub accepted: u64,
    pub undetected: u64,
    /// Greatest error of a time once the clock had settled, seconds, without the delay common to
    /// all results.
    pub worst_error_s: f64,
    pub counters: SessionCounters,
    /// Violations found in the trial, as text.
    pub failures: Vec<String>,
}

/// A board, a session, and the line between them.
struct SimulatedLine {
    device: Device,
    session: Session,
    rng: ChaCha8Rng,
    now_ns: i64,
    port_baud: u32,
    is_plugged: bool,
    period_s: f64,
    tick_s: f64,
    sent: VecDeque<SentResult>,
    first_frame_ns: Option<i64>,
    /// Time since which the session's clock has run, nanoseconds, and number of frames since then.
    streaming_since_ns: i64,
    frames_since: u64,
    tick_jumps: u64,
    /// End of the last accepted frame, nanoseconds.
    last_end_ns: Option<i64>,
    /// Arrival of the last frame before which one was missed, or of the first after the fault,
    /// nanoseconds.
    back_ns: Option<i64>,
    fault_ns: Option<i64>,
    ended: Option<Event>,
    outcome: Outcome,
}

/// Board, link and set-up of a trial.
fn board_and_setup(trial: u64) -> (Board, Link, Setup) {
    let d16 = preset("d16").expect("a preset");
    let config = |points, rate| {
        let subsweeps = vec![Subsweep { num_points: points, ..d16.subsweeps[0] }];
        SensorConfig { sweeps_per_frame: 4, subsweeps, frame_rate: rate, ..d16.clone() }
    };
    let sensor = |sensor_id, points| SensorSetup { sensor_id, config: config(points, None) };
    let serial = Link::Serial { baud: None };
    match trial % 5 {
        0 => (Board::Xc120, serial, Setup::single(1, config(10, Some(66.0)))),
        1 => (Board::Xm125, serial, Setup::single(1, config(10, Some(66.0)))),
        2 => (Board::Sparkfun, serial, Setup::single(1, config(10, Some(20.0)))),
        3 => (Board::Xc120, Link::Tcp, Setup::single(2, config(10, Some(120.0)))),
        _ => {
            let groups = vec![vec![sensor(1, 10), sensor(2, 7)], vec![sensor(2, 12)]];
            (Board::Xc120, serial, Setup { groups, update_rate_hz: Some(50.0), ..Setup::default() })
        }
    }
}

impl SimulatedLine {
    fn new(trial: u64, seed: u64, phase: Phase) -> Self {
        let (board, link, setup) = board_and_setup(trial);
        let frame_s = setup.sensors().map(|s| frame_timing(&s.config).frame_period_s).fold(0.0, f64::max);
        let period_s = setup.update_rate_hz.map_or(frame_s, |rate| 1.0 / rate);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let now_ns = rng.random_range(1..1000) * S;
        let mut device = Device::new(board, Box::new(TickSeededNoise), FaultPlan::default(), seed, now_ns);
        device.record_sent();
        let session = Session::new(setup, link, now_ns).expect("a sound set-up");
        let outcome = Outcome {
            phase,
            recovery_s: 0.0,
            lost: 0,
            accepted: 0,
            undetected: 0,
            worst_error_s: 0.0,
            counters: SessionCounters::default(),
            failures: Vec::new(),
        };
        Self {
            device,
            session,
            rng,
            now_ns,
            port_baud: 0,
            is_plugged: true,
            period_s,
            tick_s: 1.0 / f64::from(board.ticks_per_second()),
            sent: VecDeque::new(),
            first_frame_ns: None,
            streaming_since_ns: 0,
            frames_since: 0,
            tick_jumps: 0,
            last_end_ns: None,
            back_ns: None,
            fault_ns: None,
            ended: None,
            outcome,
        }
    }

    /// Runs until a time, or until a condition holds.
    fn run(&mut self, until_ns: i64, is_so: impl Fn(&Self) -> bool) {
        loop {
            self.apply_actions();
            if is_so(self) {
                return;
            }
            let next_ns = self.device.next_ns().min(self.session.next_deadline_ns());
            if next_ns > until_ns {
                self.now_ns = until_ns;
                return;
            }
            self.now_ns = self.now_ns.max(next_ns);
            let mut out = Vec::new();
            self.device.poll(self.now_ns, &mut out);
            self.deliver(out);
            self.session.poll(self.now_ns);
            while let Some(event) = self.session.next_event() {
                self.handle_event(event);
            }
        }
    }

    fn apply_actions(&mut self) {
        while let Some(action) = self.session.next_action() {
            match action {
                Action::Send(bytes) if self.is_plugged => {
                    let bytes = self.garbled(bytes, self.device.baud());
                    self.device.receive(&bytes, self.now_ns);
                }
                Action::SendBreak if self.is_plugged => self.device.receive_break(),
                Action::SetBaud(baud) => self.port_baud = baud,
                Action::Reopen if self.is_plugged => {
                    self.device.receive_break();
                    self.session.line_opened(self.now_ns);
                }
                _ => {}
            }
        }
    }

    /// Bytes sent at one speed and received at another are noise.
    fn garbled(&mut self, bytes: Vec<u8>, baud: Option<u32>) -> Vec<u8> {
        match baud.filter(|baud| *baud != self.port_baud) {
            Some(_) => bytes.iter().map(|_| self.rng.random()).collect(),
            None => bytes,
        }
    }

    fn deliver(&mut self, out: Vec<Output>) {
        for output in out {
            match output {
                Output::Bytes { bytes, baud } if self.is_plugged => {
                    let bytes = self.garbled(bytes, baud);
                    self.session.receive(&bytes, self.now_ns);
                }
                Output::Bytes { .. } => {}
                Output::Unplugged => {
                    self.is_plugged = false;
                    self.session.line_lost("unplugged");
                }
                Output::Plugged => {
                    self.is_plugged = true;
                    self.session.line_opened(self.now_ns);
                }
            }
        }
    }

    fn handle_event(&mut self, event: Event) {
        match event {
            Event::Frames(frames) => self.check(&frames),
            Event::Streaming => (self.streaming_since_ns, self.frames_since) = (self.now_ns, 0),
            Event::Stopped => self.ended = Some(event),
            Event::Failed(ref error) => {
                self.outcome.failures.push(format!("gave up: {error}"));
                self.ended = Some(event);
            }
            _ => {}
        }
    }

    /// Compares the frames of a result with what was sent.
    fn check(&mut self, frames: &[SensorFrame]) {
        self.sent.extend(self.device.take_sent());
        self.outcome.accepted += 1;
        let jumps = self.session.counters().tick_jumps;
        if jumps > std::mem::replace(&mut self.tick_jumps, jumps) {
            // The session's clock restarted.
            (self.streaming_since_ns, self.frames_since) = (self.now_ns, 0);
        }
        self.frames_since += 1;
        let Some((index, is_exact)) = self.matching(frames) else {
            let faults: Vec<_> = self.sent.iter().rev().take(3).map(|sent| &sent.faults).collect();
            return self.outcome.failures.push(format!(
                "a frame that differs from every sent one; last faults: \
                {faults:?}"
            ));
        };
        self.outcome.undetected += u64::from(!is_exact);
        let sent = self.sent[index].clone();
        self.sent.drain(..index);
        self.check_times(frames, &sent, is_exact);
        let end_ns = sent.ends_ns[0];
        if self.fault_ns.is_some() {
            let gap = self.last_end_ns.map_or(1.0, |last| (end_ns - last) as f64 * 1e-9 / self.period_s);
            self.outcome.lost += (gap.round() as u64).saturating_sub(1);
            if gap > 1.5 || self.back_ns.is_none() {
                self.back_ns = Some(self.now_ns);
            }
        }
        self.last_end_ns = Some(end_ns);
        self.first_frame_ns.get_or_insert(self.now_ns);
    }

    /// Index of the sent result that equals the frames, and whether it is equal exactly. Otherwise
    /// a damaged result whose damage cannot be detected.
    fn matching(&self, frames: &[SensorFrame]) -> Option<(usize, bool)> {
        let samples: Vec<_> = frames.iter().flat_map(|f| &f.frame.samples).copied().collect();
        let same_headers = |sent: &SentResult| {
            frames.len() == sent.infos.len()
                && frames.iter().zip(&sent.infos).all(|(SensorFrame { frame, .. }, info)| {
                    frame.tick as u32 == info.tick
                        && frame.temperature_c == info.temperature
                        && frame.data_saturated == info.data_saturated
                        && frame.calibration_needed == info.calibration_needed
                        && frame.frame_delayed == info.frame_delayed
                })
        };
        let exact = self.sent.iter().position(|sent| sent.samples == samples && same_headers(sent));
        if let Some(index) = exact {
            return Some((index, true));
        }
        let undetected = self.sent.iter().position(|sent| {
            let is_line_struck = sent.faults.iter().any(|(at, _)| *at < sent.line_bytes);
            let is_flipped = sent.faults.iter().any(|(at, fault)| *fault == Fault::Flip && *at >= sent.line_bytes);
            let bits = |a: i16, b: i16| (a ^ b).count_ones();
            let wrong_bits: u32 =
                sent.samples.iter().zip(&samples).map(|(a, b)| bits(a.re, b.re) + bits(a.im, b.im)).sum();
            (is_line_struck && sent.samples == samples)
                || (is_flipped && same_headers(sent) && sent.samples.len() == samples.len() && wrong_bits == 1)
        })?;
        Some((undetected, false))
    }

    fn check_times(&mut self, frames: &[SensorFrame], sent: &SentResult, is_exact: bool) {
        let assumed = LINE_BYTES * frames.len() as i64;
        let byte_ns = self.device.baud().map_or(0, |_| 10 * S / i64::from(self.port_baud));
        // Results wait for the last sensor.
        let waits_ns = sent.ends_ns.iter().max().map_or(0, |last| last - sent.ends_ns[0]);
        let shared_ns = READING_NS + waits_ns + (sent.line_bytes as i64 - assumed) * byte_ns;
        let is_settled = self.frames_since as f64 * self.period_s > SETTLED_S;
        for (SensorFrame { frame, .. }, end_ns) in frames.iter().zip(&sent.ends_ns) {
            let error_s = (frame.host_time_ns - end_ns - shared_ns) as f64 * 1e-9;
            if !is_exact && error_s.abs() < UNDETECTED_TICK_SHARE * self.period_s + 2e-3 {
                continue;
            }
            if is_settled {
                self.outcome.worst_error_s = self.outcome.worst_error_s.max(error_s.abs());
            }
            let sigma_s = self.session.clock_report().map_or(0.0, |report| report.sigma_s);
            let bound_s =
                if is_settled { self.tick_s.max(SIGMAS * sigma_s) + BOARD_DELAY_S } else { UNSETTLED_TOLERANCE_S };
            if error_s.abs() > bound_s {
                let since_s = (self.now_ns - self.streaming_since_ns) as f64 * 1e-9;
                let text =
                    format!("a time off by {:.3} ms {since_s:.1} s after the start, 1σ {sigma_s:.1e}", error_s * 1e3);
                self.outcome.failures.push(text);
            }
        }
    }

    fn inject(&mut self, fault: Fault) {
        let mut out = Vec::new();
        self.device.inject(fault, self.now_ns, &mut out);
        self.fault_ns = Some(self.now_ns);
        self.deliver(out);
    }

    /// Runs until no frame has been missed for `STABLE_NS`.
    fn await_recovery(&mut self) {
        let fault_ns = self.fault_ns.unwrap_or(self.now_ns);
        let is_back = |world: &Self| {
            world.ended.is_some()
                || world.back_ns.is_some_and(|at| at.max(fault_ns + S) + STABLE_NS <= world.now_ns)
                    && world.last_end_ns.is_some_and(|end| world.now_ns - end < S / 4)
        };
        self.run(fault_ns + RECOVERY_TIMEOUT_NS, is_back);
        match self.back_ns.filter(|_| self.ended.is_none() && is_back(self)) {
            Some(at) => self.outcome.recovery_s = (at - fault_ns) as f64 * 1e-9,
            None => self.outcome.failures.push("did not recover".into()),
        }
    }

    fn stop(&mut self) {
        let asked_ns = self.now_ns;
        self.session.stop(asked_ns);
        self.run(asked_ns + RECOVERY_TIMEOUT_NS, |world| world.ended.is_some());
        if self.ended != Some(Event::Stopped) {
            self.outcome.failures.push("did not stop".into());
        }
    }
}

/// Runs one trial, with the fault at a random time of its phase.
pub fn run(fault: Fault, trial: u64, seed: u64) -> Outcome {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ (trial << 8) ^ ((fault as u64) << 48));
    let phase = match rng.random_range(0..10) {
        0..3 => Phase::Opening,
        3..9 => Phase::Streaming,
        _ => Phase::Stopping,
    };
    let mut world = SimulatedLine::new(trial, rng.random(), phase);
    let begun_ns = world.now_ns;
    if phase == Phase::Opening {
        let commands = rng.random_range(0..6);
        world.run(begun_ns + 3 * S, |world| world.device.counters().commands >= commands);
        world.inject(fault);
        world.await_recovery();
        world.outcome.lost = 0;
    } else {
        world.run(begun_ns + 10 * S, |world| world.first_frame_ns.is_some());
        let until_ns = world.now_ns + (rng.random_range(0.0..4.0) * 1e9) as i64;
        world.run(until_ns, |_| false);
        world.inject(fault);
    }
    match phase {
        Phase::Opening => {}
        Phase::Streaming => world.await_recovery(),
        Phase::Stopping => {
            let until_ns = world.now_ns + rng.random_range(0..S / 50);
            world.run(until_ns, |_| false);
        }
    }
    if world.ended.is_none() {
        world.stop();
    }
    if phase == Phase::Stopping {
        let fault_ns = world.fault_ns.unwrap_or(world.now_ns);
        world.outcome.recovery_s = (world.now_ns - fault_ns) as f64 * 1e-9;
        world.outcome.lost = 0;
    }
    world.outcome.counters = world.session.counters();
    world.outcome
}

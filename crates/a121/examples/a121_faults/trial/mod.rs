//! One fault, at a random time of one session with a simulated board, in simulated time. What
//! arrives is compared with what was sent.

mod frame_check;
mod outcome;

use a121::device::{Board, Device, Fault, FaultPlan, Output, TickSeededNoise};
use a121::{Action, Event, Link, SensorFrame, SensorSetup, Session, SessionCounters, Setup};
use a121::{SensorConfig, Subsweep, frame_timing, preset};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use frame_check::{Arrival, FrameCheck};
pub use outcome::{Outcome, Phase};

const S: i64 = 1_000_000_000;
/// Time after which a session that has not recovered counts as failed, nanoseconds. Choice: many
/// times the session's longest pause of 8 s.
const RECOVERY_TIMEOUT_NS: i64 = 120 * S;
/// A session has recovered when no frame was missed for this long, nanoseconds. Choice: longer than
/// a fault's own effects after its end, such as a burst of 1 s.
const STABLE_NS: i64 = 2 * S;

/// When frames arrived, as far as it tells how a session recovers.
#[derive(Default)]
struct Recovery {
    fault_ns: Option<i64>,
    first_frame_ns: Option<i64>,
    /// End of the last accepted frame, nanoseconds.
    last_end_ns: Option<i64>,
    /// Arrival of the last frame before which one was missed, or of the first after the fault,
    /// nanoseconds.
    back_ns: Option<i64>,
}

impl Recovery {
    /// Takes an accepted frame; returns how many were missed before it, since the fault.
    fn accept(&mut self, end_ns: i64, now_ns: i64, period_s: f64) -> u64 {
        let mut lost = 0;
        if self.fault_ns.is_some() {
            let gap = self.last_end_ns.map_or(1.0, |last| (end_ns - last) as f64 * 1e-9 / period_s);
            lost = (gap.round() as u64).saturating_sub(1);
            if gap > 1.5 || self.back_ns.is_none() {
                self.back_ns = Some(now_ns);
            }
        }
        self.last_end_ns = Some(end_ns);
        self.first_frame_ns.get_or_insert(now_ns);
        lost
    }

    /// Whether no frame has been missed for `STABLE_NS` since the fault.
    fn is_back(&self, fault_ns: i64, now_ns: i64) -> bool {
        self.back_ns.is_some_and(|at| at.max(fault_ns + S) + STABLE_NS <= now_ns)
            && self.last_end_ns.is_some_and(|end| now_ns - end < S / 4)
    }
}

/// A board, a session, and the line between them.
struct SimulatedLine {
    device: Device,
    session: Session,
    rng: ChaCha8Rng,
    now_ns: i64,
    port_baud: u32,
    is_plugged: bool,
    /// Period of the results, seconds.
    period_s: f64,
    frames: FrameCheck,
    recovery: Recovery,
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
            frames: FrameCheck::new(period_s, 1.0 / f64::from(board.ticks_per_second())),
            recovery: Recovery::default(),
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
            Event::Streaming => self.frames.restart_clock(self.now_ns),
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
        self.frames.add_sent(self.device.take_sent());
        let arrival = Arrival {
            now_ns: self.now_ns,
            byte_ns: self.device.baud().map_or(0, |_| 10 * S / i64::from(self.port_baud)),
            tick_jumps: self.session.counters().tick_jumps,
            sigma_s: self.session.clock_report().map_or(0.0, |report| report.sigma_s),
        };
        if let Some(end_ns) = self.frames.check(frames, &arrival, &mut self.outcome) {
            self.outcome.lost += self.recovery.accept(end_ns, self.now_ns, self.period_s);
        }
    }

    fn inject(&mut self, fault: Fault) {
        let mut out = Vec::new();
        self.device.inject(fault, self.now_ns, &mut out);
        self.recovery.fault_ns = Some(self.now_ns);
        self.deliver(out);
    }

    /// Runs until no frame has been missed for `STABLE_NS`.
    fn await_recovery(&mut self) {
        let fault_ns = self.recovery.fault_ns.unwrap_or(self.now_ns);
        let is_back = |world: &Self| world.ended.is_some() || world.recovery.is_back(fault_ns, world.now_ns);
        self.run(fault_ns + RECOVERY_TIMEOUT_NS, is_back);
        match self.recovery.back_ns.filter(|_| self.ended.is_none() && is_back(self)) {
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
        world.run(begun_ns + 10 * S, |world| world.recovery.first_frame_ns.is_some());
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
        let fault_ns = world.recovery.fault_ns.unwrap_or(world.now_ns);
        world.outcome.recovery_s = (world.now_ns - fault_ns) as f64 * 1e-9;
        world.outcome.lost = 0;
    }
    world.outcome.counters = world.session.counters();
    world.outcome
}

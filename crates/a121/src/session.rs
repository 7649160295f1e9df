//! A session with a board: from an open line to timed frames, and recovery from every fault. Pure:
//! takes bytes and host times, returns actions and events.
//!
//! Sequence: break (serial only) → system info → sensor info → baud rate (serial only) → set-up →
//! start → streaming → stop and drain. Every problem is reported as an event. If a retry can help,
//! the session restarts from the break after a pause, which doubles up to 8 s. Replies have no
//! checksum, so the session asks for the system info until two replies agree, and a set-up error
//! ends the session only if it occurs twice. A board that requests a calibration is stopped and set
//! up again. Calibrations are reused after faults.
//!
//! The caller performs the actions of [`Session::next_action`], passes received bytes to
//! [`Session::receive`], and calls [`Session::poll`] at [`Session::next_deadline_ns`].
//!
//! [`Session`] is the state machine; the files of this module are its parts, each of which owns its
//! state.

mod board;
mod calibrations;
mod event;
mod frame_times;
mod input;
mod outbox;
mod plan;
mod retries;
mod state;

use crate::{
    ClockReport, Command, Message, Received, Reply, ResultLayout, ResultMessage, SensorInfo, SessionError, Setup,
    SetupReply, SystemInfo,
};

pub use event::{Action, Event, Link, SensorFrame, SessionCounters};

use board::{Board, Identification, Identified};
use calibrations::Calibrations;
use frame_times::{FrameTimes, Ticks};
use input::Input;
use outbox::Outbox;
use plan::Plan;
use retries::Retries;
use state::{Request, STOP_HINT, StaleStop, State};

/// Highest number of sensors of a board. Source: the ports of an XC120 with XE121.
pub const MAX_SENSORS: u32 = 5;
/// Baud rate at the start of every session. Source: the exploration protocol.
pub const FIRST_BAUD: u32 = 115_200;

const S: i64 = 1_000_000_000;
/// Wait after requesting a break, nanoseconds. Source: 0.25 s for the break itself, and 1 s of
/// quiet, as in the vendor's client.
const BREAK_NS: i64 = S + S / 4;
/// Timeout for a reply, nanoseconds. Source: the vendor's client.
const ANSWER_NS: i64 = 2 * S;
/// Additional timeout for stopping, nanoseconds. Source: the vendor's client.
const STOP_EXTRA_NS: i64 = S;
/// Approximate size of a result's line, bytes; with the payload it gives the transfer time. Source:
/// the protocol's result line with its five fields.
const LINE_BYTES: f64 = 170.0;

/// A session with one board. See the file's head.
pub struct Session {
    plan: Plan,
    board: Identification,
    calibrations: Calibrations,
    input: Input,
    /// Since the last set-up.
    times: Option<FrameTimes>,
    state: State,
    deadline_ns: i64,
    /// Bytes that belonged to no message when the last command was sent.
    skipped_before: u64,
    retries: Retries,
    stale_stop: StaleStop,
    outbox: Outbox,
    counters: SessionCounters,
}

impl Session {
    /// Starts a session on an open line.
    ///
    /// # Errors
    /// The set-up breaks a rule.
    pub fn new(setup: Setup, link: Link, now_ns: i64) -> Result<Self, SessionError> {
        let calibrations = Calibrations::new(setup.calibrations.clone());
        let mut session = Self {
            plan: Plan::new(setup, link)?,
            board: Identification::default(),
            calibrations,
            input: Input::new(now_ns),
            times: None,
            state: State::Closed,
            deadline_ns: i64::MAX,
            skipped_before: 0,
            retries: Retries::default(),
            stale_stop: StaleStop::default(),
            outbox: Outbox::default(),
            counters: SessionCounters::default(),
        };
        session.connect(now_ns);
        Ok(session)
    }

    /// The next action to perform on the line, in order.
    pub fn next_action(&mut self) -> Option<Action> {
        self.outbox.next_action()
    }

    /// The next event.
    pub fn next_event(&mut self) -> Option<Event> {
        self.outbox.next_event()
    }

    /// When [`Self::poll`] is due, host nanoseconds.
    pub fn next_deadline_ns(&self) -> i64 {
        match self.input.quiet_deadline_ns(self.board.has_baud()).filter(|_| self.state != State::Over) {
            Some(quiet_ns) => self.deadline_ns.min(quiet_ns),
            None => self.deadline_ns,
        }
    }

    /// Whether the session is over: stopped or failed.
    pub fn is_over(&self) -> bool {
        self.state == State::Over
    }

    /// The counters.
    pub fn counters(&self) -> SessionCounters {
        let (stream, dropped_events) = (self.input.counters(), self.outbox.dropped_events());
        SessionCounters { stream, dropped_events, ..self.counters }
    }

    /// Quality of the frame times; `None` before streaming.
    pub fn clock_report(&self) -> Option<ClockReport> {
        self.times.as_ref().map(FrameTimes::report)
    }

    /// Takes bytes that were read at a host time.
    pub fn receive(&mut self, bytes: &[u8], now_ns: i64) {
        if matches!(self.state, State::Over | State::Closed | State::Breaking) {
            return;
        }
        let received = self.input.receive(bytes, now_ns);
        self.handle_all(received, now_ns);
    }

    /// Performs what is due at a host time.
    pub fn poll(&mut self, now_ns: i64) {
        if let Some(received) = self.input.accept_when_quiet(self.board.has_baud(), now_ns) {
            self.handle_all(received, now_ns);
        }
        if now_ns >= self.deadline_ns {
            self.time_out(now_ns);
        }
    }

    /// Ends the session: frames in transit are still emitted, then [`Event::Stopped`].
    pub fn stop(&mut self, now_ns: i64) {
        match self.state {
            State::Over => {}
            State::Streaming | State::Awaiting(Request::Start) => self.stop_streaming(true, now_ns),
            State::Stopping { .. } => self.state = State::Stopping { ends: true },
            _ => self.finish(Event::Stopped),
        }
    }

    /// Reports that the line was lost: unplugged, or closed by the other side.
    pub fn line_lost(&mut self, reason: &str) {
        self.outbox.cancel_actions();
        if self.state == (State::Stopping { ends: true }) {
            self.finish(Event::Stopped);
        } else if !matches!(self.state, State::Over | State::Closed) {
            self.enter(State::Closed, i64::MAX);
            self.outbox.report(Event::Trouble(SessionError::LineLost(reason.to_owned())));
        }
    }

    /// Reports that the line is open again.
    pub fn line_opened(&mut self, now_ns: i64) {
        if self.state != State::Over {
            self.connect(now_ns);
        }
    }

    fn enter(&mut self, state: State, deadline_ns: i64) {
        (self.state, self.deadline_ns) = (state, deadline_ns);
    }

    fn connect(&mut self, now_ns: i64) {
        self.counters.connects += 1;
        self.board = Identification::default();
        self.stale_stop = StaleStop::default();
        self.input.expect_results(None);
        self.input.clear();
        match self.plan.link {
            Link::Serial { .. } => {
                self.outbox.act(Action::SetBaud(FIRST_BAUD));
                self.outbox.act(Action::SendBreak);
                self.enter(State::Breaking, now_ns.saturating_add(BREAK_NS));
            }
            Link::Tcp => self.ask(Request::System, now_ns),
        }
    }

    fn ask(&mut self, asked: Request, now_ns: i64) {
        let bytes = match asked {
            Request::System => Command::GetSystemInfo.to_bytes(),
            Request::Sensors => Command::GetSensorInfo.to_bytes(),
            Request::Baud(baud) => Command::SetUartBaudrate(baud).to_bytes(),
            Request::Setup => {
                let version = self.board.version();
                let calibrations = self.calibrations.reusable(version);
                Command::Setup(&Setup { calibrations, ..self.plan.setup.clone() }, version).to_bytes()
            }
            Request::Start => Command::StartStreaming.to_bytes(),
        };
        self.outbox.act(Action::Send(bytes));
        self.skipped_before = self.input.counters().skipped_bytes;
        self.enter(State::Awaiting(asked), now_ns.saturating_add(self.patience_ns(asked)));
    }

    /// Timeout for a reply, nanoseconds.
    fn patience_ns(&self, asked: Request) -> i64 {
        if asked == Request::Start { self.frame_patience_ns() } else { ANSWER_NS }
    }

    /// Timeout for the next frame, nanoseconds.
    fn frame_patience_ns(&self) -> i64 {
        ANSWER_NS.max(((1.5 * self.plan.result_period_s() + 1.0).min(1e6) * 1e9) as i64)
    }

    fn time_out(&mut self, now_ns: i64) {
        match self.state {
            State::Pausing if self.plan.link == Link::Tcp => {
                self.outbox.act(Action::Reopen);
                self.enter(State::Closed, i64::MAX);
            }
            State::Pausing => self.connect(now_ns),
            State::Breaking => {
                self.outbox.act(Action::FlushInput);
                self.input.clear();
                self.ask(Request::System, now_ns);
            }
            State::Awaiting(asked) => {
                self.counters.unanswered += 1;
                let seconds = self.patience_ns(asked) as f64 * 1e-9;
                self.retry_after_pause(self.unanswered(asked, seconds), now_ns);
            }
            State::Streaming => {
                self.counters.silences += 1;
                let seconds = self.frame_patience_ns() as f64 * 1e-9;
                self.retry_after_pause(SessionError::Silent { seconds }, now_ns);
            }
            // No reply after the stop command counts as stopped.
            State::Stopping { ends: true } => self.finish(Event::Stopped),
            State::Stopping { ends: false } => {
                self.counters.unanswered += 1;
                let seconds = (self.frame_patience_ns() + STOP_EXTRA_NS) as f64 * 1e-9;
                let error = SessionError::NoAnswer { asked: "stop_streaming", seconds, hint: STOP_HINT };
                self.retry_after_pause(error, now_ns);
            }
            State::Closed | State::Over => self.deadline_ns = i64::MAX,
        }
    }

    /// Why a command has no answer.
    fn unanswered(&self, asked: Request, seconds: f64) -> SessionError {
        let asked_for = asked.name();
        match self.input.counters().skipped_bytes - self.skipped_before {
            0 => SessionError::NoAnswer { asked: asked_for, seconds, hint: asked.hint(self.plan.link) },
            bytes => SessionError::ForeignBytes { asked: asked_for, seconds, bytes },
        }
    }

    fn retry_after_pause(&mut self, error: SessionError, now_ns: i64) {
        self.outbox.report(Event::Trouble(error));
        self.input.expect_results(None);
        let pause_ns = self.retries.next_pause_ns();
        self.enter(State::Pausing, now_ns.saturating_add(pause_ns));
    }

    /// Ends the session if the same error occurs twice; once, it may be a transmission fault.
    fn fail(&mut self, error: SessionError, now_ns: i64) {
        match self.retries.is_repeated(&error) {
            true => self.finish(Event::Failed(error)),
            false => self.retry_after_pause(error, now_ns),
        }
    }

    fn finish(&mut self, event: Event) {
        self.enter(State::Over, i64::MAX);
        self.outbox.report(event);
    }

    fn handle_all(&mut self, mut received: Vec<Received>, now_ns: i64) {
        for Received { message, arrival_ns } in received.drain(..) {
            if self.is_over() {
                break;
            }
            match message {
                Message::Reply(Reply::Log(line)) => self.outbox.report(Event::Log(line)),
                Message::Reply(reply) => self.handle(reply, now_ns),
                Message::Result(result) => self.handle_result(result, arrival_ns, now_ns),
                Message::StaleResult => self.handle_stale(now_ns),
            }
        }
        self.input.recycle(received);
    }

    fn handle(&mut self, reply: Reply, now_ns: i64) {
        match (self.state, reply) {
            (State::Awaiting(Request::System), Reply::System(info)) => self.on_system_info(info, now_ns),
            (State::Awaiting(Request::Sensors), Reply::Sensors(sensors)) => self.on_sensor_info(sensors, now_ns),
            (State::Awaiting(Request::Baud(baud)), Reply::Ok) => {
                self.outbox.act(Action::SetBaud(baud));
                self.ask(Request::Setup, now_ns);
            }
            (State::Awaiting(Request::Setup), Reply::Setup(reply)) => self.on_setup_reply(reply, now_ns),
            (State::Awaiting(Request::Start), Reply::Started) => self.begin_streaming(now_ns),
            (State::Stopping { ends: true }, Reply::Stopped | Reply::SessionEnded) => self.finish(Event::Stopped),
            (State::Stopping { ends: false }, Reply::Stopped) => {
                self.input.expect_results(None);
                self.ask(Request::Setup, now_ns);
            }
            // The stream of an older session has stopped. The board may not have processed the
            // earlier command, so it is sent again.
            (State::Awaiting(asked), Reply::Stopped) if self.stale_stop == StaleStop::ReplyPending => {
                self.stale_stop = StaleStop::Answered;
                if let Request::System | Request::Sensors = asked {
                    self.ask(asked, now_ns);
                }
            }
            (State::Awaiting(Request::System), Reply::Stopped) => self.counters.unexpected_replies += 1,
            (State::Awaiting(_) | State::Streaming, Reply::SessionEnded | Reply::Stopped) => {
                self.retry_after_pause(SessionError::EndedByServer, now_ns);
            }
            (State::Awaiting(Request::Setup), Reply::Error(message)) => {
                // A rejected calibration may be the cause. Without calibrations, the next error is
                // about the configuration.
                let error = SessionError::Refused { asked: "setup", message };
                match self.calibrations.discard() {
                    true => self.retry_after_pause(error, now_ns),
                    false => self.fail(error, now_ns),
                }
            }
            (State::Awaiting(asked), Reply::Error(message)) => {
                self.retry_after_pause(SessionError::Refused { asked: asked.name(), message }, now_ns);
            }
            (State::Streaming, Reply::Error(message)) => {
                self.retry_after_pause(SessionError::Refused { asked: "to stream on", message }, now_ns);
            }
            _ => self.counters.unexpected_replies += 1,
        }
    }

    fn on_system_info(&mut self, info: SystemInfo, now_ns: i64) {
        let info = match self.board.compare(info) {
            Identified::Agreed(info) => info,
            Identified::AskAgain => return self.ask(Request::System, now_ns),
            Identified::Differ => return self.retry_after_pause(SessionError::AnswersDiffer, now_ns),
        };
        match Board::new(info, &self.plan) {
            Ok(board) => {
                self.board.known = Some(board);
                self.ask(Request::Sensors, now_ns);
            }
            Err(error) => self.finish(Event::Failed(error)),
        }
    }

    fn on_sensor_info(&mut self, sensors: Vec<SensorInfo>, now_ns: i64) {
        if let Err(error) = self.plan.check_sensors(&sensors) {
            return self.retry_after_pause(error, now_ns);
        }
        let Some(board) = &mut self.board.known else { return };
        let next = match board.baud_to_set(self.plan.link) {
            Some(baud) => {
                board.baud = Some(baud);
                Request::Baud(baud)
            }
            None => Request::Setup,
        };
        let info = board.info.clone();
        self.outbox.report(Event::Connected(info, sensors));
        self.ask(next, now_ns);
    }

    fn on_setup_reply(&mut self, reply: SetupReply, now_ns: i64) {
        let layout = ResultLayout::of(&self.plan.setup);
        if !layout.agrees_with(&reply) {
            return self.fail(SessionError::OtherFrames, now_ns);
        }
        let Some(board) = &self.board.known else { return };
        let bits = 10.0 * (LINE_BYTES * self.plan.timings().len() as f64 + layout.payload_bytes() as f64);
        let transfer_s = board.baud.map_or(0.0, |baud| bits / f64::from(baud));
        self.times = Some(FrameTimes::new(&self.plan, board.info.ticks_per_second, transfer_s));
        self.calibrations.keep(&reply.calibrations);
        self.input.expect_results(Some(layout));
        self.outbox.report(Event::SetUp(reply));
        self.ask(Request::Start, now_ns);
    }

    fn begin_streaming(&mut self, now_ns: i64) {
        self.enter(State::Streaming, now_ns.saturating_add(self.frame_patience_ns()));
        self.outbox.report(Event::Streaming);
    }

    fn stop_streaming(&mut self, ends: bool, now_ns: i64) {
        self.outbox.act(Action::Send(Command::StopStreaming.to_bytes()));
        self.enter(State::Stopping { ends }, now_ns.saturating_add(self.frame_patience_ns() + STOP_EXTRA_NS));
    }

    /// Stops a board that still streams for an earlier client.
    fn handle_stale(&mut self, now_ns: i64) {
        if self.state == State::Awaiting(Request::System) && self.stale_stop == StaleStop::NotSent {
            self.stale_stop = StaleStop::ReplyPending;
            self.outbox.act(Action::Send(Command::StopStreaming.to_bytes()));
            self.deadline_ns = now_ns.saturating_add(ANSWER_NS + STOP_EXTRA_NS);
        }
    }

    fn handle_result(&mut self, result: ResultMessage, arrival_ns: i64, now_ns: i64) {
        // The reply to the start command was lost.
        if self.state == State::Awaiting(Request::Start) {
            self.begin_streaming(now_ns);
        }
        if !matches!(self.state, State::Streaming | State::Stopping { .. }) {
            return;
        }
        let Some(times) = &mut self.times else { return };
        let (ticks, has_jumped) = times.check(&result.infos, arrival_ns);
        self.counters.tick_jumps += u64::from(has_jumped);
        let ticks = match ticks {
            Ticks::Accepted(ticks) => ticks,
            Ticks::Unconfirmed => return self.counters.unconfirmed += 1,
            Ticks::Refused => return self.counters.refused_ticks += 1,
        };
        let asks_for_calibration = result.infos.iter().any(|info| info.calibration_needed);
        let frames = times.frames(&self.plan.setup, result, &ticks, arrival_ns);
        self.counters.results += 1;
        self.retries = Retries::default();
        self.outbox.report(Event::Frames(frames));
        if self.state != State::Streaming {
            return;
        }
        self.deadline_ns = now_ns.saturating_add(self.frame_patience_ns());
        if asks_for_calibration && self.calibrations.renew(now_ns) {
            self.counters.recalibrations += 1;
            self.outbox.report(Event::Recalibrating);
            self.stop_streaming(false, now_ns);
        }
    }
}

#[cfg(test)]
#[path = "session_tests.rs"]
mod tests;

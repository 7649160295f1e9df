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
//! Longer than other files: the session is one state machine, and each of its states answers to the
//! same messages and times.

use std::collections::VecDeque;

use super::{
    Calibration, Clock, ClockReport, Command, LogLine, Message, Parser, Received, Reply, ResultLayout, ResultMessage,
    SensorInfo, SensorSetup, SessionError, Setup, SetupReply, StreamCounters, SystemInfo, TickUnwrapper, TickVerdict,
    Version,
};
use crate::{Frame, FrameTiming, Prf, SensorConfig, frame_timing};

/// Highest number of sensors of a board.
pub const MAX_SENSORS: u32 = 5;
/// Baud rate at the start of every session.
pub const FIRST_BAUD: u32 = 115_200;

const S: i64 = 1_000_000_000;
/// Wait after requesting a break, nanoseconds: 0.25 s for the break itself, and 1 s that the server
/// needs afterwards.
const BREAK_NS: i64 = S + S / 4;
/// Timeout for a reply, nanoseconds. Choice.
const ANSWER_NS: i64 = 2 * S;
/// Additional timeout for stopping, nanoseconds. Choice.
const STOP_EXTRA_NS: i64 = S;
/// A line without bytes for this long has ended a payload, nanoseconds. Serial lines need longer,
/// because converters pass bytes on in pieces, one per millisecond. Choice.
const QUIET_NS: i64 = 300_000;
const QUIET_SERIAL_NS: i64 = 2_000_000;
/// Limit of differing replies to the first command before the session restarts. Choice.
const MAX_ANSWERS: usize = 6;
/// First and longest pause before a retry, nanoseconds. Choice.
const RETRY_PAUSE_NS: (i64, i64) = (S / 2, 8 * S);
/// A calibration request sooner than this after the last one is ignored, nanoseconds. Choice.
const RECALIBRATE_NS: i64 = 10 * S;
/// Limit of unread events. Choice.
const MAX_EVENTS: usize = 4096;
/// Approximate size of a result's line, bytes; with the payload it gives the transfer time.
const LINE_BYTES: f64 = 170.0;

/// Versions up to this one are not supported.
const LAST_UNSUPPORTED: Version = Version::release(0, 2, 0);
const CALIBRATION_REUSE_SINCE: Version = Version::development(0, 4, 3, 280);
const PRF_5_2_SINCE: Version = Version::development(0, 4, 3, 310);
const PRF_15_6_SINCE: Version = Version::development(0, 7, 1, 37);

/// Link to the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Link {
    /// A serial port.
    Serial {
        /// Baud rate to switch to; `None` for the highest one of the board.
        baud: Option<u32>,
    },
    /// A socket to the server on a Raspberry Pi.
    Tcp,
}

/// What the caller has to do with the line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// Write these bytes.
    Send(Vec<u8>),
    /// Send a break.
    SendBreak,
    /// Discard bytes that were received but not yet passed to the session.
    FlushInput,
    /// Switch the local port to this speed.
    SetBaud(u32),
    /// Close the socket, open it again, and call [`Session::line_opened`].
    Reopen,
}

/// A frame of one sensor, with its host time.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorFrame {
    /// Group within the set-up.
    pub group: usize,
    /// Sensor on the board, from 1.
    pub sensor_id: u32,
    /// The frame; its host time is the end of the measurement.
    pub frame: Frame,
}

/// An event of the session.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// The board answered.
    Connected(SystemInfo, Vec<SensorInfo>),
    /// The sensors are set up.
    SetUp(SetupReply),
    /// Streaming started.
    Streaming,
    /// The frames of one result, group by group.
    Frames(Vec<SensorFrame>),
    /// A line of the board's log.
    Log(LogLine),
    /// A sensor requested a calibration; all sensors are set up again.
    Recalibrating,
    /// A problem; the session retries.
    Trouble(SessionError),
    /// A problem that a retry cannot solve; the session is over.
    Failed(SessionError),
    /// Stopped on request.
    Stopped,
}

/// Counters of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SessionCounters {
    /// Counters of the byte stream.
    pub stream: StreamCounters,
    /// Results emitted as frames.
    pub results: u64,
    /// Results that only served to confirm the first tick.
    pub unconfirmed: u64,
    /// Results rejected because of their tick.
    pub refused_ticks: u64,
    /// Jumps of the sensor's clock.
    pub tick_jumps: u64,
    /// Connection attempts.
    pub connects: u64,
    /// Missing replies.
    pub unanswered: u64,
    /// Times that frames stopped.
    pub silences: u64,
    /// Replies without a request.
    pub unexpected_replies: u64,
    /// New set-ups after a calibration request.
    pub recalibrations: u64,
    /// Events dropped because they were not read.
    pub dropped_events: u64,
}

/// State of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Waits before a retry.
    Pausing,
    /// The line is closed.
    Closed,
    Breaking,
    Awaiting(Request),
    Streaming,
    /// Stopping, either to end or to set up again.
    Stopping {
        ends: bool,
    },
    Over,
}

/// The request whose reply is awaited.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Request {
    System,
    Sensors,
    Baud(u32),
    Setup,
    Start,
}

impl Request {
    fn name(self) -> &'static str {
        match self {
            Self::System => "get_system_info",
            Self::Sensors => "get_sensor_info",
            Self::Baud(_) => "set_uart_baudrate",
            Self::Setup => "setup",
            Self::Start => "start_streaming",
        }
    }
}

/// The board that answered.
#[derive(Debug, Clone)]
struct Board {
    info: SystemInfo,
    version: Version,
    /// Baud rate; `None` if the link has no baud rate.
    baud: Option<u32>,
}

/// A session with one board. See the file's head.
pub struct Session {
    setup: Setup,
    link: Link,
    timings: Vec<FrameTiming>,
    parser: Parser,
    received: Vec<Received>,
    state: State,
    deadline_ns: i64,
    last_bytes_ns: i64,
    pause_ns: i64,
    /// Different system infos received since the last break.
    system_infos: Vec<SystemInfo>,
    board: Option<Board>,
    /// Error of the last set-up, if it failed.
    unconfirmed_error: Option<SessionError>,
    calibrations: Vec<Calibration>,
    recalibrated_ns: Option<i64>,
    stop_sent: bool,
    /// A stop command was sent to an older stream, and its reply is still missing.
    stop_reply_pending: bool,
    ticks: Vec<TickUnwrapper>,
    clock: Option<Clock>,
    actions: VecDeque<Action>,
    events: VecDeque<Event>,
    counters: SessionCounters,
}

impl Session {
    /// Starts a session on an open line.
    ///
    /// # Errors
    /// The set-up breaks a rule.
    pub fn new(setup: Setup, link: Link, now_ns: i64) -> Result<Self, SessionError> {
        check(&setup)?;
        let timings = setup.sensors().map(|s| frame_timing(&s.config)).collect();
        let mut session = Self {
            calibrations: setup.calibrations.clone(),
            setup,
            link,
            timings,
            parser: Parser::default(),
            received: Vec::new(),
            state: State::Closed,
            deadline_ns: i64::MAX,
            last_bytes_ns: now_ns,
            pause_ns: RETRY_PAUSE_NS.0,
            system_infos: Vec::new(),
            board: None,
            unconfirmed_error: None,
            recalibrated_ns: None,
            stop_sent: false,
            stop_reply_pending: false,
            ticks: Vec::new(),
            clock: None,
            actions: VecDeque::new(),
            events: VecDeque::new(),
            counters: SessionCounters::default(),
        };
        session.connect(now_ns);
        Ok(session)
    }

    /// The next action to perform on the line, in order.
    pub fn next_action(&mut self) -> Option<Action> {
        self.actions.pop_front()
    }

    /// The next event.
    pub fn next_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// When [`Self::poll`] is due, host nanoseconds.
    pub fn next_deadline_ns(&self) -> i64 {
        match self.parser.has_unconfirmed() && self.state != State::Over {
            true => self.deadline_ns.min(self.last_bytes_ns.saturating_add(self.quiet_ns())),
            false => self.deadline_ns,
        }
    }

    /// Whether the session is over: stopped or failed.
    pub fn is_over(&self) -> bool {
        self.state == State::Over
    }

    /// The counters.
    pub fn counters(&self) -> SessionCounters {
        SessionCounters { stream: *self.parser.counters(), ..self.counters }
    }

    /// Quality of the frame times; `None` before streaming.
    pub fn clock_report(&self) -> Option<ClockReport> {
        self.clock.as_ref().map(Clock::report)
    }

    /// Takes bytes that were read at a host time.
    pub fn receive(&mut self, bytes: &[u8], now_ns: i64) {
        if matches!(self.state, State::Over | State::Closed | State::Breaking) {
            return;
        }
        self.last_bytes_ns = now_ns;
        let mut received = std::mem::take(&mut self.received);
        self.parser.push(bytes, now_ns, &mut received);
        self.handle_all(&mut received, now_ns);
    }

    /// Performs what is due at a host time.
    pub fn poll(&mut self, now_ns: i64) {
        if self.parser.has_unconfirmed() && now_ns.saturating_sub(self.last_bytes_ns) >= self.quiet_ns() {
            let mut received = std::mem::take(&mut self.received);
            self.parser.accept_when_quiet(&mut received);
            self.handle_all(&mut received, now_ns);
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
        self.actions.clear();
        if self.state == (State::Stopping { ends: true }) {
            self.finish(Event::Stopped);
        } else if !matches!(self.state, State::Over | State::Closed) {
            self.enter(State::Closed, i64::MAX);
            self.push_event(Event::Trouble(SessionError::LineLost(reason.to_owned())));
        }
    }

    /// Reports that the line is open again.
    pub fn line_opened(&mut self, now_ns: i64) {
        if self.state != State::Over {
            self.connect(now_ns);
        }
    }

    fn quiet_ns(&self) -> i64 {
        let has_speed = self.board.as_ref().is_some_and(|board| board.baud.is_some());
        if has_speed { QUIET_SERIAL_NS } else { QUIET_NS }
    }

    fn push_event(&mut self, event: Event) {
        if self.events.len() >= MAX_EVENTS {
            self.events.pop_front();
            self.counters.dropped_events += 1;
        }
        self.events.push_back(event);
    }

    fn enter(&mut self, state: State, deadline_ns: i64) {
        (self.state, self.deadline_ns) = (state, deadline_ns);
    }

    fn connect(&mut self, now_ns: i64) {
        self.counters.connects += 1;
        self.board = None;
        self.system_infos.clear();
        (self.stop_sent, self.stop_reply_pending) = (false, false);
        self.parser.expect_results(None);
        self.parser.clear();
        match self.link {
            Link::Serial { .. } => {
                self.actions.extend([Action::SetBaud(FIRST_BAUD), Action::SendBreak]);
                self.enter(State::Breaking, now_ns.saturating_add(BREAK_NS));
            }
            Link::Tcp => self.ask(Request::System, now_ns),
        }
    }

    fn ask(&mut self, asked: Request, now_ns: i64) {
        let version = self.board.as_ref().map_or(LAST_UNSUPPORTED, |board| board.version);
        let bytes = match asked {
            Request::System => Command::GetSystemInfo.to_bytes(),
            Request::Sensors => Command::GetSensorInfo.to_bytes(),
            Request::Baud(baud) => Command::SetUartBaudrate(baud).to_bytes(),
            Request::Setup => {
                let reuse = version >= CALIBRATION_REUSE_SINCE;
                self.setup.calibrations = if reuse { self.calibrations.clone() } else { Vec::new() };
                Command::Setup(&self.setup, version).to_bytes()
            }
            Request::Start => Command::StartStreaming.to_bytes(),
        };
        self.actions.push_back(Action::Send(bytes));
        let extra_ns = if asked == Request::Start { self.frame_patience_ns() } else { ANSWER_NS };
        self.enter(State::Awaiting(asked), now_ns.saturating_add(extra_ns));
    }

    /// Timeout for the next frame, nanoseconds.
    fn frame_patience_ns(&self) -> i64 {
        ANSWER_NS.max(((1.5 * self.result_period_s() + 1.0).min(1e6) * 1e9) as i64)
    }

    /// Time between results, seconds: as configured, but at least the time that the groups need one
    /// after the other.
    fn result_period_s(&self) -> f64 {
        let busy_s =
            |s: &SensorSetup| frame_timing(&SensorConfig { frame_rate: None, ..s.config.clone() }).frame_period_s;
        let groups_s: f64 = self.setup.groups.iter().map(|g| g.iter().map(busy_s).fold(0.0, f64::max)).sum();
        let update_s = self.setup.update_rate_hz.map_or(0.0, |rate| 1.0 / rate);
        self.timings.iter().map(|t| t.frame_period_s).fold(groups_s.max(update_s), f64::max)
    }

    fn time_out(&mut self, now_ns: i64) {
        match self.state {
            State::Pausing if self.link == Link::Tcp => {
                self.actions.push_back(Action::Reopen);
                self.enter(State::Closed, i64::MAX);
            }
            State::Pausing => self.connect(now_ns),
            State::Breaking => {
                self.actions.push_back(Action::FlushInput);
                self.parser.clear();
                self.ask(Request::System, now_ns);
            }
            State::Awaiting(asked) => {
                self.counters.unanswered += 1;
                let waited_ns = if asked == Request::Start { self.frame_patience_ns() } else { ANSWER_NS };
                let hint = match (asked, self.link) {
                    (Request::System, Link::Serial { .. }) => {
                        "XE125: use the port named Enhanced. SparkFun: flow control off"
                    }
                    (Request::System, Link::Tcp) => "Is the exploration server running?",
                    _ => "A slower baud rate may help",
                };
                let seconds = waited_ns as f64 * 1e-9;
                self.retry_after_pause(SessionError::NoAnswer { asked: asked.name(), seconds, hint }, now_ns);
            }
            State::Streaming => {
                self.counters.silences += 1;
                self.retry_after_pause(
                    SessionError::Silent { seconds: self.frame_patience_ns() as f64 * 1e-9 },
                    now_ns,
                );
            }
            // No reply after the stop command counts as stopped.
            State::Stopping { ends: true } => self.finish(Event::Stopped),
            State::Stopping { ends: false } => {
                self.counters.unanswered += 1;
                let seconds = (self.frame_patience_ns() + STOP_EXTRA_NS) as f64 * 1e-9;
                let hint = "A slower baud rate may help";
                self.retry_after_pause(SessionError::NoAnswer { asked: "stop_streaming", seconds, hint }, now_ns);
            }
            State::Closed | State::Over => self.deadline_ns = i64::MAX,
        }
    }

    fn retry_after_pause(&mut self, error: SessionError, now_ns: i64) {
        self.push_event(Event::Trouble(error));
        self.parser.expect_results(None);
        self.enter(State::Pausing, now_ns.saturating_add(self.pause_ns));
        self.pause_ns = (2 * self.pause_ns).min(RETRY_PAUSE_NS.1);
    }

    /// Ends the session if the same error occurs twice; once, it may be a transmission fault.
    fn fail(&mut self, error: SessionError, now_ns: i64) {
        if self.unconfirmed_error.as_ref() == Some(&error) {
            return self.finish(Event::Failed(error));
        }
        self.unconfirmed_error = Some(error.clone());
        self.retry_after_pause(error, now_ns);
    }

    fn finish(&mut self, event: Event) {
        self.enter(State::Over, i64::MAX);
        self.push_event(event);
    }

    fn handle_all(&mut self, received: &mut Vec<Received>, now_ns: i64) {
        for Received { message, arrival_ns } in received.drain(..) {
            if self.is_over() {
                break;
            }
            match message {
                Message::Reply(Reply::Log(line)) => self.push_event(Event::Log(line)),
                Message::Reply(reply) => self.handle(reply, now_ns),
                Message::Result(result) => self.handle_result(result, arrival_ns, now_ns),
                Message::StaleResult => self.handle_stale(now_ns),
            }
        }
        self.received = std::mem::take(received);
    }

    fn handle(&mut self, reply: Reply, now_ns: i64) {
        match (self.state, reply) {
            (State::Awaiting(Request::System), Reply::System(info)) => self.on_system_info(info, now_ns),
            (State::Awaiting(Request::Sensors), Reply::Sensors(sensors)) => self.on_sensor_info(sensors, now_ns),
            (State::Awaiting(Request::Baud(baud)), Reply::Ok) => {
                self.actions.push_back(Action::SetBaud(baud));
                self.ask(Request::Setup, now_ns);
            }
            (State::Awaiting(Request::Setup), Reply::Setup(reply)) => self.on_setup_reply(reply, now_ns),
            (State::Awaiting(Request::Start), Reply::Started) => self.begin_streaming(now_ns),
            (State::Stopping { ends: true }, Reply::Stopped | Reply::SessionEnded) => self.finish(Event::Stopped),
            (State::Stopping { ends: false }, Reply::Stopped) => {
                self.parser.expect_results(None);
                self.ask(Request::Setup, now_ns);
            }
            // The stream of an older session has stopped. The board may not have processed the
            // earlier command, so it is sent again.
            (State::Awaiting(asked), Reply::Stopped) if self.stop_reply_pending => {
                self.stop_reply_pending = false;
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
                match std::mem::take(&mut self.calibrations).is_empty() {
                    true => self.fail(error, now_ns),
                    false => self.retry_after_pause(error, now_ns),
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
        if !self.system_infos.contains(&info) {
            self.system_infos.push(info);
            return match self.system_infos.len() < MAX_ANSWERS {
                true => self.ask(Request::System, now_ns),
                false => self.retry_after_pause(SessionError::AnswersDiffer, now_ns),
            };
        }
        match self.check_board(&info) {
            Ok(version) => {
                let baud = info.max_baudrate.map(|_| FIRST_BAUD).filter(|_| self.link != Link::Tcp);
                self.board = Some(Board { info, version, baud });
                self.ask(Request::Sensors, now_ns);
            }
            Err(error) => self.finish(Event::Failed(error)),
        }
    }

    fn check_board(&self, info: &SystemInfo) -> Result<Version, SessionError> {
        if let Some(sensor) = info.sensor.as_ref().filter(|sensor| *sensor != "a121") {
            return Err(SessionError::WrongSensor(sensor.clone()));
        }
        let found =
            Version::parse(&info.rss_version).ok_or_else(|| SessionError::UnknownVersion(info.rss_version.clone()))?;
        if found <= LAST_UNSUPPORTED {
            return Err(SessionError::TooOld { found, needed: Version::release(0, 2, 1) });
        }
        if info.ticks_per_second == 0 {
            return Err(SessionError::NoTicks);
        }
        for subsweep in self.setup.sensors().flat_map(|s| &s.config.subsweeps) {
            let needed = match subsweep.prf {
                Prf::Mhz5_2 => PRF_5_2_SINCE,
                Prf::Mhz15_6 => PRF_15_6_SINCE,
                _ => continue,
            };
            if found < needed {
                return Err(SessionError::TooOldForPrf { found, needed, prf_mhz: subsweep.prf.hz() / 1e6 });
            }
        }
        match (self.link, info.max_baudrate.map(|max| max.max(FIRST_BAUD))) {
            (Link::Serial { baud: Some(asked) }, Some(max)) if !(FIRST_BAUD..=max).contains(&asked) => {
                Err(SessionError::Baud { asked, max })
            }
            _ => Ok(found),
        }
    }

    fn on_sensor_info(&mut self, sensors: Vec<SensorInfo>, now_ns: i64) {
        let is_connected = |id: u32| sensors.get(id as usize - 1).is_some_and(|sensor| sensor.connected);
        let missing = self.setup.sensors().map(|s| s.sensor_id).find(|&id| !is_connected(id));
        if let Some(sensor_id) = missing {
            let connected: Vec<String> =
                (1..=sensors.len() as u32).filter(|&id| is_connected(id)).map(|id| id.to_string()).collect();
            let connected = match connected.is_empty() {
                true => "none is connected at all".to_owned(),
                false => format!("connected: {}", connected.join(", ")),
            };
            return self.retry_after_pause(SessionError::NotConnected { sensor_id, connected }, now_ns);
        }
        let Some(board) = &mut self.board else { return };
        let next = match (self.link, board.info.max_baudrate.map(|max| max.max(FIRST_BAUD))) {
            (Link::Serial { baud }, Some(max)) if baud.unwrap_or(max) != FIRST_BAUD => {
                board.baud = Some(baud.unwrap_or(max));
                Request::Baud(baud.unwrap_or(max))
            }
            _ => Request::Setup,
        };
        let info = board.info.clone();
        self.push_event(Event::Connected(info, sensors));
        self.ask(next, now_ns);
    }

    fn on_setup_reply(&mut self, reply: SetupReply, now_ns: i64) {
        let layout = ResultLayout::of(&self.setup);
        if !layout.agrees_with(&reply) {
            return self.fail(SessionError::OtherFrames, now_ns);
        }
        let Some(board) = &self.board else { return };
        let rate = board.info.ticks_per_second;
        let period_s = self.result_period_s();
        self.ticks = self.timings.iter().map(|t| TickUnwrapper::new(t.frame_s, period_s, rate)).collect();
        let bits = 10.0 * (LINE_BYTES * self.timings.len() as f64 + layout.payload_bytes() as f64);
        let transfer_s = board.baud.map_or(0.0, |baud| bits / f64::from(baud));
        self.clock = Some(Clock::new(rate, period_s, transfer_s));
        self.calibrations.clone_from(&reply.calibrations);
        self.parser.expect_results(Some(layout));
        self.push_event(Event::SetUp(reply));
        self.ask(Request::Start, now_ns);
    }

    fn begin_streaming(&mut self, now_ns: i64) {
        self.enter(State::Streaming, now_ns.saturating_add(self.frame_patience_ns()));
        self.push_event(Event::Streaming);
    }

    fn stop_streaming(&mut self, ends: bool, now_ns: i64) {
        self.actions.push_back(Action::Send(Command::StopStreaming.to_bytes()));
        self.enter(State::Stopping { ends }, now_ns.saturating_add(self.frame_patience_ns() + STOP_EXTRA_NS));
    }

    /// Stops a board that still streams for an earlier client.
    fn handle_stale(&mut self, now_ns: i64) {
        if self.state == State::Awaiting(Request::System) && !std::mem::replace(&mut self.stop_sent, true) {
            self.stop_reply_pending = true;
            self.actions.push_back(Action::Send(Command::StopStreaming.to_bytes()));
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
        let Some(ticks) = self.accepted_ticks(&result, arrival_ns) else { return };
        if self.state == State::Streaming {
            self.deadline_ns = now_ns.saturating_add(self.frame_patience_ns());
        }
        self.pause_ns = RETRY_PAUSE_NS.0;
        self.unconfirmed_error = None;
        self.counters.results += 1;
        let asks_for_calibration = result.infos.iter().any(|info| info.calibration_needed);
        let frames = self.timed_frames(result, &ticks, arrival_ns);
        self.push_event(Event::Frames(frames));
        let is_due = self.recalibrated_ns.is_none_or(|at| now_ns.saturating_sub(at) > RECALIBRATE_NS);
        if asks_for_calibration && self.state == State::Streaming && is_due {
            self.recalibrated_ns = Some(now_ns);
            self.counters.recalibrations += 1;
            self.calibrations.clear();
            self.push_event(Event::Recalibrating);
            self.stop_streaming(false, now_ns);
        }
    }

    /// The unwrapped ticks of all sensors, if all are accepted.
    fn accepted_ticks(&mut self, result: &ResultMessage, arrival_ns: i64) -> Option<Vec<i64>> {
        let (mut accepted, mut is_first, mut has_jumped) = (Vec::new(), false, false);
        let mut of_first = None;
        for (index, (ticks, info)) in self.ticks.iter_mut().zip(&result.infos).enumerate() {
            // The clock follows the first sensor; the other sensors' ticks come from the same board
            // clock.
            let since_first = info.tick.wrapping_sub(result.infos[0].tick) as i32;
            let is_possible = |tick| {
                let on_clock = if index == 0 {
                    Some(tick)
                } else {
                    of_first.map(|at: i64| at.saturating_add(i64::from(since_first)))
                };
                self.clock.as_ref().zip(on_clock).is_none_or(|(clock, tick)| clock.is_possible(tick, arrival_ns))
            };
            match ticks.check(info.tick, arrival_ns, is_possible) {
                TickVerdict::Next(tick) => {
                    of_first = of_first.or((index == 0).then_some(tick));
                    accepted.push(tick);
                }
                TickVerdict::Jumped(tick) => {
                    has_jumped |= index == 0;
                    accepted.push(tick);
                }
                TickVerdict::First => is_first = true,
                _ => {}
            }
        }
        if has_jumped && let Some(clock) = &mut self.clock {
            self.counters.tick_jumps += 1;
            clock.reset();
        }
        if accepted.len() != result.infos.len() {
            let counter = if is_first { &mut self.counters.unconfirmed } else { &mut self.counters.refused_ticks };
            *counter += 1;
            return None;
        }
        Some(accepted)
    }

    fn timed_frames(&mut self, result: ResultMessage, ticks: &[i64], arrival_ns: i64) -> Vec<SensorFrame> {
        let (Some(clock), Some(&first)) = (&mut self.clock, ticks.first()) else { return Vec::new() };
        let rate = self.board.as_ref().map_or(1.0, |board| f64::from(board.info.ticks_per_second));
        let first_ns = clock.time_ns(first, arrival_ns);
        let places =
            self.setup.groups.iter().enumerate().flat_map(|(group, s)| s.iter().map(move |s| (group, s.sensor_id)));
        let parts = places.zip(ticks).zip(result.infos.iter().zip(result.frames));
        let frame =
            |(((group, sensor_id), &tick), (info, samples)): (((usize, u32), &i64), (&super::ResultInfo, _))| {
                // Each sensor's ticks were unwrapped from its own first tick, which may be beyond a
                // wrap.
                let after = (tick as u32).wrapping_sub(first as u32) as i32;
                let after_ns = (f64::from(after) / rate * 1e9).round() as i64;
                let frame = Frame {
                    tick: first.saturating_add(i64::from(after)),
                    host_time_ns: first_ns.saturating_add(after_ns),
                    temperature_c: info.temperature,
                    data_saturated: info.data_saturated,
                    frame_delayed: info.frame_delayed,
                    calibration_needed: info.calibration_needed,
                    samples,
                };
                SensorFrame { group, sensor_id, frame }
            };
        parts.map(frame).collect()
    }
}

/// Checks all rules that do not depend on the board.
fn check(setup: &Setup) -> Result<(), SessionError> {
    if setup.groups.is_empty() || setup.groups.iter().any(Vec::is_empty) {
        return Err(SessionError::NoSensors);
    }
    for group in &setup.groups {
        for (index, sensor) in group.iter().enumerate() {
            let sensor_id = sensor.sensor_id;
            if !(1..=MAX_SENSORS).contains(&sensor_id) {
                return Err(SessionError::SensorId(sensor_id));
            }
            if group[..index].iter().any(|other| other.sensor_id == sensor_id) {
                return Err(SessionError::SensorTwice(sensor_id));
            }
            sensor.config.validate().map_err(|source| SessionError::Config { sensor_id, source })?;
            if let (Some(update_rate_hz), Some(frame_rate_hz)) = (setup.update_rate_hz, sensor.config.frame_rate) {
                return Err(SessionError::BothRates { update_rate_hz, frame_rate_hz, sensor_id });
            }
        }
    }
    match setup.update_rate_hz.filter(|rate| !(rate.is_finite() && *rate > 0.0)) {
        Some(rate) => Err(SessionError::UpdateRate(rate)),
        None => Ok(()),
    }
}

#[cfg(test)]
#[path = "session_tests.rs"]
mod tests;

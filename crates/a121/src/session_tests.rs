//! Tests of the session with a simulated board, in simulated time.

use std::collections::VecDeque;

use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::super::test_stream::{Fault, Sent, TestBoard, small_setup};
use super::board::MAX_ANSWERS;
use super::input::QUIET_NS;
use super::outbox::MAX_EVENTS;
use super::*;
use crate::{Frame, SensorSetup};

/// Latency of the system, nanoseconds; the transfer time comes on top.
const DELAY_NS: i64 = 100_000;

/// A session, its board, and the line between them.
struct Bench {
    session: Session,
    board: TestBoard,
    rng: ChaCha8Rng,
    now_ns: i64,
    port_baud: u32,
    on_the_way: VecDeque<(i64, Vec<u8>)>,
    events: Vec<Event>,
    actions: Vec<Action>,
    /// If set, this fault hits one frame in eight.
    faults: Option<fn(&mut ChaCha8Rng) -> Fault>,
}

impl Bench {
    fn new(board: TestBoard, link: Link) -> Self {
        let session = Session::new(small_setup(), link, 0).unwrap();
        Self {
            session,
            board,
            rng: ChaCha8Rng::seed_from_u64(1),
            now_ns: 0,
            port_baud: 0,
            on_the_way: VecDeque::new(),
            events: Vec::new(),
            actions: Vec::new(),
            faults: None,
        }
    }

    fn serial() -> Self {
        Self::new(TestBoard::new(), Link::Serial { baud: None })
    }

    fn run_s(&mut self, seconds: f64) {
        let end_ns = self.now_ns + (seconds * 1e9) as i64;
        loop {
            self.act();
            let arrival_ns = self.on_the_way.front().map_or(i64::MAX, |(at, _)| *at);
            let next_ns = arrival_ns.min(self.board.next_frame_ns).min(self.session.next_deadline_ns());
            if next_ns > end_ns {
                self.events.extend(std::iter::from_fn(|| self.session.next_event()));
                self.now_ns = end_ns;
                return;
            }
            self.now_ns = self.now_ns.max(next_ns);
            if self.board.next_frame_ns <= self.now_ns {
                self.send_frame();
            }
            while self.on_the_way.front().is_some_and(|(at, _)| *at <= self.now_ns) {
                let (_, bytes) = self.on_the_way.pop_front().unwrap();
                self.session.receive(&bytes, self.now_ns);
            }
            self.session.poll(self.now_ns);
            self.events.extend(std::iter::from_fn(|| self.session.next_event()));
        }
    }

    fn act(&mut self) {
        while let Some(action) = self.session.next_action() {
            self.actions.push(action.clone());
            match action {
                Action::Send(bytes) if self.port_baud == self.board.baud || self.session.plan.link == Link::Tcp => {
                    let answer = self.board.answer(&bytes, self.now_ns);
                    self.on_the_way.push_back((self.now_ns + DELAY_NS, answer));
                }
                Action::Send(_) => {}
                Action::SendBreak => self.board.reset(),
                Action::FlushInput => self.on_the_way.clear(),
                Action::SetBaud(baud) => self.port_baud = baud,
                Action::Reopen => self.session.line_opened(self.now_ns),
            }
        }
    }

    fn send_frame(&mut self) {
        let faults = self.faults.filter(|_| self.rng.random_bool(0.125));
        let rng = &mut self.rng;
        let bytes = self.board.frame(|length| faults.map(|kind| (kind(rng), rng.random_range(0..length))));
        if self.board.dead {
            return;
        }
        // In two reads, 50 µs apart.
        let (first, second) = bytes.split_at(self.rng.random_range(0..bytes.len()));
        let ready_ns =
            self.now_ns + DELAY_NS + (bytes.len() as f64 * 1e10 / f64::from(self.port_baud.max(1_000_000))) as i64;
        self.on_the_way.push_back((ready_ns - 50_000, first.to_vec()));
        self.on_the_way.push_back((ready_ns, second.to_vec()));
        if self.rng.random_bool(0.1) {
            let log = b"{\"status\":\"log\",\"level\":\"info\",\"timestamp\":1,\"module\":\"m\",\"log\":\"l\"}\n";
            self.on_the_way.push_back((ready_ns + 10_000, log.to_vec()));
        }
    }

    fn frames(&self) -> Vec<&Frame> {
        let frames = self.events.iter().filter_map(|event| if let Event::Frames(f) = event { Some(f) } else { None });
        frames.map(|frames| &frames[0].frame).collect()
    }

    fn troubles(&self) -> Vec<&SessionError> {
        let troubles = self.events.iter().filter_map(|event| match event {
            Event::Trouble(error) | Event::Failed(error) => Some(error),
            _ => None,
        });
        troubles.collect()
    }

    fn commands(&self) -> Vec<&str> {
        self.board.commands.iter().map(|command| command["cmd"].as_str().unwrap()).collect()
    }
}

#[test]
fn session_streams_at_the_boards_baud_rate_and_stops() {
    let mut bench = Bench::serial();
    bench.run_s(4.25);
    let opening =
        ["get_system_info", "get_system_info", "get_sensor_info", "set_uart_baudrate", "setup", "start_streaming"];
    assert_eq!(bench.commands(), opening);
    assert_eq!(bench.actions[..3], [Action::SetBaud(115_200), Action::SendBreak, Action::FlushInput]);
    assert_eq!((bench.board.baud, bench.port_baud), (2_000_000, 2_000_000));
    bench.session.stop(bench.now_ns);
    bench.run_s(1.0);
    assert_eq!(bench.events.last(), Some(&Event::Stopped));
    assert!(bench.session.is_over() && bench.troubles().is_empty());
    // All frames except the first, which waits for confirmation, with their samples, flags and
    // times.
    let (frames, sent) = (bench.frames(), &bench.board.frames[1..]);
    assert_eq!(frames.len(), sent.len());
    assert!(sent.len() > 190);
    for (frame, sent) in frames.iter().zip(sent) {
        assert_eq!((frame.tick as u32, frame.temperature_c), (sent.info.tick, sent.info.temperature));
        assert_eq!(frame.data_saturated, sent.info.data_saturated);
        assert!(sent.payload.chunks(4).zip(&frame.samples).all(|(bytes, s)| bytes[..2] == s.re.to_le_bytes()));
        assert!((frame.host_time_ns - sent.end_ns).abs() < 500_000);
    }
    assert_eq!(bench.session.counters().unconfirmed, 1);
    assert_eq!(bench.session.counters().stream.skipped_bytes, 0);
}

#[test]
fn tick_wrap_loses_no_frame() {
    let mut bench = Bench::serial();
    bench.board.first_tick = (1 << 32) - 3_000_000;
    bench.run_s(6.0);
    assert_eq!(bench.session.counters().results + 1, bench.board.frames.len() as u64);
    assert!(bench.frames().windows(2).all(|f| f[1].tick > f[0].tick && f[1].host_time_ns > f[0].host_time_ns));
    assert!(bench.frames().last().unwrap().tick > 1 << 32);
}

/// More than a thousand faults of one kind in one session: only faulty frames are lost, and emitted
/// frames are right unless the fault is undetectable.
fn thousand_faults(kind: fn(&mut ChaCha8Rng) -> Fault) {
    let mut bench = Bench::serial();
    bench.run_s(3.0);
    bench.faults = Some(kind);
    bench.run_s(130.0);
    bench.faults = None;
    bench.run_s(0.5);
    let struck: Vec<&Sent> = bench.board.frames.iter().filter(|sent| sent.fault.is_some()).collect();
    assert!(struck.len() > 1000, "{}", struck.len());
    assert_eq!((bench.session.counters().connects, bench.troubles().len()), (1, 0));
    let (frames, mut next, mut wrong) = (bench.frames(), 0, 0);
    for sent in &bench.board.frames[1..] {
        let length = super::super::test_stream::result_bytes(&sent.info, &sent.payload).len();
        let Some(frame) = frames.get(next).filter(|f| (f.host_time_ns - sent.end_ns).abs() < 5_000_000) else {
            assert!(sent.fault.is_some(), "lost without a fault: {sent:?}");
            continue;
        };
        next += 1;
        let samples: Vec<u8> =
            frame.samples.iter().flat_map(|s| [s.re.to_le_bytes(), s.im.to_le_bytes()].concat()).collect();
        let in_line = sent.fault.is_some_and(|(_, at)| at < length - sent.payload.len());
        let is_flipped = matches!(sent.fault, Some((Fault::Flip(_), _)));
        wrong += u32::from(sent.fault.is_some());
        assert!(samples == sent.payload || is_flipped && !in_line, "{sent:?}");
        let tick_error = (frame.tick as u32).wrapping_sub(sent.info.tick) as i32;
        assert!(tick_error == 0 || in_line && tick_error.abs() <= 455, "{tick_error} at {sent:?}");
        assert!(frame.temperature_c == sent.info.temperature || in_line, "{sent:?}");
        assert!(frame.data_saturated == sent.info.data_saturated && !frame.calibration_needed, "{sent:?}");
    }
    assert_eq!(next, frames.len());
    println!("{} faults, {wrong} emitted, {:?}", struck.len(), bench.session.counters());
}

#[test]
fn lost_bytes_lose_only_touched_frames() {
    thousand_faults(|_| Fault::Lose);
}

#[test]
fn doubled_bytes_lose_only_touched_frames() {
    thousand_faults(|_| Fault::Double);
}

#[test]
fn flipped_bits_lose_only_touched_frames() {
    thousand_faults(|rng| Fault::Flip(1 << rng.random_range(0..8)));
}

#[test]
fn silent_board_is_set_up_again_with_its_calibration() {
    let mut bench = Bench::serial();
    bench.run_s(4.0);
    bench.board.dead = true;
    bench.run_s(2.1);
    assert!(matches!(bench.troubles()[..], [SessionError::Silent { seconds }] if *seconds == 2.0));
    bench.run_s(20.0);
    let missed = bench.troubles().iter().filter(|e| matches!(e, SessionError::NoAnswer { .. })).count();
    assert!((2..8).contains(&missed), "{missed}");
    bench.board.dead = false;
    let before = bench.session.counters().results;
    bench.run_s(13.0);
    assert!(bench.session.counters().results > before + 60);
    let last_setup = bench.board.commands.iter().rev().find(|c| c["cmd"] == "setup").unwrap();
    assert_eq!(last_setup["calibration_info"][0]["data"], "cal1");
    assert_eq!(bench.session.counters().silences, 1);
}

#[test]
fn session_resumes_after_a_lost_line() {
    let mut bench = Bench::serial();
    bench.run_s(3.0);
    bench.session.line_lost("unplugged");
    bench.board.reset();
    bench.run_s(5.0);
    assert!(matches!(bench.troubles()[..], [SessionError::LineLost(_)]));
    let before = bench.session.counters().results;
    bench.session.line_opened(bench.now_ns);
    bench.run_s(2.25);
    assert!(bench.session.counters().results > before + 50);
    // Times keep rising.
    assert!(bench.frames().windows(2).all(|f| f[1].host_time_ns > f[0].host_time_ns));
}

#[test]
fn clock_restart_loses_one_frame() {
    let mut bench = Bench::serial();
    bench.run_s(4.0);
    bench.board.first_tick = 900_000_000;
    bench.run_s(2.0);
    let counters = bench.session.counters();
    assert_eq!((counters.tick_jumps, counters.refused_ticks, counters.connects), (1, 1, 1));
    assert_eq!(counters.results + 2, bench.board.frames.len() as u64);
    assert!(bench.frames().windows(2).all(|f| f[1].host_time_ns - f[0].host_time_ns < 31_000_000));
}

#[test]
fn fatal_errors_say_what_to_do() {
    let failed = |change: fn(&mut TestBoard)| {
        let mut board = TestBoard::new();
        change(&mut board);
        let mut bench = Bench::new(board, Link::Serial { baud: None });
        bench.run_s(4.0);
        (bench.session.is_over(), bench.troubles().first().map(|e| e.to_string()).unwrap_or_default())
    };
    type Case = (fn(&mut TestBoard), bool, &'static str);
    let cases: [Case; 6] = [
        (|b| b.rss_version = "a121-v0.2.0".into(), true, "version 0.2.0 is too old"),
        (|b| b.rss_version = "banana".into(), true, "\"banana\" is not understood"),
        (|b| b.rss_version = "a121-v0.7.0".into(), true, "does not know prf 15.6 MHz (0.7.1.dev37 does)"),
        (|b| b.ticks_per_second = 0, true, "no ticks"),
        (|b| b.connected = false, false, "no sensor is connected at connector 1 (none is connected at all)"),
        (|b| b.refuses = Some("setup"), true, "refuses setup: I do not want to"),
    ];
    for (change, is_over, text) in cases {
        let (over, message) = failed(change);
        assert_eq!(over, is_over, "{message}");
        assert!(message.contains(text), "{message}");
    }
    let mut bench = Bench::new(TestBoard::new(), Link::Serial { baud: Some(3_000_000) });
    bench.run_s(3.0);
    assert_eq!(bench.troubles(), [&SessionError::Baud { asked: 3_000_000, max: 2_000_000 }]);
}

#[test]
fn setup_refused_once_is_retried() {
    let mut bench = Bench::serial();
    bench.board.refuses = Some("setup");
    bench.run_s(1.4);
    bench.board.refuses = None;
    bench.run_s(2.0);
    assert!(matches!(bench.troubles()[..], [SessionError::Refused { asked: "setup", .. }]));
    assert!(!bench.session.is_over() && !bench.frames().is_empty());
}

#[test]
fn damaged_system_info_is_not_accepted() {
    for (ticks, version) in [(1_100_000, "a121-v1.12.0"), (1_000_000, "banana"), (1_000_000, "a121-v0.2.0")] {
        let mut bench = Bench::serial();
        bench.run_s(0.999);
        (bench.board.ticks_per_second, bench.board.rss_version) = (ticks, version.into());
        // Waits until the first reply is in transit.
        while bench.board.commands.is_empty() {
            bench.run_s(1e-4);
        }
        let sound = TestBoard::new();
        (bench.board.ticks_per_second, bench.board.rss_version) = (sound.ticks_per_second, sound.rss_version);
        bench.run_s(2.0);
        assert!(bench.troubles().is_empty() && bench.frames().len() > 50, "{ticks} {version}");
        assert_eq!(bench.session.board.known.as_ref().unwrap().info.ticks_per_second, 1_000_000);
    }
    // A board with ever-changing replies is given up for now.
    let mut bench = Bench::serial();
    for step in 0..30_000 {
        bench.board.ticks_per_second = 1_000_000 + step;
        bench.run_s(1e-4);
    }
    assert!(bench.troubles().contains(&&SessionError::AnswersDiffer) && bench.frames().is_empty());
}

#[test]
fn doubled_byte_in_a_split_payload_is_detected() {
    let mut bench = Bench::serial();
    bench.run_s(3.0);
    let before = bench.frames().len();
    // All bytes but the last, which arrives 1 ms later, as with a USB converter.
    let bytes = bench.board.frame(|length| Some((Fault::Double, length - 50)));
    let (first, second) = bytes.split_at(bytes.len() - 1);
    bench.on_the_way.push_back((bench.now_ns, first.to_vec()));
    bench.on_the_way.push_back((bench.now_ns + 1_000_000, second.to_vec()));
    bench.run_s(0.008);
    let counters = bench.session.counters().stream;
    assert_eq!((bench.frames().len(), counters.unconfirmed_damage), (before, 0));
    bench.run_s(0.5);
    assert_eq!(bench.session.counters().stream.damaged_payloads, 1);
    assert!(bench.frames().len() > before + 20);
}

#[test]
fn slow_ports_keep_the_first_baud_rate() {
    let mut bench = Bench::new(TestBoard::new(), Link::Serial { baud: Some(115_200) });
    bench.run_s(3.0);
    assert!(!bench.commands().contains(&"set_uart_baudrate") && !bench.frames().is_empty());
}

#[test]
fn server_still_streaming_is_stopped_first() {
    let mut bench = Bench::new(TestBoard::new(), Link::Tcp);
    (bench.board.streaming, bench.board.next_frame_ns, bench.board.refuses) =
        (true, 1_000_000, Some("get_system_info"));
    bench.board.refuses = None;
    bench.board.dead = false;
    // The reply to the first command is lost in the stream.
    bench.act();
    bench.on_the_way.clear();
    bench.run_s(3.0);
    assert_eq!(bench.commands()[..3], ["get_system_info", "stop_streaming", "get_system_info"]);
    assert!(bench.frames().len() > 100 && bench.troubles().is_empty());
    assert!(!bench.actions.iter().any(|a| matches!(a, Action::SendBreak | Action::SetBaud(_))));
}

#[test]
fn calibration_request_triggers_one_new_setup() {
    let mut bench = Bench::serial();
    bench.run_s(3.0);
    bench.board.calibration_needed = true;
    bench.run_s(0.1);
    bench.board.calibration_needed = false;
    bench.run_s(1.0);
    assert_eq!((bench.board.setups, bench.session.counters().recalibrations), (2, 1));
    assert!(bench.board.commands.iter().rev().find(|c| c["cmd"] == "setup").unwrap().get("calibration_info").is_none());
    assert!(bench.events.contains(&Event::Recalibrating) && bench.troubles().is_empty());
    // A sensor that keeps requesting a calibration is not set up endlessly.
    bench.board.calibration_needed = true;
    bench.run_s(35.0);
    assert!((3..=6).contains(&bench.board.setups), "{}", bench.board.setups);
}

#[test]
fn invalid_setups_are_rejected() {
    let sound = small_setup();
    let refused = |change: fn(&mut Setup)| {
        let mut setup = sound.clone();
        change(&mut setup);
        Session::new(setup, Link::Tcp, 0).err()
    };
    assert_eq!(refused(|_| {}), None);
    assert_eq!(refused(|s| s.groups.clear()), Some(SessionError::NoSensors));
    assert_eq!(refused(|s| s.groups.push(vec![])), Some(SessionError::NoSensors));
    assert_eq!(refused(|s| s.groups[0][0].sensor_id = 0), Some(SessionError::SensorId(0)));
    assert_eq!(refused(|s| s.groups[0][0].sensor_id = 6), Some(SessionError::SensorId(6)));
    assert_eq!(
        refused(|s| s.groups[0] = [s.groups[0].clone(), s.groups[0].clone()].concat()),
        Some(SessionError::SensorTwice(1))
    );
    assert!(matches!(refused(|s| s.update_rate_hz = Some(5.0)), Some(SessionError::BothRates { .. })));
    assert!(matches!(refused(|s| s.groups[0][0].config.subsweeps.clear()), Some(SessionError::Config { .. })));
    let unset = |s: &mut Setup| s.groups[0][0].config.frame_rate = None;
    let mut setup = sound.clone();
    unset(&mut setup);
    setup.update_rate_hz = Some(f64::NAN);
    assert!(matches!(Session::new(setup, Link::Tcp, 0), Err(SessionError::UpdateRate(_))));
}

#[test]
fn unread_events_are_bounded_and_counted() {
    let mut bench = Bench::serial();
    bench.run_s(3.0);
    for _ in 0..MAX_EVENTS + 10 {
        bench.session.outbox.report(Event::Streaming);
    }
    assert_eq!(bench.session.counters().dropped_events, 10);
    assert_eq!(std::iter::from_fn(|| bench.session.next_event()).count(), MAX_EVENTS);
}

/// A session over TCP that has received these lines, one at a time.
fn session_with_lines(setup: Setup, lines: &[&str]) -> Session {
    let mut session = Session::new(setup, Link::Tcp, 0).unwrap();
    lines.iter().for_each(|line| session.receive(line.as_bytes(), 1_000_000));
    session
}

fn commands_of(session: &mut Session) -> usize {
    std::iter::from_fn(|| session.next_action()).filter(|action| matches!(action, Action::Send(_))).count()
}

const SYSTEM: &str = "{\"status\":\"ok\",\"system_info\":{\"rss_version\":\"a121-v1.12.0\",\"sensor\":\"a121\",\
                      \"sensor_count\":5,\"ticks_per_second\":1000000}}\n";
const SENSORS: &str = "{\"status\":\"ok\",\"sensor_info\":[{\"connected\":true},{\"connected\":true}]}\n";

#[test]
fn damaged_system_info_does_not_end_the_session() {
    // One byte of the first reply is changed: version, sensor name, tick rate.
    let changes =
        [("v1.12.0", "v1.1x.0"), ("\"a121\"", "\"a131\""), ("1000000,", "1800000,"), ("1000000,", "1000001,")];
    for (right, wrong) in changes {
        let right_info = SYSTEM.replace("1000000}", "1000000,\"max_baudrate\":2000000}");
        let wrong_info = right_info.replacen(right, wrong, 1);
        assert_ne!(wrong_info, right_info);
        let mut session = session_with_lines(small_setup(), &[&wrong_info]);
        assert_eq!(commands_of(&mut session), 2, "asked again after {wrong}");
        (0..2).for_each(|_| session.receive(right_info.as_bytes(), 2_000_000));
        session.receive(SENSORS.as_bytes(), 3_000_000);
        assert_eq!(session.board.known.as_ref().unwrap().info.ticks_per_second, 1_000_000, "{wrong}");
        assert!(matches!(session.next_event(), Some(Event::Connected(..))));
        // The same reply twice is accepted.
        let mut session = session_with_lines(small_setup(), &[&wrong_info, &wrong_info]);
        assert_eq!(commands_of(&mut session), if wrong.starts_with('1') { 3 } else { 2 });
    }
    // A different reply each time is reported, and the session restarts.
    let odd = |n: u32| SYSTEM.replace("1000000", &n.to_string());
    let lines: Vec<String> = (1..=MAX_ANSWERS as u32).map(odd).collect();
    let mut session = session_with_lines(small_setup(), &lines.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(session.next_event(), Some(Event::Trouble(SessionError::AnswersDiffer)));
    assert_eq!((commands_of(&mut session), session.is_over()), (MAX_ANSWERS, false));
}

#[test]
fn damaged_setup_reply_does_not_end_the_session() {
    let other = "{\"status\":\"ok\",\"tick_period\":0,\"metadata\":[[{\"frame_data_length\":41,\
                 \"sweep_data_length\":10}]]}\n";
    for wrong in [other, "{\"status\":\"error\",\"message\":\"what?\"}\n"] {
        let mut session = session_with_lines(small_setup(), &[SYSTEM, SYSTEM, SENSORS, wrong]);
        assert!(!session.is_over(), "{wrong}");
        session.poll(2 * S);
        session.line_opened(3 * S);
        [SYSTEM, SYSTEM, SENSORS, wrong].iter().for_each(|line| session.receive(line.as_bytes(), 3 * S));
        assert!(session.is_over(), "said twice: {wrong}");
    }
}

#[test]
fn late_and_endless_stop_replies_are_handled() {
    // The board still streamed for an earlier client, but replies at once.
    let stale = "{\"result_info\":[[{\"tick\":5,\"data_saturated\":false,\"temperature\":3,\
                 \"calibration_needed\":false,\"frame_delayed\":false}]],\"status\":\"ok\",\"payload_size\":0}\n";
    let session = session_with_lines(small_setup(), &[stale, SYSTEM, SYSTEM, "{\"status\":\"stop\"}\n", SENSORS]);
    assert_eq!(session.state, State::Awaiting(Request::Setup));
    // A board that sends nothing else is not asked endlessly, and the missing reply is noticed.
    let mut session = session_with_lines(small_setup(), &["{\"status\":\"stop\"}\n"; 500]);
    assert!(commands_of(&mut session) <= 2);
    session.poll(3 * S);
    assert!(matches!(session.next_event(), Some(Event::Trouble(SessionError::NoAnswer { .. }))));
}

#[test]
fn bytes_instead_of_an_answer_are_counted_in_the_message() {
    let mut session =
        session_with_lines(small_setup(), &["$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M*47\r\n"]);
    session.poll(3 * S);
    let trouble = session.next_event();
    let Some(Event::Trouble(SessionError::ForeignBytes { asked, bytes, .. })) = trouble else { panic!("{trouble:?}") };
    assert_eq!((asked, bytes), ("get_system_info", 58));
}

#[test]
fn board_without_faster_rate_keeps_the_first() {
    for max in [0, 9600, 115_199] {
        let mut board = TestBoard::new();
        board.max_baudrate = Some(max);
        let mut bench = Bench::new(board, Link::Serial { baud: None });
        bench.run_s(2.0);
        assert!(!bench.commands().contains(&"set_uart_baudrate"), "{max}");
        assert!(bench.frames().iter().all(|frame| (0..2 * S).contains(&frame.host_time_ns)), "{max}");
        assert!(!bench.frames().is_empty());
    }
}

#[test]
fn no_event_follows_the_end() {
    let mut bench = Bench::serial();
    bench.run_s(3.0);
    bench.session.stop(bench.now_ns);
    let late = "{\"status\":\"stop\"}\n{\"status\":\"log\",\"level\":\"info\",\"module\":\"m\",\"log\":\"bye\"}\n";
    bench.session.receive(late.as_bytes(), bench.now_ns);
    let events: Vec<Event> = std::iter::from_fn(|| bench.session.next_event()).collect();
    assert_eq!(events.last(), Some(&Event::Stopped));
}

/// Two groups: sensors 1 and 2 together, then sensor 1 again.
fn two_groups() -> Setup {
    let sensor = |sensor_id| SensorSetup { sensor_id, ..small_setup().groups[0][0].clone() };
    let mut setup = Setup { groups: vec![vec![sensor(1), sensor(2)], vec![sensor(1)]], ..Default::default() };
    setup.groups.iter_mut().flatten().for_each(|s| s.config.frame_rate = None);
    setup
}

#[test]
fn sensors_and_groups_stay_in_time_over_a_tick_wrap() {
    let frame = "{\"frame_data_length\":40,\"sweep_data_length\":10}";
    let set_up = format!("{{\"status\":\"ok\",\"tick_period\":0,\"metadata\":[[{frame},{frame}],[{frame}]]}}\n");
    let mut session = session_with_lines(two_groups(), &[SYSTEM, SYSTEM, SENSORS, &set_up, "{\"status\":\"start\"}\n"]);
    let mut results = Vec::new();
    for k in 0..60u32 {
        let info = |after: u32| {
            let tick = (u32::MAX - 100).wrapping_add(20_000 * k + after);
            format!(
                "{{\"tick\":{tick},\"data_saturated\":false,\"temperature\":3,\"calibration_needed\":false,\
                 \"frame_delayed\":false}}"
            )
        };
        // The second group ends 300 µs after the first, whose sensors end 2 µs apart; the first
        // result spans the wrap.
        let (a, b, c) = (info(0), info(2), info(300));
        let line = format!("{{\"result_info\":[[{a},{b}],[{c}]],\"status\":\"ok\",\"payload_size\":480}}\n");
        let now_ns = S + 20_000_000 * i64::from(k);
        session.receive(&[line.as_bytes(), &[7; 480]].concat(), now_ns);
        session.poll(now_ns + QUIET_NS);
        results.extend(std::iter::from_fn(|| session.next_event()));
    }
    let frames = results.iter().filter_map(|e| if let Event::Frames(f) = e { Some(f) } else { None });
    let frames: Vec<_> = frames.collect();
    assert_eq!(frames.len(), 59);
    for result in frames {
        let [first, second, third] = &result[..] else { panic!() };
        assert_eq!((second.frame.tick - first.frame.tick, third.frame.tick - first.frame.tick), (2, 300));
        assert_eq!(third.frame.host_time_ns - first.frame.host_time_ns, 300_000);
        assert_eq!((first.group, second.sensor_id, third.group), (0, 2, 1));
    }
}

#[test]
fn frame_timeout_adds_up_over_groups() {
    let mut setup = two_groups();
    setup.groups.iter_mut().flatten().for_each(|s| s.config.sweep_rate = Some(0.3));
    // Four sweeps of two groups take 2 · 3 / 0.3 s, plus overhead.
    let session = Session::new(setup.clone(), Link::Tcp, 0).unwrap();
    assert!(session.frame_patience_ns() > 31 * S, "{}", session.frame_patience_ns());
    // An update rate above what the sensors can do does not shorten the timeout.
    setup.update_rate_hz = Some(10.0);
    assert!(Session::new(setup, Link::Tcp, 0).unwrap().frame_patience_ns() > 31 * S);
}

proptest! {
    #[test]
    fn arbitrary_bytes_and_times_do_not_panic(
        pieces in prop::collection::vec(
            (prop_oneof![
                prop::collection::vec(any::<u8>(), 0..300),
                prop::sample::select(vec![
                    "{\"status\":\"ok\"}\n", "{\"status\":\"start\"}\n", "{\"status\":\"stop\"}\n",
                    "{\"status\":\"error\",\"message\":\"x\"}\n",
                    "{\"status\":\"ok\",\"result_info\":[],\"payload_size\":0}\n",
                    "{\"status\":\"ok\",\"sensor_info\":[]}\n",
                    "{\"status\":\"ok\",\"tick_period\":0,\"metadata\":[[]]}\n",
                    "{\"status\":\"ok\",\"result_info\":[[]],\"payload_size\":0}\n",
                ]).prop_map(|text| text.as_bytes().to_vec()),
            ], any::<i64>(), 0u8..6),
            0..40),
        tcp in any::<bool>(),
    ) {
        let mut bench = Bench::new(TestBoard::new(), if tcp { Link::Tcp } else { Link::Serial { baud: None } });
        bench.run_s(1.2);
        for (bytes, time_ns, what) in pieces {
            match what {
                0 => bench.session.poll(time_ns),
                1 => bench.session.receive(&bytes, time_ns),
                2 => bench.session.line_opened(bench.now_ns),
                _ => bench.session.receive(&bytes, bench.now_ns),
            }
            bench.act();
        }
    }
}

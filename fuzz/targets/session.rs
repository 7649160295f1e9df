//! Session with a board controlled by the fuzzer: correct replies, damaged ones, any bytes, at any
//! time; the line is lost and reopened.
//!
//! Checks: no panic; frames have the length of the set-up, with rising ticks and times; memory is
//! bounded; polling moves every deadline; a session that is not over streams again once its board
//! works correctly.
#![no_main]

use a121::{Action, Event, Link, Session, SessionError};
use libfuzzer_sys::fuzz_target;
use radar_chaperone_fuzz::board::{self, Board, TICKS_PER_SECOND};
use radar_chaperone_fuzz::{memory, script::Script, seeds};

const S: i64 = 1_000_000_000;
const PERIOD_NS: i64 = S / 20;
/// A working board must be streaming again within this time, nanoseconds.
const RECOVERY_NS: i64 = 60 * S;

const LINES: [&str; 14] = [
    "{\"status\":\"ok\"}\n",
    "{\"status\":\"start\"}\n",
    "{\"status\":\"stop\"}\n",
    "{\"status\":\"error\",\"message\":\"no\"}\n",
    "{\"status\":\"ok\",\"result_info\":[],\"payload_size\":0}\n",
    "{\"status\":\"ok\",\"sensor_info\":[]}\n",
    "{\"status\":\"ok\",\"sensor_info\":[{\"connected\":false},{\"connected\":true}]}\n",
    "{\"status\":\"ok\",\"tick_period\":0,\"metadata\":[[]]}\n",
    "{\"status\":\"ok\",\"result_info\":[[]],\"payload_size\":0}\n",
    "{\"status\":\"log\",\"level\":\"info\",\"timestamp\":1,\"module\":\"m\",\"log\":\"l\"}\n",
    "{\"status\":\"ok\",\"system_info\":{\"rss_version\":\"a121-v1.12.0\",\"sensor_count\":5,\"ticks_per_second\":1}}\n",
    "{\"status\":\"ok\",\"system_info\":{\"rss_version\":\"a121-v9.1.0-3-gab\",\"sensor_count\":5,\
     \"ticks_per_second\":4294967295,\"max_baudrate\":0}}\n",
    "{\"status\":\"ok\",\"system_info\":{\"rss_version\":\"a111\",\"sensor_count\":5,\"ticks_per_second\":1000}}\n",
    "{\"",
];

struct Bench {
    session: Session,
    board: Board,
    lengths: Vec<usize>,
    /// Bytes sent by the board and not yet received by the session.
    on_the_way: Vec<Vec<u8>>,
    now_ns: i64,
    tick: u32,
    port_baud: u32,
    is_open: bool,
    frames: u32,
    /// Tick and time (host ns) of the newest frame of the first sensor since the last set-up.
    newest: Option<(i64, i64)>,
}

fuzz_target!(init: seeds::write("session"), |data: &[u8]| {
    // Unread log lines of 16 kB would be the most that events can hold; here events are read.
    memory::bounded((1 << 23) + 64 * data.len(), (1 << 20) + 64 * data.len(), || run(Script(data)));
});

fn run(mut script: Script) {
    let (choice, is_serial) = (script.u8(), script.u8() % 2 == 0);
    let setup = board::setup(choice);
    let link = if is_serial { Link::Serial { baud: None } } else { Link::Tcp };
    let mut bench = Bench {
        session: Session::new(setup.clone(), link, 0).expect("a sound set-up"),
        lengths: board::samples(&setup).concat(),
        board: Board::new(setup, is_serial),
        on_the_way: Vec::new(),
        now_ns: 0,
        tick: 5_000_000,
        port_baud: 115_200,
        is_open: true,
        frames: 0,
        newest: None,
    };
    let mut is_odd = false;
    bench.run_until_idle();
    while !script.is_over() {
        is_odd |= bench.step(&mut script);
        bench.run_until_idle();
    }
    if !is_odd {
        bench.recover();
    }
}

impl Bench {
    /// Performs one action of the fuzzer; returns whether it used an impossible time.
    fn step(&mut self, script: &mut Script) -> bool {
        match script.u8() % 16 {
            0..=3 => self.deliver_all(),
            4 => {
                let count = usize::from(script.u8());
                self.session.receive(script.bytes(count), self.now_ns);
            }
            5 => {
                let count = usize::from(script.u16());
                self.session.receive(script.bytes(count), self.now_ns);
            }
            6 => self.session.receive(LINES[usize::from(script.u8()) % LINES.len()].as_bytes(), self.now_ns),
            7 => {
                self.advance(PERIOD_NS);
                self.send(0, 0x55);
                self.deliver_all();
            }
            8 => {
                self.tick = self.tick.wrapping_add(script.i64() as u32);
                let (flags, fill) = (script.u8(), script.u8());
                self.send(flags, fill);
            }
            9 => self.damage(script),
            10 => self.advance(i64::from(script.u16()) * 1000),
            11 => {
                self.advance(i64::from(script.u8()) * S / 10);
                self.session.poll(self.now_ns);
            }
            12 => {
                let deadline_ns = self.session.next_deadline_ns();
                if deadline_ns < self.now_ns.saturating_add(1000 * S) {
                    self.advance((deadline_ns - self.now_ns).max(0));
                    self.session.poll(self.now_ns);
                }
            }
            13 => match self.is_open {
                true => {
                    self.session.line_lost("unplugged");
                    (self.is_open, self.port_baud) = (false, 115_200);
                    self.on_the_way.clear();
                }
                false => self.open(),
            },
            14 if script.u8() == 0x42 => self.session.stop(self.now_ns),
            14 => self.session.poll(self.now_ns),
            _ => {
                let (time_ns, count) = (script.i64(), usize::from(script.u8()));
                match count % 2 {
                    0 => self.session.poll(time_ns),
                    _ => self.session.receive(script.bytes(count), time_ns),
                }
                self.newest = None;
                return true;
            }
        }
        false
    }

    fn open(&mut self) {
        self.is_open = true;
        self.board.reset();
        self.session.line_opened(self.now_ns);
    }

    fn advance(&mut self, time_ns: i64) {
        self.now_ns += time_ns;
        self.tick = self.tick.wrapping_add((time_ns / (S / i64::from(TICKS_PER_SECOND))) as u32);
    }

    fn send(&mut self, flags: u8, fill: u8) {
        self.on_the_way.push(board::result(&self.board.setup, self.tick, flags, fill));
    }

    fn deliver_all(&mut self) {
        for bytes in std::mem::take(&mut self.on_the_way) {
            self.session.receive(&bytes, self.now_ns);
        }
    }

    /// Removes, doubles or changes a byte in transit.
    fn damage(&mut self, script: &mut Script) {
        let (kind, at, bits) = (script.u8(), usize::from(script.u16()), script.u8());
        let Some(bytes) = self.on_the_way.last_mut().filter(|bytes| !bytes.is_empty()) else { return };
        let at = at % bytes.len();
        match kind % 3 {
            0 => drop(bytes.remove(at)),
            1 => bytes.insert(at, bytes[at]),
            _ => bytes[at] ^= bits,
        }
    }

    /// Performs the session's actions and checks its events.
    fn run_until_idle(&mut self) {
        while let Some(action) = self.session.next_action() {
            match action {
                Action::Send(bytes) if self.is_open && (self.port_baud == self.board.baud || !self.board.is_serial) => {
                    let answer = self.board.answer(&bytes);
                    self.on_the_way.push(answer);
                }
                Action::Send(_) => {}
                Action::SendBreak => self.board.reset(),
                Action::FlushInput => self.on_the_way.clear(),
                Action::SetBaud(baud) => {
                    assert!(baud >= 115_200, "a port at {baud} baud");
                    self.port_baud = baud;
                }
                Action::Reopen => self.open(),
            }
        }
        while let Some(event) = self.session.next_event() {
            self.check(&event);
        }
        // Polling at a deadline must move it.
        let mut polls = 0;
        while self.session.next_deadline_ns() <= self.now_ns && polls < 8 {
            self.session.poll(self.now_ns);
            polls += 1;
        }
        assert!(polls < 8 || self.now_ns == i64::MAX, "a deadline that no poll moves");
    }

    fn check(&mut self, event: &Event) {
        match event {
            Event::SetUp(_) => self.newest = None,
            Event::Frames(frames) => {
                self.frames += 1;
                assert!(frames.iter().map(|f| f.frame.samples.len()).eq(self.lengths.iter().copied()));
                let first = (frames[0].frame.tick, frames[0].frame.host_time_ns);
                if let Some(before) = self.newest.replace(first) {
                    assert!(first.0 > before.0 && first.1 > before.1, "{before:?} before {first:?}");
                }
            }
            Event::Trouble(SessionError::LineLost(_)) => assert!(!self.is_open),
            _ => {}
        }
    }

    /// From now on the board works correctly and the line holds.
    fn recover(&mut self) {
        let end_ns = self.now_ns + RECOVERY_NS;
        let before = self.frames;
        if !self.is_open {
            self.open();
        }
        self.run_until_idle();
        let mut next_frame_ns = self.now_ns;
        while !self.session.is_over() && self.frames < before + 3 {
            self.deliver_all();
            self.run_until_idle();
            if !self.on_the_way.is_empty() || self.session.is_over() {
                continue;
            }
            let next_ns = match self.board.streaming {
                true => next_frame_ns.min(self.session.next_deadline_ns()),
                false => self.session.next_deadline_ns(),
            };
            assert!(next_ns <= end_ns, "no frames from a sound board: {:?}", self.session.counters());
            self.advance((next_ns - self.now_ns).max(0));
            if self.board.streaming && self.now_ns >= next_frame_ns {
                self.send(0, 0x11);
                next_frame_ns = self.now_ns + PERIOD_NS;
            }
            self.session.poll(self.now_ns);
            self.run_until_idle();
        }
    }
}

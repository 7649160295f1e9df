//! The reader thread: owns the board's port and session. It reads so that the port never fills,
//! waits for bytes or the session's next deadline, and forwards events through a queue that never
//! blocks it.
//!
//! A lost port is retried every half second. Where the USB device is known it is searched by that,
//! because a replugged board may have another path.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, JoinHandle, sleep};
use std::time::Duration;

use super::queue::Queue;
use super::{Dropped, Latency, LatencyReport, Received, now_ns, raise_priority_of_this_thread, thread_cpu_ns};
use a121::find::{Candidate, find_replugged, list_ports};
use a121::{Action, Address, ClockReport, Event, Line, PortError, Session, SessionCounters, SessionError, Setup};

/// Longest wait for bytes, nanoseconds: bounds the reaction time to a stop. Choice: a stop is not
/// noticeably late; fifty wake-ups a second on an idle line.
const MAX_WAIT_NS: i64 = 20_000_000;
/// Interval of attempts to reopen a lost port, nanoseconds. Choice: a replugged board costs half a
/// second at most; looking for ports reads a few files.
const RETRY_NS: i64 = 500_000_000;
/// A port that stays lost for longer is reported with the reason, nanoseconds. Choice: a board that
/// was just plugged in has its permissions by then.
const REPORT_AFTER_NS: i64 = 2_000_000_000;
/// A board that has not stopped by then is abandoned, nanoseconds. Choice: longer than the session
/// waits for the board to confirm and to send what it has buffered.
const MAX_STOP_NS: i64 = 5_000_000_000;
/// Interval of the shared counters, nanoseconds. Choice: as often as a display is drawn.
const COUNTERS_INTERVAL_NS: i64 = 100_000_000;
/// Bounds for lines of the board's log and for other events that wait for a slow reader. Choice:
/// enough lines to explain a fault, while a board that logs without end fills no memory. Other
/// events come a few at a time.
const MAX_LOGS: usize = 256;
const MAX_OTHERS: usize = 1024;
/// Channels of the queue.
const FRAMES: usize = 0;
const LOGS: usize = 1;
const OTHERS: usize = 2;
/// Bytes read at once. Choice: more than a port's buffer holds, so one call empties it.
const READ_BYTES: usize = 1 << 16;

/// Options of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StreamOptions {
    /// Bound of results that wait for a slow reader; beyond, the oldest are dropped and counted.
    pub max_results: usize,
    /// Speed of a serial port, bits per second; `None`: the fastest that works.
    pub baud: Option<u32>,
}

impl Default for StreamOptions {
    /// A bound of about 15 s of the default preset.
    fn default() -> Self {
        Self { max_results: 1024, baud: None }
    }
}

/// Events of a stream.
#[derive(Debug, Clone, PartialEq)]
pub enum StreamEvent {
    /// An event of the session.
    Session(Event),
    /// A lost port was reopened at this address.
    Reopened(String),
    /// A lost port stays lost, with the reason; sent once.
    Waiting(String),
}

/// Why a stream cannot start.
#[derive(Debug, thiserror::Error)]
pub enum StreamError {
    /// The port does not open.
    #[error(transparent)]
    Port(#[from] PortError),
    /// The set-up is invalid.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The thread cannot be created.
    #[error("cannot start the reader's thread: {0}")]
    Thread(std::io::Error),
}

/// Counters of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StreamCounters {
    /// The session's counters.
    pub session: SessionCounters,
    /// Quality of the times; `None` before streaming.
    pub clock: Option<ClockReport>,
    /// Events dropped because nobody fetched them in time.
    pub dropped: Dropped,
    /// How often the port was lost.
    pub losses: u64,
    /// How often it was reopened.
    pub reopenings: u64,
    /// From the bytes that completed a result to its forwarding.
    pub latency: LatencyReport,
    /// Processor time of the reader's thread, seconds.
    pub cpu_s: f64,
    /// Running time, seconds.
    pub running_s: f64,
}

struct Shared {
    queue: Queue<StreamEvent, 3>,
    counters: Mutex<StreamCounters>,
    stop: AtomicBool,
}

/// A board's stream. Dropping it stops the board and waits for that, a few seconds at most.
pub struct SensorStream {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl SensorStream {
    /// Opens the port and starts the session.
    ///
    /// # Errors
    /// The port does not open; the set-up is invalid.
    pub fn open(setup: Setup, candidate: &Candidate, options: &StreamOptions) -> Result<Self, StreamError> {
        let line = Line::open(&candidate.address)?;
        let session = Session::new(setup, candidate.link(options.baud), now_ns())?;
        let shared = Arc::new(Shared {
            queue: Queue::new([options.max_results, MAX_LOGS, MAX_OTHERS]),
            counters: Mutex::default(),
            stop: AtomicBool::new(false),
        });
        let reader = Reader {
            session,
            line: Some(line),
            place: candidate.clone(),
            shared: Arc::clone(&shared),
            buffer: vec![0; READ_BYTES],
            start_ns: now_ns(),
            last_read_ns: 0,
            next_try_ns: 0,
            lost_ns: None,
            stop_by_ns: None,
            published_ns: 0,
            latency: Latency::default(),
            counters: StreamCounters::default(),
        };
        let thread = Builder::new().name("a121 reader".into()).spawn(|| reader.run()).map_err(StreamError::Thread)?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// The next event, waiting at most this long.
    pub fn recv_timeout(&self, patience: Duration) -> Received<StreamEvent> {
        self.shared.queue.receive(patience)
    }

    /// Counters, at most 0.1 s old.
    pub fn counters(&self) -> StreamCounters {
        let counters = *self.shared.counters.lock().unwrap_or_else(PoisonError::into_inner);
        let [frames, logs, others] = self.shared.queue.dropped();
        StreamCounters { dropped: Dropped { frames, logs, others }, ..counters }
    }

    /// Asks the board to stop. Events on their way still arrive, then the stream reports its end.
    pub fn stop(&self) {
        self.shared.stop.store(true, Ordering::Relaxed);
    }

    /// Stops and waits for the thread's end, a few seconds at most.
    pub fn finish(mut self) -> StreamCounters {
        self.end();
        self.counters()
    }

    fn end(&mut self) {
        self.stop();
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has been printed.
            let _ = thread.join();
        }
    }
}

impl Drop for SensorStream {
    fn drop(&mut self) {
        self.end();
    }
}

/// Closes the queue when the thread ends for any reason.
struct QueueCloser(Arc<Shared>);

impl Drop for QueueCloser {
    fn drop(&mut self) {
        self.0.queue.end();
    }
}

/// State of the thread.
struct Reader {
    session: Session,
    line: Option<Line>,
    place: Candidate,
    shared: Arc<Shared>,
    buffer: Vec<u8>,
    start_ns: i64,
    last_read_ns: i64,
    next_try_ns: i64,
    /// Since when the port has been lost; `None` once that was reported.
    lost_ns: Option<i64>,
    stop_by_ns: Option<i64>,
    published_ns: i64,
    latency: Latency,
    counters: StreamCounters,
}

impl Reader {
    fn run(mut self) {
        let _end = QueueCloser(Arc::clone(&self.shared));
        raise_priority_of_this_thread();
        while !self.is_over() {
            self.apply_stop();
            match self.line.is_some() {
                true => self.serve(),
                false => self.reopen_when_due(),
            }
            self.forward_events();
            self.publish(COUNTERS_INTERVAL_NS);
        }
        self.line = None;
        self.publish(0);
    }

    fn is_over(&self) -> bool {
        self.session.is_over() || self.stop_by_ns.is_some_and(|by_ns| now_ns() >= by_ns)
    }

    fn apply_stop(&mut self) {
        if self.stop_by_ns.is_none() && self.shared.stop.load(Ordering::Relaxed) {
            let now_ns = now_ns();
            self.session.stop(now_ns);
            self.stop_by_ns = Some(now_ns.saturating_add(MAX_STOP_NS));
        }
    }

    /// Performs the session's actions, then waits for bytes or its next deadline.
    fn serve(&mut self) {
        let Some(line) = &mut self.line else { return };
        while let Some(action) = self.session.next_action() {
            if action == Action::Reopen {
                (self.line, self.next_try_ns, self.lost_ns) = (None, 0, Some(now_ns()));
                return;
            }
            if let Err(error) = line.perform(&action) {
                return self.close_lost_line(&error);
            }
        }
        let wait_ns = self.session.next_deadline_ns().saturating_sub(now_ns()).clamp(0, MAX_WAIT_NS);
        // Received bytes are processed before the session checks its deadlines.
        match line.read(&mut self.buffer, Duration::from_nanos(wait_ns as u64)) {
            Ok(0) => {}
            Ok(count) => {
                self.last_read_ns = now_ns();
                self.session.receive(&self.buffer[..count], self.last_read_ns);
            }
            Err(error) => return self.close_lost_line(&error),
        }
        self.session.poll(now_ns());
    }

    fn close_lost_line(&mut self, error: &PortError) {
        let reason = match error {
            PortError::Gone { reason, .. } => reason.clone(),
            other => other.to_string(),
        };
        self.session.line_lost(&reason);
        let now_ns = now_ns();
        (self.line, self.next_try_ns, self.lost_ns) = (None, now_ns.saturating_add(RETRY_NS), Some(now_ns));
        self.counters.losses += 1;
    }

    fn reopen_when_due(&mut self) {
        let now_ns = now_ns();
        if now_ns < self.next_try_ns {
            let wait_ns = (self.next_try_ns - now_ns).min(MAX_WAIT_NS);
            return sleep(Duration::from_nanos(wait_ns as u64));
        }
        match self.address_now().and_then(|address| Line::open(&address)) {
            Ok(line) => {
                self.shared.queue.push(OTHERS, StreamEvent::Reopened(line.address().to_string()));
                self.line = Some(line);
                self.counters.reopenings += 1;
                self.session.line_opened(self::now_ns());
            }
            Err(error) => {
                self.next_try_ns = now_ns.saturating_add(RETRY_NS);
                // The permissions of a board that was just plugged in may take a moment to be set.
                if self.lost_ns.is_some_and(|lost_ns| now_ns.saturating_sub(lost_ns) > REPORT_AFTER_NS) {
                    self.lost_ns = None;
                    self.shared.queue.push(OTHERS, StreamEvent::Waiting(error.to_string()));
                }
            }
        }
    }

    /// The board's current address.
    fn address_now(&mut self) -> Result<Address, PortError> {
        if let (Some(usb), Address::Serial { path, .. }) = (&self.place.usb, &mut self.place.address) {
            match find_replugged(&list_ports(), usb, path) {
                Some(port) => path.clone_from(&port.path),
                None => {
                    let there = "the board is not plugged in".to_owned();
                    return Err(PortError::NotFound { path: path.clone(), available: there });
                }
            }
        }
        Ok(self.place.address.clone())
    }

    fn forward_events(&mut self) {
        while let Some(event) = self.session.next_event() {
            let channel = match event {
                Event::Frames(_) => FRAMES,
                Event::Log(_) => LOGS,
                _ => OTHERS,
            };
            self.shared.queue.push(channel, StreamEvent::Session(event));
            if channel == FRAMES {
                self.latency.push(now_ns().saturating_sub(self.last_read_ns));
            }
        }
    }

    /// Updates the shared counters when they are older than this.
    fn publish(&mut self, age_ns: i64) {
        let now_ns = now_ns();
        if now_ns.saturating_sub(self.published_ns) < age_ns {
            return;
        }
        self.published_ns = now_ns;
        self.counters = StreamCounters {
            session: self.session.counters(),
            clock: self.session.clock_report(),
            latency: self.latency.report(),
            cpu_s: thread_cpu_ns() as f64 * 1e-9,
            running_s: now_ns.saturating_sub(self.start_ns) as f64 * 1e-9,
            ..self.counters
        };
        *self.shared.counters.lock().unwrap_or_else(PoisonError::into_inner) = self.counters;
    }
}

#[cfg(all(test, unix))]
#[path = "sensor_tests.rs"]
mod tests;

//! Watches the frame loop from another thread: a VR runtime may hang in any call, and the loop with
//! it. The log says so, and a stop ends the program all the same, once the recording is complete.

use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::time::Duration;

use super::now_ns;

/// A call that has not returned for this time hangs, nanoseconds. Choice: a compositor restarts, and a game loads, within a second
/// or two; what takes longer is worth a line in the log.
const HANG_NS: i64 = 3_000_000_000;
/// Longest end of a session, nanoseconds. Choice: the runtime waits for the graphics card to finish its copies.
const MAX_END_NS: i64 = 10_000_000_000;
/// Interval of checks. Choice: a stop while the runtime hangs takes as much longer.
const CHECK_INTERVAL: Duration = Duration::from_millis(100);

/// What keeps a session from going on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hang {
    /// A call of the runtime in the frame loop.
    Runtime,
    /// The end of the session: a call of the runtime, or one of this program's threads.
    End,
}

impl Hang {
    fn limit_ns(self) -> i64 {
        match self {
            Self::Runtime => HANG_NS,
            Self::End => MAX_END_NS,
        }
    }
}

impl fmt::Display for Hang {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = self.limit_ns() / 1_000_000_000;
        match self {
            Self::Runtime => write!(f, "the VR runtime has not answered for {seconds} s"),
            Self::End => write!(f, "the session has not ended for {seconds} s"),
        }
    }
}

/// When the frame loop last began a frame.
pub struct Heartbeat {
    last_ns: AtomicI64,
    is_ending: AtomicBool,
    is_over: AtomicBool,
}

impl Default for Heartbeat {
    fn default() -> Self {
        // Opening the graphics device before the first frame takes its time.
        Self { last_ns: AtomicI64::new(i64::MAX), is_ending: AtomicBool::new(false), is_over: AtomicBool::new(false) }
    }
}

impl Heartbeat {
    /// A frame begins.
    pub fn beat(&self, time_ns: i64) {
        self.last_ns.store(time_ns, Ordering::Relaxed);
    }

    /// The last frame is over; the session ends.
    pub fn begin_end(&self) {
        self.beat(now_ns());
        self.is_ending.store(true, Ordering::Relaxed);
    }

    /// No call of the runtime follows.
    pub fn end(&self) {
        self.is_over.store(true, Ordering::Relaxed);
    }

    /// Logs what hangs, and when the runtime answers again. Returns at the end, or what hangs while the program is to stop or the
    /// session ends.
    pub fn watch(&self, stop: &AtomicBool) -> Option<Hang> {
        let mut hangs_since_ns = None;
        while !self.is_over.load(Ordering::Relaxed) {
            let (last_ns, now_ns) = (self.last_ns.load(Ordering::Relaxed), now_ns());
            let is_ending = self.is_ending.load(Ordering::Relaxed);
            let hang = if is_ending { Hang::End } else { Hang::Runtime };
            let hangs = now_ns.saturating_sub(last_ns) >= hang.limit_ns();
            match hangs_since_ns {
                None if hangs => {
                    log::error!("{hang}: no warnings are shown");
                    hangs_since_ns = Some(last_ns);
                }
                Some(since_ns) if !hangs => {
                    log::warn!("the VR runtime answers again, after {:.0} s", (last_ns - since_ns) as f64 * 1e-9);
                    hangs_since_ns = None;
                }
                _ => {}
            }
            if hangs && (is_ending || stop.load(Ordering::Relaxed)) {
                return Some(hang);
            }
            std::thread::sleep(CHECK_INTERVAL);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_ends_the_watch_only_while_the_runtime_hangs() {
        let (heartbeat, stop) = (Heartbeat::default(), AtomicBool::new(true));
        heartbeat.beat(now_ns() - HANG_NS);
        assert_eq!(heartbeat.watch(&stop), Some(Hang::Runtime));
        let heartbeat = Heartbeat::default();
        heartbeat.beat(now_ns());
        heartbeat.end();
        assert_eq!(heartbeat.watch(&stop), None);
    }

    #[test]
    fn an_end_that_hangs_is_abandoned_without_a_stop() {
        let (heartbeat, stop) = (Heartbeat::default(), AtomicBool::new(false));
        heartbeat.begin_end();
        heartbeat.beat(now_ns() - MAX_END_NS);
        let hang = heartbeat.watch(&stop).expect("it hangs");
        // It may be a thread of this program.
        assert_eq!(hang.to_string(), "the session has not ended for 10 s");
    }
}

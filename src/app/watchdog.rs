//! Watches the frame loop from another thread: a VR runtime may hang in any call, and the loop with
//! it. The log says so, and a stop ends the program all the same, once the recording is complete.

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

    /// Logs when the runtime hangs and when it answers again. Returns at the end, or when the runtime hangs while the program is to
    /// stop or the session ends; true: it hangs.
    pub fn watch(&self, stop: &AtomicBool) -> bool {
        let mut hangs_since_ns = None;
        while !self.is_over.load(Ordering::Relaxed) {
            let (last_ns, now_ns) = (self.last_ns.load(Ordering::Relaxed), now_ns());
            let is_ending = self.is_ending.load(Ordering::Relaxed);
            let limit_ns = if is_ending { MAX_END_NS } else { HANG_NS };
            let hangs = now_ns.saturating_sub(last_ns) >= limit_ns;
            match hangs_since_ns {
                None if hangs => {
                    log::error!(
                        "the VR runtime has not answered for {} s: no warnings are shown",
                        limit_ns / 1_000_000_000
                    );
                    hangs_since_ns = Some(last_ns);
                }
                Some(since_ns) if !hangs => {
                    log::warn!("the VR runtime answers again, after {:.0} s", (last_ns - since_ns) as f64 * 1e-9);
                    hangs_since_ns = None;
                }
                _ => {}
            }
            if hangs && (is_ending || stop.load(Ordering::Relaxed)) {
                return true;
            }
            std::thread::sleep(CHECK_INTERVAL);
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_ends_the_watch_only_while_the_runtime_hangs() {
        let (heartbeat, stop) = (Heartbeat::default(), AtomicBool::new(true));
        heartbeat.beat(now_ns() - HANG_NS);
        assert!(heartbeat.watch(&stop));
        let heartbeat = Heartbeat::default();
        heartbeat.beat(now_ns());
        heartbeat.end();
        assert!(!heartbeat.watch(&stop));
    }

    #[test]
    fn an_end_that_hangs_is_abandoned_without_a_stop() {
        let (heartbeat, stop) = (Heartbeat::default(), AtomicBool::new(false));
        heartbeat.begin_end();
        heartbeat.beat(now_ns() - MAX_END_NS);
        assert!(heartbeat.watch(&stop));
    }
}

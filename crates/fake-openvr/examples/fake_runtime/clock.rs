//! The monotonic clock, and the display's frames on it.

use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};

/// Time of the host's monotonic clock, nanoseconds.
pub fn now_ns() -> i64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec * 1_000_000_000 + now.tv_nsec
}

/// Frames of the display: frame n begins `n` periods after the first one.
#[derive(Debug, Clone, Copy)]
pub struct Frames {
    first_ns: i64,
    period_ns: i64,
    /// The last frame for which WaitFrameSync returned.
    last_begun: Option<i64>,
}

impl Frames {
    /// Frames from `first_ns` on.
    pub fn new(first_ns: i64, frequency_hz: f64) -> Self {
        Self { first_ns, period_ns: (1e9 / frequency_hz).round() as i64, last_begun: None }
    }

    /// The frame at a time.
    pub fn at(&self, time_ns: i64) -> i64 {
        (time_ns - self.first_ns).div_euclid(self.period_ns)
    }

    /// Frames missed by a client that waits in this one.
    pub fn missed(&self, current: i64) -> u64 {
        self.last_begun.map_or(0, |last| (current - last).max(0) as u64)
    }

    /// WaitFrameSync returns for this frame.
    pub fn begin(&mut self, frame: i64) {
        self.last_begun = Some(frame);
    }

    /// Begin of a frame, nanoseconds.
    pub fn start_ns(&self, frame: i64) -> i64 {
        self.first_ns + frame * self.period_ns
    }
}

/// Sleeps until a time of the monotonic clock.
pub fn sleep_until(time_ns: i64) {
    loop {
        let left_ns = time_ns - now_ns();
        if left_ns <= 0 {
            return;
        }
        std::thread::sleep(Duration::from_nanos(left_ns as u64));
    }
}

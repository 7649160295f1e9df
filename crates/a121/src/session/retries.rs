//! Pauses between attempts, and errors that count only when they repeat.

use crate::SessionError;

/// First and longest pause before a retry, nanoseconds. Choice: a board boots in less than a
/// second; a port that stays away is tried often enough that plugging in seems immediate.
const PAUSE_NS: (i64, i64) = (500_000_000, 8_000_000_000);

/// Attempts since the last frame.
pub(super) struct Retries {
    pause_ns: i64,
    /// Error of the last set-up, if it failed.
    unconfirmed_error: Option<SessionError>,
}

impl Default for Retries {
    fn default() -> Self {
        Self { pause_ns: PAUSE_NS.0, unconfirmed_error: None }
    }
}

impl Retries {
    /// The pause before the next attempt, nanoseconds; each is twice the one before.
    pub fn next_pause_ns(&mut self) -> i64 {
        let pause_ns = self.pause_ns;
        self.pause_ns = (2 * pause_ns).min(PAUSE_NS.1);
        pause_ns
    }

    /// Whether this error is the one of the last set-up; once, it may be a transmission fault.
    pub fn is_repeated(&mut self, error: &SessionError) -> bool {
        if self.unconfirmed_error.as_ref() == Some(error) {
            return true;
        }
        self.unconfirmed_error = Some(error.clone());
        false
    }
}

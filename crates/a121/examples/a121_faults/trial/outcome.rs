//! What a trial gives.

use a121::SessionCounters;

/// Time of the fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Before streaming: with the reply to one of the commands.
    Opening,
    /// While frames are streamed.
    Streaming,
    /// While the session stops.
    Stopping,
}

/// Result of a trial.
#[derive(Debug, Clone)]
pub struct Outcome {
    pub phase: Phase,
    /// Time from the fault to the frame after which none was missed, to the first frame, or to the
    /// end, seconds.
    pub recovery_s: f64,
    /// Frames missed.
    pub lost: u64,
    /// Frames accepted; and, of them, frames with a flipped bit that cannot be detected.
    pub accepted: u64,
    pub undetected: u64,
    /// Greatest error of a time once the clock had settled, seconds, without the delay common to
    /// all results.
    pub worst_error_s: f64,
    pub counters: SessionCounters,
    /// Violations found in the trial, as text.
    pub failures: Vec<String>,
}

//! Comparison of the frames that a session emits with what the board sent.

use std::collections::VecDeque;

use a121::SensorFrame;
use a121::device::{Fault, READING_NS, SentResult};

use super::outcome::Outcome;

/// Length of a result's line that the session assumes (source: its `LINE_BYTES`), bytes per sensor.
/// With it goes the part of the delay that the session subtracts.
const LINE_BYTES: i64 = 170;
/// Accuracy required of times. After `SETTLED_S` seconds of frames: the greater of `SIGMAS` stated
/// standard deviations and one tick, plus `BOARD_DELAY_S` seconds for differences between the
/// board's own delays. Before: `UNSETTLED_TOLERANCE_S` seconds, the longest delay that is
/// simulated. Choice: 5σ fails once in a million frames by chance; 0.1 ms is twice the mean of the
/// simulated board's additional delay.
const SETTLED_S: f64 = 2.0;
const SIGMAS: f64 = 5.0;
const BOARD_DELAY_S: f64 = 0.1e-3;
const UNSETTLED_TOLERANCE_S: f64 = 0.25;
/// A flipped digit of a tick is detected when it moves the tick by more than this share of the
/// period. Source: `PERIOD_TOLERANCE` of the session's ticks.
const UNDETECTED_TICK_SHARE: f64 = 0.03;

/// What the line and the session were when a result arrived.
pub struct Arrival {
    pub now_ns: i64,
    /// Time of a byte on the line, nanoseconds; 0 if the line has no baud rate.
    pub byte_ns: i64,
    /// Jumps of the board's clock that the session has counted.
    pub tick_jumps: u64,
    /// Standard deviation of the times that the session states, seconds.
    pub sigma_s: f64,
}

/// What was sent, and how long the session's clock has run.
pub struct FrameCheck {
    /// Period of the results and of the board's ticks, seconds.
    period_s: f64,
    tick_s: f64,
    sent: VecDeque<SentResult>,
    /// Time since which the session's clock has run, nanoseconds, and number of frames since then.
    streaming_since_ns: i64,
    frames_since: u64,
    tick_jumps: u64,
}

impl FrameCheck {
    pub fn new(period_s: f64, tick_s: f64) -> Self {
        Self { period_s, tick_s, sent: VecDeque::new(), streaming_since_ns: 0, frames_since: 0, tick_jumps: 0 }
    }

    /// The session's clock starts.
    pub fn restart_clock(&mut self, now_ns: i64) {
        (self.streaming_since_ns, self.frames_since) = (now_ns, 0);
    }

    pub fn add_sent(&mut self, sent: Vec<SentResult>) {
        self.sent.extend(sent);
    }

    /// Compares the frames of a result; returns the true end of the first one's measurement,
    /// nanoseconds, if the board sent them.
    pub fn check(&mut self, frames: &[SensorFrame], at: &Arrival, outcome: &mut Outcome) -> Option<i64> {
        outcome.accepted += 1;
        if at.tick_jumps > std::mem::replace(&mut self.tick_jumps, at.tick_jumps) {
            self.restart_clock(at.now_ns);
        }
        self.frames_since += 1;
        let Some((index, is_exact)) = self.matching(frames) else {
            let faults: Vec<_> = self.sent.iter().rev().take(3).map(|sent| &sent.faults).collect();
            let text = format!("a frame that differs from every sent one; last faults: {faults:?}");
            outcome.failures.push(text);
            return None;
        };
        outcome.undetected += u64::from(!is_exact);
        self.sent.drain(..index);
        let sent = &self.sent[0];
        self.check_times(frames, sent, is_exact, at, outcome);
        Some(sent.ends_ns[0])
    }

    /// Index of the sent result that equals the frames, and whether it is equal exactly. Otherwise
    /// a damaged result whose damage cannot be detected.
    fn matching(&self, frames: &[SensorFrame]) -> Option<(usize, bool)> {
        let samples: Vec<_> = frames.iter().flat_map(|f| &f.frame.samples).copied().collect();
        let same_headers = |sent: &SentResult| {
            frames.len() == sent.infos.len()
                && frames.iter().zip(&sent.infos).all(|(SensorFrame { frame, .. }, info)| {
                    frame.tick as u32 == info.tick
                        && frame.temperature_c == info.temperature
                        && frame.data_saturated == info.data_saturated
                        && frame.calibration_needed == info.calibration_needed
                        && frame.frame_delayed == info.frame_delayed
                })
        };
        let exact = self.sent.iter().position(|sent| sent.samples == samples && same_headers(sent));
        if let Some(index) = exact {
            return Some((index, true));
        }
        let undetected = self.sent.iter().position(|sent| {
            let is_line_struck = sent.faults.iter().any(|(at, _)| *at < sent.line_bytes);
            let is_flipped = sent.faults.iter().any(|(at, fault)| *fault == Fault::Flip && *at >= sent.line_bytes);
            let bits = |a: i16, b: i16| (a ^ b).count_ones();
            let wrong_bits: u32 =
                sent.samples.iter().zip(&samples).map(|(a, b)| bits(a.re, b.re) + bits(a.im, b.im)).sum();
            (is_line_struck && sent.samples == samples)
                || (is_flipped && same_headers(sent) && sent.samples.len() == samples.len() && wrong_bits == 1)
        })?;
        Some((undetected, false))
    }

    fn check_times(
        &self,
        frames: &[SensorFrame],
        sent: &SentResult,
        is_exact: bool,
        at: &Arrival,
        outcome: &mut Outcome,
    ) {
        let assumed = LINE_BYTES * frames.len() as i64;
        // Results wait for the last sensor.
        let waits_ns = sent.ends_ns.iter().max().map_or(0, |last| last - sent.ends_ns[0]);
        let shared_ns = READING_NS + waits_ns + (sent.line_bytes as i64 - assumed) * at.byte_ns;
        let is_settled = self.frames_since as f64 * self.period_s > SETTLED_S;
        for (SensorFrame { frame, .. }, end_ns) in frames.iter().zip(&sent.ends_ns) {
            let error_s = (frame.host_time_ns - end_ns - shared_ns) as f64 * 1e-9;
            if !is_exact && error_s.abs() < UNDETECTED_TICK_SHARE * self.period_s + 2e-3 {
                continue;
            }
            if is_settled {
                outcome.worst_error_s = outcome.worst_error_s.max(error_s.abs());
            }
            let sigma_s = at.sigma_s;
            let bound_s =
                if is_settled { self.tick_s.max(SIGMAS * sigma_s) + BOARD_DELAY_S } else { UNSETTLED_TOLERANCE_S };
            if error_s.abs() > bound_s {
                let since_s = (at.now_ns - self.streaming_since_ns) as f64 * 1e-9;
                let text =
                    format!("a time off by {:.3} ms {since_s:.1} s after the start, 1σ {sigma_s:.1e}", error_s * 1e3);
                outcome.failures.push(text);
            }
        }
    }
}

//! When a streaming board's frames are measured, and what is sent of them.

use num_complex::Complex;

use super::protocol::{BoardSetup, SensorEntry};
use crate::frame_timing;

/// Between the end of a measurement and the next one's start, or the server's reading of it, seconds: measured on a
/// free-running XC120.
const READ_S: f64 = 0.88e-3;

/// Times of a result, seconds.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Timing {
    /// For each sensor, group by group: from the start of the first to the end of its own.
    ends_s: Vec<f64>,
    /// From the start of the first to the end of the last.
    pub whole_s: f64,
    /// From result to result, where nothing is late.
    pub period_s: f64,
}

impl Timing {
    /// Groups measure one after the other, the sensors of a group together.
    pub fn of(groups: &[Vec<SensorEntry>], update_rate: Option<f64>) -> Self {
        let (mut ends_s, mut whole_s, mut period_s) = (Vec::new(), 0.0f64, update_rate.map_or(0.0, |rate| 1.0 / rate));
        for group in groups {
            let timings: Vec<_> = group.iter().map(|entry| frame_timing(&entry.config)).collect();
            ends_s.extend(timings.iter().map(|timing| whole_s + timing.frame_s));
            whole_s += timings.iter().map(|timing| timing.frame_s).fold(0.0, f64::max);
            period_s = timings.iter().map(|timing| timing.frame_period_s).fold(period_s, f64::max);
        }
        Self { ends_s, whole_s, period_s: period_s.max(whole_s) }
    }
}

/// What is said of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SentInfo {
    /// The counter at the end of its measurement.
    pub tick: u32,
    /// Whether a sample hit the limit.
    pub data_saturated: bool,
    /// °C.
    pub temperature: i16,
    /// Whether the sensor asks to be calibrated.
    pub calibration_needed: bool,
    /// Whether it comes later than asked for.
    pub frame_delayed: bool,
}

/// A result that is measured, or waits to be read.
#[derive(Debug, Clone)]
pub(super) struct Measured {
    pub start_s: f64,
    pub end_ns: i64,
    pub ends_ns: Vec<i64>,
    pub infos: Vec<SentInfo>,
    pub samples: Vec<Complex<i16>>,
}

/// A stream under way.
#[derive(Debug, Clone)]
pub(super) struct Stream {
    pub setup: BoardSetup,
    pub index: u64,
    pub next: Measured,
}

impl BoardSetup {
    /// For each sensor, group by group: itself, and when its frame ends after the result's start, seconds.
    pub fn ends_s(&self) -> impl Iterator<Item = (&SensorEntry, f64)> {
        self.groups.iter().flatten().zip(self.timing.ends_s.iter().copied())
    }
}

impl Stream {
    /// When the next measurement starts, board's seconds, where this one was read at that time; and whether that is
    /// later than asked for.
    pub fn next_start_s(&self, read_s: f64) -> (f64, bool) {
        let wanted_s = self.next.start_s + self.setup.timing.period_s;
        let free_s = read_s.max(self.next.start_s + self.setup.timing.whole_s + READ_S);
        // A frame that the configuration itself makes as long as its period is as asked for.
        (wanted_s.max(free_s), free_s > wanted_s + READ_S)
    }
}

/// The bytes of a result and how many of them are its line.
pub(super) fn result_bytes(groups: &[Vec<SensorEntry>], result: &Measured) -> (Vec<u8>, usize) {
    use std::fmt::Write;
    let mut infos = result.infos.iter();
    let mut line = String::from("{\"result_info\":[");
    for (index, group) in groups.iter().enumerate() {
        line.push_str(if index == 0 { "[" } else { ",[" });
        for (index, info) in infos.by_ref().take(group.len()).enumerate() {
            let comma = if index == 0 { "" } else { "," };
            // Writing to a string does not fail.
            let _ = write!(
                line,
                "{comma}{{\"tick\":{},\"data_saturated\":{},\"temperature\":{},\"calibration_needed\":{},\
                 \"frame_delayed\":{}}}",
                info.tick, info.data_saturated, info.temperature, info.calibration_needed, info.frame_delayed
            );
        }
        line.push(']');
    }
    let _ = writeln!(line, "],\"status\":\"ok\",\"payload_size\":{}}}", 4 * result.samples.len());
    let line_bytes = line.len();
    let mut bytes = line.into_bytes();
    bytes.reserve_exact(4 * result.samples.len());
    for sample in &result.samples {
        bytes.extend_from_slice(&sample.re.to_le_bytes());
        bytes.extend_from_slice(&sample.im.to_le_bytes());
    }
    (bytes, line_bytes)
}

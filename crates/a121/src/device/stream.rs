//! Timing of a streaming board's frames, and the bytes of its results.

use num_complex::Complex;

use super::protocol::{BoardSetup, SensorEntry};
use crate::frame_timing;

/// Time between the end of a measurement and the start of the next one or its readout, seconds.
/// Measured: the ticks of a free-running XC120 in the vendor's recordings.
const READ_S: f64 = 0.88e-3;

/// Timing of a result, seconds.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Timing {
    /// For each sensor, by group: from the start of the result to the end of the sensor's
    /// measurement.
    ends_s: Vec<f64>,
    /// From the start of the result to the end of its last measurement.
    pub whole_s: f64,
    /// Result period, if nothing is late.
    pub period_s: f64,
}

impl Timing {
    /// Groups measure one after the other, the sensors of a group at the same time.
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

/// Metadata of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SentInfo {
    /// Tick at the end of its measurement.
    pub tick: u32,
    /// Whether a sample hit the limit of the converter.
    pub data_saturated: bool,
    /// Chip temperature, °C.
    pub temperature: i16,
    /// Whether the sensor requests a calibration.
    pub calibration_needed: bool,
    /// Whether it is later than requested.
    pub frame_delayed: bool,
}

/// A measured result that waits for its readout.
#[derive(Debug, Clone)]
pub(super) struct Measured {
    pub start_s: f64,
    pub end_ns: i64,
    pub ends_ns: Vec<i64>,
    pub infos: Vec<SentInfo>,
    pub samples: Vec<Complex<i16>>,
}

/// A running stream.
#[derive(Debug, Clone)]
pub(super) struct Stream {
    pub setup: BoardSetup,
    pub index: u64,
    pub next: Measured,
    /// When the board writes another line of its log, host nanoseconds.
    pub next_log_ns: i64,
}

impl BoardSetup {
    /// The sensors, by group, each with the end of its frame after the result's start, seconds.
    pub fn ends_s(&self) -> impl Iterator<Item = (&SensorEntry, f64)> {
        self.groups.iter().flatten().zip(self.timing.ends_s.iter().copied())
    }
}

impl Stream {
    /// Start of the next measurement, board seconds, if this one was read at `read_s`; and whether
    /// that is later than requested.
    pub fn next_start_s(&self, read_s: f64) -> (f64, bool) {
        let wanted_s = self.next.start_s + self.setup.timing.period_s;
        let free_s = read_s.max(self.next.start_s + self.setup.timing.whole_s + READ_S);
        // A frame that is as long as its period by configuration is not late.
        (wanted_s.max(free_s), free_s > wanted_s + READ_S)
    }
}

/// The bytes of a result, and the size of its JSON line.
pub(super) fn result_bytes(groups: &[Vec<SensorEntry>], result: &Measured) -> (Vec<u8>, usize) {
    use std::fmt::Write;
    let mut infos = result.infos.iter();
    let mut line = String::from("{\"result_info\":[");
    for (index, group) in groups.iter().enumerate() {
        line.push_str(if index == 0 { "[" } else { ",[" });
        for (index, info) in infos.by_ref().take(group.len()).enumerate() {
            let comma = if index == 0 { "" } else { "," };
            // Writing to a string cannot fail.
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

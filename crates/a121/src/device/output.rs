//! What a simulated board gives to its caller: bytes, results as sent, counters.

use std::collections::BTreeMap;

use num_complex::Complex;

use super::{Fault, SentInfo};

/// Output of a board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Output {
    /// Bytes reach the reader.
    Bytes {
        /// The bytes.
        bytes: Vec<u8>,
        /// Their baud rate; a reader at another rate gets noise. `None` if the line has no baud
        /// rate.
        baud: Option<u32>,
    },
    /// The board was unplugged.
    Unplugged,
    /// The board was plugged in again.
    Plugged,
}

/// A result as the board sent it, for comparison with what arrives.
#[derive(Debug, Clone, PartialEq)]
pub struct SentResult {
    /// One per sensor, by group.
    pub infos: Vec<SentInfo>,
    /// True end of each sensor's measurement, host nanoseconds.
    pub ends_ns: Vec<i64>,
    /// Samples of all sensors, by group.
    pub samples: Vec<Complex<i16>>,
    /// Size of its JSON line.
    pub line_bytes: usize,
    /// Faults that hit it, as (offset, kind).
    pub faults: Vec<(usize, Fault)>,
}

/// Counters of a board.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct DeviceCounters {
    /// Results sent.
    pub results: u64,
    /// Results that were later than requested.
    pub delayed: u64,
    /// Results never sent, because the board hung or restarted.
    pub lost: u64,
    /// Bytes sent.
    pub bytes: u64,
    /// Commands received.
    pub commands: u64,
    /// Faults by kind.
    pub faults: BTreeMap<Fault, u64>,
}

//! Calibrations that the board made and that it gets back after a fault.

use crate::{Calibration, Version};

const REUSE_SINCE: Version = Version::development(0, 4, 3, 280);
/// A calibration request sooner than this after the last one is ignored, nanoseconds. Choice: a new
/// calibration needs a new set-up, an interruption of some tenths of a second; a sensor that asks
/// again at once is faulty.
const RECALIBRATE_NS: i64 = 10_000_000_000;

/// The calibrations of the sensors, and when they were last made anew.
pub(super) struct Calibrations {
    known: Vec<Calibration>,
    renewed_ns: Option<i64>,
}

impl Calibrations {
    pub fn new(known: Vec<Calibration>) -> Self {
        Self { known, renewed_ns: None }
    }

    /// Those to send to a board of this version.
    pub fn reusable(&self, version: Version) -> Vec<Calibration> {
        if version >= REUSE_SINCE { self.known.clone() } else { Vec::new() }
    }

    pub fn keep(&mut self, known: &[Calibration]) {
        self.known = known.to_vec();
    }

    /// Forgets them; returns whether there were any.
    pub fn discard(&mut self) -> bool {
        !std::mem::take(&mut self.known).is_empty()
    }

    /// Forgets them at a sensor's request, unless the last request was recent.
    pub fn renew(&mut self, now_ns: i64) -> bool {
        let is_due = self.renewed_ns.is_none_or(|at| now_ns.saturating_sub(at) > RECALIBRATE_NS);
        if is_due {
            self.renewed_ns = Some(now_ns);
            self.known.clear();
        }
        is_due
    }
}

//! What sweeps and poses are corrected by, for reports.

use radar_sar::TimeOffset;
use radar_sar::geometry::Pose;

use crate::MountInUse;

/// What sweeps and poses are corrected by, and what the data show of it.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationInUse {
    /// The time offset in use: time of a sweep's pose minus time of the sweep, seconds.
    pub time_offset_s: f64,
    /// Its last estimate, applied or not; `None` when there was none.
    pub time_offset_estimate: Option<TimeOffset>,
    /// The mount in use, and its last estimate.
    pub mount: MountInUse,
    /// Slow tracking error in each axis as last estimated, rms, metres.
    pub drift_m: Option<f64>,
    /// Measured minus true range, metres, by which the ranges are corrected: of each subsweep that hears echoes, as set or as the
    /// loopback shows it. `None` while neither is known.
    pub range_bias_m: Option<Vec<f64>>,
}

impl CalibrationInUse {
    /// Nothing was estimated.
    pub fn as_set(time_offset_s: f64, head_from_sensor: Pose) -> Self {
        let mount = MountInUse { assumed: head_from_sensor, in_use: head_from_sensor, estimate: None };
        Self { time_offset_s, time_offset_estimate: None, mount, drift_m: None, range_bias_m: None }
    }

    /// The last estimate of the time offset, if the motion made it observable.
    pub fn observed_time_offset(&self) -> Option<TimeOffset> {
        self.time_offset_estimate.filter(|estimate| estimate.observable)
    }

    /// The range bias of greatest magnitude, metres.
    pub fn greatest_range_bias_m(&self) -> Option<f64> {
        self.range_bias_m.iter().flatten().copied().max_by(|a, b| a.abs().total_cmp(&b.abs()))
    }
}

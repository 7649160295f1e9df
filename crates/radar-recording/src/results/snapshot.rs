//! Snapshot of the results at one moment.

use radar_mapping::{CalibrationInUse, Evidence, Scene};
use radar_sar::geometry::Pose;

/// Snapshot of the results at one moment.
#[derive(Debug, Clone, Copy)]
pub struct Snapshot<'a> {
    /// Its time: that of the newest processed event, host nanoseconds.
    pub time_ns: i64,
    /// Newest pose of the head, `tracking_from_head`.
    pub head: Option<Pose>,
    /// The detected objects.
    pub scene: &'a Scene,
    /// The evidence, by voxel.
    pub evidence: &'a Evidence,
    /// End of the newest sweep in the evidence, host nanoseconds.
    pub evidence_ns: Option<i64>,
    /// What sweeps and poses are corrected by.
    pub calibration: &'a CalibrationInUse,
    /// Counters since the start.
    pub counted: ResultsCounters,
}

/// Counters since the start.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ResultsCounters {
    /// Frames used.
    pub frames: u64,
    /// Sweeps imaged.
    pub sweeps: u64,
    /// Poses used.
    pub poses: u64,
    /// Frames skipped.
    pub frames_left_out: u64,
    /// Sweeps skipped.
    pub sweeps_left_out: u64,
    /// Poses not used.
    pub poses_left_out: u64,
    /// Updates of the map.
    pub updates: u64,
    /// Confirmed objects removed from the map.
    pub removed: u64,
}

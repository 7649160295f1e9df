//! Snapshot of the results at one moment.

use radar_mapping::{Evidence, MountInUse, Scene};
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
    /// Time offset in use, seconds: time of a sweep's pose minus time of the sweep.
    pub time_offset_s: f64,
    /// Time offset estimated from the data.
    pub estimate: Option<OffsetEstimate>,
    /// The mount in use, with its last estimate.
    pub mount: Option<MountInUse>,
    /// Slow tracking error in each axis as estimated, rms, metres.
    pub drift_m: Option<f64>,
    /// Counters since the start.
    pub counted: ResultsCounters,
}

/// Estimate of the time offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffsetEstimate {
    /// The offset, seconds.
    pub offset_s: f64,
    /// Its 1σ, seconds.
    pub sigma_s: f64,
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

//! What is known at one moment, as it is handed over: plain data.

use radar_mapping::{Evidence, Scene};
use radar_sar::geometry::Pose;

/// What is known at one moment.
#[derive(Debug, Clone, Copy)]
pub struct Snapshot<'a> {
    /// When it is known, host nanoseconds: the time of the newest event that was worked off.
    pub time_ns: i64,
    /// Newest pose of the head, `tracking_from_head`.
    pub head: Option<Pose>,
    /// What stands in the room.
    pub scene: &'a Scene,
    /// Where there is evidence.
    pub evidence: &'a Evidence,
    /// End of the newest sweep that it rests on, host nanoseconds.
    pub evidence_ns: Option<i64>,
    /// Time of a sweep's pose minus time of the sweep, as it is in force, seconds.
    pub time_offset_s: f64,
    /// The same as the data tell it.
    pub estimate: Option<OffsetEstimate>,
    /// What was taken and left out since the beginning.
    pub counted: ResultsCounters,
}

/// The time offset as the data tell it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffsetEstimate {
    /// Seconds.
    pub offset_s: f64,
    /// Its 1σ, seconds.
    pub sigma_s: f64,
}

/// What was taken and left out since the beginning.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ResultsCounters {
    /// Frames taken in.
    pub frames: u64,
    /// Sweeps imaged.
    pub sweeps: u64,
    /// Poses taken in.
    pub poses: u64,
    /// Frames skipped.
    pub frames_left_out: u64,
    /// Sweeps skipped.
    pub sweeps_left_out: u64,
    /// Poses not used.
    pub poses_left_out: u64,
    /// Looks at the evidence.
    pub updates: u64,
    /// Confirmed places that were forgotten.
    pub removed: u64,
}

//! A tracked head pose as received, and why some are refused.

use serde::{Deserialize, Serialize};

use crate::geometry::{Pose, PoseError};

/// The tracking system's state for a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrackingResult {
    /// Running and within its range.
    Ok,
    /// Running, but out of range: the pose is a guess.
    OutOfRange,
    /// Only the rotation is tracked.
    RotationOnly,
    /// Still initialising, or not tracking at all.
    NotTracking,
}

/// A pose as the tracking system gave it, valid or not. Recordings keep it as it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseSample {
    /// Host's monotonic clock, nanoseconds.
    pub time_ns: i64,
    /// Position of the head in the tracking frame, metres.
    pub position_m: [f64; 3],
    /// Rotation `tracking_from_head` as x, y, z, w.
    pub quaternion_xyzw: [f64; 4],
    /// The system marks the pose valid.
    pub valid: bool,
    /// The system's state.
    pub result: TrackingResult,
}

/// Why a pose is not used. A recording keeps it all the same.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PoseRefusal {
    /// Marked invalid by the system.
    #[error("the tracking system calls the pose invalid")]
    Invalid,
    /// Valid, but out of range, rotation only, or not tracking.
    #[error("the tracking result is {0:?}")]
    Result(TrackingResult),
    /// Numbers that make no pose.
    #[error(transparent)]
    Numbers(#[from] PoseError),
    /// Not later than the pose before it.
    #[error("time {time_ns} ns is not after {before_ns} ns, the pose before it")]
    TimeNotRising {
        /// Its time.
        time_ns: i64,
        /// The time of the pose before.
        before_ns: i64,
    },
}

impl PoseSample {
    /// A valid pose.
    pub fn valid(time_ns: i64, pose: &Pose) -> Self {
        Self {
            time_ns,
            position_m: pose.translation.to_array(),
            quaternion_xyzw: pose.rotation.to_array(),
            valid: true,
            result: TrackingResult::Ok,
        }
    }

    /// `tracking_from_head`, when everything about it is valid.
    ///
    /// # Errors
    /// Marked invalid, not tracking fully, or numbers that make no pose.
    pub fn tracking_from_head(&self) -> Result<Pose, PoseRefusal> {
        if !self.valid {
            return Err(PoseRefusal::Invalid);
        }
        if self.result != TrackingResult::Ok {
            return Err(PoseRefusal::Result(self.result));
        }
        Ok(Pose::try_new(self.position_m, self.quaternion_xyzw)?)
    }
}

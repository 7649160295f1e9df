//! What became of an input.

use radar_sar::PoseRefusal;

/// An input that was accepted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Accepted {
    /// Sweeps that got their pose with this input and were handed to the search.
    pub observations: usize,
}

/// Why an input was left out. Nothing of it reaches the map; each reason is also counted in
/// [`ObserverCounters`](super::ObserverCounters).
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// The frame is not as long as configured.
    #[error("frame has {samples} samples, the configuration gives {expected}")]
    FrameLength {
        /// Samples in the frame.
        samples: usize,
        /// Samples in a frame of the configuration.
        expected: usize,
    },
    /// A sample hit the converter's limit.
    #[error("frame at {0} ns is saturated")]
    FrameSaturated(i64),
    /// The frame is not later than the one before.
    #[error("frame at {0} ns is not later than the one before")]
    FrameTimeNotRising(i64),
    /// The frame is far ahead of the one before, and no other confirms it yet.
    #[error("frame at {0} ns is far ahead of the one before")]
    FrameTimeLeapt(i64),
    /// The pose is invalid, its numbers are not finite, or it is not later than the one before.
    #[error("pose: {0}")]
    Pose(#[from] PoseRefusal),
    /// The pose is not later than the one before.
    #[error("pose at {0} ns is not later than the one before")]
    PoseTimeNotRising(i64),
    /// The pose is far ahead of the one before, and no other confirms it yet.
    #[error("pose at {0} ns is far ahead of the one before")]
    PoseTimeLeapt(i64),
}

//! The player at one time.

use glam::DVec3;

use radar_sar::geometry::Pose;

/// The player at one time, in the tracking frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wearer {
    /// When, host nanoseconds.
    pub time_ns: i64,
    /// Where the head is.
    pub tracking_from_head: Pose,
    /// Where the left and the right hand are, metres; `None` for one that is not tracked.
    pub hands_m: [Option<DVec3>; 2],
}

impl Wearer {
    /// A player of whom the head alone is tracked.
    pub fn head_only(time_ns: i64, tracking_from_head: Pose) -> Self {
        Self { time_ns, tracking_from_head, hands_m: [None; 2] }
    }
}

/// A part of the player's body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum BodyPart {
    /// Head and neck.
    Head,
    /// From below the head to the floor.
    Torso,
    /// Left hand and arm.
    LeftHand,
    /// Right hand and arm.
    RightHand,
}

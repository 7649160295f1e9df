//! The wearer of the headset at one time.

use glam::DVec3;

use radar_sar::geometry::Pose;

/// The wearer of the headset at one time, in the tracking frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wearer {
    /// Time, host nanoseconds.
    pub time_ns: i64,
    /// Pose of the head.
    pub tracking_from_head: Pose,
    /// Positions of the left and the right hand, metres; `None` for an untracked hand.
    pub hands_m: [Option<DVec3>; 2],
}

impl Wearer {
    /// A wearer of whom only the head is tracked.
    pub fn head_only(time_ns: i64, tracking_from_head: Pose) -> Self {
        Self { time_ns, tracking_from_head, hands_m: [None; 2] }
    }
}

/// A part of the wearer's body.
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

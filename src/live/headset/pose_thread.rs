//! Poses between frames: the radar's sweeps come a thousand times a second, and a head's path is known the better the more often it is
//! asked for. A thread of its own, since the frame loop sleeps in the runtime meanwhile.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use super::frames::PoseSink;
use super::samples::{poses_now, sample};
use crate::live::now_ns;
use crate::openvr::{Hands, Runtime};
use radar_sar::geometry::Pose;

/// Where the room lies, as other threads need it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RoomFrame {
    /// Turns poses of the raw universe into the session's.
    pub session_from_raw: Pose,
    /// Where the standing universe is now.
    pub standing_from_raw: Pose,
    /// The tracking system's name for the room.
    pub universe: Option<u64>,
    /// Times that the raw universe has leapt.
    pub leaps: u64,
    /// Times that the user wanted the map to begin anew.
    pub map_resets: u64,
}

/// For other threads; `None` before the session's frame is laid.
pub(super) type SharedFrame = Mutex<Option<RoomFrame>>;

/// Reads the head's pose so many times a second until told to stop. A pose that took too long to read is left out, and so is every
/// pose before the session's frame is known.
pub(super) fn read_poses(runtime: &Runtime, frame: &SharedFrame, rate_hz: f64, sink: PoseSink, stop: &AtomicBool) {
    let period_ns = (1e9 / rate_hz) as i64;
    let mut next_ns = now_ns();
    while !stop.load(Ordering::Relaxed) {
        let wait_ns = next_ns.saturating_sub(now_ns());
        if wait_ns > 0 {
            std::thread::sleep(Duration::from_nanos(wait_ns as u64));
        }
        // Where this thread was put aside for long, there is nothing to catch up with.
        next_ns = (next_ns + period_ns).max(now_ns());
        // Held until the pose has gone on: nobody lays the frame anew in between.
        let frame = frame.lock().unwrap_or_else(PoisonError::into_inner);
        if let (Some(frame), Some((time_ns, poses))) = (&*frame, poses_now(runtime, Hands::NONE)) {
            sink(&sample(time_ns, &poses.head, &frame.session_from_raw));
        }
    }
}

//! Reads poses between frames: the radar measures about a thousand sweeps a second, and more poses
//! give a more accurate path of the head. Runs in its own thread, because the frame loop sleeps in
//! the runtime meanwhile.

use radar_mapping::Event;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use super::samples::{poses_now, sample};
use super::status::EventSink;
use crate::app::now_ns;
use crate::openvr::{Hands, Runtime};
use radar_sar::geometry::Pose;

/// The tracking frames, as other threads need them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RoomFrame {
    /// Transforms poses of the raw universe into the session frame.
    pub session_from_raw: Pose,
    /// Transforms poses of the raw universe into the current standing universe.
    pub standing_from_raw: Pose,
    /// The tracking system's id of the room.
    pub universe: Option<u64>,
    /// How often the raw universe has leapt.
    pub leaps: u64,
    /// How often the user requested a map reset.
    pub map_resets: u64,
}

/// Shared with other threads; `None` before the session frame is defined.
pub(super) type SharedFrame = Mutex<Option<RoomFrame>>;

/// Reads head poses at this rate until asked to stop. Skips poses that took too long to read, and
/// all poses before the session frame is defined.
pub(super) fn read_poses(runtime: &Runtime, frame: &SharedFrame, rate_hz: f64, sink: EventSink, stop: &AtomicBool) {
    let period_ns = (1e9 / rate_hz) as i64;
    let mut next_ns = now_ns();
    while !stop.load(Ordering::Relaxed) {
        let wait_ns = next_ns.saturating_sub(now_ns());
        if wait_ns > 0 {
            std::thread::sleep(Duration::from_nanos(wait_ns as u64));
        }
        // After a long preemption, missed reads are not made up.
        next_ns = (next_ns + period_ns).max(now_ns());
        // Held until the pose has been pushed, so that nobody changes the frame in between.
        let frame = frame.lock().unwrap_or_else(PoisonError::into_inner);
        if let (Some(frame), Some((time_ns, poses))) = (&*frame, poses_now(runtime, Hands::NONE)) {
            sink(Event::Pose(sample(time_ns, &poses.head, &frame.session_from_raw)));
        }
    }
}

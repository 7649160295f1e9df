//! Samples poses: for the radar the current head pose with its time, not the one predicted for
//! display; for the warnings the wearer as predicted for display.

use crate::app::now_ns;
use crate::openvr::{DevicePose, Hands, Poses, Runtime, TrackingState, Universe};
use crate::warning::Wearer;
use radar_mapping::HandsSample;
use radar_sar::PoseSample;
use radar_sar::TrackingResult;
use radar_sar::geometry::Pose;

/// A call that took longer was interrupted, so the time of its pose is unknown, nanoseconds.
/// Choice: a call takes microseconds, and half of this at a hand's 2 m/s is a millimetre.
const MAX_CALL_NS: i64 = 1_000_000;

/// Poses and their time, host nanoseconds; `None` when the time is unknown.
pub(super) fn poses_now(runtime: &Runtime, hands: Hands) -> Option<(i64, Poses)> {
    let start_ns = now_ns();
    let poses = runtime.poses(Universe::Raw, 0.0, hands);
    let took_ns = now_ns() - start_ns;
    (took_ns <= MAX_CALL_NS).then_some((start_ns + took_ns / 2, poses))
}

/// The head's sample in the session frame.
pub(super) fn sample(time_ns: i64, head: &DevicePose, session_from_raw: &Pose) -> PoseSample {
    let result = match head.state {
        TrackingState::Ok => TrackingResult::Ok,
        TrackingState::OutOfRange => TrackingResult::OutOfRange,
        TrackingState::RotationOnly => TrackingResult::RotationOnly,
        TrackingState::NotTracking => TrackingResult::NotTracking,
    };
    let pose = head.pose.map_or(Pose::IDENTITY, |raw_from_head| *session_from_raw * raw_from_head);
    // Invalid numbers count as no pose.
    let valid = head.connected && head.valid && head.pose.is_some();
    PoseSample { valid, result, ..PoseSample::valid(time_ns, &pose) }
}

/// Samples hand positions. Without controllers there are no samples; the loss of the last
/// controller gives one.
#[derive(Debug, Default)]
pub(super) struct HandSampler {
    had_some: bool,
    last_ns: Option<i64>,
}

/// Least interval of hand samples, nanoseconds. Choice: the interval at which the mapper keeps
/// them.
const HAND_INTERVAL_NS: i64 = 10_000_000;

impl HandSampler {
    /// Positions of the tracked hands in the session frame; `None` when no sample is due.
    pub fn next(&mut self, time_ns: i64, poses: &Poses, session_from_raw: &Pose) -> Option<HandsSample> {
        if self.last_ns.is_some_and(|last_ns| (0..HAND_INTERVAL_NS).contains(&time_ns.saturating_sub(last_ns))) {
            return None;
        }
        let position =
            |hand: &DevicePose| hand.valid_pose().map(|pose| session_from_raw.transform_point(pose.translation));
        let hands_m = [position(&poses.hands[0]), position(&poses.hands[1])];
        let has_some = hands_m.iter().any(Option::is_some);
        let had_some = std::mem::replace(&mut self.had_some, has_some);
        if !has_some && !had_some {
            return None;
        }
        self.last_ns = Some(time_ns);
        Some(HandsSample { time_ns, hands_m })
    }
}

/// The wearer in the standing universe: the head pose given, and the hands that are tracked.
pub(super) fn wearer(time_ns: i64, standing_from_head: Pose, poses: &Poses, raw_from_standing: &Pose) -> Wearer {
    let standing_from_raw = raw_from_standing.inverse();
    let position =
        |hand: &DevicePose| hand.valid_pose().map(|pose| standing_from_raw.transform_point(pose.translation));
    Wearer {
        time_ns,
        tracking_from_head: standing_from_head,
        hands_m: [position(&poses.hands[0]), position(&poses.hands[1])],
    }
}

//! Poses as messages of the Foxglove schemas, so that Foxglove and Rerun can show a recording.

use foxglove::messages::{FrameTransform, Pose as FoxglovePose, PoseInFrame, Quaternion, Timestamp, Vector3};
use glam::{DQuat, DVec3};

use radar_sar::geometry::Pose;

/// Names of the frames in Foxglove.
pub(super) const TRACKING: &str = "tracking";
pub(super) const HEAD: &str = "head";
pub(super) const SENSOR: &str = "sensor";

/// Pose of the head.
pub(super) fn head_transform(time_ns: i64, tracking_from_head: &Pose) -> FrameTransform {
    transform(time_ns, TRACKING, HEAD, tracking_from_head)
}

/// Pose of the sensor on the head (mount).
pub(super) fn mount_transform(time_ns: i64, head_from_sensor: &Pose) -> FrameTransform {
    transform(time_ns, HEAD, SENSOR, head_from_sensor)
}

/// Position of a hand; its rotation is not recorded.
pub(super) fn hand_pose(time_ns: i64, position_m: DVec3) -> PoseInFrame {
    PoseInFrame {
        timestamp: Some(timestamp(time_ns)),
        frame_id: TRACKING.to_owned(),
        pose: Some(foxglove_pose(&Pose::from_translation(position_m))),
    }
}

/// Pose of the child frame in the parent frame.
pub(super) fn transform(time_ns: i64, parent: &str, child: &str, parent_from_child: &Pose) -> FrameTransform {
    FrameTransform {
        timestamp: Some(timestamp(time_ns)),
        parent_frame_id: parent.to_owned(),
        child_frame_id: child.to_owned(),
        translation: Some(vector(parent_from_child.translation)),
        rotation: Some(quaternion(parent_from_child.rotation)),
    }
}

pub(super) fn foxglove_pose(pose: &Pose) -> FoxglovePose {
    FoxglovePose { position: Some(vector(pose.translation)), orientation: Some(quaternion(pose.rotation)) }
}

pub(super) fn vector(v: DVec3) -> Vector3 {
    Vector3 { x: v.x, y: v.y, z: v.z }
}

fn quaternion(q: DQuat) -> Quaternion {
    Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }
}

/// Converts a time. Foxglove's times start at 0 and have 32-bit seconds; times outside are clamped.
pub(super) fn timestamp(time_ns: i64) -> Timestamp {
    let time_ns = time_ns.max(0);
    match u32::try_from(time_ns / 1_000_000_000) {
        Ok(seconds) => Timestamp::new(seconds, (time_ns % 1_000_000_000) as u32),
        Err(_) => Timestamp::MAX,
    }
}

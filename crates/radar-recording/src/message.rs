//! Frames, poses and hands as protobuf messages, exact to the bit in both directions.

use num_complex::Complex;
use prost::Message;

use glam::DVec3;

use a121::Frame;
use radar_mapping::HandsSample;
use radar_sar::PoseSample;
use radar_sar::TrackingResult;

/// Types generated from proto/radar_chaperone.proto.
mod wire {
    #![allow(clippy::all, missing_docs)]
    include!(concat!(env!("OUT_DIR"), "/radar_chaperone.rs"));
}

/// Compiled descriptors of proto/radar_chaperone.proto: schema data of its messages.
pub(super) const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/radar_chaperone.descriptors"));
/// Channel ids that every recording has.
pub(super) const FRAME_CHANNEL: u16 = 1;
pub(super) const POSE_CHANNEL: u16 = 2;
pub(super) const HEAD_CHANNEL: u16 = 3;
pub(super) const MOUNT_CHANNEL: u16 = 4;
/// Channel ids that only recordings with hands have.
pub(super) const HANDS_CHANNEL: u16 = 7;
pub(super) const HAND_CHANNELS: [u16; 2] = [8, 9];
/// Encoding of all messages.
pub(super) const MESSAGE_ENCODING: &str = "protobuf";
/// Topic and schema of frames.
pub(super) const FRAME_TOPIC: &str = "/radar/frame";
pub(super) const FRAME_SCHEMA: &str = "radar_chaperone.Frame";
/// Topic and schema of raw poses.
pub(super) const POSE_TOPIC: &str = "/tracking/head_raw";
pub(super) const POSE_SCHEMA: &str = "radar_chaperone.TrackedPose";

/// Topic and schema of raw hands.
pub(super) const HANDS_TOPIC: &str = "/tracking/hands_raw";
pub(super) const HANDS_SCHEMA: &str = "radar_chaperone.TrackedHands";

/// Most points of a frame. Physics: the sensor's buffer holds 4095 (data sheet, "Limitations"); what claims more is no frame.
const MAX_FRAME_POINTS: usize = 4095;

pub(super) fn encode_frame(frame: &Frame) -> Vec<u8> {
    let sample_bytes = |s: &Complex<i16>| {
        let ([a, b], [c, d]) = (s.re.to_le_bytes(), s.im.to_le_bytes());
        [a, b, c, d]
    };
    wire::Frame {
        tick: frame.tick,
        host_time_ns: frame.host_time_ns,
        temperature_c: frame.temperature_c.into(),
        data_saturated: frame.data_saturated,
        frame_delayed: frame.frame_delayed,
        calibration_needed: frame.calibration_needed,
        samples: frame.samples.iter().flat_map(sample_bytes).collect(),
    }
    .encode_to_vec()
}

/// Decodes a frame, or returns why the bytes are not a frame.
pub(super) fn decode_frame(bytes: &[u8]) -> Result<Frame, String> {
    let message = wire::Frame::decode(bytes).map_err(|error| format!("a frame is not a protobuf message ({error})"))?;
    let (points, rest) = message.samples.as_chunks::<4>();
    if !rest.is_empty() {
        return Err(format!("a frame has {} bytes of samples, not a multiple of 4", message.samples.len()));
    }
    if points.len() > MAX_FRAME_POINTS {
        return Err(format!("a frame has {} points, more than the sensor's {MAX_FRAME_POINTS}", points.len()));
    }
    let temperature_c = i16::try_from(message.temperature_c)
        .map_err(|_| format!("a frame has a temperature of {} °C", message.temperature_c))?;
    Ok(Frame {
        tick: message.tick,
        host_time_ns: message.host_time_ns,
        temperature_c,
        data_saturated: message.data_saturated,
        frame_delayed: message.frame_delayed,
        calibration_needed: message.calibration_needed,
        samples: points.iter().map(|&p| complex_from_le_bytes(p)).collect(),
    })
}

/// A sample from int16 real, int16 imaginary, little-endian.
pub(super) fn complex_from_le_bytes([a, b, c, d]: [u8; 4]) -> Complex<i16> {
    Complex::new(i16::from_le_bytes([a, b]), i16::from_le_bytes([c, d]))
}

pub(super) fn encode_pose(pose: &PoseSample) -> Vec<u8> {
    let result = match pose.result {
        TrackingResult::Ok => wire::TrackingResult::Ok,
        TrackingResult::OutOfRange => wire::TrackingResult::OutOfRange,
        TrackingResult::RotationOnly => wire::TrackingResult::RotationOnly,
        TrackingResult::NotTracking => wire::TrackingResult::NotTracking,
    };
    wire::TrackedPose {
        time_ns: pose.time_ns,
        position_m: pose.position_m.to_vec(),
        quaternion_xyzw: pose.quaternion_xyzw.to_vec(),
        valid: pose.valid,
        result: result.into(),
    }
    .encode_to_vec()
}

/// Decodes a pose, or returns why the bytes are not a pose.
pub(super) fn decode_pose(bytes: &[u8]) -> Result<PoseSample, String> {
    let message =
        wire::TrackedPose::decode(bytes).map_err(|error| format!("a pose is not a protobuf message ({error})"))?;
    let lengths = (message.position_m.len(), message.quaternion_xyzw.len());
    let (Ok(position_m), Ok(quaternion_xyzw)) = (message.position_m.try_into(), message.quaternion_xyzw.try_into())
    else {
        return Err(format!("a pose has {} position and {} quaternion numbers, not 3 and 4", lengths.0, lengths.1));
    };
    let result = match wire::TrackingResult::try_from(message.result) {
        Ok(wire::TrackingResult::Ok) => TrackingResult::Ok,
        Ok(wire::TrackingResult::OutOfRange) => TrackingResult::OutOfRange,
        Ok(wire::TrackingResult::RotationOnly) => TrackingResult::RotationOnly,
        Ok(wire::TrackingResult::NotTracking) => TrackingResult::NotTracking,
        Ok(wire::TrackingResult::Unspecified) | Err(_) => {
            return Err(format!("a pose has the unknown tracking result {}", message.result));
        }
    };
    Ok(PoseSample { time_ns: message.time_ns, position_m, quaternion_xyzw, valid: message.valid, result })
}

/// Encodes hands; a position that is not finite counts as not tracked.
pub(super) fn encode_hands(hands: &HandsSample) -> Vec<u8> {
    let numbers =
        |hand: Option<DVec3>| hand.filter(|position| position.is_finite()).map_or(vec![], |p| p.to_array().to_vec());
    let [left_m, right_m] = hands.hands_m.map(numbers);
    wire::TrackedHands { time_ns: hands.time_ns, left_m, right_m }.encode_to_vec()
}

/// Decodes hands, or returns why the bytes are not hands.
pub(super) fn decode_hands(bytes: &[u8]) -> Result<HandsSample, String> {
    let message =
        wire::TrackedHands::decode(bytes).map_err(|error| format!("hands are not a protobuf message ({error})"))?;
    let position = |numbers: &[f64]| match numbers {
        [] => Ok(None),
        &[x, y, z] if [x, y, z].iter().all(|v| v.is_finite()) => Ok(Some(DVec3::new(x, y, z))),
        _ => Err(format!("a hand has the position {numbers:?}, not three numbers or none")),
    };
    Ok(HandsSample { time_ns: message.time_ns, hands_m: [position(&message.left_m)?, position(&message.right_m)?] })
}

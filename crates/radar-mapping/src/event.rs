//! Inputs of the mapper, and how separate streams become one in order of time.

use a121::Frame;
use glam::DVec3;
use radar_sar::PoseSample;

use super::HandsSample;

/// An input of the mapper, or of a recording.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// A raw frame of the sensor.
    Frame(Frame),
    /// A raw pose of the head, valid or not.
    Pose(PoseSample),
    /// Positions of the wearer's hands.
    Hands(HandsSample),
}

impl Event {
    /// Time on the host's monotonic clock, nanoseconds: the end of a frame, the time of a pose or
    /// of hands.
    pub fn time_ns(&self) -> i64 {
        match self {
            Self::Frame(frame) => frame.host_time_ns,
            Self::Pose(pose) => pose.time_ns,
            Self::Hands(hands) => hands.time_ns,
        }
    }

    /// Hands at a time, tracking frame, metres; `None` for an untracked one.
    pub fn hands(time_ns: i64, hands_m: [Option<DVec3>; 2]) -> Self {
        Self::Hands(HandsSample { time_ns, hands_m })
    }
}

/// Frames and poses as one stream in order of time, a pose before a frame of the same time. Each
/// stream keeps its own order even if its times run backwards.
pub fn in_time_order(
    frames: impl IntoIterator<Item = Frame>,
    poses: impl IntoIterator<Item = PoseSample>,
) -> impl Iterator<Item = Event> {
    let (mut frames, mut poses) = (frames.into_iter().peekable(), poses.into_iter().peekable());
    std::iter::from_fn(move || {
        let next_frame_ns = frames.peek().map(|frame| frame.host_time_ns);
        let is_due = |pose: &PoseSample| next_frame_ns.is_none_or(|frame_ns| pose.time_ns <= frame_ns);
        poses.next_if(is_due).map(Event::Pose).or_else(|| frames.next().map(Event::Frame))
    })
}

#[cfg(test)]
mod tests {
    use a121::preset;
    use radar_sar::geometry::Pose;

    use super::*;

    #[test]
    fn poses_precede_frames_of_the_same_time_and_nothing_is_lost() {
        let points = preset("d16").unwrap().points_per_frame();
        let frame = |host_time_ns: i64| Frame {
            tick: host_time_ns,
            host_time_ns,
            temperature_c: 30,
            data_saturated: false,
            frame_delayed: false,
            calibration_needed: false,
            samples: vec![num_complex::Complex::new(0, 0); points],
        };
        let pose = |time_ns: i64| PoseSample::valid(time_ns, &Pose::IDENTITY);
        let events = in_time_order([1, 3, 9].map(frame), [2, 3, 4].map(pose));
        let order: Vec<(bool, i64)> = events.map(|event| (matches!(event, Event::Frame(_)), event.time_ns())).collect();
        let expected = [(true, 1), (false, 2), (false, 3), (true, 3), (false, 4), (true, 9)];
        assert_eq!(order, expected);
    }
}

//! Inputs of the mapper, and how separate streams become one in order of time.

use std::collections::VecDeque;

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
/// stream keeps its own order even if its times run backwards. A single time that leaps ahead does not hold back what follows it.
pub fn in_time_order(
    frames: impl IntoIterator<Item = Frame>,
    poses: impl IntoIterator<Item = PoseSample>,
) -> impl Iterator<Item = Event> {
    let mut frames = Sequence::new(frames.into_iter(), |frame: &Frame| frame.host_time_ns);
    let mut poses = Sequence::new(poses.into_iter(), |pose: &PoseSample| pose.time_ns);
    std::iter::from_fn(move || {
        let pose_is_due = match (poses.due_ns(), frames.due_ns()) {
            (Some(pose_ns), Some(frame_ns)) => pose_ns <= frame_ns,
            (pose_ns, _) => pose_ns.is_some(),
        };
        if pose_is_due { poses.take().map(Event::Pose) } else { frames.take().map(Event::Frame) }
    })
}

/// How far a sequence is looked ahead. Choice: more wrong times in a row than a lossy line gives.
const LOOK_AHEAD: usize = 16;

/// One stream in its own order, with what comes next.
struct Sequence<I: Iterator> {
    rest: I,
    next: VecDeque<I::Item>,
    time_ns: fn(&I::Item) -> i64,
}

impl<I: Iterator> Sequence<I> {
    fn new(rest: I, time_ns: fn(&I::Item) -> i64) -> Self {
        Self { rest, next: VecDeque::new(), time_ns }
    }

    /// When the next item is due: at its time, or as soon as something that follows it.
    fn due_ns(&mut self) -> Option<i64> {
        let missing = LOOK_AHEAD.saturating_sub(self.next.len());
        self.next.extend(self.rest.by_ref().take(missing));
        self.next.iter().map(self.time_ns).min()
    }

    fn take(&mut self) -> Option<I::Item> {
        self.next.pop_front()
    }
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
        // Times that leap ahead, or back.
        for wrong in [1_000, -1_000, i64::MAX, i64::MIN] {
            for of_pose in [true, false] {
                let leap = |n: i64, leaps: bool| if leaps && n == 20 { wrong } else { 10 * n };
                let frames = (0..100).map(|n| frame(leap(n, !of_pose)));
                let poses: Vec<PoseSample> = (0..100).map(|n| pose(leap(n, of_pose))).collect();
                let events: Vec<Event> = in_time_order(frames, poses).collect();
                assert_eq!(events.len(), 200);
                for (at, event) in events.iter().enumerate().filter(|(_, event)| event.time_ns() != wrong) {
                    assert!((event.time_ns() / 10 - at as i64 / 2).abs() <= 16, "{wrong}: {at} is {}", event.time_ns());
                }
            }
        }
    }
}

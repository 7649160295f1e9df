//! Endless scenario: samples of a frame at any time, and the tracked poses in order.
//!
//! A motion has the scenario's length, so memory is bounded. After its end it runs backwards, then
//! forwards again, and so on. Before time 0 nothing moves.

use num_complex::Complex;

use super::scenario::PreparedScenario;
use super::tracker::Tracker;
use a121::{SensorConfig, frame_timing};
use radar_sar::geometry::Pose;

/// An endless scenario.
#[derive(Debug, Clone)]
pub struct LiveScenario {
    prepared: PreparedScenario,
    tracker: Tracker,
    poses: u64,
}

impl LiveScenario {
    pub(super) fn new(prepared: PreparedScenario) -> Self {
        let tracker = Tracker::new(prepared.scenario.errors, prepared.scenario.seed);
        Self { prepared, tracker, poses: 0 }
    }

    /// Appends the samples of a frame of a valid configuration whose measurement ends at `end_s`,
    /// seconds; returns whether a sample saturated. Each frame number has its own noise.
    pub fn frame(&self, config: &SensorConfig, number: u64, end_s: f64, samples: &mut Vec<Complex<i16>>) -> bool {
        let start_s = end_s - frame_timing(config).frame_s;
        let sensor_at = |t: f64| self.prepared.sensor_at(self.path_time_s(t));
        let sensor = self.prepared.sensor_model(config);
        self.prepared.frame(config, &sensor, (number, start_s), sensor_at, samples)
    }

    /// Time of the next pose, seconds.
    pub fn next_pose_s(&self) -> f64 {
        self.poses as f64 / self.prepared.scenario.errors.rate_hz
    }

    /// The next tracked pose, `tracking_from_head`, with its stamped time, seconds; `None` if tracking
    /// is lost.
    pub fn next_pose(&mut self) -> Option<(f64, Pose)> {
        let time_s = self.next_pose_s();
        let pose = self.prepared.head_at(self.path_time_s(time_s));
        self.poses += 1;
        let measured = self.tracker.measure(time_s, &pose);
        measured.is_valid.then_some((time_s + measured.stamp_error_s, measured.tracking_from_head))
    }

    /// Time on the scenario's path, seconds: at rest before the start, then forwards and backwards
    /// in turn.
    fn path_time_s(&self, time_s: f64) -> f64 {
        let length_s = self.prepared.scenario.duration_s;
        if time_s <= length_s {
            return time_s.max(0.0);
        }
        let within_s = time_s.rem_euclid(2.0 * length_s);
        within_s.min(2.0 * length_s - within_s)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Scenario;
    use a121::{frame_timing, preset};

    #[test]
    fn live_frames_match_a_recording_and_continue_after_its_end() {
        let config = preset("d16").unwrap();
        let scenario = Scenario::new("furnished-room", "natural", config.clone(), 0.5, 7);
        let recorded = scenario.run().unwrap();
        let mut live = scenario.live().unwrap();
        let timing = frame_timing(&config);
        for index in [0, 9, 30] {
            let mut samples = Vec::new();
            let end_s = index as f64 * timing.frame_period_s + timing.frame_s;
            live.frame(&config, index, end_s, &mut samples);
            // Rounding of times changes a sample by one step at most.
            let differ = samples.iter().zip(&recorded.frames[index as usize].samples).filter(|(a, b)| a != b).count();
            assert!(samples.len() == 800 && differ < 8, "{differ}");
        }
        let (_, mut before) = live.next_pose().unwrap();
        for _ in 0..600 {
            assert!(live.next_pose_s() < 6.0);
            let (_, pose) = live.next_pose().unwrap();
            assert!(pose.translation.distance(before.translation) < 0.03);
            before = pose;
        }
        let mut samples = Vec::new();
        live.frame(&config, 1, 1e6, &mut samples);
        assert_eq!(samples.len(), 800);
    }
}

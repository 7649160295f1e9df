//! The sensor's path for a corrected mount.

use glam::{DMat3, DVec3};

use crate::geometry::Pose;

/// Samples farther apart than this are not joined, nanoseconds. Choice: the path is sampled every 5 ms where it is known; a
/// missing sample is a pause, or a jump of the tracking frame.
const MAX_STEP_NS: i64 = 7_500_000;
/// Unsteadiness is that of the sensor, and by rotation that of the points this far along its axes, metres. Choice: a head's radius,
/// farther than a mount is wrong.
const LEVER_M: f64 = 0.1;

/// The sensor at a time.
#[derive(Debug, Clone, Copy)]
pub(super) struct PathState {
    pub position_m: DVec3,
    pub velocity_m_per_s: DVec3,
    /// `tracking_from_sensor`'s rotation.
    pub tracking_from_sensor: DMat3,
}

/// Greatest distances of the sensor, or by rotation of a point [`LEVER_M`] from it, from where they would be.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Unsteadiness {
    /// Had the sensor stayed where it was first, metres.
    pub from_rest_m: f64,
    /// Had it gone straight to where it was last, at constant speed and without turning, metres.
    pub from_uniform_m: f64,
}

#[derive(Debug, Clone, Copy)]
struct Sample {
    time_ns: i64,
    state: PathState,
}

/// States of the sensor in rising time; cubic between neighbours, undefined across a gap.
#[derive(Debug, Clone, Default)]
pub(super) struct SensorPath {
    samples: Vec<Sample>,
}

impl SensorPath {
    /// Adds the next sample; ignored unless it is later than the last one and finite.
    pub fn push(&mut self, time_ns: i64, sensor: &Pose, velocity_m_per_s: DVec3) {
        let rises = self.samples.last().is_none_or(|last| time_ns > last.time_ns);
        let tracking_from_sensor = DMat3::from_quat(sensor.rotation);
        if rises && sensor.translation.is_finite() && tracking_from_sensor.is_finite() && velocity_m_per_s.is_finite() {
            let state = PathState { position_m: sensor.translation, velocity_m_per_s, tracking_from_sensor };
            self.samples.push(Sample { time_ns, state });
        }
    }

    /// Time of the newest sample.
    pub fn end_ns(&self) -> Option<i64> {
        self.samples.last().map(|s| s.time_ns)
    }

    /// Removes older samples.
    pub fn forget_before(&mut self, time_ns: i64) {
        let old = self.samples.partition_point(|s| s.time_ns < time_ns);
        self.samples.drain(..old);
    }

    /// First and last times of the stretches without a gap that overlap a span.
    pub fn stretches(&self, from_ns: i64, to_ns: i64) -> Vec<(i64, i64)> {
        let first = self.samples.partition_point(|s| s.time_ns < from_ns).saturating_sub(1);
        let end = (self.samples.partition_point(|s| s.time_ns <= to_ns) + 1).min(self.samples.len());
        let stretches = self.samples[first..end.max(first)].chunk_by(|a, b| b.time_ns - a.time_ns <= MAX_STEP_NS);
        stretches.filter_map(|stretch| Some((stretch.first()?.time_ns, stretch.last()?.time_ns))).collect()
    }

    /// Whether the path has no gap from one time to the other.
    pub fn covers(&self, from_ns: i64, to_ns: i64) -> bool {
        let first = self.samples.partition_point(|s| s.time_ns <= from_ns);
        let last = self.samples.partition_point(|s| s.time_ns < to_ns);
        let unbroken = |n: usize| self.samples[n].time_ns - self.samples[n - 1].time_ns <= MAX_STEP_NS;
        first > 0 && last < self.samples.len() && (first..=last).all(unbroken)
    }

    /// By how much the sensor departs from rest, and from uniform motion without rotation, from one time to the other.
    pub fn unsteadiness(&self, from_ns: i64, to_ns: i64) -> Unsteadiness {
        let index = |time_ns: i64| self.samples.partition_point(|s| s.time_ns < time_ns);
        let samples = &self.samples[index(from_ns)..index(to_ns.saturating_add(1))];
        let [Some(first), Some(last)] = [samples.first(), samples.last()] else { return Unsteadiness::default() };
        let (start, way) = (first.state.position_m, last.state.position_m - first.state.position_m);
        let span_ns = (last.time_ns - first.time_ns).max(1) as f64;
        let mut greatest = Unsteadiness::default();
        for Sample { time_ns, state } in samples {
            let turned = state.tracking_from_sensor - first.state.tracking_from_sensor;
            let turned_m = turned.to_cols_array_2d().map(|axis| LEVER_M * DVec3::from_array(axis).length());
            let turned_m = turned_m.into_iter().fold(0.0, f64::max);
            let on_line = start + way * ((time_ns - first.time_ns) as f64 / span_ns);
            greatest.from_rest_m = greatest.from_rest_m.max(state.position_m.distance(start)).max(turned_m);
            greatest.from_uniform_m = greatest.from_uniform_m.max(state.position_m.distance(on_line)).max(turned_m);
        }
        greatest
    }

    /// The path of a point this far from the sensor, metres in the sensor's axes.
    pub fn shifted(&self, shift_m: DVec3) -> Self {
        let lever = |n: usize| self.samples[n].state.tracking_from_sensor * shift_m;
        let shifted = |n: usize| {
            let Sample { time_ns, state } = self.samples[n];
            let (before, after) = (n.saturating_sub(1), (n + 1).min(self.samples.len() - 1));
            let span_ns = self.samples[after].time_ns - self.samples[before].time_ns;
            let turning = (lever(after) - lever(before)) / (span_ns.max(1) as f64 * 1e-9);
            let state = PathState {
                position_m: state.position_m + lever(n),
                velocity_m_per_s: state.velocity_m_per_s + turning,
                ..state
            };
            Sample { time_ns, state }
        };
        Self { samples: (0..self.samples.len()).map(shifted).collect() }
    }

    /// State at a time; `None` outside the path and in gaps.
    pub fn at(&self, time_ns: i64) -> Option<PathState> {
        let later = self.samples.partition_point(|s| s.time_ns < time_ns).max(1);
        let (first, second) = (self.samples.get(later - 1)?, self.samples.get(later)?);
        if second.time_ns - first.time_ns > MAX_STEP_NS || time_ns < first.time_ns {
            return None;
        }
        let (a, b) = (&first.state, &second.state);
        let step_s = (second.time_ns - first.time_ns) as f64 * 1e-9;
        let u = (time_ns - first.time_ns) as f64 * 1e-9 / step_s;
        // Hermite cubic from positions and velocities of both neighbours.
        let (way, from, to) = (b.position_m - a.position_m, a.velocity_m_per_s * step_s, b.velocity_m_per_s * step_s);
        let (c2, c3) = (way * 3.0 - from * 2.0 - to, from + to - way * 2.0);
        Some(PathState {
            position_m: a.position_m + (from + (c2 + c3 * u) * u) * u,
            velocity_m_per_s: (from + (c2 * 2.0 + c3 * (3.0 * u)) * u) / step_s,
            tracking_from_sensor: if u < 0.5 { a.tracking_from_sensor } else { b.tracking_from_sensor },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    const MS: i64 = 1_000_000;

    fn cubic(t: f64) -> (Pose, DVec3) {
        let pose =
            Pose { translation: DVec3::new(t, t * t, 1.0 - t * t * t), rotation: DQuat::from_rotation_y(2.0 * t) };
        (pose, DVec3::new(1.0, 2.0 * t, -3.0 * t * t))
    }

    /// 0.5 s without the samples from 250 to 295 ms.
    fn path() -> SensorPath {
        let mut path = SensorPath::default();
        for n in (0..100).filter(|n| !(50..60).contains(n)) {
            let (pose, velocity) = cubic(n as f64 * 5e-3);
            path.push(n * 5 * MS, &pose, velocity);
        }
        path
    }

    #[test]
    fn cubics_are_followed_and_gaps_are_not_crossed() {
        let path = path();
        for time_ns in [0, 3 * MS, 244 * MS, 301 * MS, 495 * MS] {
            let (state, (pose, velocity)) = (path.at(time_ns).unwrap(), cubic(time_ns as f64 * 1e-9));
            assert!(state.position_m.distance(pose.translation) < 1e-12, "{time_ns}");
            assert!(state.velocity_m_per_s.distance(velocity) < 1e-10, "{time_ns}");
        }
        for outside in [-1, 246 * MS, 299 * MS, 496 * MS] {
            assert!(path.at(outside).is_none());
        }
        assert!(path.covers(0, 245 * MS) && path.covers(301 * MS, 495 * MS));
        assert!(!path.covers(240 * MS, 300 * MS) && !path.covers(-1, 10 * MS) && !path.covers(400 * MS, 496 * MS));
        assert_eq!(path.stretches(100 * MS, 600 * MS), [(95 * MS, 245 * MS), (300 * MS, 495 * MS)]);
        assert_eq!(path.stretches(600 * MS, 700 * MS).len(), 1);
        assert_eq!(SensorPath::default().stretches(0, MS), []);
    }

    #[test]
    fn motion_and_rotation_are_unsteady_and_uniform_motion_only_less_so() {
        let path = |pose: &dyn Fn(f64) -> Pose| {
            let mut path = SensorPath::default();
            (0..200).for_each(|n| path.push(n * 5 * MS, &pose(n as f64 * 5e-3), DVec3::ZERO));
            path
        };
        let along = |speed: f64| path(&|t| Pose::from_translation((t + 0.1 * t * t) * speed * DVec3::X));
        let Unsteadiness { from_rest_m, from_uniform_m } = along(1.0).unsteadiness(0, 500 * MS);
        // At most 0.1 · 0.25² off the line between its ends.
        assert!((from_rest_m - 0.525).abs() < 1e-12 && (from_uniform_m - 0.1 * 0.0625).abs() < 1e-4);
        assert_eq!(along(0.0).unsteadiness(0, 500 * MS), Unsteadiness::default());
        let turns = path(&|t| Pose { rotation: DQuat::from_rotation_y(0.1 * t), ..Pose::IDENTITY });
        let Unsteadiness { from_rest_m, from_uniform_m } = turns.unsteadiness(0, 500 * MS);
        assert!((from_rest_m - 5e-3).abs() < 1e-5 && from_uniform_m == from_rest_m);
        assert_eq!(SensorPath::default().unsteadiness(0, MS), Unsteadiness::default());
    }

    #[test]
    fn a_shifted_sensor_moves_with_the_rotation() {
        let shift_m = DVec3::new(0.03, -0.02, 0.05);
        let path = path().shifted(shift_m);
        for time_ns in [50 * MS, 123 * MS, 400 * MS] {
            let time_s = time_ns as f64 * 1e-9;
            let (state, at) = (path.at(time_ns).unwrap(), |t: f64| cubic(t).0.transform_point(shift_m));
            assert!(state.position_m.distance(at(time_s)) < 1e-6, "{time_ns}");
            let velocity = (at(time_s + 1e-4) - at(time_s - 1e-4)) / 2e-4;
            assert!(state.velocity_m_per_s.distance(velocity) < 1e-4, "{time_ns}");
        }
    }
}

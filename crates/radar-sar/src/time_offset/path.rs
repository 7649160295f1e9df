//! The sensor's path over time, interpolated between samples.

use glam::DVec3;

/// Samples farther apart than this are not joined, nanoseconds. Choice: twice the 5 ms at which the
/// path is sampled, and some; one missing sample is joined, a pause is not.
const MAX_STEP_NS: i64 = 12_000_000;

#[derive(Debug, Clone, Copy)]
struct Sample {
    time_ns: i64,
    position_m: DVec3,
    velocity_m_per_s: DVec3,
}

/// Positions and velocities in rising time; cubic between neighbours, undefined across a gap.
#[derive(Debug, Clone, Default)]
pub(super) struct SensorPath {
    samples: Vec<Sample>,
}

impl SensorPath {
    /// Adds the next sample; ignored unless it is later than the last one and finite.
    pub fn push(&mut self, time_ns: i64, position_m: DVec3, velocity_m_per_s: DVec3) {
        let rises = self.samples.last().is_none_or(|last| time_ns > last.time_ns);
        if rises && position_m.is_finite() && velocity_m_per_s.is_finite() {
            self.samples.push(Sample { time_ns, position_m, velocity_m_per_s });
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

    /// Whether the path has no gap from one time to the other.
    pub fn covers(&self, from_ns: i64, to_ns: i64) -> bool {
        let first = self.samples.partition_point(|s| s.time_ns <= from_ns);
        let last = self.samples.partition_point(|s| s.time_ns < to_ns);
        let unbroken = |n: usize| self.samples[n].time_ns - self.samples[n - 1].time_ns <= MAX_STEP_NS;
        first > 0 && last < self.samples.len() && (first..=last).all(unbroken)
    }

    /// Number of samples before a time: first guessed for evenly spaced samples, then searched.
    fn first_from(&self, time_ns: i64) -> usize {
        if let [first, second, ..] = self.samples[..]
            && time_ns > first.time_ns
        {
            let steps = (time_ns - first.time_ns - 1) as u64 / (second.time_ns - first.time_ns) as u64;
            let guess = steps as usize + 1;
            if let Some([before, after]) = self.samples.get(guess - 1..=guess)
                && before.time_ns < time_ns
                && time_ns <= after.time_ns
            {
                return guess;
            }
        }
        self.samples.partition_point(|s| s.time_ns < time_ns)
    }

    /// Position and velocity at a time; `None` outside the path and in gaps.
    pub fn at(&self, time_ns: i64) -> Option<(DVec3, DVec3)> {
        let later = self.first_from(time_ns).max(1);
        let (a, b) = (self.samples.get(later - 1)?, self.samples.get(later)?);
        if b.time_ns - a.time_ns > MAX_STEP_NS || time_ns < a.time_ns {
            return None;
        }
        let step_s = (b.time_ns - a.time_ns) as f64 * 1e-9;
        let u = (time_ns - a.time_ns) as f64 * 1e-9 / step_s;
        // Hermite cubic from positions and velocities of both neighbours.
        let (way, from, to) = (b.position_m - a.position_m, a.velocity_m_per_s * step_s, b.velocity_m_per_s * step_s);
        let (c2, c3) = (way * 3.0 - from * 2.0 - to, from + to - way * 2.0);
        let position_m = a.position_m + (from + (c2 + c3 * u) * u) * u;
        Some((position_m, (from + (c2 * 2.0 + c3 * (3.0 * u)) * u) / step_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    fn cubic(t: f64) -> (DVec3, DVec3) {
        (DVec3::new(t, t * t, 1.0 - t * t * t), DVec3::new(1.0, 2.0 * t, -3.0 * t * t))
    }

    #[test]
    fn cubics_are_followed_and_gaps_are_not_crossed() {
        let mut path = SensorPath::default();
        for n in (0..100).filter(|n| !(50..60).contains(n)) {
            let (position, velocity) = cubic(n as f64 * 5e-3);
            path.push(n * 5 * MS, position, velocity);
        }
        for time_ns in [0, 3 * MS, 244 * MS, 301 * MS, 495 * MS] {
            let ((position, velocity), expected) = (path.at(time_ns).unwrap(), cubic(time_ns as f64 * 1e-9));
            assert!(position.distance(expected.0) < 1e-12 && velocity.distance(expected.1) < 1e-10, "{time_ns}");
        }
        for outside in [-1, 246 * MS, 299 * MS, 496 * MS] {
            assert_eq!(path.at(outside), None);
        }
        assert!(path.covers(0, 245 * MS) && path.covers(301 * MS, 495 * MS));
        assert!(!path.covers(240 * MS, 300 * MS) && !path.covers(-1, 10 * MS) && !path.covers(400 * MS, 496 * MS));
    }
}

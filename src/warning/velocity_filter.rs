//! Velocity of a tracked point from successive positions.
//!
//! Displacement over elapsed time, so that dropped frames do no harm, smoothed exponentially
//! against tracking jitter. Equal times change nothing. Backward times, long pauses and position
//! leaps restart the filter.

use glam::DVec3;

use radar_sar::math;

/// A longer pause restarts the filter, nanoseconds. Choice: longer than a lost frame or two,
/// shorter than a head takes to turn round.
const MAX_PAUSE_NS: i64 = 250_000_000;

/// Velocity of one point.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct VelocityFilter {
    last: Option<(i64, DVec3)>,
    velocity_m_per_s: DVec3,
    has_restarted: bool,
}

impl VelocityFilter {
    /// Takes a position and returns the velocity, m/s.
    pub fn update(&mut self, time_ns: i64, position_m: DVec3, fastest_m_per_s: f64, smoothing_s: f64) -> DVec3 {
        self.has_restarted = false;
        let Some((then_ns, before_m)) = self.last else { return self.restart(time_ns, position_m) };
        let passed_ns = time_ns.saturating_sub(then_ns);
        if passed_ns == 0 {
            return self.velocity_m_per_s;
        }
        let passed_s = passed_ns as f64 * 1e-9;
        let fresh = (position_m - before_m) / passed_s;
        if !(0..=MAX_PAUSE_NS).contains(&passed_ns) || fresh.length() > fastest_m_per_s {
            return self.restart(time_ns, position_m);
        }
        self.velocity_m_per_s = fresh.lerp(self.velocity_m_per_s, math::exp(-passed_s / smoothing_s));
        self.last = Some((time_ns, position_m));
        self.velocity_m_per_s
    }

    /// Whether the last position restarted the filter.
    pub fn has_restarted(&self) -> bool {
        self.has_restarted
    }

    fn restart(&mut self, time_ns: i64, position_m: DVec3) -> DVec3 {
        *self = Self { last: Some((time_ns, position_m)), velocity_m_per_s: DVec3::ZERO, has_restarted: true };
        DVec3::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME_NS: i64 = 11_000_000;

    fn take(speed: &mut VelocityFilter, time_ns: i64, x_m: f64) -> f64 {
        speed.update(time_ns, DVec3::X * x_m, 6.0, 0.08).x
    }

    #[test]
    fn steady_velocity_survives_dropped_frames() {
        let mut speed = VelocityFilter::default();
        let mut speeds = Vec::new();
        for frame in (0..200).filter(|frame| frame % 7 != 3 && !(90..100).contains(frame)) {
            let time_ns = frame * FRAME_NS;
            speeds.push(take(&mut speed, time_ns, 1.2e-9 * time_ns as f64));
        }
        assert!(speeds[60..].iter().all(|v| (v - 1.2).abs() < 0.01), "{speeds:?}");
    }

    #[test]
    fn position_jitter_gives_no_velocity() {
        let mut speed = VelocityFilter::default();
        let jitter = |frame: i64| 3e-4 * (frame as f64 * 12.9898).sin();
        let speeds = (0..200).map(|frame| take(&mut speed, frame * FRAME_NS, jitter(frame)).abs());
        assert!(speeds.fold(0.0, f64::max) < 0.03);
    }

    #[test]
    fn time_anomalies_and_leaps_restart_the_filter() {
        let mut speed = VelocityFilter::default();
        for frame in 0..60 {
            take(&mut speed, frame * FRAME_NS, 0.011 * frame as f64);
        }
        let before = take(&mut speed, 60 * FRAME_NS, 0.66);
        assert!((before - 1.0).abs() < 0.01);
        assert_eq!(take(&mut speed, 60 * FRAME_NS, 0.70), before, "no time has passed");
        assert_eq!(take(&mut speed, 61 * FRAME_NS, 5.0), 0.0, "a leap");
        assert_eq!(take(&mut speed, 10 * FRAME_NS, 5.0), 0.0, "backwards");
        assert_eq!(take(&mut speed, 90 * FRAME_NS, 5.2), 0.0, "after a pause");
        assert!(take(&mut speed, i64::MAX, 5.2).is_finite() && take(&mut speed, i64::MIN, 5.2).is_finite());
    }
}

//! Dead reckoning with an inertial measurement unit that is strapped to the body: rotation,
//! velocity and position from the means of angular velocity ω and specific force F over each
//! interval h (Savage, "Strapdown Inertial Navigation Integration Algorithm Design", J. Guidance
//! 21, 1998).
//!
//! With ω̇ and Ḟ from the interval before, both linear in time:
//!
//! ```text
//! turn     φ = h ω + h³/12 ω × ω̇                                        (coning)
//! velocity Δv = h F + h²/2 ω × F + h³/6 ω × (ω × F) + h³/12 (ω × Ḟ − ω̇ × F) (rotation, sculling)
//! position Δp = h v + h²/2 F − h³/12 Ḟ + h³/6 ω × F, gravity added to both
//! ```
//!
//! The rest is of the fourth order in h. It has no error model: measurements are taken as true.

use glam::{DQuat, DVec3};

use super::{GRAVITY_M_PER_S2, ImuSample};
use radar_sar::geometry::Pose;

/// Longest interval that one sample is used for, seconds. Choice: over a longer gap the motion is
/// unknown; the filter coasts instead.
pub(super) const MAX_INTERVAL_S: f64 = 0.1;

/// State of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NavState {
    /// Host nanoseconds.
    pub time_ns: i64,
    /// Pose of the body.
    pub tracking_from_body: Pose,
    /// Velocity of its origin, tracking frame, m/s.
    pub velocity_m_per_s: DVec3,
}

/// Mean angular velocity and specific force over an interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Means {
    pub rate: DVec3,
    pub force: DVec3,
}

/// Slopes of the means over time, from two consecutive intervals.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Slopes {
    rate: DVec3,
    force: DVec3,
}

impl Slopes {
    pub fn between(before: Option<(Means, f64)>, now: &Means, interval_s: f64) -> Self {
        let Some((before, before_s)) = before else { return Self::default() };
        let per_s = 2.0 / (before_s + interval_s);
        Self { rate: (now.rate - before.rate) * per_s, force: (now.force - before.force) * per_s }
    }
}

impl NavState {
    /// At rest in a pose.
    pub fn at_rest(time_ns: i64, tracking_from_body: Pose) -> Self {
        Self { time_ns, tracking_from_body, velocity_m_per_s: DVec3::ZERO }
    }

    /// The state an interval later.
    pub(super) fn advanced(&self, h: f64, means: &Means, slopes: &Slopes) -> Self {
        let (rate, force) = (means.rate, means.force);
        let (h2, h3) = (h * h, h * h * h);
        let turned = rate.cross(force);
        let turn = rate * h + rate.cross(slopes.rate) * (h3 / 12.0);
        let sculling = rate.cross(slopes.force) - slopes.rate.cross(force);
        let gain = force * h + turned * (h2 / 2.0) + rate.cross(turned) * (h3 / 6.0) + sculling * (h3 / 12.0);
        let way = force * (h2 / 2.0) - slopes.force * (h3 / 12.0) + turned * (h3 / 6.0);
        let Pose { translation, rotation } = self.tracking_from_body;
        let position = translation + self.velocity_m_per_s * h + rotation * way + GRAVITY_M_PER_S2 * (h2 / 2.0);
        Self {
            time_ns: self.time_ns.saturating_add((h * 1e9).round() as i64),
            tracking_from_body: Pose::new(position, rotation * DQuat::from_scaled_axis(turn)),
            velocity_m_per_s: self.velocity_m_per_s + rotation * gain + GRAVITY_M_PER_S2 * h,
        }
    }
}

/// Dead reckoning from a known state.
#[derive(Debug, Clone, Copy)]
pub struct Strapdown {
    state: NavState,
    before: Option<(Means, f64)>,
}

impl Strapdown {
    /// From a state.
    pub fn new(state: NavState) -> Self {
        Self { state, before: None }
    }

    /// The state so far.
    pub fn state(&self) -> &NavState {
        &self.state
    }

    /// Adds a sample and returns the state at its time. A sample that is not later, or not finite,
    /// changes nothing. After a pause of more than 0.1 s the sample counts for its last 0.1 s, and
    /// the body is assumed to have moved on straight before.
    pub fn push(&mut self, sample: &ImuSample) -> &NavState {
        let interval_s = sample.time_ns.saturating_sub(self.state.time_ns) as f64 * 1e-9;
        if interval_s > 0.0 && sample.is_finite() {
            let coasted_s = (interval_s - MAX_INTERVAL_S).max(0.0);
            if coasted_s > 0.0 {
                self.state.tracking_from_body.translation += self.state.velocity_m_per_s * coasted_s;
                self.before = None;
            }
            let h = interval_s - coasted_s;
            let means = Means { rate: sample.angular_rate_rad_per_s, force: sample.specific_force_m_per_s2 };
            let slopes = Slopes::between(self.before, &means, h);
            self.state = NavState { time_ns: sample.time_ns, ..self.state.advanced(h, &means, &slopes) };
            self.before = Some((means, h));
        }
        &self.state
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Greatest error of the position, metres, and of the rotation, rad, after 4 s of a coning and
    /// swinging body, with samples that are exact means.
    fn errors(rate_hz: f64) -> (f64, f64) {
        let position = |t: f64| DVec3::new((2.0 * t).sin() * 0.3, 0.1 * (3.1 * t).cos(), 0.2 * (1.7 * t).sin());
        let rotation =
            |t: f64| DQuat::from_rotation_y(0.8 * (2.3 * t).sin()) * DQuat::from_rotation_x(0.5 * (2.9 * t).cos());
        let e = 1e-4;
        let velocity = |t: f64| (position(t + e) - position(t - e)) / (2.0 * e);
        let h = 1.0 / rate_hz;
        let ns = |t: f64| (t * 1e9).round() as i64;
        let start = NavState {
            time_ns: 0,
            tracking_from_body: Pose::new(position(0.0), rotation(0.0)),
            velocity_m_per_s: velocity(0.0),
        };
        let mut strapdown = Strapdown::new(start);
        let mut worst = (0.0f64, 0.0f64);
        for n in 0..(4.0 * rate_hz) as usize {
            let (mut rate, mut force) = (DVec3::ZERO, DVec3::ZERO);
            // Means by fine steps: their own error is far below the integration's.
            for part in 0..64 {
                let [a, b] = [part, part + 1].map(|p| (n as f64 + f64::from(p) / 64.0) * h);
                let middle = rotation(0.5 * (a + b));
                rate += (rotation(a).conjugate() * rotation(b)).to_scaled_axis();
                force += middle.conjugate() * (velocity(b) - velocity(a) - GRAVITY_M_PER_S2 * (b - a));
            }
            let t = (n + 1) as f64 * h;
            let state = strapdown.push(&ImuSample {
                time_ns: ns(t),
                angular_rate_rad_per_s: rate / h,
                specific_force_m_per_s2: force / h,
            });
            let Pose { translation, rotation: turned } = state.tracking_from_body;
            worst.0 = worst.0.max(translation.distance(position(t)));
            worst.1 = worst.1.max((turned * rotation(t).conjugate()).to_scaled_axis().length());
        }
        worst
    }

    #[test]
    fn perfect_imu_reproduces_path_with_third_order_convergence() {
        let (coarse, fine) = (errors(100.0), errors(200.0));
        assert!(fine.0 < 1e-4 && fine.1 < 1e-5, "{coarse:?} {fine:?}");
        assert!(coarse.0 / fine.0 > 6.0 && coarse.1 / fine.1 > 6.0, "third order: {coarse:?} {fine:?}");
    }

    #[test]
    fn rest_and_free_fall_are_integrated() {
        let mut strapdown = Strapdown::new(NavState::at_rest(0, Pose::from_translation(DVec3::Y)));
        let sample = |n: i64, force: DVec3| ImuSample {
            time_ns: n * 10_000_000,
            angular_rate_rad_per_s: DVec3::ZERO,
            specific_force_m_per_s2: force,
        };
        (1..=100).for_each(|n| {
            strapdown.push(&sample(n, -GRAVITY_M_PER_S2));
        });
        assert!(strapdown.state().tracking_from_body.translation.distance(DVec3::Y) < 1e-9);
        (101..=200).for_each(|n| {
            strapdown.push(&sample(n, DVec3::ZERO));
        });
        let fallen = strapdown.state();
        assert!((fallen.tracking_from_body.translation.y - (1.0 - 0.5 * 9.806_65)).abs() < 0.05, "{fallen:?}");
        assert!((fallen.velocity_m_per_s.y + 9.806_65).abs() < 0.05);
    }

    #[test]
    fn bad_samples_are_ignored_and_pauses_stay_bounded() {
        let mut strapdown = Strapdown::new(NavState::at_rest(1_000, Pose::IDENTITY));
        let before = *strapdown.state();
        let nan = ImuSample { time_ns: 2_000, angular_rate_rad_per_s: DVec3::NAN, specific_force_m_per_s2: DVec3::ONE };
        let late = ImuSample { time_ns: 1_000, angular_rate_rad_per_s: DVec3::ONE, ..nan };
        let far = ImuSample { time_ns: i64::MIN, ..late };
        for sample in [nan, late, far] {
            assert_eq!(*strapdown.push(&sample), before);
        }
        let after = ImuSample {
            time_ns: 60_000_000_000,
            angular_rate_rad_per_s: DVec3::ZERO,
            specific_force_m_per_s2: DVec3::X,
        };
        let state = strapdown.push(&after);
        assert_eq!(state.time_ns, 60_000_000_000);
        assert!(state.tracking_from_body.translation.length() < 0.1 && state.velocity_m_per_s.length() < 1.0);
    }
}

//! Dead reckoning from the end of a rest on, and the thesis' script.

use crate::inertial::true_state;
use glam::DVec3;

use crate::inertial::{GRAVITY_M_PER_S2, ImuSample, NavState, Strapdown};
use radar_sar::geometry::Pose;
use radar_simulation::TruePath;

/// Offsets that the IMU shows at rest, where its pose is known.
struct RestOffsets {
    rate: DVec3,
    force: DVec3,
}

impl RestOffsets {
    /// From the samples up to a time.
    fn of(samples: &[ImuSample], until_ns: i64, pose: &Pose) -> Self {
        let rest: Vec<&ImuSample> = samples.iter().take_while(|sample| sample.time_ns <= until_ns).collect();
        let mean = |of: fn(&ImuSample) -> DVec3| rest.iter().map(|s| of(s)).sum::<DVec3>() / rest.len().max(1) as f64;
        let up = pose.rotation.conjugate() * -GRAVITY_M_PER_S2;
        Self { rate: mean(|s| s.angular_rate_rad_per_s), force: mean(|s| s.specific_force_m_per_s2) - up }
    }

    fn corrected(&self, sample: &ImuSample) -> ImuSample {
        ImuSample {
            angular_rate_rad_per_s: sample.angular_rate_rad_per_s - self.rate,
            specific_force_m_per_s2: sample.specific_force_m_per_s2 - self.force,
            ..*sample
        }
    }
}

/// Dead reckoning from the end of the rest on, with or without removal of the offsets.
pub(super) fn dead_reckon(samples: &[ImuSample], path: &TruePath, until_ns: i64, is_zeroed: bool) -> Vec<NavState> {
    let start = true_state(path, until_ns);
    let none = RestOffsets { rate: DVec3::ZERO, force: DVec3::ZERO };
    let zero = if is_zeroed { RestOffsets::of(samples, until_ns, &start.tracking_from_body) } else { none };
    let mut strapdown = Strapdown::new(NavState::at_rest(until_ns, start.tracking_from_body));
    let later = samples.iter().filter(|sample| sample.time_ns > until_ns);
    later.map(|sample| *strapdown.push(&zero.corrected(sample))).collect()
}

/// The thesis' script: double integral of the accelerometer minus its mean at rest, without regard
/// to attitude.
pub(super) fn thesis_script(samples: &[ImuSample], until_ns: i64) -> Vec<NavState> {
    let zero = RestOffsets::of(samples, until_ns, &Pose::IDENTITY);
    let mut state = NavState::at_rest(until_ns, Pose::IDENTITY);
    let step = |sample: &ImuSample| {
        let h = (sample.time_ns - state.time_ns) as f64 * 1e-9;
        let moved = zero.corrected(sample).specific_force_m_per_s2 + GRAVITY_M_PER_S2;
        state.velocity_m_per_s += moved * h;
        state.tracking_from_body.translation += state.velocity_m_per_s * h;
        state.time_ns = sample.time_ns;
        state
    };
    samples.iter().filter(|sample| sample.time_ns > until_ns).map(step).collect()
}

/// Distance from the truth some time after another, metres.
pub(super) fn drift_m(states: &[NavState], from_ns: i64, after_s: f64, truth: impl Fn(i64) -> DVec3) -> f64 {
    let at = states.partition_point(|state| state.time_ns < from_ns + (after_s * 1e9) as i64);
    let state = states.get(at.min(states.len().saturating_sub(1)));
    state.map_or(f64::NAN, |state| state.tracking_from_body.translation.distance(truth(state.time_ns)))
}

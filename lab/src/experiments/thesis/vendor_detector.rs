//! Thesis experiment "vendor detector": the vendor's obstacle detector and this program on the same
//! sweeps, where the detector works, and where it leaves the direction open.

mod detector_run;
mod free_motion;
mod pair;
mod picture;
mod straight_motion;
mod uncertainty_ring;

use super::{ExperimentError, Outcome, SNR_DB, Trials};
use crate::baselines::DetectorConfig;
use a121::Profile;

/// The robot's motion and its speed, m/s; and the duration until it is beside the reflector,
/// seconds. Choice: within the 0.5 m/s that the vendor's settings allow.
const ROBOT: (&str, f64) = ("straight-0.3", 0.3);
const ROBOT_DURATION_S: f64 = 3.0;
/// Angles to the path at which figures are taken, and the half width around them, degrees. Choice:
/// nearer the path the cosine hardly changes with the angle, farther from it the beam ends.
const ANGLES_DEG: [f64; 3] = [35.0, 45.0, 55.0];
const ANGLE_HALF_DEG: f64 = 5.0;
/// Motions of a head, with their names.
const FREE_MOTIONS: [(&str, &str); 2] = [("sphere-50cm", "within a sphere of 50 cm"), ("natural", "natural play")];
/// Length of these recordings, seconds. Choice: every motion passes all its points.
const FREE_DURATION_S: f64 = 10.0;
/// Detector configuration for these motions: longer range, higher speeds, points as far apart as
/// the pulse allows.
const FREE_CONFIG: DetectorConfig = DetectorConfig {
    range_m: [0.4, 1.8],
    step_length: 12,
    hwaas: 12,
    profile: Profile::P3,
    sweeps: 16,
    update_hz: 50.0,
    max_speed_m_per_s: 1.25,
};
/// Number of sweeps for our position. Choice: the error is near its least from here on.
const SWEEPS: usize = 200;
/// Tolerances for matching a reflection to an object: in range, metres, and, with two objects, in
/// speed, m/s. Choice: the vendor's own distance for merging two reflections.
const RANGE_MATCH_M: f64 = 0.05;
const SPEED_MATCH_M_PER_S: f64 = 0.05;
/// Minimum sensor speed at which the detector is evaluated, m/s. Choice: slower, less than two of
/// its speed bins hold all directions.
const MIN_SPEED_M_PER_S: f64 = 0.1;
/// Maximum angle off the boresight at which a reflection is expected, degrees. Choice: the echo has
/// lost 24 dB there.
const MAX_OFF_BORESIGHT_DEG: f64 = 60.0;

pub(super) fn run(trials: &Trials) -> Result<Outcome, ExperimentError> {
    let mut outcome = Outcome {
        procedure: format!(
            "The vendor's detector, implemented from its description, and ours on the same simulated sweeps; a \
             corner reflector of {SNR_DB:.0} dB at 1 m, {} seeds. Robot motion: straight ahead at {} m/s with the \
             vendor's own configuration (0.15 to 0.6 m, step 2, 12 averages, profile 3, 16 sweeps in a window, 50 \
             windows per second), past a reflector 30 cm beside the path. Head motion: the same algorithm with ranges \
             from {} to {} m and speeds up to {} m/s, with the tracked speed in place of a robot's. It is calibrated \
             with half a second of an empty room. Ours: {SWEEPS} of the sweeps by farthest point, least squares, the \
             position refined.",
            trials.seeds, ROBOT.1, FREE_CONFIG.range_m[0], FREE_CONFIG.range_m[1], FREE_CONFIG.max_speed_m_per_s
        ),
        ..Outcome::default()
    };
    let right = straight_motion::straight(trials, &mut outcome)?;
    trials.report_progress(1, 5);
    free_motion::free(trials, &mut outcome, right)?;
    trials.report_progress(3, 5);
    pair::pair(trials, &mut outcome)?;
    Ok(outcome)
}

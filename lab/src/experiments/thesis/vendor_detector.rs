//! The vendor's obstacle detector beside this program's way, on the same sweeps: where it works, and what it leaves open.

mod detector_run;
mod free_motion;
mod pair;
mod picture;
mod straight_motion;
mod uncertainty_ring;

use super::{ExperimentError, Outcome, SNR_DB, Trials};
use crate::baselines::DetectorConfig;
use a121::Profile;

/// A robot's speed, m/s, and how long it goes until it is beside the reflector, seconds.
const ROBOT: (&str, f64) = ("straight-0.3", 0.3);
const ROBOT_DURATION_S: f64 = 3.0;
/// Angles to the way at which figures are taken, degrees, and how far looks may lie from them.
const ANGLES_DEG: [f64; 3] = [35.0, 45.0, 55.0];
const ANGLE_HALF_DEG: f64 = 5.0;
/// Motions that are no robot's, with the words for them.
const FREE_MOTIONS: [(&str, &str); 2] = [("sphere-50cm", "within a sphere of 50 cm"), ("natural", "natural play")];
const FREE_DURATION_S: f64 = 10.0;
/// For them the detector sees farther and follows faster, with points as far apart as the pulse allows.
const FREE_CONFIG: DetectorConfig = DetectorConfig {
    range_m: [0.4, 1.8],
    step_length: 12,
    hwaas: 12,
    profile: Profile::P3,
    sweeps: 16,
    update_hz: 50.0,
    max_speed_m_per_s: 1.25,
};
/// Sweeps of ours.
const SWEEPS: usize = 200;
/// A reflection is a thing's when it is as near to its range, and for two things also to its speed, as this.
const RANGE_MATCH_M: f64 = 0.05;
const SPEED_MATCH_M_PER_S: f64 = 0.05;
/// Slower than this nothing is asked of the detector, m/s.
const MIN_SPEED_M_PER_S: f64 = 0.1;
/// Farther off the boresight than this a thing is not asked for: the echo has lost 24 dB, degrees.
const MAX_OFF_BORESIGHT_DEG: f64 = 60.0;

pub(super) fn run(trials: &Trials) -> Result<Outcome, ExperimentError> {
    let mut outcome = Outcome {
        procedure: format!(
            "The vendor's detector, written from its description, and ours on the same simulated sweeps; a corner reflector of {SNR_DB:.0} dB at 1 m, \
             {} seeds. As a robot goes: straight on at {} m/s with the vendor's own configuration (0.15 to 0.6 m, step 2, 12 averages, profile 3, \
             16 sweeps in a window, 50 looks a second), past a reflector 30 cm beside the way. As a head goes: the same algorithm reaching \
             from {} to {} m and following up to {} m/s, with the speed that tracking tells in place of a robot's. It is calibrated with half a second of an \
             empty room. Ours: {SWEEPS} of the sweeps by farthest point, least squares, the place refined.",
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

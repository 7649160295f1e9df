//! Thesis experiment "IMU prototype": poses from inertia alone on a swinging arm, and inertia
//! beside a tracker with outages.

mod dead_reckoning;
mod drifts;
mod outages;
mod swing;

use super::imaging_methods::{Quality, THESIS_VOXEL_M, chosen, locate, volume};
use super::{ExperimentError, Outcome, SNR_DB, Trials};
use crate::experiments::trial_recording::{TrialRecording, quantile};
use crate::inertial::{ICM_42688, ImuSpec, MPU_6050, NavState, TACTICAL};
use a121::preset;
use radar_sar::PoseSample;
use radar_sar::geometry::Pose;
use radar_sar::{Selection, Statistic};
use radar_simulation::{ARM_M, ARM_REST_S, Scenario, Simulated, TruePath};

/// IMU grades: the thesis' prototype, a current consumer part, tactical grade.
const IMU_PARTS: [ImuSpec; 3] = [MPU_6050, ICM_42688, TACTICAL];
/// Time at rest from which offsets are estimated, seconds: as long as the arm rests.
const REST_S: f64 = ARM_REST_S;
/// Times at which the drift is read, seconds. Choice: from a short outage to far beyond what
/// inertia bridges.
const DRIFT_TIMES_S: [f64; 5] = [0.5, 1.0, 2.0, 5.0, 10.0];
/// Durations of the swing that are imaged, from its start, seconds. Choice: from a quarter of a
/// swing to and fro to two of them.
const SWING_DURATIONS_S: [f64; 4] = [1.0, 2.0, 4.0, 8.0];
/// Start and durations of the tracker's outages, seconds; 0: no outage. Choice: two swings before
/// it, so that the filter has learnt the biases; durations from one that does no harm to one that
/// ruins the image.
const OUTAGE_START_S: f64 = 8.0;
const OUTAGE_DURATIONS_S: [f64; 8] = [0.0, 0.1, 0.3, 0.5, 1.0, 3.0, 5.0, 10.0];
/// Time before the tracker's return that is imaged, seconds. Choice: one swing to and fro, so that
/// all images have the same aperture. Then the recording's length, and the sweeps per image.
const WINDOW_S: f64 = 4.0;
const DURATION_S: f64 = OUTAGE_START_S + 10.0;
const SWEEPS: usize = 50;
/// Voxel edge at which blur is visible, metres. Choice: below the blur to be seen, above what the
/// run time allows.
const FINE_VOXEL_M: f64 = 0.04;
/// An image is sharp when the reflector's error is at most this, metres, and the footprint at most
/// this many times that without an outage. Choice: half a voxel of the image, and a blur that one
/// begins to see.
const SHARP_M: f64 = 0.02;
const SHARP_RATIO: f64 = 1.5;

/// One seed of the swinging arm, shared by all units.
struct SwingTrial {
    scenario: Scenario,
    simulated: Simulated,
    path: TruePath,
    start_ns: i64,
}

impl SwingTrial {
    fn new(seed: u64) -> Result<Self, ExperimentError> {
        let scenario = Scenario { snr_db: Some(SNR_DB), ..scenario("swinging-arm", DURATION_S, seed)? };
        let (simulated, path) = (scenario.run()?, scenario.path()?);
        let start_ns = simulated.frames.first().map_or(0, |frame| frame.host_time_ns);
        Ok(Self { scenario, simulated, path, start_ns })
    }

    fn ns(&self, since_s: f64) -> i64 {
        self.start_ns + (since_s * 1e9) as i64
    }

    /// The sweeps between two times, with poses of any source.
    fn seen(&self, poses: &[PoseSample], from_s: f64, to_s: f64) -> TrialRecording {
        TrialRecording::joined(&self.scenario, &self.simulated, poses).between(self.ns(from_s), self.ns(to_s))
    }
}

/// Radar and IMU on one plate, as in the prototype: the IMU's frame is the sensor's.
fn scenario(motion: &str, duration_s: f64, seed: u64) -> Result<Scenario, ExperimentError> {
    let config = preset("fine").ok_or(ExperimentError::Preset("fine"))?;
    let mut scenario = Scenario::new("corner-reflector", motion, config, duration_s, seed);
    scenario.head_from_sensor = Pose::IDENTITY;
    scenario.errors.mount_m = 0.0;
    Ok(scenario)
}

/// Median of each column.
fn medians(rows: &[Vec<f64>]) -> Vec<f64> {
    let columns = rows.first().map_or(0, Vec::len);
    (0..columns).map(|n| quantile(&rows.iter().map(|row| row[n]).collect::<Vec<_>>(), 0.5)).collect()
}

/// Error of the thesis' image, metres; footprint of the fine image, litres; error of the refined
/// position, metres.
fn image_errors(recorded: &TrialRecording) -> [f64; 3] {
    let sweeps = chosen(recorded, SWEEPS, Selection::FarthestPoint);
    if sweeps.is_empty() {
        return [f64::INFINITY; 3];
    }
    let thesis = Quality::of(&volume(&sweeps, Statistic::Thesis, THESIS_VOXEL_M, recorded.seed), recorded.truth_m);
    let fine = Quality::of(&volume(&sweeps, Statistic::Ls, FINE_VOXEL_M, recorded.seed), recorded.truth_m);
    let (refined, _) = locate(&sweeps, recorded.seed);
    let own = refined.map_or(f64::INFINITY, |refined| refined.position_m.distance(recorded.truth_m));
    [thesis.error_m(), fine.footprint_l, own]
}

/// Navigation states as tracker poses, at half the IMU's rate.
fn pose_samples(states: &[NavState]) -> Vec<PoseSample> {
    states.iter().step_by(2).map(|state| PoseSample::valid(state.time_ns, &state.tracking_from_body)).collect()
}

pub(super) fn run(trials: &Trials) -> Result<Outcome, ExperimentError> {
    let mut outcome = Outcome {
        procedure: format!(
            "An arm of {:.0} cm swings the sensor by 60° to either side, facing the reflector; an inertial \
             measurement unit (IMU) sits beside the sensor, simulated from its part's Allan deviation, offsets, scale \
             errors and misalignments, 400 samples per second; {} seeds, medians. The arm rests for {REST_S:.0} s \
             first, from which the offsets are estimated. The script integrates the accelerometer twice; dead \
             reckoning also integrates the gyroscope; fusion is an error-state Kalman filter of inertia and optical \
             poses that estimates offsets, scale errors, misalignments and the tracker's drift.",
            ARM_M * 100.0,
            trials.seeds
        ),
        ..Outcome::default()
    };
    let drifts = drifts::drifts(trials)?;
    drifts::drift_findings(&mut outcome, &drifts);
    let swung = (1..=trials.seeds).map(SwingTrial::new).collect::<Result<Vec<_>, _>>()?;
    let of_swing = swing::swing_images(&mut outcome, &swung);
    swing::swing_findings(&mut outcome, &drifts, &of_swing);
    outages::outages(&mut outcome, &drifts, &swung);
    Ok(outcome)
}

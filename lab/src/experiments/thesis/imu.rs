//! Poses by inertia: the thesis' prototype on a swinging arm, and inertia beside a tracker that goes away.

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

/// From what a prototype has to what costs a car.
const IMU_PARTS: [ImuSpec; 3] = [MPU_6050, ICM_42688, TACTICAL];
/// Time at rest that offsets are told from, seconds: the arm rests that long.
const REST_S: f64 = ARM_REST_S;
/// Drift is read after these times, seconds.
const DRIFT_TIMES_S: [f64; 5] = [0.5, 1.0, 2.0, 5.0, 10.0];
/// Images are of the first so many seconds of the swing.
const SWING_DURATIONS_S: [f64; 4] = [1.0, 2.0, 4.0, 8.0];
/// The tracker goes away then, seconds, for so long; 0 is not at all.
const OUTAGE_START_S: f64 = 8.0;
const OUTAGE_DURATIONS_S: [f64; 8] = [0.0, 0.1, 0.3, 0.5, 1.0, 3.0, 5.0, 10.0];
/// Images are of so much before the tracker comes back, seconds: a swing there and back, so that all have the same aperture.
const WINDOW_S: f64 = 4.0;
const DURATION_S: f64 = OUTAGE_START_S + 10.0;
const SWEEPS: usize = 50;
/// Voxels in which a blur shows, metres.
const FINE_VOXEL_M: f64 = 0.04;
/// An image counts as sharp while the reflector is placed this well, metres, and half of the peak fills at most so much more than it did.
const SHARP_M: f64 = 0.02;
const SHARP_RATIO: f64 = 1.5;

/// One seed of the arm, with what is shared by all units.
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

/// Radar and unit on one plate, as the prototype's: the unit's frame is the sensor's.
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

/// Error of the thesis' image, footprint of the fine one in litres, and error of the refined place.
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

/// States as poses of a tracker, at half the unit's rate.
fn pose_samples(states: &[NavState]) -> Vec<PoseSample> {
    states.iter().step_by(2).map(|state| PoseSample::valid(state.time_ns, &state.tracking_from_body)).collect()
}

pub(super) fn run(trials: &Trials) -> Result<Outcome, ExperimentError> {
    let mut outcome = Outcome {
        procedure: format!(
            "An arm of {:.0} cm swings the sensor by 60° to either side, facing the reflector; an inertial measurement unit (IMU) sits beside the sensor, \
             simulated by its part's Allan figures, offsets, scales and misalignments, 400 samples a second; {} seeds, medians. It rests for {REST_S:.0} s \
             first, which tells its offsets. The script integrates twice what the accelerometer reports; dead reckoning also turns with the gyroscope; \
             fusion is an error-state Kalman filter of inertia and optical poses, with offsets, scales, misalignments and the tracker's wander as unknowns.",
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

//! What all cases image: a corner reflector 1 m deep, seen for 10 s by the preset `fine`, 20 dB at 1 m, default tracking error.

use glam::DVec3;

use super::BenchmarkError;
use super::plan::CUBE_M;
use crate::geometry::Aabb;
use crate::radar::{Observation, preset};
use crate::simulation::Scenario;
use crate::tracking::{HistorySettings, ObserverSettings, observe_all};

const PRESET: &str = "fine";
const DURATION_S: f64 = 10.0;
const SNR_DB: f64 = 20.0;

/// In words.
pub(super) fn workload(motion: &str) -> String {
    format!("corner reflector at 1 m, {motion}, {DURATION_S:.0} s, {PRESET}, {SNR_DB:.0} dB, {CUBE_M:.0} m cube")
}

/// A simulated recording.
#[derive(Debug)]
pub(super) struct Recorded {
    pub seed: u64,
    pub observations: Vec<Observation>,
    /// Where the reflector is, tracking frame, metres.
    pub truth_m: DVec3,
}

pub(super) fn record(motion: &str, seed: u64) -> Result<Recorded, BenchmarkError> {
    let config = preset(PRESET).ok_or(BenchmarkError::Preset(PRESET))?;
    let mut scenario = Scenario::new("corner-reflector", motion, config, DURATION_S, seed);
    scenario.snr_db = Some(SNR_DB);
    let simulated = scenario.run()?;
    let observer = ObserverSettings {
        history: HistorySettings::default(),
        head_from_sensor: scenario.head_from_sensor,
        time_offset_s: 0.0,
    };
    let (observations, _) = observe_all(&scenario.config, observer, &simulated.frames, &simulated.poses);
    let truth_m = simulated.truth.obstacles.iter().flat_map(|o| o.points_m.first()).next().copied();
    Ok(Recorded { seed, observations, truth_m: truth_m.unwrap_or(DVec3::NAN) })
}

/// The cube that is searched. Every seed shifts it by another part of a voxel, or the reflector would always lie in the same
/// corner of one.
pub(super) fn region(voxel_m: f64, seed: u64) -> Aabb {
    // Powers of the plastic number's inverse spread evenly over a cube.
    let part = [0.819_172_5, 0.671_043_6, 0.549_700_5].map(|step| (step * seed as f64).fract() - 0.5);
    let middle = DVec3::new(0.0, 1.5, -0.5 * CUBE_M) + DVec3::from_array(part) * voxel_m;
    Aabb { min: middle - 0.5 * CUBE_M, max: middle + 0.5 * CUBE_M }
}

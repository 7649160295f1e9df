//! A simulated recording, joined: what trials image.

use glam::DVec3;

use radar_mapping::{ObserverSettings, observe_all};
use radar_sar::Observation;
use radar_sar::geometry::Aabb;
use radar_sar::truth::Truth;
use radar_sar::{HistorySettings, PoseSample};
use radar_simulation::{Scenario, ScenarioError, Simulated};

/// Sweeps with their poses, and what is really there.
#[derive(Debug, Clone)]
pub(super) struct TrialRecording {
    pub seed: u64,
    pub observations: Vec<Observation>,
    /// The first point of what stands there, tracking frame, metres; NaN when nothing does.
    pub truth_m: DVec3,
    /// All of what is there.
    pub truth: Truth,
}

impl TrialRecording {
    /// Simulates a scenario; poses are taken to be as late as the sweeps, as they are.
    pub fn of(scenario: &Scenario) -> Result<Self, ScenarioError> {
        let simulated = scenario.run()?;
        Ok(Self::joined(scenario, &simulated, &simulated.poses))
    }

    /// A simulated recording with poses of any tracker.
    pub fn joined(scenario: &Scenario, simulated: &Simulated, poses: &[PoseSample]) -> Self {
        let observer = ObserverSettings {
            history: HistorySettings::default(),
            head_from_sensor: scenario.head_from_sensor,
            time_offset_s: 0.0,
        };
        let (observations, _) = observe_all(&scenario.config, observer, &simulated.frames, poses);
        let truth_m = simulated.truth.obstacles.iter().flat_map(|o| o.points_m.first()).next().copied();
        let truth_m = truth_m.unwrap_or(DVec3::NAN);
        Self { seed: scenario.seed, observations, truth_m, truth: simulated.truth.clone() }
    }

    /// The part of it between two host times, nanoseconds.
    pub fn between(&self, from_ns: i64, to_ns: i64) -> Self {
        let within = |sweep: &&Observation| (from_ns..to_ns).contains(&sweep.mid_time_ns);
        Self {
            observations: self.observations.iter().filter(within).cloned().collect(),
            truth: self.truth.clone(),
            ..*self
        }
    }
}

/// Edge of the cube that is searched, metres: the thesis' (section 3.5.1).
pub(super) const CUBE_M: f64 = 3.0;

/// The part of a voxel by which a seed shifts the cube that is searched, −½ to ½ each way: or the reflector would always lie in
/// the same corner of one.
pub(super) fn offset(seed: u64) -> DVec3 {
    // Powers of the plastic number's inverse spread evenly over a cube.
    DVec3::from_array([0.819_172_5, 0.671_043_6, 0.549_700_5].map(|step| (step * seed as f64).fract() - 0.5))
}

/// The cube that is searched, shifted by the seed.
pub(super) fn region(voxel_m: f64, seed: u64) -> Aabb {
    let middle = DVec3::new(0.0, 1.5, -0.5 * CUBE_M) + offset(seed) * voxel_m;
    Aabb { min: middle - 0.5 * CUBE_M, max: middle + 0.5 * CUBE_M }
}

/// The value at a share of the sorted ones, the middle of two where it lies between; 0 without any.
pub(super) fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let Some(last) = sorted.len().checked_sub(1) else { return 0.0 };
    let at = share * last as f64;
    let (below, above) = (sorted[at as usize], sorted[(at.ceil() as usize).min(last)]);
    if below == above { below } else { below + (above - below) * at.fract() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_lie_between_the_sorted_values() {
        assert_eq!(quantile(&[3.0, 1.0, 2.0], 0.5), 2.0);
        assert_eq!(quantile(&[4.0, 1.0], 0.5), 2.5);
        assert_eq!(quantile(&[], 0.5), 0.0);
        assert_eq!(quantile(&[1.0, f64::INFINITY, 2.0], 0.95), f64::INFINITY);
    }
}

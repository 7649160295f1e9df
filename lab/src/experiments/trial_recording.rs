//! A simulated recording with its sweeps and poses joined: the input of the trials.

use glam::DVec3;

use radar_mapping::{ObserverSettings, observe_all};
use radar_sar::Observation;
use radar_sar::geometry::Aabb;
use radar_sar::truth::Truth;
use radar_sar::{HistorySettings, PoseSample};
use radar_simulation::{Scenario, ScenarioError, Simulated};

/// Sweeps with their poses, and the truth.
#[derive(Debug, Clone)]
pub(super) struct TrialRecording {
    pub seed: u64,
    pub observations: Vec<Observation>,
    /// First point of the first obstacle, tracking frame, metres; NaN without obstacles.
    pub truth_m: DVec3,
    /// The whole truth.
    pub truth: Truth,
}

impl TrialRecording {
    /// Simulates a scenario. The time offset between poses and sweeps is left uncorrected.
    pub fn of(scenario: &Scenario) -> Result<Self, ScenarioError> {
        let simulated = scenario.run()?;
        Ok(Self::joined(scenario, &simulated, &simulated.poses))
    }

    /// A simulated recording with the poses of any tracker.
    pub fn joined(scenario: &Scenario, simulated: &Simulated, poses: &[PoseSample]) -> Self {
        let observer = ObserverSettings {
            history: HistorySettings::default(),
            head_from_sensor: scenario.head_from_sensor,
            time_offset_s: 0.0,
            range_bias_m: None,
        };
        let (observations, _) = observe_all(&scenario.config, observer, &simulated.frames, poses);
        let truth_m = simulated.truth.obstacles.iter().flat_map(|o| o.points_m.first()).next().copied();
        let truth_m = truth_m.unwrap_or(DVec3::NAN);
        Self { seed: scenario.seed, observations, truth_m, truth: simulated.truth.clone() }
    }

    /// The part between two host times, nanoseconds.
    pub fn between(&self, from_ns: i64, to_ns: i64) -> Self {
        let within = |sweep: &&Observation| (from_ns..to_ns).contains(&sweep.mid_time_ns);
        Self {
            observations: self.observations.iter().filter(within).cloned().collect(),
            truth: self.truth.clone(),
            ..*self
        }
    }
}

/// Edge of the searched cube, metres: the thesis', section 3.5.1.
pub(super) const CUBE_M: f64 = 3.0;

/// Shift of the searched cube for a seed, in voxels, −½ to ½ along each axis. Without it the
/// reflector would lie at the same position in a voxel for every seed.
pub(super) fn offset(seed: u64) -> DVec3 {
    // Multiples of the powers of the plastic number's inverse, modulo 1, spread evenly over a cube.
    DVec3::from_array([0.819_172_5, 0.671_043_6, 0.549_700_5].map(|step| (step * seed as f64).fract() - 0.5))
}

/// The searched cube, shifted by the seed.
pub(super) fn region(voxel_m: f64, seed: u64) -> Aabb {
    let middle = DVec3::new(0.0, 1.5, -0.5 * CUBE_M) + offset(seed) * voxel_m;
    Aabb { min: middle - 0.5 * CUBE_M, max: middle + 0.5 * CUBE_M }
}

/// Quantile of values, interpolated linearly; 0 without values.
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

//! What makes up a sub-aperture, and which points it covers.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::geometry::Pose;
use crate::{Beam, Observation, RangeAxis};
use crate::{BoundedSettings, SettingBound, bounds, math};

/// Parameters of the sub-aperture statistic.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SubapertureSettings {
    /// Length of a sub-aperture, seconds.
    pub duration_s: f64,
    /// A sub-aperture of fewer sweeps is dropped.
    pub min_sweeps: usize,
    /// Time in which old evidence decays to 1/e relative to new evidence, seconds.
    pub decay_s: f64,
    /// Least two-way amplitude at which a point counts as in the beam.
    pub min_amplitude: f64,
    /// The same for a plane such as a wall. It is lower because planes return far more power.
    pub plane_min_amplitude: f64,
    /// Nearest range used, metres.
    pub min_range_m: f64,
    /// Farthest range used, metres.
    pub max_range_m: f64,
    /// Edge of a voxel, metres. Half of the 14 cm pulse and less than the 10 cm that a sub-aperture at walking
    /// pace resolves at 1.5 m. Voxels of more than 6.5 cm do not fit the boxes of the fast way (`brick.rs`).
    pub voxel_m: f64,
}

/// At the end of each interval that makes mapping hardest, as far as the other settings allow it, a furnished room gives obstacles and walls (`tests/program/settings_file.rs`): what ended
/// all warnings would go unnoticed.
impl BoundedSettings for SubapertureSettings {
    const BOUNDS: &'static [SettingBound<Self>] = bounds![
        duration_s: 0.01, 0.2;
        min_sweeps: 2.0, 80.0;
        decay_s: 0.5, 100.0;
        min_amplitude: 0.01, 0.7;
        plane_min_amplitude: 0.001, 0.25;
        min_range_m: 0.05, 1.0;
        max_range_m: 1.0, 5.0;
        voxel_m: 0.02, 0.5;
    ];
}

impl Default for SubapertureSettings {
    fn default() -> Self {
        Self {
            duration_s: 0.090,
            min_sweeps: 8,
            decay_s: 1.5,
            min_amplitude: 0.25,
            plane_min_amplitude: 0.01,
            min_range_m: 0.35,
            max_range_m: 2.3,
            voxel_m: 0.065,
        }
    }
}

impl SubapertureSettings {
    /// Cosine of the widest angle that counts as in the beam.
    #[inline]
    pub fn min_cos(&self, beam: &Beam) -> f64 {
        beam.cut_off_cos(self.min_amplitude)
    }

    /// Cosine of the widest angle at which a plane counts as in the beam.
    pub fn plane_min_cos(&self, beam: &Beam) -> f64 {
        beam.cut_off_cos(self.plane_min_amplitude)
    }

    /// The same, limited to a sweep's range axis: sweeps carry no information beyond it.
    #[inline]
    pub fn within(&self, axis: &RangeAxis) -> Self {
        let (min_range_m, max_range_m) = (self.min_range_m.max(axis.first_m), self.max_range_m.min(axis.last_m()));
        Self { min_range_m, max_range_m, ..*self }
    }

    /// Whether a point is in the beam and range of a sensor pose.
    #[inline]
    pub fn sees(&self, tracking_from_sensor: &Pose, min_cos: f64, place: DVec3) -> bool {
        let to = place - tracking_from_sensor.translation;
        let along = to.dot(tracking_from_sensor.forward());
        // Comparing signed squares avoids the square root.
        let distance2 = to.length_squared();
        distance2 >= self.min_range_m * self.min_range_m
            && distance2 <= self.max_range_m * self.max_range_m
            && along * along.abs() >= min_cos * min_cos.abs() * distance2
    }

    /// Whether a sweep at `time_ns` belongs to the sub-aperture that began at `first_ns` and whose
    /// last sweep was at `last_ns`: it lies within the sub-aperture's length, and the pause before
    /// it is shorter than a third of that length.
    pub fn continues(&self, first_ns: i64, last_ns: i64, time_ns: i64) -> bool {
        let duration_ns = self.duration_s * 1e9;
        ((time_ns.saturating_sub(first_ns)) as f64) < duration_ns
            && ((time_ns.saturating_sub(last_ns)) as f64) < duration_ns / 3.0
    }
}

/// Taper weight of sweep `k` of `count` in its sub-aperture: 1 − ½·cos, normalised to mean square
/// 1.
pub fn taper(k: usize, count: usize) -> f64 {
    let turn = std::f64::consts::TAU * (k as f64 + 0.5) / count as f64;
    (1.0 - 0.5 * math::cos(turn)) / 1.125f64.sqrt()
}

/// Indices of the sweeps of each sub-aperture, in time order. Each subsweep is partitioned
/// separately.
pub fn partition(observations: &[Observation], settings: &SubapertureSettings) -> Vec<Vec<usize>> {
    let mut open: std::collections::BTreeMap<usize, Vec<usize>> = Default::default();
    let mut done = Vec::new();
    for (index, observation) in observations.iter().enumerate() {
        let block = open.entry(observation.geometry.subsweep).or_default();
        if let (Some(&first), Some(&last)) = (block.first(), block.last()) {
            let time = |i: usize| observations[i].mid_time_ns;
            if !settings.continues(time(first), time(last), observation.mid_time_ns) {
                done.push(std::mem::take(block));
            }
        }
        block.push(index);
    }
    done.extend(open.into_values());
    done.retain(|block| block.len() >= settings.min_sweeps);
    done
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_limited_by_axis_and_settings() {
        let settings = SubapertureSettings::default();
        let long = RangeAxis { first_m: 0.2, step_m: 0.06, points: 50 };
        assert_eq!(settings.within(&long), settings);
        let short = settings.within(&RangeAxis { first_m: 0.4, step_m: 0.02, points: 11 });
        let sees = |range_m: f64| short.sees(&Pose::IDENTITY, 0.5, DVec3::NEG_Z * range_m);
        assert_eq!([0.39, 0.41, 0.59, 0.61].map(sees), [false, true, true, false]);
        // An axis entirely beyond the farthest range.
        let nothing = settings.within(&RangeAxis { first_m: 3.0, step_m: 0.02, points: 11 });
        assert!([0.5, 2.0, 3.1].iter().all(|range_m| !nothing.sees(&Pose::IDENTITY, 0.5, DVec3::NEG_Z * *range_m)));
    }

    #[test]
    fn the_taper_has_unit_mean_square() {
        for count in [12, 45, 96] {
            let mean = (0..count).map(|k| taper(k, count).powi(2)).sum::<f64>() / count as f64;
            assert!((mean - 1.0).abs() < 1e-12);
        }
    }
}

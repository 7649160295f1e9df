//! What a block is, and what it sees.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::geometry::Pose;
use crate::math;
use crate::{Beam, Observation, RangeAxis};

/// Parameters of the block score.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SubapertureSettings {
    /// Length of a block, seconds.
    pub block_s: f64,
    /// A block of fewer sweeps is dropped.
    pub min_sweeps: usize,
    /// Time in which evidence fades to 1/e as newer comes in, seconds.
    pub memory_s: f64,
    /// A place is in the beam from this two-way amplitude on.
    pub min_amplitude: f64,
    /// And a mirror, as walls are, from this one on: it returns so much more.
    pub mirror_min_amplitude: f64,
    /// Nearest range looked at, metres.
    pub min_range_m: f64,
    /// Farthest range looked at, metres.
    pub max_range_m: f64,
    /// Edge of a voxel, metres.
    pub voxel_m: f64,
}

impl Default for SubapertureSettings {
    fn default() -> Self {
        Self {
            block_s: 0.090,
            min_sweeps: 8,
            memory_s: 1.5,
            min_amplitude: 0.25,
            mirror_min_amplitude: 0.01,
            min_range_m: 0.35,
            max_range_m: 2.3,
            voxel_m: 0.05,
        }
    }
}

impl SubapertureSettings {
    /// Cosine of the widest angle that counts as in the beam.
    pub fn min_cos(&self, beam: &Beam) -> f64 {
        beam.cut_off_cos(self.min_amplitude)
    }

    /// Cosine of the widest angle at which a mirror counts as in the beam.
    pub fn mirror_min_cos(&self, beam: &Beam) -> f64 {
        beam.cut_off_cos(self.mirror_min_amplitude)
    }

    /// The same for sweeps of a range axis: where it does not reach, they say nothing.
    pub fn within(&self, axis: &RangeAxis) -> Self {
        let (min_range_m, max_range_m) = (self.min_range_m.max(axis.first_m), self.max_range_m.min(axis.last_m()));
        Self { min_range_m, max_range_m, ..*self }
    }

    /// Whether a sensor pose has a place in its beam and range.
    pub fn sees(&self, tracking_from_sensor: &Pose, min_cos: f64, place: DVec3) -> bool {
        let to = place - tracking_from_sensor.translation;
        let along = to.dot(tracking_from_sensor.forward());
        // Squares with their sign spare the root.
        let distance2 = to.length_squared();
        distance2 >= self.min_range_m * self.min_range_m
            && distance2 <= self.max_range_m * self.max_range_m
            && along * along.abs() >= min_cos * min_cos.abs() * distance2
    }

    /// Whether a sweep at `time_ns` still belongs to a block that began at `first_ns` and whose last sweep was at `last_ns`:
    /// within the block's length, and after no pause longer than a third of it.
    pub fn continues(&self, first_ns: i64, last_ns: i64, time_ns: i64) -> bool {
        let block_ns = self.block_s * 1e9;
        ((time_ns.saturating_sub(first_ns)) as f64) < block_ns
            && ((time_ns.saturating_sub(last_ns)) as f64) < block_ns / 3.0
    }
}

/// Weight of sweep `k` of `count` in its block: 1 − ½·cos over the block, mean square 1.
pub fn taper(k: usize, count: usize) -> f64 {
    let turn = std::f64::consts::TAU * (k as f64 + 0.5) / count as f64;
    (1.0 - 0.5 * math::cos(turn)) / 1.125f64.sqrt()
}

/// Indices of the sweeps of each block, in time; each subsweep has blocks of its own.
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
        // An axis that lies wholly beyond.
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

//! Whole volumes on all cores: `ls` with cubic interpolation, any statistic from the oracle.

use glam::DVec3;
use rayon::prelude::*;

use super::compression::compress_all;
use super::{Oracle, Statistic, Volume};
use crate::geometry::Aabb;
use crate::radar::{Beam, Observation};

/// Σ |z|² over sweeps, LSB². Agrees with the oracle to 1 % of the volume's peak; the same bits on any number of threads,
/// since every voxel is summed in the order of the sweeps.
pub fn ls_volume(observations: &[Observation], beam: &Beam, region: &Aabb, voxel_m: f64) -> Volume {
    let compressed = compress_all(observations, |_| 1.0);
    fill(region, voxel_m, |place| {
        let each = observations.iter().zip(&compressed).map(|(observation, sweep)| {
            let distance_m = observation.distance_m(place);
            let counts = distance_m > 0.0
                && observation.geometry.axis.contains(distance_m)
                && beam.amplitude(observation.cos_off_boresight(place)) > 0.0;
            if counts { sweep.at(distance_m).norm_sqr() } else { 0.0 }
        });
        each.sum()
    })
}

/// Any statistic, place by place.
pub fn oracle_volume(oracle: &Oracle, statistic: Statistic, region: &Aabb, voxel_m: f64) -> Volume {
    fill(region, voxel_m, |place| oracle.value(statistic, place))
}

fn fill(region: &Aabb, voxel_m: f64, value: impl Fn(DVec3) -> f64 + Sync) -> Volume {
    let mut volume = Volume::covering(region, voxel_m);
    let mut values = std::mem::take(&mut volume.values);
    let (grid, row) = (&volume, volume.size[0]);
    values.par_chunks_mut(row).enumerate().for_each(|(n, values)| {
        for (i, out) in values.iter_mut().enumerate() {
            *out = value(grid.center(grid.voxel(n * row + i))) as f32;
        }
    });
    volume.values = values;
    volume
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::blocks::BlockSettings;
    use crate::imaging::test_data::{Echo, on_one_thread, sweeps, winding};

    #[test]
    fn the_fast_sum_agrees_with_the_oracle_on_any_number_of_threads() {
        let at = DVec3::new(0.1, 0.0, -1.2);
        let observations = sweeps(0.03, winding, &[(Echo::Point(at), 5.0)], 1);
        let region = Aabb { min: at - 0.4, max: at + 0.4 };
        let fast = ls_volume(&observations, &Beam::Lensless, &region, 0.1);
        let oracle = Oracle::new(&observations, &Beam::Lensless, &BlockSettings::default());
        let exact = oracle_volume(&oracle, Statistic::Ls, &region, 0.1);
        let peak = exact.peak().unwrap().1;
        assert!(fast.values.iter().zip(&exact.values).all(|(a, b)| (a - b).abs() <= 0.01 * peak));
        assert_eq!(on_one_thread(|| ls_volume(&observations, &Beam::Lensless, &region, 0.1)), fast);
    }
}

//! Volumes of any statistic, voxel by voxel from the oracle: the reference for fast volumes.

use rayon::prelude::*;

use super::{Oracle, Statistic, Volume};
use crate::geometry::Aabb;

/// Any statistic at every voxel's centre.
pub fn oracle_volume(oracle: &Oracle, statistic: Statistic, region: &Aabb, voxel_m: f64) -> Volume {
    let mut volume = Volume::covering(region, voxel_m);
    let mut values = std::mem::take(&mut volume.values);
    let (grid, row) = (&volume, volume.size[0]);
    values.par_chunks_mut(row).enumerate().for_each(|(n, values)| {
        for (i, out) in values.iter_mut().enumerate() {
            *out = oracle.value(statistic, grid.center(grid.voxel(n * row + i))) as f32;
        }
    });
    volume.values = values;
    volume
}

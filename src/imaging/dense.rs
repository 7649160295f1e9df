//! Whole volumes on all cores: `ls` with cubic interpolation, `blocks` by its kernel, any statistic from the oracle.

use glam::DVec3;
use rayon::prelude::*;

use super::blocks::{Block, BlockBuilder, BlockSettings, LANES, MEAN_LOG_OF_NOISE, Points};
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

/// Block score A/√B over a whole recording. Agrees with the oracle to 0.02 of the peak and 0.02; needs sweeps of one
/// subsweep in time, others are left out. Voxels that no block had in its beam are 0.
pub fn blocks_volume(
    observations: &[Observation],
    beam: &Beam,
    settings: &BlockSettings,
    region: &Aabb,
    voxel_m: f64,
) -> Volume {
    let Some(first) = observations.first() else { return Volume::covering(region, voxel_m) };
    let mut builder = BlockBuilder::new(*settings);
    let one_geometry = observations.iter().filter(|o| o.geometry.subsweep == first.geometry.subsweep);
    let mut blocks: Vec<Block> = one_geometry.filter_map(|o| builder.push(o.clone())).collect();
    blocks.extend(builder.close());
    let newest_ns = observations.iter().map(|o| o.mid_time_ns).max().unwrap_or(0);
    let min_cos = settings.min_cos(beam);
    let mut volume = Volume::covering(region, voxel_m);
    let mut values = std::mem::take(&mut volume.values);
    // Chunks of voxels are independent, and each sums its blocks in time: the same bits on any number of threads.
    values.par_chunks_mut(LANES * 16).enumerate().for_each(|(chunk, out)| {
        let center = |n: usize| volume.center(volume.voxel(chunk * LANES * 16 + n));
        let centers: Vec<DVec3> = (0..out.len()).map(center).collect();
        let mut sums = vec![(0.0f64, 0.0f64); out.len()];
        for block in &blocks {
            let seen: Vec<usize> =
                (0..out.len()).filter(|&n| settings.sees(&block.middle, min_cos, centers[n])).collect();
            let age_s = (newest_ns - block.mid_time_ns) as f64 * 1e-9;
            let rho = (-age_s / settings.memory_s).exp();
            for lanes in seen.chunks(LANES) {
                let relative = |&n: &usize| (centers[n] - block.middle.translation).as_vec3().to_array();
                let places: Vec<[f32; 3]> = lanes.iter().map(relative).collect();
                let coherence = block.coherence_at_points(&Points::of(&places));
                for (&n, m) in lanes.iter().zip(coherence.m) {
                    sums[n].0 += rho * (f64::from(m).ln_1p() - MEAN_LOG_OF_NOISE);
                    sums[n].1 += rho * rho;
                }
            }
        }
        for (value, (a, b)) in out.iter_mut().zip(sums) {
            *value = if b > 0.0 { (a / b.sqrt()) as f32 } else { 0.0 };
        }
    });
    volume.values = values;
    volume
}

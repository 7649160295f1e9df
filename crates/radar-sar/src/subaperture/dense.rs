//! Sub-aperture scores of a whole recording over a box: every voxel, every sub-aperture.

use glam::DVec3;
use rayon::prelude::*;

use super::{MEAN_LOG_OF_NOISE, Subaperture, SubapertureBuilder, SubapertureSettings};
use crate::Volume;
use crate::geometry::Aabb;
use crate::math;
use crate::{Beam, Observation};

/// Voxels that one task handles. Choice: enough work for a task to pay; results do not depend on
/// it.
const CHUNK: usize = 256;

/// A/√B at the time of the newest sweep.
///
/// Agrees with the oracle to 0.02 of the peak plus 0.02. Uses the sweeps of the first one's
/// subsweep, which must be in time order; others are left out. The value is 0 where no sub-aperture
/// had a voxel in its beam. The result has the same bits on any number of threads: voxels are
/// independent, and each sums its sub-apertures in time order.
pub fn subaperture_volume(
    observations: &[Observation],
    beam: &Beam,
    settings: &SubapertureSettings,
    region: &Aabb,
    voxel_m: f64,
) -> Volume {
    let mut volume = Volume::covering(region, voxel_m);
    let Some(first) = observations.first() else { return volume };
    let mut builder = SubapertureBuilder::new(*settings);
    let one_geometry = observations.iter().filter(|o| o.geometry.subsweep == first.geometry.subsweep);
    let mut blocks: Vec<Subaperture> = one_geometry.filter_map(|o| builder.push(o.clone())).collect();
    blocks.extend(builder.close());
    let newest_ns = observations.iter().map(|o| o.mid_time_ns).max().unwrap_or(0);
    let min_cos = settings.min_cos(beam);
    let mut values = std::mem::take(&mut volume.values);
    values.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, out)| {
        let centers: Vec<DVec3> = (0..out.len()).map(|n| volume.center(volume.voxel(chunk * CHUNK + n))).collect();
        let mut sums = vec![(0.0f64, 0.0f64); out.len()];
        for block in &blocks {
            let settings = settings.within(&block.geometry().axis);
            let seen: Vec<usize> =
                (0..out.len()).filter(|&n| settings.sees(&block.middle, min_cos, centers[n])).collect();
            let relative = |&n: &usize| (centers[n] - block.middle.translation).as_vec3().to_array();
            let places: Vec<[f32; 3]> = seen.iter().map(relative).collect();
            let age_s = (newest_ns - block.mid_time_ns) as f64 * 1e-9;
            let rho = math::exp(-age_s / settings.decay_s);
            for (n, coherence) in seen.into_iter().zip(block.coherence_at_points(&places)) {
                sums[n].0 += rho * (math::ln_1p(f64::from(coherence.m)) - MEAN_LOG_OF_NOISE);
                sums[n].1 += rho * rho;
            }
        }
        for (value, (a, b)) in out.iter_mut().zip(sums) {
            *value = if b > 0.0 { (a / b.sqrt()) as f32 } else { 0.0 };
        }
    });
    volume.values = values;
    volume
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_data::{Echo, on_one_thread, sweeps, winding};
    use crate::{Oracle, Statistic, oracle_volume};

    #[test]
    fn the_volume_agrees_with_the_oracle_on_any_number_of_threads() {
        let at = DVec3::new(0.1, 0.0, -1.2);
        let observations = sweeps(0.4, winding, &[(Echo::Point(at), 5.0)], 1);
        let (beam, settings) = (Beam::Lensless, SubapertureSettings::default());
        let region = Aabb { min: at - 0.3, max: at + 0.3 };
        let fast = subaperture_volume(&observations, &beam, &settings, &region, 0.1);
        let exact = oracle_volume(&Oracle::new(&observations, &beam, &settings), Statistic::Subaperture, &region, 0.1);
        let tolerance = 0.02 * exact.peak().unwrap().1 + 0.02;
        for (a, b) in fast.values.iter().zip(&exact.values) {
            assert!((a - b).abs() <= tolerance, "{a} {b}");
        }
        assert_eq!(on_one_thread(|| subaperture_volume(&observations, &beam, &settings, &region, 0.1)), fast);
    }
}

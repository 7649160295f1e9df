//! Voxels with evidence for display: more than the evidence that became an obstacle.

use glam::{DVec3, Vec3};
use radar_sar::geometry::Pose;

/// Scores of voxels, the highest first.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Evidence {
    /// Edge of a voxel, metres.
    pub voxel_m: f64,
    /// Centres, tracking frame, metres, and scores. Single precision, because many are kept.
    pub voxels: Vec<(Vec3, f32)>,
}

impl Evidence {
    /// The `most` highest of these. Equal scores are ordered by position. Non-finite ones are
    /// dropped.
    pub fn strongest(voxel_m: f64, mut voxels: Vec<(DVec3, f32)>, most: usize) -> Self {
        voxels.retain(|(point, score)| point.is_finite() && score.is_finite());
        let order = |a: &(DVec3, f32), b: &(DVec3, f32)| {
            let by_position = a.0.x.total_cmp(&b.0.x).then(a.0.y.total_cmp(&b.0.y)).then(a.0.z.total_cmp(&b.0.z));
            b.1.total_cmp(&a.1).then(by_position)
        };
        voxels.sort_unstable_by(order);
        voxels.truncate(most);
        Self { voxel_m, voxels: voxels.into_iter().map(|(point, score)| (point.as_vec3(), score)).collect() }
    }

    /// The same in another frame.
    pub(crate) fn moved(mut self, to_from: &Pose) -> Self {
        let moved = |at: Vec3| to_from.transform_point(at.as_dvec3()).as_vec3();
        self.voxels.iter_mut().for_each(|(at, _)| *at = moved(*at));
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strongest_keeps_highest_scores_and_drops_non_finite() {
        let voxels = [1.0, f32::NAN, 3.0, 2.0, 3.0].into_iter().enumerate();
        let voxels: Vec<_> = voxels.map(|(n, score)| (DVec3::X * -(n as f64), score)).collect();
        let kept = Evidence::strongest(0.05, voxels, 3);
        assert_eq!(
            kept.voxels.iter().map(|v| (v.0.x, v.1)).collect::<Vec<_>>(),
            [(-4.0, 3.0), (-2.0, 3.0), (-3.0, 2.0)]
        );
    }
}

//! Position refinement of tracks: the sub-aperture score's position, at the greatest fine voxel,
//! and that of `ls`, weighted by their covariances.

use glam::{DMat3, DVec3};

use super::super::Detection;
use super::shapes::Shape;
use super::{FINE_EDGE_M, PEAK_RADIUS_M, RefinedPoint, RoomMapper};
use radar_sar::Observation;
use radar_sar::geometry::{Aabb, Plane};
use radar_sar::{RangePower, Refined, farthest_points, refine};

/// Most sweeps of the window used by `ls` for one point, chosen by farthest point (choice).
const REFINE_SWEEPS: usize = 150;
/// Farthest that `ls` may move a point, metres (choice): a voxel and a half.
const REFINE_REACH_M: f64 = 0.075;

impl RoomMapper {
    /// The greatest fine voxel around a point and the shape around it, when the point is imaged
    /// finely.
    fn fine_maximum(&mut self, at: DVec3) -> Option<(DVec3, Shape)> {
        let around = Aabb { min: at - FINE_EDGE_M * 0.5, max: at + FINE_EDGE_M * 0.5 };
        let voxels = self.fine.above_within(&around, 0.0, &self.window.iter().collect::<Vec<_>>())?;
        let greatest = voxels.iter().reduce(|a, b| if b.score > a.score { b } else { a })?;
        Some((greatest.position_m, Shape::of_fine(&voxels)))
    }

    /// Refines confirmed tracks whose quality has improved.
    pub(super) fn refine_new(&mut self, walls: &[Detection<Plane>], points: &[Detection<DVec3>]) {
        let stale: Vec<(u64, DVec3, f64, f64)> = self
            .points
            .confirmed()
            .filter(|s| self.refined.get(&s.id).is_none_or(|(quality, _)| *quality < s.quality))
            .map(|s| (s.id, s.estimate, s.quality, s.score))
            .collect();
        for (id, at, quality, score) in stale {
            let (at, shape) = self.fine_maximum(at).unwrap_or_else(|| (at, self.coarse_shape(at, score)));
            let (position_m, covariance_m2) = self.refined_position(at, walls, points);
            self.refined.insert(id, (quality, RefinedPoint { position_m, covariance_m2, shape }));
        }
    }

    /// The position of the sub-aperture score and that of `ls`, weighted by their covariances.
    fn refined_position(&self, at: DVec3, walls: &[Detection<Plane>], points: &[Detection<DVec3>]) -> (DVec3, DMat3) {
        let block_variance = (self.settings.blocks.voxel_m * 0.5).powi(2);
        let by_blocks = (at, DMat3::from_diagonal(DVec3::splat(block_variance)));
        let Some(by_ls) = self.refined_by_ls(at, walls, points) else { return by_blocks };
        let (block_information, ls_information) = (by_blocks.1.inverse(), by_ls.covariance_m2.inverse());
        let covariance_m2 = (block_information + ls_information).inverse();
        let position_m = covariance_m2 * (block_information * at + ls_information * by_ls.position_m);
        (position_m, (covariance_m2 + covariance_m2.transpose()) * 0.5)
    }

    fn refined_by_ls(&self, at: DVec3, walls: &[Detection<Plane>], points: &[Detection<DVec3>]) -> Option<Refined> {
        let blocks = &self.settings.blocks;
        let sees = |o: &&Observation| blocks.within(&o.geometry.axis).sees(&o.tracking_from_sensor, self.min_cos, at);
        let sweeps = self.sweeps.iter().take(self.sweeps.len() - self.sweeps_since.min(self.sweeps.len()));
        let seen: Vec<&Observation> = sweeps.filter(sees).collect();
        let positions: Vec<DVec3> = seen.iter().map(|o| o.tracking_from_sensor.translation).collect();
        let chosen: Vec<Observation> =
            farthest_points(&positions, REFINE_SWEEPS).into_iter().map(|n| seen[n].clone()).collect();
        let mut power = RangePower::new(&chosen, &self.beam, self.settings.blocks.min_range_m);
        for other in points.iter().filter(|p| p.estimate.distance(at) > PEAK_RADIUS_M) {
            power.mask_point(other.estimate);
        }
        for wall in walls {
            power.mask_plane(&wall.estimate);
        }
        refine(&power, at, Some(REFINE_REACH_M), &self.errors)
    }
}

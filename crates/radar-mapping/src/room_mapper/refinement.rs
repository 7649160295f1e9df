//! Position refinement of tracks: the sub-aperture score's position, at the greatest fine voxel,
//! and that of `ls`, weighted by their covariances.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::PEAK_RADIUS_M;
use super::config::RoomConfig;
use super::imaging::Imaging;
use super::intake::SweepIntake;
use super::objects::{ObjectMap, RefinedPoint};
use super::window::Window;
use crate::Detection;
use radar_sar::Observation;
use radar_sar::geometry::Plane;
use radar_sar::{RangePower, Refined, farthest_points, refine};

/// Most sweeps of the window used by `ls` for one point, chosen by farthest point. Choice: more
/// cost time and gain little: in simulation at 20 dB the error of `ls` is 4.1 mm with 50 sweeps,
/// 2.2 with 200 and 2.1 with 1200.
const REFINE_SWEEPS: usize = 150;
/// Most sweeps that these are chosen of, evenly spaced in time. Choice: 4 ms apart in a window of 4 s, in which a head moves as
/// many millimetres; choosing takes time in proportion.
const REFINE_CANDIDATES: usize = 1000;
/// 1σ of the position that the sub-apertures' score gives, in each direction, metres. Choice: tracking and mount leave about 2 cm.
const SUBAPERTURE_SIGMA_M: f64 = 0.025;
/// Farthest that `ls` may move a point, metres. Choice: three times its 1σ by the sub-apertures.
const REFINE_REACH_M: f64 = 0.075;

/// What positions are refined from.
pub(super) struct Refinement<'a> {
    pub config: &'a RoomConfig,
    pub window: &'a Window,
    pub intake: &'a SweepIntake,
    /// Detections of the update, whose ranges are masked for each other.
    pub walls: &'a [Detection<Plane>],
    pub points: &'a [Detection<DVec3>],
}

impl Refinement<'_> {
    /// Refines confirmed tracks whose quality has improved.
    pub fn update(&self, objects: &mut ObjectMap, imaging: &mut Imaging) {
        let stale = objects.stale();
        let is_fine = imaging.update_fine(stale.iter().map(|track| track.estimate), self.window);
        let imaging = &*imaging;
        let refined = stale.par_iter().zip(is_fine).map(|(track, is_fine)| {
            let coarse = || (track.estimate, imaging.coarse_shape(track.estimate, track.score));
            let (at, shape) = is_fine.then(|| imaging.fine_maximum(track.estimate)).flatten().unwrap_or_else(coarse);
            let (position_m, covariance_m2) = self.refined_position(at);
            RefinedPoint { position_m, covariance_m2, shape }
        });
        let refined: Vec<RefinedPoint> = refined.collect();
        stale.iter().zip(refined).for_each(|(track, refined)| objects.set_refined(track, refined));
    }

    /// The position of the sub-aperture score and that of `ls`, weighted by their covariances.
    fn refined_position(&self, at: DVec3) -> (DVec3, DMat3) {
        let by_subapertures = (at, DMat3::from_diagonal(DVec3::splat(SUBAPERTURE_SIGMA_M.powi(2))));
        let Some(by_ls) = self.refined_by_ls(at) else { return by_subapertures };
        let (subaperture_information, ls_information) = (by_subapertures.1.inverse(), by_ls.covariance_m2.inverse());
        let covariance_m2 = (subaperture_information + ls_information).inverse();
        let position_m = covariance_m2 * (subaperture_information * at + ls_information * by_ls.position_m);
        (position_m, (covariance_m2 + covariance_m2.transpose()) * 0.5)
    }

    fn refined_by_ls(&self, at: DVec3) -> Option<Refined> {
        let subapertures = &self.config.settings.subapertures;
        let sees = |o: &&Observation| {
            subapertures.within(&o.geometry.axis).sees(&o.tracking_from_sensor, self.config.min_cos, at)
        };
        let seen: Vec<&Observation> = self.intake.window_sweeps().filter(sees).collect();
        let seen: Vec<_> = seen.iter().step_by(seen.len().div_ceil(REFINE_CANDIDATES).max(1)).copied().collect();
        let positions: Vec<DVec3> = seen.iter().map(|o| o.tracking_from_sensor.translation).collect();
        let chosen: Vec<Observation> =
            farthest_points(&positions, REFINE_SWEEPS).into_iter().map(|n| seen[n].clone()).collect();
        let mut power = RangePower::new(&chosen, &self.config.beam, self.config.settings.subapertures.min_range_m);
        for other in self.points.iter().filter(|p| p.estimate.distance(at) > PEAK_RADIUS_M) {
            power.mask_point(other.estimate);
        }
        for wall in self.walls {
            power.mask_plane(&wall.estimate);
        }
        refine(&power, at, Some(REFINE_REACH_M), &self.config.errors)
    }
}

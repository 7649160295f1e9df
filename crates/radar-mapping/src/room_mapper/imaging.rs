//! Second stage: the score fields that sub-apertures are summed into.

use glam::DVec3;
use radar_sar::geometry::{Aabb, Plane};
use radar_sar::subaperture::{Field, FineField, Peak, PlaneField, PlanePeak, Subaperture};

use super::config::RoomConfig;
use super::shapes::Shape;
use super::window::Window;
use super::{FINE_EDGE_M, PEAK_RADIUS_M};
use crate::{Detection, Evidence};

/// Coarse, fine and plane scores.
#[derive(Debug)]
pub(super) struct Imaging {
    field: Field,
    fine: FineField,
    planes: PlaneField,
    voxel_m: f64,
}

impl Imaging {
    pub fn new(config: &RoomConfig) -> Self {
        let (settings, min_cos) = (&config.settings, config.min_cos);
        Self {
            field: Field::new(settings.subapertures, min_cos),
            fine: FineField::new(settings.fine, settings.subapertures, min_cos),
            planes: PlaneField::new(settings.subapertures, config.plane_min_cos),
            voxel_m: settings.subapertures.voxel_m,
        }
    }

    /// (voxel, sweep) pairs summed, and bricks ever in the beam.
    pub fn work(&self) -> (u64, u64) {
        (self.field.updates, self.field.brick_count() as u64)
    }

    /// The scores on fine voxels, where something is.
    pub fn fine(&self) -> &FineField {
        &self.fine
    }

    /// Adds a sub-aperture.
    pub fn add(&mut self, subaperture: &Subaperture) {
        let Self { field, fine, planes, .. } = self;
        // Walls are searched in the sub-aperture as it was measured, with the known ones in it.
        let add_to_planes = || planes.add(subaperture.uncancelled());
        rayon::join(|| field.add(subaperture), || rayon::join(add_to_planes, || fine.push_subaperture(subaperture)));
    }

    /// A sub-aperture has left the window.
    pub fn leave(&mut self) {
        self.fine.pop_subaperture();
    }

    /// Local maxima of planes and points since a time, by falling score.
    pub fn peaks(&mut self, config: &RoomConfig, since_ns: i64) -> (Vec<PlanePeak>, Vec<Peak>) {
        let clean = config.settings.clean;
        let planes = self.planes.peaks(clean.plane_min_score, clean.plane_min_subapertures, since_ns);
        (planes, self.field.peaks(clean.min_candidate_score, PEAK_RADIUS_M, since_ns))
    }

    /// The planes and points to test, of an update's maxima.
    pub fn candidates(&self, planes: &[PlanePeak], peaks: &[Peak], config: &RoomConfig) -> (Vec<Plane>, Vec<DVec3>) {
        let most = config.settings.clean.max_candidates;
        let points = peaks.iter().take(most).map(|peak| self.field.summit(peak));
        (planes.iter().map(|peak| peak.plane).collect(), points.collect())
    }

    /// Every voxel that was ever seen and scores at least `min_score`, the `most` highest.
    pub fn evidence(&self, min_score: f64, most: usize) -> Evidence {
        let peaks = self.field.above(min_score, i64::MIN);
        let voxels = peaks.into_iter().map(|peak| (peak.position_m, peak.score as f32)).collect();
        Evidence::strongest(self.voxel_m, voxels, most)
    }

    /// Keeps the fine field around known objects and around detections that may soon be confirmed:
    /// those that are observable and strong enough.
    pub fn request_fine(
        &mut self,
        known: impl Iterator<Item = DVec3>,
        detections: &[Detection<DVec3>],
        config: &RoomConfig,
    ) {
        let min_score = config.settings.fine.min_score;
        let strong = detections.iter().filter(|p| p.observable && p.score >= min_score).map(|p| p.estimate);
        let points: Vec<DVec3> = known.chain(strong).collect();
        self.fine.request(&points, FINE_EDGE_M);
    }

    /// Brings the fine field up to date around points, one after the other; false for a point that has to wait.
    pub fn update_fine(&mut self, places: impl Iterator<Item = DVec3>, window: &Window) -> Vec<bool> {
        let regions: Vec<Aabb> = places.map(fine_region).collect();
        self.fine.update_around(&regions, &window.iter().collect::<Vec<_>>())
    }

    /// The greatest fine voxel around a point and the shape around it, when the point is imaged
    /// finely.
    pub fn fine_maximum(&self, at: DVec3) -> Option<(DVec3, Shape)> {
        let voxels = self.fine.above_within(&fine_region(at), 0.0);
        let greatest = voxels.iter().reduce(|a, b| if b.score > a.score { b } else { a })?;
        Some((greatest.position_m, Shape::of_fine(&voxels)))
    }

    /// The voxels around a track that score at least three quarters of its score, for where no fine
    /// voxels are open.
    pub fn coarse_shape(&self, point: DVec3, score: f64) -> Shape {
        Shape::around(point, score, self.voxel_m, |center| self.field.score_at(center))
    }

    /// Edge of a coarse voxel, metres.
    pub fn voxel_m(&self) -> f64 {
        self.voxel_m
    }
}

/// The cube around a point that is imaged finely.
fn fine_region(at: DVec3) -> Aabb {
    Aabb { min: at - FINE_EDGE_M * 0.5, max: at + FINE_EDGE_M * 0.5 }
}

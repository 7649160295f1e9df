//! Which points a sub-aperture has in its beam: bounding spheres first, then layers of voxels one
//! by one.

use glam::DVec3;

use super::super::{Subaperture, SubapertureSettings};
use crate::simd::{Kernel, LANES, Lanes, on_widest};

/// How much of a sphere is in the beam of a sub-aperture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Coverage {
    None,
    Some,
    All,
}

/// A sub-aperture and its beam.
pub(super) struct BeamView<'a> {
    pub block: &'a Subaperture,
    /// Limited to the sub-aperture's range axis.
    pub settings: SubapertureSettings,
    min_cos: f64,
    /// Sine of the widest angle in the beam.
    max_sin: f64,
    forward: DVec3,
}

impl<'a> BeamView<'a> {
    pub fn new(block: &'a Subaperture, settings: &SubapertureSettings, min_cos: f64) -> Self {
        let settings = settings.within(&block.geometry().axis);
        let max_sin = (1.0 - min_cos * min_cos).max(0.0).sqrt();
        Self { block, settings, min_cos, max_sin, forward: block.middle.forward() }
    }

    /// Conservative: `None` and `All` are certain.
    pub fn sphere_coverage(&self, middle: DVec3, radius_m: f64) -> Coverage {
        let radius_m = radius_m + 1e-9;
        let to = middle - self.block.middle.translation;
        let (distance_m, along_m) = (to.length(), to.dot(self.forward));
        let across_m = (distance_m * distance_m - along_m * along_m).max(0.0).sqrt();
        // Distance outside the beam's cone, from its surface.
        let outside_m = across_m * self.min_cos - along_m * self.max_sin;
        let SubapertureSettings { min_range_m, max_range_m, .. } = self.settings;
        if outside_m > radius_m || distance_m > max_range_m + radius_m || distance_m + radius_m < min_range_m {
            Coverage::None
        } else if outside_m < -radius_m && distance_m + radius_m < max_range_m && distance_m - radius_m > min_range_m {
            Coverage::All
        } else {
            Coverage::Some
        }
    }
}

impl BeamView<'_> {
    /// Which voxels of a layer are in the beam, lane 0 at `corner`: [`SubapertureSettings::sees`] for
    /// sixteen at a time.
    pub fn layer_coverage(&self, corner: DVec3) -> [bool; LANES] {
        on_widest(CoverLayer { view: self, corner })
    }
}

struct CoverLayer<'a> {
    view: &'a BeamView<'a>,
    corner: DVec3,
}

impl Kernel for CoverLayer<'_> {
    type Out = [bool; LANES];

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) -> [bool; LANES] {
        let BeamView { settings, forward, min_cos, block, .. } = self.view;
        let to = self.corner - block.middle.translation;
        let (min2, max2) = (settings.min_range_m * settings.min_range_m, settings.max_range_m * settings.max_range_m);
        let cos2 = min_cos * min_cos.abs();
        let mut seen = [false; LANES];
        for l in 0..LANES {
            let (x, y) = (to.x + COLUMN[l] * settings.voxel_m, to.y + ROW[l] * settings.voxel_m);
            let along = x * forward.x + y * forward.y + to.z * forward.z;
            let distance2 = x * x + y * y + to.z * to.z;
            seen[l] = (distance2 >= min2) & (distance2 <= max2) & (along * along.abs() >= cos2 * distance2);
        }
        seen
    }
}

/// Position of a lane in a layer of 4 × 4.
const COLUMN: [f64; LANES] = [0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0];
const ROW: [f64; LANES] = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0];

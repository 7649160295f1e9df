//! A box of voxels with one value each.

use glam::DVec3;

use crate::geometry::Aabb;

/// Values on a regular grid. The centre of voxel (i, j, k) along x, y, z lies at `origin_m + (i +
/// ½, j + ½, k + ½) · voxel_m`.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    /// Lowest corner of the box, tracking frame, metres.
    pub origin_m: DVec3,
    /// Edge of a voxel, metres.
    pub voxel_m: f64,
    /// Number of voxels along x, y, z.
    pub size: [usize; 3],
    /// Values, `[z][y][x]`: x runs fastest.
    pub values: Vec<f32>,
}

impl Volume {
    /// All zero, covering a box; the last voxels may extend beyond it.
    pub fn covering(region: &Aabb, voxel_m: f64) -> Self {
        let size = Self::size_covering(region, voxel_m);
        Self { origin_m: region.min, voxel_m, size, values: vec![0.0; size.iter().product()] }
    }

    /// Number of voxels along x, y, z that cover a box; the last ones may extend beyond it.
    pub fn size_covering(region: &Aabb, voxel_m: f64) -> [usize; 3] {
        (region.size() / voxel_m - 1e-9).ceil().max(DVec3::ONE).to_array().map(|n| n as usize)
    }

    /// Index into `values` of voxel (i, j, k).
    pub fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.size[1] + j) * self.size[0] + i
    }

    /// Voxel (i, j, k) of an index into `values`.
    ///
    /// # Panics
    /// `self.size[0] * self.size[1] == 0`.
    pub fn voxel(&self, index: usize) -> [usize; 3] {
        [index % self.size[0], index / self.size[0] % self.size[1], index / (self.size[0] * self.size[1])]
    }

    /// Centre of a voxel, metres.
    pub fn center(&self, voxel: [usize; 3]) -> DVec3 {
        self.origin_m + (DVec3::from_array(voxel.map(|n| n as f64)) + 0.5) * self.voxel_m
    }

    /// The box it covers.
    pub fn region(&self) -> Aabb {
        let size = DVec3::from_array(self.size.map(|n| n as f64)) * self.voxel_m;
        Aabb { min: self.origin_m, max: self.origin_m + size }
    }

    /// The greatest value and where it is; `None` when nothing is above 0.
    pub fn peak(&self) -> Option<(usize, f32)> {
        let best = self.values.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
        (best.1 > 0.0).then_some(best)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_and_voxels_are_inverse_and_x_runs_fastest() {
        let region = Aabb { min: DVec3::new(-1.0, 0.0, 2.0), max: DVec3::new(0.0, 0.5, 2.3) };
        let volume = Volume::covering(&region, 0.1);
        assert_eq!(volume.size, [10, 5, 3]);
        assert_eq!(volume.index([1, 0, 0]), 1);
        for index in 0..volume.values.len() {
            assert_eq!(volume.index(volume.voxel(index)), index);
        }
        assert!((volume.center([0, 4, 2]) - DVec3::new(-0.95, 0.45, 2.25)).length() < 1e-12);
    }
}

//! A volume as bricks of 4 × 4 × 4 voxels. All algorithms (dense, adaptive, rolling) work on the
//! same bricks, so a voxel's value does not depend on the algorithm.

use glam::DVec3;

use super::brick_geometry::EDGE;
use crate::Volume;
use crate::geometry::Aabb;

/// Layout of the voxels and bricks of a box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrickGrid {
    /// Lowest corner of the box, tracking frame, metres.
    pub origin_m: DVec3,
    /// Edge of a voxel, metres.
    pub voxel_m: f64,
    /// Voxels along x, y, z.
    pub size: [usize; 3],
}

impl BrickGrid {
    /// Covers a box, with the layout of [`Volume::covering`].
    pub fn covering(region: &Aabb, voxel_m: f64) -> Self {
        Self { origin_m: region.min, voxel_m, size: Volume::size_covering(region, voxel_m) }
    }

    /// Bricks along x, y, z; the last ones may extend beyond the box.
    pub fn bricks(&self) -> [usize; 3] {
        self.size.map(|n| n.div_ceil(EDGE))
    }

    /// Total number of voxels.
    pub fn voxels(&self) -> usize {
        self.size.iter().product()
    }

    /// Centre of the box: the origin of kernel coordinates.
    pub fn middle_m(&self) -> DVec3 {
        self.origin_m + DVec3::from_array(self.size.map(|n| n as f64)) * (0.5 * self.voxel_m)
    }

    /// Centre of a brick relative to `from`, metres.
    pub(super) fn brick_center(&self, brick: [usize; 3], from: DVec3) -> [f32; 3] {
        let voxels = DVec3::from_array(brick.map(|n| (n * EDGE) as f64 + EDGE as f64 * 0.5));
        (self.origin_m - from + voxels * self.voxel_m).as_vec3().to_array()
    }

    /// Centres of the bricks along each axis relative to `from`, metres.
    pub(super) fn brick_centers(&self, from: DVec3) -> [Vec<f32>; 3] {
        let along = |axis: usize| (0..self.bricks()[axis]).map(|n| self.brick_center([n; 3], from)[axis]).collect();
        [along(0), along(1), along(2)]
    }

    /// Voxels of a brick within the box: (index in the brick, index into a volume's values).
    pub(super) fn voxels_of(&self, brick: [usize; 3]) -> impl Iterator<Item = (usize, usize)> + use<> {
        let [nx, ny, nz] = self.size;
        let first = brick.map(|n| n * EDGE);
        (0..EDGE * EDGE * EDGE).filter_map(move |n| {
            let [x, y, z] = [first[0] + n % EDGE, first[1] + n / EDGE % EDGE, first[2] + n / (EDGE * EDGE)];
            (x < nx && y < ny && z < nz).then_some((n, (z * ny + y) * nx + x))
        })
    }

    /// A zero volume with this layout.
    pub fn volume(&self) -> Volume {
        Volume { origin_m: self.origin_m, voxel_m: self.voxel_m, size: self.size, values: vec![0.0; self.voxels()] }
    }
}

//! Shapes of tracks.
//!
//! The shape of a track is the fine voxels around its position that score at least three quarters
//! of the greatest. This image is coherent within each sub-aperture and summed over the window. It
//! is made when the position is refined, so it sharpens when the object is seen better and stays as
//! it is in between. Cells of 4 cm are few enough to compute distances to at every frame that is
//! drawn.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use glam::{DVec3, IVec3};
use radar_sar::subaperture::Peak;

/// Edge of a shape's cell, metres. Choice: each frame of the headset measures its distance to every
/// cell, and 4 cm are as fine as a warning is drawn; cells of 1 cm would be 64 times as many.
pub(super) const CELL_M: f64 = 0.04;
/// Share of the greatest score that a voxel of the shape has at least. Choice: −1.2 dB; lower
/// values take the sides of the peak, as wide as the aperture resolves, for the object.
const MIN_SCORE_SHARE: f64 = 0.75;

/// The cells with evidence of a track: centres and scores. All shapes share one lattice.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shape {
    pub cells: Vec<(DVec3, f32)>,
}

impl Shape {
    /// Of the fine voxels around a point: the greatest score in each cell.
    pub fn of_fine(voxels: &[Peak]) -> Self {
        let greatest = voxels.iter().map(|voxel| voxel.score).fold(0.0, f64::max);
        let strong = voxels.iter().filter(|voxel| voxel.score >= MIN_SCORE_SHARE * greatest);
        Self::of_cells(strong.map(|voxel| (cell_of(voxel.position_m), voxel.score)))
    }

    /// Of the coarse voxels of this edge around a point that score at least three quarters of its
    /// score.
    pub fn around(point: DVec3, score: f64, voxel_m: f64, score_at: impl Fn(DVec3) -> Option<f64>) -> Self {
        let offset = |n: i32| DVec3::new(f64::from(n % 3 - 1), f64::from(n / 3 % 3 - 1), f64::from(n / 9 - 1));
        let center = |n| ((point / voxel_m).floor() + offset(n) + 0.5) * voxel_m;
        let scores = (0..27).map(center).filter_map(|center| Some((center, score_at(center)?)));
        Self::of_voxels(scores.filter(|(_, here)| *here >= MIN_SCORE_SHARE * score), voxel_m)
    }

    /// Of voxels of this edge: the cells whose centres lie in one, at least one for each voxel and
    /// at most three along an edge.
    fn of_voxels(voxels: impl Iterator<Item = (DVec3, f64)>, voxel_m: f64) -> Self {
        let cells = voxels.flat_map(|(middle, score)| {
            let [low, high] =
                [-0.5, 0.5].map(|side| cell_of(middle + side * (voxel_m - CELL_M).clamp(0.0, 2.0 * CELL_M)));
            let along = move |axis: usize| low[axis]..=high[axis];
            along(0).flat_map(move |x| along(1).flat_map(move |y| along(2).map(move |z| (IVec3::new(x, y, z), score))))
        });
        Self::of_cells(cells)
    }

    /// The greatest score in each cell.
    fn of_cells(cells: impl Iterator<Item = (IVec3, f64)>) -> Self {
        let mut greatest: BTreeMap<[i32; 3], f32> = BTreeMap::new();
        for (cell, score) in cells {
            let best = greatest.entry(cell.to_array()).or_default();
            *best = best.max(score as f32);
        }
        Self { cells: greatest.into_iter().map(|(cell, score)| (center_of(IVec3::from(cell)), score)).collect() }
    }

    /// The `most` highest-scoring cells.
    pub fn strongest(mut self, most: usize) -> Vec<(DVec3, f32)> {
        self.cells.sort_by(by_falling_score);
        self.cells.truncate(most);
        self.cells
    }
}

/// The cell that contains a point.
pub(super) fn cell_of(point: DVec3) -> IVec3 {
    (point / CELL_M).floor().as_ivec3()
}

/// Centre of a cell.
pub(super) fn center_of(cell: IVec3) -> DVec3 {
    (cell.as_dvec3() + 0.5) * CELL_M
}

/// Higher score first, equal scores by position.
pub(super) fn by_falling_score(a: &(DVec3, f32), b: &(DVec3, f32)) -> Ordering {
    let by_position = |a: &DVec3, b: &DVec3| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z));
    b.1.total_cmp(&a.1).then_with(|| by_position(&a.0, &b.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shape_keeps_cells_near_the_greatest_score() {
        let voxel = |x: f64, score: f64| Peak { position_m: DVec3::new(x, 0.005, 0.005), score };
        let shape = Shape::of_fine(&[voxel(0.005, 6.0), voxel(0.025, 8.0), voxel(0.045, 6.0), voxel(0.085, 5.9)]);
        assert_eq!(shape.cells, [(DVec3::splat(0.02), 8.0), (DVec3::new(0.06, 0.02, 0.02), 6.0)]);
        assert_eq!(Shape::of_fine(&[]).cells, []);
    }

    #[test]
    fn coarse_voxels_are_split_into_cells() {
        let cells = |middles: &[DVec3], voxel_m: f64| {
            Shape::of_voxels(middles.iter().map(|middle| (*middle, 5.0)), voxel_m).cells.len()
        };
        // 20 cm are four voxels of 5 cm and five cells of 4 cm: none is left out between them or
        // comes twice.
        let row: Vec<DVec3> = (0..4).map(|n| DVec3::new(0.05 * f64::from(n) + 0.025, 0.02, 0.02)).collect();
        assert_eq!(cells(&row, 0.05), 5);
        assert_eq!(cells(&[DVec3::splat(0.05)], 0.02), 1, "of a voxel smaller than a cell");
        assert_eq!(cells(&[DVec3::splat(0.06)], 0.12), 27);
    }
}

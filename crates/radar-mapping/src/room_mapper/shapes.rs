//! Obstacles from tracks: tracks near each other are one obstacle, with the shapes of all.
//!
//! The shape of a track is the fine voxels around its position that score at least three quarters
//! of the greatest. This image is coherent within each sub-aperture and summed over the window. It
//! is made when the position is refined, so it sharpens when the object is seen better and stays as
//! it is in between. Cells of 4 cm are few enough to compute distances to at every frame that is
//! drawn.

use std::cmp::Ordering;
use std::collections::{BTreeMap, HashSet};

use glam::{DMat3, DVec3, IVec3};

use super::{RefinedPoint, RoomMapper};
use crate::{Observed, Obstacle, Track};
use radar_sar::geometry::Aabb;
use radar_sar::subaperture::Peak;

/// Tracks nearer to each other than this are one obstacle, metres (choice).
const CLUSTER_M: f64 = 0.30;
/// Edge of a shape's cell, metres (choice).
const CELL_M: f64 = 0.04;
/// Share of the greatest score that a voxel of the shape has at least (choice).
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
fn cell_of(place: DVec3) -> IVec3 {
    (place / CELL_M).floor().as_ivec3()
}

fn center_of(cell: IVec3) -> DVec3 {
    (cell.as_dvec3() + 0.5) * CELL_M
}

/// Higher score first, equal scores by position.
fn by_falling_score(a: &(DVec3, f32), b: &(DVec3, f32)) -> Ordering {
    let by_place = |a: &DVec3, b: &DVec3| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z));
    b.1.total_cmp(&a.1).then_with(|| by_place(&a.0, &b.0))
}

impl RoomMapper {
    /// The voxels around a track that score at least three quarters of its score, for where no fine
    /// voxels are at hand.
    pub(super) fn coarse_shape(&self, place: DVec3, score: f64) -> Shape {
        let voxel_m = self.settings.blocks.voxel_m;
        let offset = |n: i32| DVec3::new(f64::from(n % 3 - 1), f64::from(n / 3 % 3 - 1), f64::from(n / 9 - 1));
        let center = |n| ((place / voxel_m).floor() + offset(n) + 0.5) * voxel_m;
        let scores = (0..27).map(center).filter_map(|center| Some((center, self.field.score_at(center)?)));
        Shape::of_voxels(scores.filter(|(_, here)| *here >= MIN_SCORE_SHARE * score), voxel_m)
    }

    /// The refined position of a track, or a coarse one if it was not refined.
    pub(super) fn refined_point_of(&self, track: &Track<DVec3>) -> RefinedPoint {
        let unrefined = || RefinedPoint {
            position_m: track.estimate,
            covariance_m2: DMat3::from_diagonal(DVec3::splat(self.settings.blocks.voxel_m.powi(2))),
            shape: self.coarse_shape(track.estimate, track.score),
        };
        self.refined.get(&track.id).map_or_else(unrefined, |(_, place)| place.clone())
    }

    /// Confirmed obstacles, by falling evidence. Tracks near each other belong to one obstacle,
    /// which has the position of the strongest.
    pub fn obstacles(&self) -> Vec<Obstacle> {
        let mut tracks: Vec<_> = self.points.confirmed().collect();
        tracks.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.id.cmp(&b.id)));
        let mut obstacles: Vec<Obstacle> = Vec::new();
        for track in tracks {
            let place = self.refined_point_of(track);
            let near = |o: &&mut Obstacle| o.position_m.distance(place.position_m) <= CLUSTER_M;
            let Some(obstacle) = obstacles.iter_mut().find(near) else {
                obstacles.push(obstacle_from_track(track, place));
                continue;
            };
            obstacle.provisional &= track.provisional;
            obstacle.shape.extend(cells(track, &place));
            obstacle.first_seen_ns = obstacle.first_seen_ns.min(track.first_ns);
            obstacle.last_seen_ns = obstacle.last_seen_ns.max(track.last_ns);
        }
        obstacles.into_iter().map(with_extent).collect()
    }
}

/// The obstacle of a single track.
fn obstacle_from_track(track: &Track<DVec3>, place: RefinedPoint) -> Obstacle {
    Obstacle {
        id: track.id,
        position_m: place.position_m,
        covariance_m2: place.covariance_m2,
        observed: Observed::Position,
        extent_m: DVec3::ZERO,
        evidence: track.score,
        shape: cells(track, &place),
        provisional: track.provisional,
        first_seen_ns: track.first_ns,
        last_seen_ns: track.last_ns,
    }
}

/// A track's cells; the one that contains its position when it has none.
fn cells(track: &Track<DVec3>, place: &RefinedPoint) -> Vec<(DVec3, f32)> {
    match place.shape.cells.is_empty() {
        true => vec![(center_of(cell_of(place.position_m)), track.score as f32)],
        false => place.shape.cells.clone(),
    }
}

/// With each cell once, the highest score first, and the box around all cells.
fn with_extent(mut obstacle: Obstacle) -> Obstacle {
    obstacle.shape.sort_by(by_falling_score);
    let mut taken = HashSet::new();
    obstacle.shape.retain(|(center, _)| taken.insert(cell_of(*center)));
    if let Some(around) = Aabb::around(obstacle.shape.iter().map(|s| s.0)) {
        obstacle.extent_m = around.size() + CELL_M;
    }
    obstacle
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

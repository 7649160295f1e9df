//! The three cross-sections of the evidence: the maximum score along the third axis, of all
//! evidence or of a slab around a point.

use glam::DVec3;

use crate::report::{greatest, inferno};
use radar_mapping::Evidence;
use radar_sar::Volume;
use radar_sar::geometry::Aabb;

/// Half thickness of a slab, metres. Choice: a chair fits the slab, and little else.
pub const SLAB_HALF_M: f64 = 0.25;
/// Limit of cells along an axis. Choice: about as many as pixels on the screen; more cells cost
/// time at every update.
const CELLS: f64 = 320.0;

/// A projection direction. Right and up match the views of the room.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Plane {
    /// From above: x to the right, forward (−z) up.
    Top,
    /// From behind: x to the right, y up.
    Front,
    /// From the right: forward (−z) to the right, y up.
    Side,
}

/// In display order.
pub const PLANES: [Plane; 3] = [Plane::Top, Plane::Front, Plane::Side];

impl Plane {
    /// Coordinates of a point to the right and upwards, metres.
    pub fn project(self, point: DVec3) -> [f64; 2] {
        match self {
            Self::Top => [point.x, -point.z],
            Self::Front => [point.x, point.y],
            Self::Side => [-point.z, point.y],
        }
    }

    /// Heading, and labels of the horizontal and vertical axis.
    pub fn labels(self) -> [&'static str; 3] {
        match self {
            Self::Top => ["From above", "x (m)", "−z (m), ahead"],
            Self::Front => ["From behind", "x (m)", "y (m)"],
            Self::Side => ["From the right", "−z (m), ahead", "y (m)"],
        }
    }

    /// The axis of the view: 0, 1, 2 for x, y, z.
    fn along(self) -> usize {
        match self {
            Self::Top => 1,
            Self::Front => 2,
            Self::Side => 0,
        }
    }
}

/// One cross-section, as cells `[row][column]` from the upper left.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// Projection direction.
    pub plane: Plane,
    /// Smallest and largest coordinate to the right, then upwards, metres.
    pub ranges_m: [[f64; 2]; 2],
    /// Columns and rows.
    pub size: [usize; 2],
    /// Maximum score of each cell; 0 if there is none.
    pub scores: Vec<f32>,
}

impl Map {
    /// The map of the evidence within a box. `around`: only voxels within half a slab of this
    /// point, along the projection direction. Scores below `least` are left out.
    pub fn of(evidence: &Evidence, plane: Plane, bounds: &Aabb, around: Option<DVec3>, least: f32) -> Self {
        let voxel_m = evidence.voxel_m.max(0.01).max(bounds.size().max_element() / CELLS);
        let low = (bounds.min / voxel_m).floor() * voxel_m;
        let along = plane.along();
        let mut volume = Volume::covering(&Aabb { min: low, max: bounds.max.max(low + voxel_m) }, voxel_m);
        for &(point, score) in evidence.voxels.iter().filter(|voxel| voxel.1 >= least) {
            let point = point.as_dvec3();
            let is_in_slab = around.is_none_or(|middle| (point[along] - middle[along]).abs() <= SLAB_HALF_M);
            let cell = ((point - low) / voxel_m).floor().as_ivec3();
            let is_inside = cell.min_element() >= 0 && (0..3).all(|axis| (cell[axis] as usize) < volume.size[axis]);
            if is_in_slab && is_inside {
                let index = volume.index(cell.to_array().map(|n| n as usize));
                volume.values[index] = volume.values[index].max(score);
            }
        }
        Self::projected(&volume, plane)
    }

    fn projected(volume: &Volume, plane: Plane) -> Self {
        let projected = greatest(volume, plane.along());
        let [first, second] = projected.size;
        let at = |a: usize, b: usize| projected.sums[b * first + a] as f32;
        let region = volume.region();
        let (low, high) = (region.min, region.max);
        let (size, ranges_m) = match plane {
            Plane::Top => ([first, second], [[low.x, high.x], [-high.z, -low.z]]),
            Plane::Front => ([first, second], [[low.x, high.x], [low.y, high.y]]),
            Plane::Side => ([second, first], [[-high.z, -low.z], [low.y, high.y]]),
        };
        let cell = |column: usize, row: usize| match plane {
            // The first row is farthest ahead: smallest z.
            Plane::Top => at(column, row),
            Plane::Front => at(column, second - 1 - row),
            Plane::Side => at(first - 1 - row, second - 1 - column),
        };
        let scores = (0..size[0] * size[1]).map(|n| cell(n % size[0], n / size[0])).collect();
        Self { plane, ranges_m, size, scores }
    }

    /// As an image: the colour scale runs from `least` (dark) to `top` (bright).
    pub fn image(&self, least: f32, top: f32) -> egui::ColorImage {
        let pixel = |score: &f32| {
            let share = (score - least) / (top - least).max(1e-6);
            let [r, g, b] = inferno(if *score > 0.0 { 0.08 + 0.92 * f64::from(share) } else { 0.0 });
            egui::Color32::from_rgb(r, g, b)
        };
        egui::ColorImage::new(self.size, self.scores.iter().map(pixel).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    const BOUNDS: Aabb = Aabb { min: DVec3::new(-1.0, 0.0, -2.0), max: DVec3::new(1.0, 1.5, 0.0) };

    fn evidence() -> Evidence {
        let voxels = vec![
            (Vec3::new(0.525, 0.225, -1.775), 9.0),
            (Vec3::new(0.525, 1.225, -0.225), 5.0),
            (Vec3::splat(99.0), 8.0),
        ];
        Evidence { voxel_m: 0.05, voxels }
    }

    /// Centre of the cell with a score.
    fn place_of(map: &Map, score: f32) -> Option<[f64; 2]> {
        let n = map.scores.iter().position(|s| *s == score)?;
        let share = [(n % map.size[0]) as f64 + 0.5, (map.size[1] - 1 - n / map.size[0]) as f64 + 0.5];
        let of = |axis: usize| {
            let [low, high] = map.ranges_m[axis];
            low + (high - low) * share[axis] / map.size[axis] as f64
        };
        Some([of(0), of(1)])
    }

    #[test]
    fn map_cells_match_voxel_positions() {
        for plane in PLANES {
            let map = Map::of(&evidence(), plane, &BOUNDS, None, 2.0);
            for (point, score) in &evidence().voxels[..2] {
                let (found, wanted) = (place_of(&map, *score), plane.project(point.as_dvec3()));
                let found = found.unwrap_or_else(|| panic!("{plane:?}: no {score}"));
                assert!(
                    (0..2).all(|axis| (found[axis] - wanted[axis]).abs() < 1e-6),
                    "{plane:?}: {found:?} {wanted:?}"
                );
            }
        }
    }

    #[test]
    fn maps_take_the_maximum_within_the_slab() {
        let mut both = evidence();
        both.voxels.push((Vec3::new(0.525, 1.025, -1.775), 3.0));
        assert_eq!(place_of(&Map::of(&both, Plane::Top, &BOUNDS, None, 2.0), 3.0), None);
        let slab = Map::of(&both, Plane::Top, &BOUNDS, Some(DVec3::Y), 2.0);
        assert!(place_of(&slab, 3.0).is_some() && place_of(&slab, 9.0).is_none());
        assert_eq!(place_of(&Map::of(&both, Plane::Top, &BOUNDS, Some(DVec3::Y), 3.5), 3.0), None);
    }

    #[test]
    fn map_size_is_bounded() {
        let huge = Aabb { min: DVec3::splat(-4000.0), max: DVec3::splat(4000.0) };
        let map = Map::of(&evidence(), Plane::Side, &huge, None, 0.0);
        assert!(map.size[0] <= 330 && map.size[1] <= 330);
        let none = Map::of(&Evidence::default(), Plane::Front, &BOUNDS, None, 0.0);
        assert_eq!(none.image(2.0, 2.0).size, none.size);
    }
}

//! Accuracy of an object's image: the imaged voxels against the true points.

use glam::DVec3;

use crate::experiments::trial_recording::quantile;
use radar_sar::geometry::Aabb;

/// Distance within which a voxel images a point, metres: the thesis' voxel edge.
const NEAR_M: f64 = 0.1;

/// Imaged voxels against true points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ShapeAccuracy {
    /// Median distance from an imaged voxel to the nearest point, metres; infinite without voxels.
    pub off_m: f64,
    /// Share of the imaged voxels within 10 cm of a point.
    pub precision: f64,
    /// Share of the points that have an imaged voxel within 10 cm.
    pub recall: f64,
    /// Size of the box around the imaged voxels, voxel edge included, metres.
    pub extent_m: DVec3,
    /// From the points' mean to the imaged voxels' centroid, weighted by their values, metres.
    pub shift_m: DVec3,
}

impl ShapeAccuracy {
    /// For voxels (centre, value) of the given edge.
    pub fn of(imaged: &[(DVec3, f32)], voxel_m: f64, points_m: &[DVec3]) -> Self {
        let nearest = |position: DVec3| points_m.iter().map(|p| p.distance(position)).fold(f64::INFINITY, f64::min);
        let distances: Vec<f64> = imaged.iter().map(|(position, _)| nearest(*position)).collect();
        let near = distances.iter().filter(|distance| **distance <= NEAR_M).count();
        let shown = points_m.iter().filter(|point| imaged.iter().any(|(at, _)| at.distance(**point) <= NEAR_M)).count();
        let weight: f64 = imaged.iter().map(|(_, value)| f64::from(*value)).sum();
        let middle = imaged.iter().map(|(at, value)| *at * f64::from(*value)).sum::<DVec3>() / weight;
        let true_middle = points_m.iter().sum::<DVec3>() / points_m.len() as f64;
        Self {
            off_m: if imaged.is_empty() { f64::INFINITY } else { quantile(&distances, 0.5) },
            precision: near as f64 / imaged.len().max(1) as f64,
            recall: shown as f64 / points_m.len().max(1) as f64,
            extent_m: Aabb::around(imaged.iter().map(|v| v.0)).map_or(DVec3::ZERO, |b| b.size() + voxel_m),
            shift_m: middle - true_middle,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn false_voxels_cost_precision_and_missed_points_cost_recall() {
        let points = [DVec3::ZERO, DVec3::X];
        let imaged = [(DVec3::ZERO, 1.0), (DVec3::X * 0.05, 1.0), (DVec3::Y * 0.5, 2.0)];
        let accuracy = ShapeAccuracy::of(&imaged, 0.1, &points);
        assert_eq!((accuracy.off_m, accuracy.recall), (0.05, 0.5));
        assert!((accuracy.precision - 2.0 / 3.0).abs() < 1e-12);
        assert!(accuracy.extent_m.distance(DVec3::new(0.15, 0.6, 0.1)) < 1e-12);
        assert!(accuracy.shift_m.distance(DVec3::new(0.0125 - 0.5, 0.25, 0.0)) < 1e-12);
        let nothing = ShapeAccuracy::of(&[], 0.1, &points);
        assert!(nothing.off_m.is_infinite() && nothing.precision == 0.0 && nothing.recall == 0.0);
        assert_eq!(ShapeAccuracy::of(&imaged, 0.1, &[]).recall, 0.0);
    }
}

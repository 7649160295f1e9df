//! An axis-aligned box.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// `min ≤ max` on each axis, metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Aabb {
    /// Lowest corner.
    pub min: DVec3,
    /// Highest corner.
    pub max: DVec3,
}

impl Aabb {
    /// From any two opposite corners.
    #[inline]
    pub fn from_corners(a: DVec3, b: DVec3) -> Self {
        Self { min: a.min(b), max: a.max(b) }
    }

    /// The smallest box around the points; `None` without any.
    #[inline]
    pub fn around(points: impl IntoIterator<Item = DVec3>) -> Option<Self> {
        points
            .into_iter()
            .map(|p| Self { min: p, max: p })
            .reduce(|a, b| Self { min: a.min.min(b.min), max: a.max.max(b.max) })
    }

    /// Edge lengths.
    #[inline]
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// Centre.
    #[inline]
    pub fn center(&self) -> DVec3 {
        (self.min + self.max) * 0.5
    }

    /// Whether the point is inside or on the border.
    #[inline]
    pub fn contains(&self, point: DVec3) -> bool {
        point.cmpge(self.min).all() && point.cmple(self.max).all()
    }

    /// The point of the box nearest to `point`.
    #[inline]
    pub fn nearest_point(&self, point: DVec3) -> DVec3 {
        point.clamp(self.min, self.max)
    }

    /// Distance from a point to the nearest point of the box; 0 inside.
    #[inline]
    pub fn distance(&self, point: DVec3) -> f64 {
        self.nearest_point(point).distance(point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_is_zero_inside_and_euclidean_outside() {
        let unit = Aabb::from_corners(DVec3::ONE, DVec3::ZERO);
        assert_eq!(unit.distance(DVec3::splat(0.5)), 0.0);
        assert_eq!(unit.distance(DVec3::new(4.0, 5.0, 0.5)), 5.0);
        assert_eq!(Aabb::around([]), None);
    }
}

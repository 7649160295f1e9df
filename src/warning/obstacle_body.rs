//! An obstacle's geometry for warnings: a set of spheres and its position uncertainty.
//!
//! The voxels of the obstacle's shape become spheres. Without a shape, spheres fill the box
//! `extent_m` around the position. A range-only obstacle is one sphere whose direction is as
//! uncertain as the beam is wide; so is a moving target. Positions that are not finite or lie
//! beyond 1 km are dropped. An invalid uncertainty counts as the largest one.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::hull::convex_hull;
use radar_mapping::{MovingTarget, Observed, Obstacle};
use radar_sar::geometry::Aabb;

/// Largest valid coordinate, metres. Choice: farther away nothing can be in a room.
const MAX_COORDINATE_M: f64 = 1000.0;
/// Direction uncertainty of a range-only obstacle: tangent of half the beam width. Choice: 30°,
/// which contains the lensless beam's half-power width.
const BEAM_TANGENT: f64 = 0.577;
/// Largest half width drawn for an unknown direction, metres. Choice: a wider panel would state
/// nothing but a distance, and hide the game.
const MAX_SPREAD_M: f64 = 1.0;
/// Largest extent that is used along one axis, metres. Choice: no furniture is longer, so a wrong
/// point cannot widen a panel across the room.
const MAX_EXTENT_M: f64 = 5.0;

/// Ids of moving targets start here, so that they differ from the map's ids. Choice: no map counts
/// so far.
const FIRST_MOVING_ID: u64 = 1 << 48;

/// Spheres of one radius with a common position uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ObstacleBody {
    /// Id of the obstacle.
    pub id: u64,
    /// Centres of the spheres, tracking frame, metres; never empty.
    pub points: Arc<[DVec3]>,
    /// Radius of each sphere, metres. A little more than half a voxel, so that neighbours overlap.
    pub radius_m: f64,
    /// The obstacle's own position. The panel is laid out from it, so that the panel stays in
    /// place.
    pub anchor: DVec3,
    /// Whether the silhouette is meaningful: false for a range-only obstacle.
    pub has_shape: bool,
    /// Restored from a saved map and not yet seen again.
    pub provisional: bool,
    /// Bounding box of the centres.
    pub around: Aabb,
    /// Convex hull of the centres seen from above: x to the right, −z up; counter-clockwise.
    pub hull: Arc<[DVec2]>,
    /// Own approach speed of a moving target, m/s; `None` for a stationary obstacle.
    pub approach_m_per_s: Option<f64>,
    covariance_m2: glam::DMat3,
}

/// Whether a point is a valid position in a room.
pub(super) fn is_valid_position(point: DVec3) -> bool {
    point.is_finite() && point.abs().max_element() <= MAX_COORDINATE_M
}

impl ObstacleBody {
    /// From an obstacle; `None` when its position is invalid.
    pub fn of(obstacle: &Obstacle) -> Option<Self> {
        let anchor = obstacle.position_m;
        if !is_valid_position(anchor) {
            return None;
        }
        let has_shape = obstacle.observed != Observed::RangeOnly;
        let shape: Vec<DVec3> = obstacle.shape.iter().map(|(p, _)| *p).filter(|p| is_valid_position(*p)).collect();
        let (points, radius_m) = if !has_shape {
            (vec![anchor], 0.05)
        } else if shape.is_empty() {
            spheres_in_box(anchor, obstacle.extent_m)
        } else {
            let radius_m = 0.6 * voxel_spacing(&shape);
            (shape, radius_m)
        };
        let hull = convex_hull(&points.iter().map(|p| DVec2::new(p.x, -p.z)).collect::<Vec<_>>());
        Some(Self {
            id: obstacle.id,
            around: Aabb::around(points.iter().copied())?,
            hull: hull.into(),
            points: points.into(),
            radius_m,
            anchor,
            has_shape,
            provisional: obstacle.provisional,
            approach_m_per_s: None,
            covariance_m2: obstacle.covariance_m2,
        })
    }

    /// From a moving target: one sphere at its range. `None` when its position is invalid.
    pub fn of_moving(moving: &MovingTarget) -> Option<Self> {
        let stands = Obstacle {
            id: moving.id.saturating_add(FIRST_MOVING_ID),
            position_m: moving.position_m(),
            covariance_m2: moving.covariance_m2(),
            observed: Observed::RangeOnly,
            extent_m: DVec3::ZERO,
            evidence: moving.evidence,
            shape: Vec::new(),
            provisional: false,
            first_seen_ns: moving.first_seen_ns,
            last_seen_ns: moving.last_seen_ns,
        };
        let approach_m_per_s = Some(-moving.speed_m_per_s).filter(|speed| speed.is_finite()).unwrap_or(0.0);
        Some(Self { approach_m_per_s: Some(approach_m_per_s), ..Self::of(&stands)? })
    }

    /// This geometry with the id and the provisional flag of a newer one.
    pub fn with_identity_of(&self, newer: &Self) -> Self {
        Self { id: newer.id, provisional: newer.provisional, ..self.clone() }
    }

    /// Position uncertainty along a unit direction: 2σ, metres, at most `cap_m`.
    pub fn two_sigma(&self, along: DVec3, cap_m: f64) -> f64 {
        let variance = along.dot(self.covariance_m2 * along);
        let two_sigma = 2.0 * variance.max(0.0).sqrt();
        if variance.is_nan() { cap_m } else { two_sigma.min(cap_m) }
    }

    /// Whether a position, seen from above, lies within the hull.
    pub fn spans(&self, point: DVec3) -> bool {
        let flat = DVec2::new(point.x, -point.z);
        let edge = |n: usize| (self.hull[n], self.hull[(n + 1) % self.hull.len()]);
        self.hull.len() >= 3 && (0..self.hull.len()).map(edge).all(|(a, b)| (b - a).perp_dot(flat - a) >= 0.0)
    }

    /// Half width of the unknown region across the line of sight, metres.
    pub fn spread(&self, across: DVec3, distance_m: f64) -> f64 {
        let known = self.two_sigma(across, MAX_SPREAD_M);
        if self.has_shape { known } else { known.max(distance_m * BEAM_TANGENT).min(MAX_SPREAD_M) }
    }
}

/// Points whose nearest neighbour is searched to estimate the voxel size. Choice: bounds the work.
const SPACING_SAMPLES: usize = 16;

/// Edge of a voxel, metres: the smallest distance between neighbours, in any orientation of the
/// frame. Clamped to 2 to 10 cm; 5 cm for a single point.
fn voxel_spacing(points: &[DVec3]) -> f64 {
    let asked = points.iter().step_by(points.len().div_ceil(SPACING_SAMPLES).max(1));
    let to_next = |point: &DVec3| {
        let apart = points.iter().map(|other| other.distance_squared(*point));
        apart.filter(|squared| *squared > 1e-8).fold(f64::INFINITY, f64::min)
    };
    let least = asked.map(to_next).fold(f64::INFINITY, f64::min).sqrt();
    if least.is_finite() { least.clamp(0.02, 0.1) } else { 0.05 }
}

/// Fills a box with spheres, at most eight along an edge; returns centres and radius.
fn spheres_in_box(middle: DVec3, extent_m: DVec3) -> (Vec<DVec3>, f64) {
    let extent = extent_m.to_array().map(|e| if e.is_finite() { e.clamp(0.0, MAX_EXTENT_M) } else { 0.0 });
    let counts = extent.map(|e| (e / 0.1).ceil().clamp(1.0, 8.0));
    let cell = DVec3::from_array(extent) / DVec3::from_array(counts);
    let [nx, ny, nz] = counts.map(|n| n as u32);
    let lowest = middle - DVec3::from_array(extent) / 2.0;
    let points = (0..nx * ny * nz)
        .map(|i| lowest + (DVec3::new((i % nx).into(), (i / nx % ny).into(), (i / (nx * ny)).into()) + 0.5) * cell)
        .collect();
    (points, (0.6 * cell.max_element()).max(0.03))
}

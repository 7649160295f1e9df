//! Footprint of an obstacle on the floor: the convex hull of its spheres from above, widened by the
//! direction uncertainty.

use std::sync::Arc;

use glam::DVec2;

use super::hull::convex_hull;
use super::object::Aspect;
use super::obstacle_body::ObstacleBody;

/// Corners of the polygon that stands for a sphere's circle. Choice: an edge cuts a circle's radius
/// by 3 %, less than a centimetre.
const CORNERS: u32 = 12;

/// Corners of an obstacle's footprint as (x, z).
pub(super) fn footprint(body: &ObstacleBody, aspect: &Aspect) -> Arc<[DVec2]> {
    let aside = DVec2::new(aspect.picture_right.x, -aspect.picture_right.z) * aspect.spread_m;
    let mut widened = Vec::new();
    for corner in body.hull.iter() {
        for k in 0..CORNERS {
            let angle = std::f64::consts::TAU * f64::from(k) / f64::from(CORNERS);
            let rim = *corner + DVec2::from_angle(angle) * body.radius_m;
            widened.extend([rim + aside, rim - aside]);
        }
    }
    convex_hull(&widened).into_iter().map(|p| DVec2::new(p.x, -p.y)).collect()
}

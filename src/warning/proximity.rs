//! Distance and closing speed between each body part and a hazard.
//!
//! Distances run from the axes of the body parts in the body model to the near side of the hazard.
//! The near side is moved towards the wearer by the position uncertainty in that direction. A body
//! part inside an obstacle's outline, or beyond a wall, has distance 0.

use glam::DVec3;

use super::body_model::{BodyModel, Limb};
use super::obstacle_body::ObstacleBody;
use super::wearer::BodyPart;

/// Largest shift of the near side by the position uncertainty, metres. Choice: as much as a panel
/// is moved; more would warn of obstacles a step away.
const MAX_RANGE_MARGIN_M: f64 = 0.1;
/// Least closing speed that gives a time to contact, m/s. Choice: slower approaches are the sway of
/// a standing body.
const MIN_CLOSING_M_PER_S: f64 = 0.1;

/// Distance of a hazard to one body part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Proximity {
    pub part: BodyPart,
    /// From the part's axis, metres.
    pub distance_m: f64,
    /// From the part's surface, metres.
    pub gap_m: f64,
    /// Nearest point of the hazard.
    pub nearest_m: DVec3,
    /// Closing speed between part and hazard, m/s.
    pub closing_m_per_s: f64,
}

impl Proximity {
    pub fn new(limb: &Limb, distance_m: f64, nearest_m: DVec3, closing_m_per_s: f64) -> Self {
        let gap_m = (distance_m - limb.radius_m).max(0.0);
        Self { part: limb.part, distance_m, gap_m, nearest_m, closing_m_per_s }
    }

    /// Time until contact at this speed, seconds.
    pub fn time_to_contact_s(&self) -> Option<f64> {
        (self.closing_m_per_s > MIN_CLOSING_M_PER_S).then(|| self.gap_m / self.closing_m_per_s)
    }

    /// Distance to compare with the settings: from the axis for head and torso, from the surface
    /// for hands.
    pub fn setting_distance_m(&self) -> f64 {
        if self.is_hand() { self.gap_m } else { self.distance_m }
    }

    pub fn is_hand(&self) -> bool {
        matches!(self.part, BodyPart::LeftHand | BodyPart::RightHand)
    }
}

/// Distances to all parts within `reach_m` of an obstacle.
pub(super) fn proximities(body: &ObstacleBody, body_model: &BodyModel, reach_m: f64) -> Vec<Proximity> {
    let is_in_reach = |limb: &&Limb| {
        let (least, greatest) = (limb.ends[0].min(limb.ends[1]), limb.ends[0].max(limb.ends[1]));
        let apart = (body.around.min - greatest).max(least - body.around.max).max(DVec3::ZERO);
        apart.length() <= reach_m + body.radius_m + MAX_RANGE_MARGIN_M
    };
    body_model.limbs.iter().filter(is_in_reach).map(|limb| near(body, limb)).collect()
}

fn near(body: &ObstacleBody, limb: &Limb) -> Proximity {
    let away = |point: DVec3| limb.at(limb.share_near(point)).0.distance_squared(point);
    let first = (body.anchor, f64::INFINITY);
    let (nearest_m, _) = body.points.iter().fold(first, |best, point| {
        let squared = away(*point);
        if squared < best.1 { (*point, squared) } else { best }
    });
    let (from, moves) = limb.at(limb.share_near(nearest_m));
    let toward = (nearest_m - from).normalize_or_zero();
    let before_m = body.radius_m + body.two_sigma(toward, MAX_RANGE_MARGIN_M);
    let distance_m = if is_within(body, limb) { 0.0 } else { (from.distance(nearest_m) - before_m).max(0.0) };
    Proximity::new(limb, distance_m, nearest_m, moves.dot(toward) + body.approach_m_per_s.unwrap_or(0.0))
}

/// Whether the part's axis passes through the obstacle's outline at a height that the obstacle
/// covers.
fn is_within(body: &ObstacleBody, limb: &Limb) -> bool {
    let [from, to] = limb.ends;
    let (low, high) = (from.y.min(to.y), from.y.max(to.y));
    high >= body.around.min.y && low <= body.around.max.y && (body.spans(from) || body.spans(to))
}

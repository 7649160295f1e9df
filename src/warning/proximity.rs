//! Which part of the body is how near to a thing, and how fast it comes nearer.
//!
//! Distances are from the axes of the body's parts (`wearer.rs`) to the near side of the thing, which is as much nearer than seen as
//! its place is uncertain in that direction. A part within the outline of a thing, or beyond a wall, is at distance 0.

use glam::DVec3;

use super::body_model::{BodyModel, Limb};
use super::obstacle_body::ObstacleBody;
use super::wearer::BodyPart;

/// The near side may be this much nearer than seen at most, however uncertain it is, metres.
const MAX_RANGE_MARGIN_M: f64 = 0.1;
/// Slower than this nothing approaches, m/s.
const MIN_CLOSING_M_PER_S: f64 = 0.1;

/// A thing as one part of the body has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Proximity {
    pub part: BodyPart,
    /// From the part's axis, metres.
    pub distance_m: f64,
    /// From the part's surface, metres.
    pub gap_m: f64,
    /// The place of the thing that is nearest.
    pub nearest_m: DVec3,
    /// How fast the part and the thing come nearer to each other, m/s.
    pub closing_m_per_s: f64,
}

impl Proximity {
    pub fn new(limb: &Limb, distance_m: f64, nearest_m: DVec3, closing_m_per_s: f64) -> Self {
        let gap_m = (distance_m - limb.radius_m).max(0.0);
        Self { part: limb.part, distance_m, gap_m, nearest_m, closing_m_per_s }
    }

    /// Until the part touches it at this speed, seconds.
    pub fn time_to_contact_s(&self) -> Option<f64> {
        (self.closing_m_per_s > MIN_CLOSING_M_PER_S).then(|| self.gap_m / self.closing_m_per_s)
    }

    /// What the settings' distances are compared with: from head and torso as the axis has it, from hands as the surface does.
    pub fn setting_distance_m(&self) -> f64 {
        if self.is_hand() { self.gap_m } else { self.distance_m }
    }

    pub fn is_hand(&self) -> bool {
        matches!(self.part, BodyPart::LeftHand | BodyPart::RightHand)
    }
}

/// The thing as each part has it that is within `reach_m`.
pub(super) fn proximities(body: &ObstacleBody, body_model: &BodyModel, reach_m: f64) -> Vec<Proximity> {
    let is_in_reach = |limb: &&Limb| {
        let (least, greatest) = (limb.ends[0].min(limb.ends[1]), limb.ends[0].max(limb.ends[1]));
        let apart = (body.around.min - greatest).max(least - body.around.max).max(DVec3::ZERO);
        apart.length() <= reach_m + body.radius_m + MAX_RANGE_MARGIN_M
    };
    body_model.limbs.iter().filter(is_in_reach).map(|limb| near(body, limb)).collect()
}

fn near(body: &ObstacleBody, limb: &Limb) -> Proximity {
    let away = |place: DVec3| limb.at(limb.share_near(place)).0.distance_squared(place);
    let first = (body.anchor, f64::INFINITY);
    let (nearest_m, _) = body.points.iter().fold(first, |best, place| {
        let squared = away(*place);
        if squared < best.1 { (*place, squared) } else { best }
    });
    let (from, moves) = limb.at(limb.share_near(nearest_m));
    let toward = (nearest_m - from).normalize_or_zero();
    let before_m = body.radius_m + body.two_sigma(toward, MAX_RANGE_MARGIN_M);
    let distance_m = if is_within(body, limb) { 0.0 } else { (from.distance(nearest_m) - before_m).max(0.0) };
    Proximity::new(limb, distance_m, nearest_m, moves.dot(toward) + body.approach_m_per_s.unwrap_or(0.0))
}

/// Whether the part's axis runs through the outline of the thing, at a height that it has.
fn is_within(body: &ObstacleBody, limb: &Limb) -> bool {
    let [from, to] = limb.ends;
    let (low, high) = (from.y.min(to.y), from.y.max(to.y));
    high >= body.around.min.y && low <= body.around.max.y && (body.spans(from) || body.spans(to))
}

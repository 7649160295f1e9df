//! The panel of a wall: in the wall's plane around the foot of the perpendicular from the head, no
//! wider than the observed part.
//!
//! Its edges are multiples of the grid spacing, so that the grid stays fixed on the wall while the
//! head moves along it and the texture stays the same. Floors and ceilings get no panel.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::body_model::{BodyModel, Limb};
use super::object::upright;
use super::obstacle_body::is_valid_position;
use super::panel::{Panel, PanelKind};
use super::proximity::Proximity;
use super::settings::WarningSettings;
use radar_mapping::Wall;
use radar_sar::geometry::Plane;
use radar_sar::math;

/// Half of the width shown at once, metres. Choice: 90° of view at 1 m, all that is near the body,
/// at few pixels.
const HALF_WIDTH_M: f64 = 1.0;
/// Height, metres. Choice: up to a raised hand; higher nothing is hit.
const HEIGHT_M: f64 = 2.2;
/// A wall extends this far beyond its observed part, metres. Choice: a smooth wall echoes only
/// where the head has been opposite; it goes on a little, but doors must stay open.
const EDGE_MARGIN_M: f64 = 0.5;
/// Up to this depth beyond the plane the distance is 0, metres. Choice: a body's depth through the
/// plane; beyond that the wearer is in the next room, or the wall is wrong.
const MAX_CONTACT_DEPTH_M: f64 = 0.5;

/// Distances of the body parts within reach to the observed part of a wall with its margin; none
/// for floors and ceilings.
///
/// A part slightly beyond the plane is at distance 0. Farther beyond, where the wall cannot be
/// right or has a door, the distance grows again: a wall has two sides, and its warning must not
/// stop abruptly.
pub(super) fn wall_proximities(wall: &Wall, body_model: &BodyModel, reach_m: f64) -> Vec<Proximity> {
    let Some((plane, outward)) = upright_plane(wall) else { return Vec::new() };
    let right = DVec3::Y.cross(-outward);
    let (least, greatest) = span(wall, right);
    let ahead_m = |point: DVec3| plane.distance(point) / plane.outward.dot(outward);
    let near = |limb: &Limb| {
        let ends = limb.ends.map(ahead_m);
        let share = if ends[0] <= ends[1] { 0.0 } else { 1.0 };
        let (least_m, greatest_m) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        let share = if greatest_m < 0.0 { 1.0 - share } else { share };
        let (point, moves) = limb.at(share);
        let aside_m = point.dot(right).clamp(least, greatest) - point.dot(right);
        let through_m = least_m.max(-greatest_m - MAX_CONTACT_DEPTH_M).max(0.0);
        let distance_m = math::hypot(through_m, aside_m);
        let nearest_m = point + outward * ahead_m(point) + right * aside_m;
        let across = if greatest_m < 0.0 { -outward } else { outward };
        let toward = (across * through_m + right * aside_m).try_normalize().unwrap_or(across);
        (distance_m <= reach_m).then(|| Proximity::new(limb, distance_m, nearest_m, moves.dot(toward)))
    };
    body_model.limbs.iter().filter_map(near).collect()
}

/// `None` for floors, ceilings, and where the wall was not observed.
pub(super) fn wall_panel(
    wall: &Wall,
    head: DVec3,
    near: &Proximity,
    alpha: f32,
    settings: &WarningSettings,
) -> Option<Panel> {
    let (plane, outward) = upright_plane(wall)?;
    let ahead_m = plane.distance(head) / plane.outward.dot(outward);
    let right = DVec3::Y.cross(-outward);
    let (from, to) = visible_span(wall, head.dot(right), right, spacing(settings))?;
    let foot = head + outward * ahead_m;
    let middle = foot + right * ((from + to) / 2.0 - foot.dot(right));
    Some(Panel {
        id: wall.id,
        kind: PanelKind::Wall,
        // Overlays are visible only from the front, and a wearer who has walked into the wall needs
        // it most.
        tracking_from_panel: upright(
            DVec3::new(middle.x, HEIGHT_M / 2.0, middle.z),
            if ahead_m < 0.0 { outward } else { -outward },
        ),
        size_m: DVec2::new(to - from, HEIGHT_M),
        silhouette: Arc::default(),
        alpha,
        distance_m: near.distance_m,
        time_to_contact_s: near.time_to_contact_s(),
        nearest_part: near.part,
        nearest_m: near.nearest_m,
        label_m: None,
    })
}

/// The plane and the horizontal direction out of the room; `None` for floors, ceilings and invalid
/// planes.
fn upright_plane(wall: &Wall) -> Option<(Plane, DVec3)> {
    let plane = normalised(wall.plane)?;
    if plane.is_level() || !is_valid_position(wall.seen_at.min) || !is_valid_position(wall.seen_at.max) {
        return None;
    }
    Some((plane, DVec3::new(plane.outward.x, 0.0, plane.outward.z).normalize()))
}

/// The plane with a normalised normal; `None` when its length was far from 1.
fn normalised(plane: Plane) -> Option<Plane> {
    let length = plane.outward.length();
    let near_one = (0.9..1.1).contains(&length) && plane.offset_m.is_finite();
    near_one.then(|| Plane { outward: plane.outward / length, offset_m: plane.offset_m / length })
}

/// First and last coordinate along `right` to show, at grid lines; `None` where nothing was
/// observed.
fn visible_span(wall: &Wall, head_at: f64, right: DVec3, spacing: f64) -> Option<(f64, f64)> {
    let (least, greatest) = span(wall, right);
    let from = ((head_at - HALF_WIDTH_M).max(least) / spacing).round();
    let to = ((head_at + HALF_WIDTH_M).min(greatest) / spacing).round();
    (to > from).then_some((from * spacing, to * spacing))
}

/// Extent of the wall along `right`.
fn span(wall: &Wall, right: DVec3) -> (f64, f64) {
    let seen = [wall.seen_at.min, wall.seen_at.max].map(|corner| corner * right);
    (seen[0].min(seen[1]).element_sum() - EDGE_MARGIN_M, seen[0].max(seen[1]).element_sum() + EDGE_MARGIN_M)
}

/// The grid spacing, or the default where it is invalid.
fn spacing(settings: &WarningSettings) -> f64 {
    let given = settings.grid_spacing_m;
    if (0.05..=1.0).contains(&given) { given } else { WarningSettings::default().grid_spacing_m }
}

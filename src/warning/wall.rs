//! The panel of a wall: in the wall's plane around the foot of the perpendicular from the head, no wider than what was seen.
//!
//! Its edges keep to multiples of the grid's spacing, so that the grid stands still on the wall while the head moves along
//! it, and the texture stays the same. Floors and ceilings give none.

use glam::{DVec2, DVec3};

use super::body::is_place;
use super::object::upright;
use super::panel::{Panel, PanelKind};
use super::player::BodyPart;
use super::settings::WarningSettings;
use crate::geometry::Plane;
use crate::obstacles::Wall;

/// A plane leaning more than this is a floor or a ceiling.
const MAX_LEAN: f64 = 0.7;
/// Half of the width shown at once, metres.
const HALF_WIDTH_M: f64 = 1.0;
/// Height, metres.
const HEIGHT_M: f64 = 2.2;
/// A wall goes on this far beyond the places it was seen at, metres.
const MARGIN_M: f64 = 0.5;
/// A head farther behind the plane than this proves the plane wrong, metres.
const BEHIND_M: f64 = 0.5;

/// `None` for floors, ceilings, walls too far to warn of, and where the wall was not seen.
pub(super) fn wall_panel(wall: &Wall, head: DVec3, settings: &WarningSettings) -> Option<Panel> {
    let plane = sound(wall.plane)?;
    if plane.outward.y.abs() > MAX_LEAN || !is_place(wall.seen_at.min) || !is_place(wall.seen_at.max) {
        return None;
    }
    let outward = DVec3::new(plane.outward.x, 0.0, plane.outward.z).normalize();
    let ahead_m = plane.distance(head) / plane.outward.dot(outward);
    let distance_m = ahead_m.max(0.0);
    let alpha = settings.alpha(distance_m);
    if !(alpha > 0.0 && ahead_m >= -BEHIND_M) {
        return None;
    }
    let right = DVec3::Y.cross(-outward);
    let (from, to) = shown(wall, head.dot(right), right, spacing(settings))?;
    let foot = head + outward * ahead_m;
    let middle = foot + right * ((from + to) / 2.0 - foot.dot(right));
    Some(Panel {
        id: wall.id,
        kind: PanelKind::Wall,
        // Overlays are seen from their front alone, and one who has walked into the wall needs it most.
        tracking_from_panel: upright(
            DVec3::new(middle.x, HEIGHT_M / 2.0, middle.z),
            if ahead_m < 0.0 { outward } else { -outward },
        ),
        size_m: DVec2::new(to - from, HEIGHT_M),
        silhouette: Vec::new(),
        alpha,
        distance_m,
        time_to_contact_s: None,
        nearest_part: BodyPart::Torso,
        nearest_m: foot,
        label_m: None,
    })
}

/// The plane with a normal of length 1 exactly; `None` when it was far from that.
fn sound(plane: Plane) -> Option<Plane> {
    let length = plane.outward.length();
    let near_one = (0.9..1.1).contains(&length) && plane.offset_m.is_finite();
    near_one.then(|| Plane { outward: plane.outward / length, offset_m: plane.offset_m / length })
}

/// First and last coordinate along `right` to show, at whole lines of the grid; `None` where nothing was seen.
fn shown(wall: &Wall, head_at: f64, right: DVec3, spacing: f64) -> Option<(f64, f64)> {
    let seen = [wall.seen_at.min, wall.seen_at.max].map(|corner| corner * right);
    let least = seen[0].min(seen[1]).element_sum() - MARGIN_M;
    let greatest = seen[0].max(seen[1]).element_sum() + MARGIN_M;
    let from = ((head_at - HALF_WIDTH_M).max(least) / spacing).round();
    let to = ((head_at + HALF_WIDTH_M).min(greatest) / spacing).round();
    (to > from).then_some((from * spacing, to * spacing))
}

/// The grid's spacing, or the default where it cannot be used.
fn spacing(settings: &WarningSettings) -> f64 {
    let given = settings.grid_spacing_m;
    if (0.05..=1.0).contains(&given) { given } else { WarningSettings::default().grid_spacing_m }
}

//! The panel of an obstacle: upright, at its near side, turned about the vertical to face the
//! wearer.
//!
//! It stands in front of the points nearest to the vertical line from the head to the floor: a
//! stool at the feet is near although it is far from the eyes. It faces the wearer from a mean of
//! the nearest points, weighted by nearness, so that noise in single voxels does not turn it.
//!
//! The panel turns continuously, its content does not. The content shows the obstacle from the
//! nearest of 24 directions, with lengths rounded to centimetres. The texture stays the same while
//! the head sways, approaches and turns, and changes every 15° around the obstacle. The silhouette
//! is then wrong by 8° at most, less than the radar image is.

use std::sync::Arc;

use glam::{DQuat, DVec2, DVec3};

use super::hull::{convex_hull, lattice_within};
use super::obstacle_body::ObstacleBody;
use super::panel::{Panel, PanelKind};
use super::proximity::Proximity;

use radar_sar::math;

/// Least distance from the eyes to a panel, metres. Choice: a nearer panel cannot be focused on.
const MIN_PANEL_DISTANCE_M: f64 = 0.2;
/// Largest shift of the near side by the position uncertainty, metres. Choice: a panel that is much
/// nearer than the obstacle would be taken for the obstacle.
const MAX_RANGE_MARGIN_M: f64 = 0.1;
/// Margin around the silhouette, metres. Choice: the outline's glow fits, and a hand's radius.
const MARGIN_M: f64 = 0.1;
/// Half of the greatest width, metres. Choice: a couch fits; wider ones fill the view at a step's
/// distance anyway.
const MAX_HALF_WIDTH_M: f64 = 1.25;
/// Least and greatest height of a panel, metres. Choice: low obstacles must catch the eye above a
/// downward look; rooms are this high.
const HEIGHT_M: (f64, f64) = (0.5, 2.4);
/// Sizes are rounded up to this step, metres. Choice: a voxel edge, so that one more voxel does not
/// change the texture's size.
const SIZE_STEP_M: f64 = 0.05;
/// Number of directions for which a picture is laid out. Choice: a silhouette is drawn anew only
/// every few steps around it, and is at most 7.5° off.
const PICTURE_DIRECTIONS: f64 = 24.0;
/// The width of the unknown region is rounded up to this step, metres. Choice: a texture serves
/// several updates; the spread itself is decimetres.
const SPREAD_STEP_M: f64 = 0.1;
/// The centre of the visible part of a very wide obstacle is rounded to this step, metres. Choice:
/// a texture serves several steps along the obstacle; a tenth of the greatest width.
const MIDDLE_STEP_M: f64 = 0.25;
/// Discs are rounded to this step, metres. Choice: below the position error, so that noise in the
/// positions does not redraw the texture.
const DISC_STEP_M: f64 = 0.01;
/// Margin from the last reflection to an obstacle's edge, metres. Choice: reflections come from
/// inside an object, and each is placed to a centimetre or two.
const EDGE_MARGIN_M: f64 = 0.03;
/// Largest number of discs in a silhouette. Choice: a graphics card draws so many at negligible
/// cost.
const MAX_DISCS: usize = 384;

/// How an obstacle is seen from the head: its near side and the panel's direction.
pub(super) struct Aspect {
    /// Horizontal unit vector from the obstacle to the wearer.
    pub facing: DVec3,
    /// Horizontal unit vector to the right in the picture, for a viewer in the direction it is laid
    /// out for.
    pub picture_right: DVec3,
    /// Half width of the unknown region along `picture_right`, metres.
    pub spread_m: f64,
    /// Horizontal distance from the wearer to the panel, metres.
    panel_distance_m: f64,
    /// Weighted mean of the nearest points; the panel faces from it to the wearer.
    near: DVec3,
}

impl Aspect {
    /// `ahead` is the head's forward direction, used when the obstacle is at the head's position.
    pub fn of(body: &ObstacleBody, head: DVec3, ahead: DVec3) -> Self {
        let distances: Vec<f64> = body.points.iter().map(|p| distance_from_wearer(head, *p)).collect();
        let nearest = distances.iter().copied().fold(f64::INFINITY, f64::min);
        let level = body.points.iter().map(|p| horizontal(*p - head).length()).fold(f64::INFINITY, f64::min);
        let near = weighted_mean(&body.points, |i| math::exp(-(distances[i] - nearest) / 0.1));
        let fallback = horizontal(-ahead).try_normalize().unwrap_or(DVec3::Z);
        let facing = Some(horizontal(head - near)).filter(|v| v.length() > 1e-3).map_or(fallback, DVec3::normalize);
        let picture_right = DVec3::Y.cross(nearest_direction(facing));
        let spread_m = body.spread(picture_right, level);
        // A small known width is used as it is; one that grows with distance is rounded up to
        // steps.
        let spread_m = if body.has_shape { spread_m } else { -round_down_to(-spread_m, SPREAD_STEP_M) };
        let before = body.radius_m + body.two_sigma(facing, MAX_RANGE_MARGIN_M);
        Self { facing, picture_right, spread_m, panel_distance_m: (level - before).max(MIN_PANEL_DISTANCE_M), near }
    }
}

/// What an obstacle's picture and footprint show, and how large they are. All of it belongs to the obstacle or is rounded, so it
/// stays the same in most frames.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Layout {
    points: Arc<[DVec3]>,
    has_shape: bool,
    radius_m: f64,
    anchor: DVec3,
    picture_right: DVec3,
    spread_m: f64,
    /// Left and right edge of the panel, from the anchor along `picture_right`, metres.
    edges_m: [f64; 2],
    height_m: f64,
}

impl Layout {
    pub fn of(body: &ObstacleBody, aspect: &Aspect) -> Self {
        let across = |p: DVec3| (p - body.anchor).dot(aspect.picture_right);
        let middle = (across(aspect.near) / MIDDLE_STEP_M).round() * MIDDLE_STEP_M;
        let border = body.radius_m + aspect.spread_m + MARGIN_M;
        let (lo, hi) = body.points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), p| {
            let x = across(*p);
            (lo.min(x), hi.max(x))
        });
        let lo = round_down((lo - border).max(middle - MAX_HALF_WIDTH_M));
        let hi = -round_down(-(hi + border).min(middle + MAX_HALF_WIDTH_M));
        let highest = body.points.iter().map(|p| p.y).fold(f64::NEG_INFINITY, f64::max);
        let doubt = body.two_sigma(DVec3::Y, 0.2);
        let height_m = -round_down(-(highest + body.radius_m + doubt + MARGIN_M).clamp(HEIGHT_M.0, HEIGHT_M.1));
        Self {
            points: Arc::clone(&body.points),
            has_shape: body.has_shape,
            radius_m: body.radius_m,
            anchor: body.anchor,
            picture_right: aspect.picture_right,
            spread_m: aspect.spread_m,
            edges_m: [lo, hi],
            height_m,
        }
    }

    fn size_m(&self) -> DVec2 {
        let [lo, hi] = self.edges_m;
        DVec2::new(hi - lo, self.height_m)
    }

    /// Discs at the spheres on the panel and within their outline, since nobody passes between parts of
    /// one object. The radius grows with the uncertainty across, and until the discs are few enough.
    pub fn silhouette(&self) -> Arc<[(DVec2, f64)]> {
        if !self.has_shape {
            return Arc::default();
        }
        let (middle_m, size_m) = (self.edges_m.iter().sum::<f64>() / 2.0, self.size_m());
        let on_panel =
            |p: &DVec3| DVec2::new((*p - self.anchor).dot(self.picture_right) - middle_m, p.y - self.height_m / 2.0);
        let placed: Vec<DVec2> = self.points.iter().map(on_panel).collect();
        let hull = convex_hull(&placed);
        let mut radius =
            round(math::hypot(self.radius_m + EDGE_MARGIN_M, self.spread_m / 2.0).min(0.3)).max(DISC_STEP_M);
        loop {
            let cell = 0.6 * radius;
            let mut taken = CellSet::covering(size_m / 2.0 + radius, cell);
            let discs: Vec<_> = placed
                .iter()
                .copied()
                .chain(lattice_within(&hull, 2.0 * cell))
                .filter(|c| (c.abs() - size_m / 2.0).max_element() < radius)
                .filter(|c| taken.insert(*c))
                .map(|c| (DVec2::new(round(c.x), round(c.y)), radius))
                .take(MAX_DISCS + 1)
                .collect();
            if discs.len() <= MAX_DISCS {
                return discs.into();
            }
            radius = round(radius * 1.5 + DISC_STEP_M);
        }
    }
}

/// The panel of an obstacle seen this way, with its silhouette.
pub(super) fn object_panel(
    body: &ObstacleBody,
    (aspect, layout): (&Aspect, &Layout),
    silhouette: Arc<[(DVec2, f64)]>,
    head: DVec3,
    near: &Proximity,
    alpha: f32,
) -> Panel {
    let right = DVec3::Y.cross(aspect.facing);
    let [lo, hi] = layout.edges_m;
    let sideways = (body.anchor - head).dot(right) + (lo + hi) / 2.0;
    let level = head - aspect.facing * aspect.panel_distance_m + right * sideways;
    Panel {
        id: body.id,
        kind: PanelKind::Object,
        tracking_from_panel: upright(DVec3::new(level.x, layout.height_m / 2.0, level.z), aspect.facing),
        size_m: layout.size_m(),
        silhouette,
        alpha,
        distance_m: near.distance_m,
        time_to_contact_s: near.time_to_contact_s(),
        nearest_part: near.part,
        nearest_m: near.nearest_m,
        label_m: None,
    }
}

/// A pose at `middle` with +y up and +z along the horizontal unit vector `facing`.
pub(super) fn upright(middle: DVec3, facing: DVec3) -> radar_sar::geometry::Pose {
    radar_sar::geometry::Pose::new(middle, DQuat::from_rotation_y(math::atan2(facing.x, facing.z)))
}

/// Square cells around the origin, a bit each. With a set of hashes a frame took a third more (lab example live_latency).
struct CellSet {
    cell_m: f64,
    /// Farthest cell from the middle along x and y.
    farthest: [i32; 2],
    bits: Vec<u64>,
}

impl CellSet {
    /// For points within ±`half_m`.
    fn covering(half_m: DVec2, cell_m: f64) -> Self {
        let farthest = (half_m / cell_m).round().to_array().map(|cells| cells as i32);
        let [columns, rows] = farthest.map(|cells| 2 * cells as usize + 1);
        Self { cell_m, farthest, bits: vec![0; (columns * rows).div_ceil(64)] }
    }

    /// Takes the cell of a point; returns whether it was free.
    fn insert(&mut self, point: DVec2) -> bool {
        let [x, y] = (point / self.cell_m).round().to_array().map(|at| at as i32);
        let [column, row] = [x + self.farthest[0], y + self.farthest[1]].map(|at| at as usize);
        let at = row * (2 * self.farthest[0] as usize + 1) + column;
        let (word, bit) = (&mut self.bits[at / 64], 1 << (at % 64));
        let is_free = *word & bit == 0;
        *word |= bit;
        is_free
    }
}

/// Distance from the vertical line between head and floor to a point; above the head, from the
/// head.
fn distance_from_wearer(head: DVec3, point: DVec3) -> f64 {
    let away = point - head;
    if away.y > 0.0 { away.length() } else { horizontal(away).length() }
}

fn horizontal(v: DVec3) -> DVec3 {
    DVec3::new(v.x, 0.0, v.z)
}

fn weighted_mean(points: &[DVec3], weight: impl Fn(usize) -> f64) -> DVec3 {
    let (sum, total) = points.iter().enumerate().fold((DVec3::ZERO, 0.0), |(sum, total), (i, p)| {
        let w = weight(i);
        (sum + *p * w, total + w)
    });
    sum / total
}

/// The nearest direction for which pictures are laid out.
fn nearest_direction(facing: DVec3) -> DVec3 {
    let step = std::f64::consts::TAU / PICTURE_DIRECTIONS;
    let (sin, cos) =
        math::sin_cos((math::atan2(facing.x, facing.z) / step).round().rem_euclid(PICTURE_DIRECTIONS) * step);
    DVec3::new(sin, 0.0, cos)
}

/// Rounds down to a step of the panel size; a value slightly above a step counts as that step.
fn round_down(v: f64) -> f64 {
    round_down_to(v, SIZE_STEP_M)
}

fn round_down_to(v: f64, step: f64) -> f64 {
    (v / step + 1e-9).floor() * step
}

fn round(v: f64) -> f64 {
    (v / DISC_STEP_M).round() * DISC_STEP_M
}

//! The room from above in the axes of the play area: forward is up.

use egui::{Align2, Color32, Painter, Pos2, Rect, Shape, Stroke, StrokeKind, Vec2, pos2, vec2};

use super::{ACCENT, CARD, FAINT, FAIR, ROUND, TEXT, font};

/// Colour of moving targets. Choice: unlike the colours of furniture.
const MOVING_COLOR: Color32 = Color32::from_rgb(255, 92, 168);
/// Colour of obstacles. Choice: muted, because furniture is the background of what moves.
const OBSTACLE_COLOR: Color32 = Color32::from_rgb(120, 150, 196);
/// Share of its colour for an obstacle from the saved map that was not detected again yet. Choice:
/// clearly fainter, still visible.
const RESTORED_ALPHA: f32 = 0.45;
/// Smallest and largest extent of the plan, metres. Choice: a small room fills the plan; beyond 10
/// m a chair would be a dot.
const MIN_SPAN_M: f64 = 3.5;
const MAX_SPAN_M: f64 = 10.0;
/// Smallest radius of a drawn obstacle, pixels. Choice: still easy to see in a headset.
const MIN_RADIUS_PX: f32 = 11.0;
/// Height of the legend below the plan, pixels. Choice: one line of text.
const LEGEND_PX: f32 = 52.0;
/// Margin around the content, metres. Choice: marks at the edge are drawn completely.
const MARGIN_M: f64 = 0.4;

/// Position and view direction of the head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Head {
    /// Position x and z, metres.
    pub at_m: [f64; 2],
    /// Unit vector of the view direction, x and z.
    pub forward: [f64; 2],
    /// Half opening angle of the beam, radians.
    pub beam_rad: f64,
    /// Largest range of the search, metres.
    pub beam_m: f64,
}

/// An obstacle.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanObstacle {
    /// Its outline: corners of a convex polygon, x and z, metres.
    pub outline_m: Vec<[f64; 2]>,
    /// Position of its strongest point, x and z, metres.
    pub at_m: [f64; 2],
    /// 1σ of that position: two half axes of an ellipse, metres.
    pub sigma_m: [[f64; 2]; 2],
    /// Whether it is warned of at the moment.
    pub is_near: bool,
    /// Whether it is from the saved map and was not detected again yet.
    pub is_restored: bool,
}

/// A moving target: somewhere on an arc.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanMovingTarget {
    /// Sensor position at the observation.
    pub from_m: [f64; 2],
    /// The arc, from end to end.
    pub arc_m: Vec<[f64; 2]>,
}

/// Content of the plan. Positions are x and z of the standing universe, metres.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plan {
    /// Width and depth of the play area, centred on the origin.
    pub play_area_m: Option<[f64; 2]>,
    /// The head, if tracked.
    pub head: Option<Head>,
    /// Walls, as pairs of end points.
    pub walls_m: Vec<[[f64; 2]; 2]>,
    /// Obstacles.
    pub obstacles: Vec<PlanObstacle>,
    /// Moving targets.
    pub moving: Vec<PlanMovingTarget>,
}

/// Convex hull: the corners in order around it.
pub fn hull(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut sorted: Vec<[f64; 2]> = points.iter().copied().filter(|p| p[0].is_finite() && p[1].is_finite()).collect();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    sorted.dedup();
    if sorted.len() < 3 {
        return sorted;
    }
    let turn = |o: [f64; 2], a: [f64; 2], b: [f64; 2]| (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
    let half = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for point in points {
            while let [.., before, last] = chain[..]
                && turn(before, last, point) <= 0.0
            {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut all = half(&mut sorted.iter().copied());
    all.extend(half(&mut sorted.iter().rev().copied()));
    all
}

/// Maps metres to pixels.
struct View {
    area: Rect,
    middle_m: [f64; 2],
    px_per_m: f64,
}

impl View {
    /// Shows all content, within the limits of the extent.
    fn of(plan: &Plan, area: Rect) -> Self {
        let mut least = [-MIN_SPAN_M / 2.0; 2];
        let mut most = [MIN_SPAN_M / 2.0; 2];
        let mut hold = |[x, z]: [f64; 2]| {
            for (i, v) in [x, z].into_iter().enumerate().filter(|(_, v)| v.is_finite()) {
                least[i] = f64::min(least[i], v.max(-MAX_SPAN_M / 2.0) - MARGIN_M);
                most[i] = f64::max(most[i], v.min(MAX_SPAN_M / 2.0) + MARGIN_M);
            }
        };
        if let Some([width, depth]) = plan.play_area_m {
            [[width / 2.0, depth / 2.0], [-width / 2.0, -depth / 2.0]].into_iter().for_each(&mut hold);
        }
        plan.walls_m.iter().flatten().copied().for_each(&mut hold);
        plan.obstacles.iter().flat_map(|obstacle| &obstacle.outline_m).copied().for_each(&mut hold);
        plan.head.iter().for_each(|head| hold(head.at_m));
        // Rounded to half metres, so that the scale does not change continuously.
        let [least, most] = [least.map(|v| (v * 2.0).floor() / 2.0), most.map(|v| (v * 2.0).ceil() / 2.0)];
        let scale = |i: usize, px: f32| f64::from(px) / (most[i] - least[i]);
        let px_per_m = scale(0, area.width()).min(scale(1, area.height()));
        Self { area, middle_m: [(least[0] + most[0]) / 2.0, (least[1] + most[1]) / 2.0], px_per_m }
    }

    fn at(&self, [x, z]: [f64; 2]) -> Pos2 {
        self.area.center() + self.along([x - self.middle_m[0], z - self.middle_m[1]])
    }

    fn along(&self, [x, z]: [f64; 2]) -> Vec2 {
        vec2((x * self.px_per_m) as f32, (z * self.px_per_m) as f32)
    }
}

/// Draws it.
pub(super) fn draw(painter: &Painter, area: Rect, plan: &Plan) {
    painter.rect_filled(area, ROUND, CARD);
    let mut inner = area.shrink(10.0);
    inner.max.y -= LEGEND_PX - 10.0;
    let view = View::of(plan, inner);
    let clipped = painter.with_clip_rect(inner);
    grid(&clipped, &view);
    if let Some([width, depth]) = plan.play_area_m {
        let half = [width / 2.0, depth / 2.0];
        let rect = Rect::from_two_pos(view.at([-half[0], -half[1]]), view.at(half));
        clipped.rect_filled(rect, 4, ACCENT.gamma_multiply(0.06));
        clipped.rect_stroke(rect, 4, Stroke::new(3.0, ACCENT.gamma_multiply(0.7)), StrokeKind::Middle);
    }
    if let Some(head) = &plan.head {
        beam(&clipped, &view, head);
    }
    for wall in &plan.walls_m {
        clipped.line_segment(wall.map(|end| view.at(end)), Stroke::new(9.0, Color32::from_rgb(168, 178, 196)));
    }
    plan.obstacles.iter().for_each(|obstacle| draw_obstacle(&clipped, &view, obstacle));
    plan.moving.iter().for_each(|mover| draw_moving_target(&clipped, &view, mover));
    if let Some(head) = &plan.head {
        draw_head(&clipped, &view, head);
    }
    legend(painter, area, plan);
}

fn grid(painter: &Painter, view: &View) {
    let reach = (f64::from(view.area.width().max(view.area.height())) / view.px_per_m / 2.0).ceil() as i64 + 1;
    let middle = view.middle_m.map(|v| v.round() as i64);
    for n in -reach..=reach {
        let [x, z] = [0, 1].map(|i| view.at([(middle[0] + n) as f64, (middle[1] + n) as f64])[i]);
        let stroke = Stroke::new(1.5, Color32::from_rgb(48, 57, 73));
        painter.vline(x, view.area.y_range(), stroke);
        painter.hline(view.area.x_range(), z, stroke);
    }
}

fn beam(painter: &Painter, view: &View, head: &Head) {
    /// Corners of the beam's arc. Choice: it looks round.
    const STEPS: usize = 24;
    let ahead = head.forward[1].atan2(head.forward[0]);
    let half = head.beam_rad.clamp(0.02, 1.5);
    let edge = |n: usize| {
        let angle = ahead + half * (2.0 * n as f64 / STEPS as f64 - 1.0);
        view.at([head.at_m[0] + head.beam_m * angle.cos(), head.at_m[1] + head.beam_m * angle.sin()])
    };
    let mut corners = vec![view.at(head.at_m)];
    corners.extend((0..=STEPS).map(edge));
    painter.add(Shape::convex_polygon(corners, ACCENT.gamma_multiply(0.13), Stroke::NONE));
}

fn draw_obstacle(painter: &Painter, view: &View, obstacle: &PlanObstacle) {
    let color = if obstacle.is_near { FAIR } else { OBSTACLE_COLOR };
    let color = if obstacle.is_restored { color.gamma_multiply(RESTORED_ALPHA) } else { color };
    let corners: Vec<Pos2> = obstacle.outline_m.iter().map(|corner| view.at(*corner)).collect();
    let around = Rect::from_points(&corners);
    match corners.len() {
        // Obstacles too small to be visible get the smallest radius.
        0..=2 => drop(painter.circle_filled(view.at(obstacle.at_m), MIN_RADIUS_PX, color)),
        _ if around.width().max(around.height()) < 2.0 * MIN_RADIUS_PX => {
            painter.circle_filled(around.center(), MIN_RADIUS_PX, color);
        }
        _ => {
            let shape = Shape::convex_polygon(corners, color.gamma_multiply(0.45), Stroke::new(3.0, color));
            painter.add(shape);
        }
    }
    // 2σ ellipse: the obstacle is inside with 95 % probability along each axis.
    let axes = obstacle.sigma_m.map(|axis| view.along(axis.map(|v| 2.0 * v)));
    if axes.iter().any(|axis| axis.length() > MIN_RADIUS_PX + 2.0) {
        let middle = view.at(obstacle.at_m);
        let at = |n: usize| {
            let angle = n as f32 / 48.0 * std::f32::consts::TAU;
            middle + axes[0] * angle.cos() + axes[1] * angle.sin()
        };
        let around: Vec<Pos2> = (0..=48).map(at).collect();
        painter.extend(Shape::dashed_line(&around, Stroke::new(2.0, TEXT.gamma_multiply(0.75)), 8.0, 7.0));
    }
}

/// Draws the wedge in which the target was observed, and the arc it is on.
fn draw_moving_target(painter: &Painter, view: &View, mover: &PlanMovingTarget) {
    let arc: Vec<Pos2> = mover.arc_m.iter().map(|point| view.at(*point)).collect();
    let mut wedge = vec![view.at(mover.from_m)];
    wedge.extend(&arc);
    painter.add(Shape::convex_polygon(wedge, MOVING_COLOR.gamma_multiply(0.14), Stroke::NONE));
    painter.add(Shape::line(arc, Stroke::new(9.0, MOVING_COLOR)));
}

fn draw_head(painter: &Painter, view: &View, head: &Head) {
    let (middle, ahead) = (view.at(head.at_m), vec2(head.forward[0] as f32, head.forward[1] as f32));
    let aside = vec2(-ahead.y, ahead.x);
    let corners = vec![middle + ahead * 44.0, middle + aside * 18.0 + ahead * 4.0, middle - aside * 18.0 + ahead * 4.0];
    painter.add(Shape::convex_polygon(corners, TEXT, Stroke::NONE));
    painter.circle(middle, 18.0, TEXT, Stroke::new(4.0, ACCENT));
}

/// Legend below the plan, or why the plan is empty.
fn legend(painter: &Painter, area: Rect, plan: &Plan) {
    let y = area.max.y - LEGEND_PX / 2.0;
    let mut x = area.min.x + 24.0;
    let is_any_remembered = plan.obstacles.iter().any(|obstacle| obstacle.is_restored);
    let entries = [
        (Some(TEXT), "you"),
        (Some(OBSTACLE_COLOR), "obstacle"),
        (Some(FAIR), "near you"),
        (Some(ACCENT), "play area"),
        // There is room for only one of these.
        match (plan.moving.is_empty(), is_any_remembered) {
            (false, _) => (Some(MOVING_COLOR), "moving"),
            (true, true) => (Some(OBSTACLE_COLOR.gamma_multiply(RESTORED_ALPHA)), "remembered"),
            (true, false) => (None, "dashed: uncertain"),
        },
    ];
    for (color, text) in entries {
        if let Some(color) = color {
            painter.circle_filled(pos2(x + 8.0, y), 8.0, color);
            x += 24.0;
        }
        x = painter.text(pos2(x, y), Align2::LEFT_CENTER, text, font(20.0), FAINT).max.x + 26.0;
    }
    painter.text(pos2(area.max.x - 24.0, y), Align2::RIGHT_CENTER, "1 m squares", font(20.0), FAINT);
    if plan.obstacles.is_empty() && plan.walls_m.is_empty() {
        let at = pos2(area.center().x, area.min.y + 46.0);
        painter.text(at, Align2::CENTER_CENTER, "Nothing found yet: look around the room", font(26.0), FAINT);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hull_contains_only_corners() {
        let points = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 0.5], [0.5, 0.0], [f64::NAN, 0.0]];
        let mut corners = hull(&points);
        corners.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        assert_eq!(corners, [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]]);
        assert_eq!(hull(&[[1.0, 2.0], [1.0, 2.0]]), [[1.0, 2.0]]);
        assert_eq!(hull(&[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]), [[0.0, 0.0], [2.0, 2.0]]);
    }

    #[test]
    fn plan_fits_everything_with_forward_up() {
        let area = Rect::from_min_size(pos2(100.0, 50.0), vec2(800.0, 500.0));
        let plan =
            Plan { play_area_m: Some([2.0, 3.0]), walls_m: vec![[[-3.0, -2.0], [3.0, -2.0]]], ..Plan::default() };
        let view = View::of(&plan, area);
        for point in [[-3.0, -2.0], [3.0, -2.0], [1.0, 1.5]] {
            assert!(area.contains(view.at(point)), "{point:?} at {}", view.at(point));
        }
        assert!(view.at([0.0, -1.0]).y < view.at([0.0, 1.0]).y && view.at([1.0, 0.0]).x > view.at([-1.0, 0.0]).x);
        // A distant wall does not shrink the room to nothing.
        let far = Plan { walls_m: vec![[[900.0, 0.0], [900.0, f64::NAN]]], ..Plan::default() };
        assert!(View::of(&far, area).px_per_m > 40.0);
    }
}

//! The room on the screen: mouse control of the camera, and labels with names and distances.

use egui::{Align2, Color32, CornerRadius, FontId, PointerButton, Pos2, Rect, Sense, Ui, pos2, vec2};
use glam::{DVec2, DVec3};

use super::camera::{Camera, Eye};
use super::history::Moment;
use super::labels::Labels;
use super::layers::Layers;
use super::recording_info::RecordingInfo;
use super::room::{axis_names, label};
use super::style;
use radar_mapping::{MovingTarget, Obstacle};
use radar_sar::geometry::{Aabb, Plane};

/// Number of obstacles that are labelled with their distance. Choice: more labels would cover the
/// room.
const MAX_FULL_LABELS: usize = 6;

/// Content of the view.
pub struct ViewContent<'a> {
    /// Information about the recording.
    pub about: &'a RecordingInfo,
    /// The displayed moment.
    pub moment: &'a Moment,
    /// The visible layers.
    pub layers: &'a Layers,
    /// The displayed box.
    pub bounds: &'a Aabb,
    /// The end of the evidence colour scale.
    pub top_score: f32,
    /// The texture with the image of the room.
    pub texture: egui::TextureId,
}

/// Draws the view. Returns the eye for the next image, and whether the user moved the camera.
pub fn viewport(ui: &mut Ui, area: Rect, camera: &mut Camera, shown: &ViewContent) -> (Eye, bool) {
    let response = ui.allocate_rect(area, Sense::click_and_drag());
    let is_moved = steer(ui, area, &response, camera);
    let eye = camera.eye(shown.moment.head.as_ref(), f64::from(area.width() / area.height().max(1.0)));
    let painter = ui.painter_at(area);
    painter.image(shown.texture, area, Rect::from_min_max(Pos2::ZERO, pos2(1.0, 1.0)), Color32::WHITE);
    let on_screen = |point: DVec3| {
        eye.project(point).map(|at| area.min + vec2(at.x as f32 * area.width(), at.y as f32 * area.height()))
    };
    names(&painter, shown, &on_screen, camera.is_first_person);
    legend(&painter, area, shown);
    (eye, is_moved)
}

fn steer(ui: &Ui, area: Rect, response: &egui::Response, camera: &mut Camera) -> bool {
    let way = response.drag_delta() / area.height().max(1.0);
    let way = DVec2::new(way.x.into(), way.y.into());
    let (scroll, zoom, shift) = ui.input(|i| (i.smooth_scroll_delta().y, i.zoom_delta(), i.modifiers.shift));
    let pans = response.dragged_by(PointerButton::Secondary)
        || response.dragged_by(PointerButton::Middle)
        || (shift && response.dragged());
    let zooms = response.contains_pointer() && (scroll != 0.0 || zoom != 1.0);
    if pans {
        camera.pan(way);
    } else if response.dragged() {
        camera.orbit(way);
    }
    if zooms {
        camera.zoom((f64::from(scroll) * 0.0025).exp() * f64::from(zoom));
    }
    let is_moved = (response.dragged() && way != DVec2::ZERO) || zooms;
    camera.is_first_person &= !is_moved;
    is_moved
}

fn names(painter: &egui::Painter, shown: &ViewContent, on_screen: &impl Fn(DVec3) -> Option<Pos2>, inside: bool) {
    let mut labels = Labels::default();
    let mut small = |point: DVec3, text: &str, color: Color32| {
        if let Some(at) = on_screen(point) {
            let taken = painter.text(at, Align2::CENTER_CENTER, text, FontId::proportional(12.0), color);
            labels.take(taken);
        }
    };
    axis_names(shown.bounds).into_iter().for_each(|(point, name)| small(point, name, style::MUTED));
    if !inside {
        metres(shown.bounds, &mut small);
    }
    if shown.layers.walls {
        for wall in &shown.moment.scene.walls {
            let foot = wall.plane.foot(wall.seen_at.center());
            let distance = shown.moment.head.map(|head| wall.plane.distance(head.translation).abs());
            let name = plane_name(&wall.plane);
            let text = distance.map_or(name.into(), |distance_m| format!("{name}  {distance_m:.2} m"));
            small(foot, &text, style::WALL.lerp_to_gamma(Color32::WHITE, 0.35));
        }
    }
    if shown.layers.truth {
        for truth in shown.about.truth.iter().flat_map(|truth| &truth.obstacles) {
            if let Some(around) = Aabb::around(truth.points_m.iter().copied()) {
                small(around.center().with_y(around.min.y - 0.06), &truth.name, style::TRUTH);
            }
        }
    }
    if shown.layers.moving {
        for moving in &shown.moment.scene.moving {
            moving_name(painter, moving, shown, on_screen, &mut labels);
        }
    }
    if shown.layers.obstacles {
        obstacle_names(painter, shown, on_screen, &mut labels);
    }
}

/// Name of a plane for the user.
fn plane_name(plane: &Plane) -> &'static str {
    match plane.is_level() {
        true if plane.outward.y < 0.0 => "floor",
        true => "ceiling",
        false => "wall",
    }
}

/// Distances along two edges of the floor, metres.
fn metres(bounds: &Aabb, small: &mut impl FnMut(DVec3, &str, Color32)) {
    let y = bounds.min.y;
    for x in bounds.min.x.ceil() as i32..=bounds.max.x.floor() as i32 {
        small(DVec3::new(x.into(), y, (bounds.max.z / 0.5).ceil() * 0.5 + 0.18), &format!("{x} m"), style::MUTED);
    }
    for z in bounds.min.z.ceil() as i32..=bounds.max.z.floor() as i32 {
        small(DVec3::new((bounds.max.x / 0.5).ceil() * 0.5 + 0.22, y, z.into()), &format!("{z} m"), style::MUTED);
    }
}

/// Labels a moving target beside the end of its arc.
fn moving_name(
    painter: &egui::Painter,
    moving: &MovingTarget,
    shown: &ViewContent,
    on_screen: &impl Fn(DVec3) -> Option<Pos2>,
    labels: &mut Labels,
) {
    let Some(at) = on_screen(moving.place_m(1.3 * moving.half_width_rad(), 0.0)) else { return };
    let text = moving.label(shown.moment.head.as_ref());
    let galley = painter.layout_no_wrap(text, FontId::proportional(14.0), style::MOVING);
    let chip = labels.place_above(Align2::CENTER_CENTER.anchor_size(at, galley.size()).expand2(vec2(4.0, 1.0)));
    painter.rect_filled(chip, CornerRadius::same(3), style::GROUND.gamma_multiply(0.85));
    painter.galley(chip.min + vec2(4.0, 1.0), galley, style::MOVING);
}

/// Labels the nearest obstacles and the selected one with distances, the others with numbers.
fn obstacle_names(
    painter: &egui::Painter,
    shown: &ViewContent,
    on_screen: &impl Fn(DVec3) -> Option<Pos2>,
    labels: &mut Labels,
) {
    let head = shown.moment.head.as_ref();
    let distance = |obstacle: &Obstacle| head.map_or(0.0, |head| obstacle.distance_m(head.translation));
    let mut order: Vec<&Obstacle> = shown.moment.scene.obstacles.iter().collect();
    order.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    for (n, obstacle) in order.into_iter().enumerate() {
        let top_m = obstacle.around().map_or(obstacle.position_m.y, |shape| shape.max.y);
        let Some(at) = on_screen(obstacle.position_m.with_y(top_m.max(obstacle.position_m.y) + 0.05)) else { continue };
        let is_selected = shown.layers.selected == Some(obstacle.id);
        let is_whole = n < MAX_FULL_LABELS || is_selected;
        let text = if is_whole { label(obstacle, head) } else { format!("#{}", obstacle.id) };
        let color = if is_whole { style::FOUND } else { style::FOUND.gamma_multiply(0.75) };
        let galley = painter.layout_no_wrap(text, FontId::proportional(if is_whole { 14.0 } else { 11.0 }), color);
        let chip = Align2::CENTER_BOTTOM.anchor_size(at, galley.size()).expand2(vec2(4.0, 1.0));
        let chip = labels.place_above(chip);
        painter.rect_filled(
            chip,
            CornerRadius::same(3),
            style::GROUND.gamma_multiply(if is_whole { 0.85 } else { 0.5 }),
        );
        if is_selected {
            let stroke = egui::Stroke::new(1.0, style::FOUND);
            painter.rect_stroke(chip, CornerRadius::same(3), stroke, egui::StrokeKind::Outside);
        }
        painter.galley(chip.min + vec2(4.0, 1.0), galley, color);
    }
}

/// Legend: meaning of the colours, and the grid spacing.
fn legend(painter: &egui::Painter, area: Rect, shown: &ViewContent) {
    let font = FontId::proportional(12.0);
    let mut at = area.left_bottom() + vec2(14.0, -14.0);
    let text = |at: Pos2, text: String| {
        painter.text(at, Align2::LEFT_BOTTOM, text, font.clone(), style::MUTED);
    };
    text(at, "grid 0.5 m; ellipsoids: 2σ".into());
    if shown.layers.evidence {
        at.y -= 20.0;
        let bar = Rect::from_min_max(at - vec2(0.0, 12.0), at + vec2(160.0, -2.0));
        color_bar(painter, bar, style::evidence);
        let least = shown.layers.min_score;
        text(
            bar.right_bottom() + vec2(8.0, 3.0),
            format!("evidence: {} {least:.1} to {:.1}", shown.about.score_name(), shown.top_score.max(least)),
        );
    }
}

/// A horizontal colour scale.
pub fn color_bar(painter: &egui::Painter, bar: Rect, color: impl Fn(f64) -> Color32) {
    /// Parts of the colour scale. Choice: steps too small to see.
    const PARTS: u16 = 64;
    for n in 0..PARTS {
        let x = |n: u16| bar.left() + bar.width() * f32::from(n) / f32::from(PARTS);
        let part = Rect::from_min_max(pos2(x(n), bar.top()), pos2(x(n + 1), bar.bottom()));
        painter.rect_filled(part, 0.0, color(f64::from(n) / f64::from(PARTS - 1)));
    }
    painter.rect_stroke(bar, 0.0, egui::Stroke::new(1.0, style::GRID_METRE), egui::StrokeKind::Outside);
}

//! The timeline: what is processed, when obstacles were first confirmed, and the current position.

use egui::{Align2, FontId, Pos2, Rect, Sense, Stroke, StrokeKind, Ui, vec2};

use super::player::{Extent, Player};
use super::style;

/// Possible intervals between two ticks, seconds. Choice: round numbers, from one update to ten
/// minutes.
const TICKS_S: [f64; 12] = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 60.0, 120.0, 300.0, 600.0];
/// Smallest distance between two ticks, egui points. Choice: the widest number with a space.
const TICK_POINTS: f64 = 70.0;

/// Actions of the buttons beside the timeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TimelineActions {
    /// Step frames back or forward.
    pub step: i32,
    /// Show or hide the help list.
    pub help: bool,
}

/// Draws buttons and timeline. Applies seek, play and pause to the player.
pub fn timeline(ui: &mut Ui, player: &mut Player, extent: &Extent, marks: &[(f64, u64)]) -> TimelineActions {
    let mut asked = TimelineActions::default();
    ui.add_space(4.0);
    ui.horizontal(|ui| {
        buttons(ui, player, extent, &mut asked);
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            asked.help = ui.button("Keys (?)").clicked();
            ui.add_space(8.0);
            ui.label(egui::RichText::new(state(player, extent)).color(style::MUTED));
        });
    });
    strip(ui, player, extent, marks);
    asked
}

/// Icons painted on buttons, because the fonts lack these glyphs.
#[derive(Clone, Copy)]
enum Icon {
    First,
    Back,
    Play,
    Pause,
    On,
    Last,
}

fn icon_button(ui: &mut Ui, sign: Icon, hint: &str) -> bool {
    let response = ui.add(egui::Button::new("").min_size(vec2(32.0, 24.0))).on_hover_text(hint);
    let (middle, color) = (response.rect.center(), ui.style().interact(&response).fg_stroke.color);
    let painter = ui.painter();
    let triangle = |x: f32, way: f32| {
        let corners = [(-3.5 * way, -6.0), (4.5 * way, 0.0), (-3.5 * way, 6.0)];
        let corners = corners.map(|(dx, dy)| middle + vec2(x + dx, dy)).to_vec();
        painter.add(egui::Shape::convex_polygon(corners, color, Stroke::NONE));
    };
    let bar = |x: f32, width: f32| {
        painter.rect_filled(Rect::from_center_size(middle + vec2(x, 0.0), vec2(width, 12.0)), 0.0, color);
    };
    match sign {
        Icon::First => (triangle(2.0, -1.0), bar(-5.0, 2.0)).1,
        Icon::Back => (triangle(-2.0, -1.0), bar(5.0, 2.0)).1,
        Icon::Play => triangle(0.0, 1.4),
        Icon::Pause => (bar(-3.5, 4.0), bar(3.5, 4.0)).1,
        Icon::On => (bar(-5.0, 2.0), triangle(2.0, 1.0)).1,
        Icon::Last => (triangle(-2.0, 1.0), bar(5.0, 2.0)).1,
    }
    response.clicked()
}

fn buttons(ui: &mut Ui, player: &mut Player, extent: &Extent, asked: &mut TimelineActions) {
    if icon_button(ui, Icon::First, "To the beginning (Home)") {
        player.seek(0.0, extent);
    }
    if icon_button(ui, Icon::Back, "One radar frame back (left arrow)") {
        asked.step = -1;
    }
    let play = if player.is_playing() { Icon::Pause } else { Icon::Play };
    if icon_button(ui, play, "Play or pause (space)") {
        player.toggle(extent);
    }
    if icon_button(ui, Icon::On, "One radar frame on (right arrow)") {
        asked.step = 1;
    }
    if icon_button(ui, Icon::Last, "To the end (End)") {
        player.seek(extent.duration_s, extent);
    }
    let mut is_looping = player.is_looping();
    if ui.toggle_value(&mut is_looping, "Loop").on_hover_text("Begin again at the end (L)").changed() {
        player.set_looping(is_looping);
    }
    let mut speed = player.speed();
    let slider = egui::Slider::new(&mut speed, super::player::SPEEDS[0]..=super::player::SPEEDS[1]);
    let slider = slider.logarithmic(true).suffix("×").custom_formatter(|v, _| format!("{v:.2}"));
    if ui.add(slider).on_hover_text("Speed (+ and −)").changed() {
        player.set_speed(speed);
    }
    ui.add_space(8.0);
    let time = format!("{} / {}", style::clock(player.time_s()), style::clock(extent.duration_s));
    ui.label(egui::RichText::new(time).monospace().size(15.0));
}

/// Progress of the processing, as text.
fn state(player: &Player, extent: &Extent) -> String {
    if extent.is_complete {
        return String::new();
    }
    if player.is_live() {
        return match extent.buffered_s - player.time_s() {
            _ if player.is_at_edge() => "live".to_owned(),
            behind_s => format!("{} behind live; press End to follow", style::clock(behind_s.max(0.0))),
        };
    }
    let percent = 100.0 * extent.buffered_s / extent.duration_s.max(1e-9);
    match player.awaited_s() {
        Some(awaited_s) => format!("processing up to {} … {percent:.0} %", style::clock(awaited_s)),
        None => format!("processing the recording … {percent:.0} %"),
    }
}

fn strip(ui: &mut Ui, player: &mut Player, extent: &Extent, marks: &[(f64, u64)]) {
    let (area, response) = ui.allocate_exact_size(vec2(ui.available_width(), 44.0), Sense::click_and_drag());
    let bar = Rect::from_min_max(area.min + vec2(8.0, 14.0), area.max - vec2(8.0, 16.0));
    let duration_s = extent.duration_s.max(1e-9);
    let x = |time_s: f64| bar.left() + bar.width() * (time_s / duration_s).clamp(0.0, 1.0) as f32;
    if let Some(at) = response.interact_pointer_pos().filter(|_| response.dragged() || response.clicked()) {
        player.seek(f64::from((at.x - bar.left()) / bar.width()) * duration_s, extent);
    }
    let painter = ui.painter_at(area);
    painter.rect_filled(bar, 3.0, style::GROUND);
    let buffered = Rect::from_min_max(bar.min, Pos2::new(x(extent.buffered_s), bar.max.y));
    painter.rect_filled(buffered, 3.0, style::GRID);
    let played = Rect::from_min_max(bar.min, Pos2::new(x(player.time_s()), bar.max.y));
    painter.rect_filled(played, 3.0, ui.visuals().selection.bg_fill);
    painter.rect_stroke(bar, 3.0, Stroke::new(1.0, style::GRID_METRE), StrokeKind::Outside);
    ticks(&painter, bar, duration_s, &x);
    for (time_s, id) in marks {
        let at = Pos2::new(x(*time_s), bar.top() - 2.0);
        let corners = vec![at, at + vec2(-4.0, -8.0), at + vec2(4.0, -8.0)];
        painter.add(egui::Shape::convex_polygon(corners, style::FOUND, Stroke::NONE));
        painter.line_segment([at, Pos2::new(at.x, bar.bottom())], Stroke::new(1.0, style::FOUND.gamma_multiply(0.5)));
        let pointer = response.hover_pos().filter(|pointer| (pointer.x - at.x).abs() < 5.0);
        if let Some(pointer) = pointer {
            let text = format!("obstacle #{id} first confirmed at {}", style::clock(*time_s));
            let anchor = if pointer.x > area.center().x { Align2::RIGHT_BOTTOM } else { Align2::LEFT_BOTTOM };
            ui.painter().text(
                Pos2::new(at.x, area.top() + 2.0),
                anchor,
                text,
                FontId::proportional(13.0),
                style::FOUND,
            );
        }
    }
    for (time_s, color) in
        player.awaited_s().map(|s| (s, style::MUTED)).into_iter().chain([(player.time_s(), style::HEAD)])
    {
        let at = x(time_s);
        painter
            .line_segment([Pos2::new(at, bar.top() - 4.0), Pos2::new(at, bar.bottom() + 4.0)], Stroke::new(2.0, color));
        painter.circle_filled(Pos2::new(at, bar.bottom() + 3.0), 4.0, color);
    }
}

fn ticks(painter: &egui::Painter, bar: Rect, duration_s: f64, x: &impl Fn(f64) -> f32) {
    let least_s = TICK_POINTS * duration_s / f64::from(bar.width()).max(1.0);
    let step_s = TICKS_S.into_iter().find(|step_s| *step_s >= least_s).unwrap_or(least_s.max(600.0));
    let count = (duration_s / step_s).floor().min(1000.0) as u32;
    for time_s in (0..=count).map(|n| f64::from(n) * step_s) {
        let at = Pos2::new(x(time_s), bar.bottom());
        painter.line_segment([at, at + vec2(0.0, 4.0)], Stroke::new(1.0, style::MUTED));
        let text = if step_s < 1.0 {
            format!("{time_s:.1}")
        } else {
            format!("{}:{:02}", time_s as u64 / 60, time_s as u64 % 60)
        };
        // The first tick label is left-aligned, so that it does not stick out.
        let anchor = if time_s > 0.0 { Align2::CENTER_TOP } else { Align2::LEFT_TOP };
        let beside = if time_s > 0.0 { 0.0 } else { -6.0 };
        painter.text(at + vec2(beside, 4.0), anchor, text, FontId::proportional(11.0), style::MUTED);
    }
}

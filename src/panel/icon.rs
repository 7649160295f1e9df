//! The tab's icon: radar waves in front of a corner of the room.

use egui::{Color32, CornerRadius, Painter, Pos2, Rect, Stroke, Ui, vec2};

use super::{ACCENT, FAIR};

/// Fills the given area with the icon.
pub fn icon(ui: &Ui, size_px: f32) {
    draw(ui.painter(), Rect::from_min_size(Pos2::ZERO, vec2(size_px, size_px)));
}

pub(super) fn draw(painter: &Painter, rect: Rect) {
    let unit = rect.width() / 64.0;
    let at = |x: f32, y: f32| rect.min + vec2(x, y) * unit;
    painter.rect_filled(rect, CornerRadius::same((12.0 * unit) as u8), Color32::from_rgb(20, 32, 46));
    let waves = at(16.0, 48.0);
    for (n, radius) in [14.0, 25.0, 36.0].into_iter().enumerate() {
        let arc = |step: usize| {
            let angle = (8.0 + 74.0 * step as f32 / 20.0).to_radians();
            waves + vec2(angle.cos(), -angle.sin()) * radius * unit
        };
        let points: Vec<Pos2> = (0..=20).map(arc).collect();
        painter.line(points, Stroke::new(4.0 * unit, ACCENT.gamma_multiply(1.0 - 0.22 * n as f32)));
    }
    painter.circle_filled(waves, 6.0 * unit, Color32::WHITE);
    painter.circle_filled(at(50.0, 15.0), 6.5 * unit, FAIR);
}

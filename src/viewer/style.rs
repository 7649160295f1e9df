//! Colours of the view (sRGB), and number formats.

use egui::Color32;

/// Background.
pub const GROUND: Color32 = Color32::from_rgb(0x14, 0x16, 0x1a);
/// Panels of the window.
pub const PANEL: Color32 = Color32::from_rgb(0x1b, 0x1e, 0x23);
/// Lines between widgets, and the floor grid.
pub const GRID: Color32 = Color32::from_rgb(0x35, 0x3a, 0x42);
/// Floor grid lines at full metres.
pub const GRID_METRE: Color32 = Color32::from_rgb(0x4b, 0x52, 0x5c);
/// Text.
pub const INK: Color32 = Color32::from_rgb(0xe6, 0xe8, 0xeb);
/// Secondary text.
pub const MUTED: Color32 = Color32::from_rgb(0x9a, 0xa1, 0xab);
/// The head and its path, and the playhead.
pub const HEAD: Color32 = Color32::from_rgb(0xf2, 0xf4, 0xf7);
/// The radar's beam.
pub const BEAM: Color32 = Color32::from_rgb(0xc9, 0x9b, 0xe8);
/// Detected obstacles.
pub const FOUND: Color32 = Color32::from_rgb(0x6f, 0xe3, 0x9a);
/// Detected walls.
pub const WALL: Color32 = Color32::from_rgb(0x5b, 0x93, 0xf0);
/// Moving targets.
pub const MOVING: Color32 = Color32::from_rgb(0xff, 0x5c, 0xa8);
/// Ground truth.
pub const TRUTH: Color32 = Color32::from_rgb(0x8d, 0x95, 0xa0);
/// Unhealthy values.
pub const BAD: Color32 = Color32::from_rgb(0xf0, 0x8a, 0x6a);

/// Red, green, blue and alpha, 0 to 1.
pub fn rgba(color: Color32, alpha: f32) -> [f32; 4] {
    let [r, g, b, _] = color.to_array().map(|v| f32::from(v) / 255.0);
    [r, g, b, alpha]
}

/// The colour for a share of the largest evidence, 0 to 1. The darkest part of the scale, which is
/// not visible on the background, is not used.
pub fn evidence(share: f64) -> Color32 {
    let [r, g, b] = crate::report::inferno(0.25 + 0.75 * share.clamp(0.0, 1.0));
    Color32::from_rgb(r, g, b)
}

/// Minutes and seconds to a hundredth.
pub fn clock(time_s: f64) -> String {
    let hundredths = (time_s.max(0.0) * 100.0).round() as u64;
    format!("{}:{:02}.{:02}", hundredths / 6000, hundredths / 100 % 60, hundredths % 100)
}

/// Applies the colours to the whole window.
pub fn apply(context: &egui::Context) {
    context.set_theme(egui::Theme::Dark);
    let mut visuals = egui::Visuals::dark();
    visuals.panel_fill = PANEL;
    visuals.window_fill = PANEL;
    visuals.extreme_bg_color = GROUND;
    visuals.override_text_color = Some(INK);
    visuals.widgets.noninteractive.bg_stroke = egui::Stroke::new(1.0, GRID);
    visuals.selection.bg_fill = Color32::from_rgb(0x2f, 0x5d, 0x8a);
    context.set_visuals_of(egui::Theme::Dark, visuals);
    context.options_mut(|options| options.zoom_with_keyboard = false);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clock_formats_minutes_and_seconds() {
        assert_eq!(
            [0.0, 9.994, 59.996, 754.25, -1.0].map(clock),
            ["0:00.00", "0:09.99", "1:00.00", "12:34.25", "0:00.00"]
        );
    }
}

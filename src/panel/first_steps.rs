//! What to do until the radar sees the room: shown where the room will be.

use egui::{Align2, Painter, Rect, Stroke, pos2, vec2};

use super::health::{Health, MountHealth, SensorHealth};
use super::{ACCENT, CARD, FAINT, GOOD, ROUND, TEXT, font};

/// Layout, pixels. Choice: four steps with three lines each fit into the plan's place.
const TITLE_PX: f32 = 76.0;
const INDENT_PX: f32 = 84.0;
/// Longest reason shown, characters. Choice: three lines of the page.
const MAX_REASON: usize = 170;

/// A step.
struct Step {
    title: &'static str,
    text: String,
    is_done: bool,
}

/// Whether the page is wanted: nothing was measured yet, and no map was restored.
pub(super) fn is_wanted(health: &Health) -> bool {
    health.age_s.is_none() && health.restored == 0
}

fn steps(health: &Health) -> [Step; 4] {
    let has_sensor = matches!(health.sensor, SensorHealth::Streaming { .. });
    let sensor = match (&health.sensor, &health.sensor_trouble) {
        (SensorHealth::Streaming { .. }, _) => "It measures.".to_owned(),
        (_, Some(why)) => shortened(why),
        (SensorHealth::Missing, None) => "Plug the board in, with a cable that carries data.".to_owned(),
        (SensorHealth::Starting | SensorHealth::Silent, None) => "It is being set up.".to_owned(),
    };
    let tracking = match health.is_tracked {
        true => "The headset is tracked.",
        false => "Put the headset on, in view of its base stations or cameras.",
    };
    let mount = match health.mount {
        MountHealth::Unknown => "Turn and nod your head: the program finds by itself where the sensor sits.",
        _ => "The program knows where the sensor sits.",
    };
    [
        Step { title: "Radar sensor", text: sensor, is_done: has_sensor },
        Step { title: "Headset", text: tracking.to_owned(), is_done: health.is_tracked },
        Step { title: "Sensor on the headset", text: mount.to_owned(), is_done: health.mount != MountHealth::Unknown },
        Step {
            title: "The room",
            text: "Look around for some seconds. What the radar has seen is drawn here, and warnings begin.".to_owned(),
            is_done: false,
        },
    ]
}

/// Draws the page.
pub(super) fn draw(painter: &Painter, area: Rect, health: &Health) {
    painter.rect_filled(area, ROUND, CARD);
    let left = area.min.x + 32.0;
    painter.text(pos2(left, area.min.y + 48.0), Align2::LEFT_CENTER, "First steps", font(36.0), TEXT);
    let steps = steps(health);
    let next = steps.iter().position(|step| !step.is_done);
    let height = (area.height() - TITLE_PX - 16.0) / steps.len() as f32;
    for (number, step) in steps.iter().enumerate() {
        let top = area.min.y + TITLE_PX + number as f32 * height;
        let middle = pos2(left + 24.0, top + 30.0);
        let color = match (step.is_done, next == Some(number)) {
            (true, _) => GOOD,
            (false, true) => ACCENT,
            (false, false) => FAINT,
        };
        if step.is_done {
            painter.circle_filled(middle, 22.0, color);
            // The font has no check mark.
            let check = [vec2(-10.0, 0.0), vec2(-3.0, 8.0), vec2(11.0, -8.0)].map(|to| middle + to);
            painter.line(check.to_vec(), Stroke::new(4.0, CARD));
        } else {
            painter.circle_stroke(middle, 21.0, Stroke::new(3.0, color));
            painter.text(middle, Align2::CENTER_CENTER, number + 1, font(26.0), color);
        }
        painter.text(pos2(left + INDENT_PX, top + 16.0), Align2::LEFT_CENTER, step.title, font(27.0), TEXT);
        let text = painter.layout(step.text.clone(), font(21.0), FAINT, area.max.x - left - INDENT_PX - 28.0);
        painter.galley(pos2(left + INDENT_PX, top + 34.0), text, FAINT);
    }
}

/// A reason in one paragraph, as long as fits.
fn shortened(why: &str) -> String {
    let why = why.split_whitespace().collect::<Vec<_>>().join(" ");
    match why.char_indices().nth(MAX_REASON) {
        Some((end, _)) => format!("{}…", why[..end].trim_end()),
        None => why,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panel::{plan_area, whole};

    fn texts(health: &Health) -> Vec<(String, Rect)> {
        let context = egui::Context::default();
        let input = egui::RawInput { screen_rect: Some(whole()), ..Default::default() };
        let output = context.run_ui(input, |ui| draw(ui.painter(), plan_area(), health));
        let text = |shape: &egui::epaint::ClippedShape| match &shape.shape {
            egui::Shape::Text(text) => Some((text.galley.text().to_owned(), text.visual_bounding_rect())),
            _ => None,
        };
        let found = output.shapes.iter().filter_map(text).collect();
        output.drop_without_applying_deltas();
        found
    }

    #[test]
    fn the_reason_for_a_missing_sensor_is_shown() {
        let why = "no permission to open /dev/ttyACM0: add yourself to the group dialout".to_owned();
        let health = Health { sensor_trouble: Some(why.clone()), ..Health::default() };
        assert!(texts(&health).iter().any(|(text, _)| *text == why));
        let streams = SensorHealth::Streaming { sweeps_per_s: 1000.0, lost_percent: 0.0 };
        let health = Health { sensor: streams, is_tracked: true, ..health };
        let texts = texts(&health);
        let shows = |wanted: &str| texts.iter().any(|(text, _)| text == wanted);
        assert!(!shows(&why) && !shows("1") && !shows("2") && shows("3"), "{texts:?}");
    }

    #[test]
    fn texts_fit_without_overlap() {
        for sensor_trouble in [None, Some("a word ".repeat(300))] {
            let health = Health { sensor_trouble, ..Health::default() };
            let texts = texts(&health);
            for (n, (text, rect)) in texts.iter().enumerate() {
                assert!(plan_area().contains_rect(*rect), "{text}: {rect}");
                assert!(texts[..n].iter().all(|(_, other)| !other.shrink(1.0).intersects(*rect)), "{text}");
            }
        }
    }
}

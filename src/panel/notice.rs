//! What a player must be told in the headset while the panel, which tells it too, is not open: that the radar sees nothing, and that it sees
//! again. Silence would be taken for a room without obstacles.

use egui::{CornerRadius, Rect, Stroke, StrokeKind, Ui, pos2, vec2};

use super::health::State;
use super::{BACKGROUND, FAINT, TEXT, font, icon};

/// Width and height of its picture, pixels.
pub const NOTICE_SIZE: [u32; 2] = [1040, 200];

/// What there is to say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Notice {
    /// No sensor was found since the start.
    NoSensor,
    /// It was there and is not any more.
    SensorGone,
    /// It is there and sends nothing.
    SensorSilent,
    /// The reconstruction has ended.
    MapStopped,
    /// It is well again.
    Recovered,
}

impl Notice {
    fn state(self) -> State {
        if self == Self::Recovered { State::Good } else { State::Bad }
    }

    /// What it says first: for the log as well.
    pub fn headline(self) -> &'static str {
        self.texts()[0]
    }

    fn texts(self) -> [&'static str; 2] {
        match self {
            Self::NoSensor => ["No radar sensor: no new warnings", "Plug it in. Nothing new is seen without it."],
            Self::SensorGone => ["Radar lost: no new warnings", "Plug it in again. Only known obstacles are shown."],
            Self::SensorSilent => {
                ["Radar is silent: no new warnings", "Unplug it and plug it in again, if it stays so."]
            }
            Self::MapStopped => ["The map stopped: no new warnings", "Restart Radar chaperone."],
            Self::Recovered => ["The radar measures", "Obstacles are warned of as they are seen."],
        }
    }
}

/// Draws it: the program's sign, what is the matter, what to do.
pub fn notice(ui: &Ui, notice: Notice) {
    let painter = ui.painter();
    let [width, height] = NOTICE_SIZE.map(|px| px as f32);
    let card = Rect::from_min_size(pos2(0.0, 0.0), vec2(width, height)).shrink(4.0);
    let round = CornerRadius::same(28);
    let color = notice.state().color();
    painter.rect(card, round, BACKGROUND, Stroke::new(4.0, color), StrokeKind::Inside);
    icon::draw(painter, Rect::from_center_size(pos2(100.0, height / 2.0), vec2(124.0, 124.0)));
    let [says, more] = notice.texts();
    let text = |text: &str, size, color| painter.layout_no_wrap(text.to_owned(), font(size), color);
    let (says, more) = (text(says, 48.0, TEXT), text(more, 34.0, FAINT));
    let top = (height - says.size().y - 10.0 - more.size().y) / 2.0;
    let below = top + says.size().y + 10.0;
    painter.galley(pos2(190.0, top), says, TEXT);
    painter.galley(pos2(190.0, below), more, FAINT);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notice_texts_fit() {
        let context = egui::Context::default();
        for which in [Notice::NoSensor, Notice::SensorGone, Notice::SensorSilent, Notice::MapStopped, Notice::Recovered]
        {
            let output = context.run_ui(egui::RawInput::default(), |ui| notice(ui, which));
            let texts: Vec<Rect> = output
                .shapes
                .iter()
                .filter(|shape| matches!(shape.shape, egui::Shape::Text(_)))
                .map(|shape| shape.shape.visual_bounding_rect())
                .collect();
            assert_eq!(texts.len(), 2, "{which:?}");
            let room = Rect::from_min_max(pos2(180.0, 20.0), pos2(1015.0, 180.0));
            assert!(texts.iter().all(|text| room.contains_rect(*text)), "{which:?}: {texts:?}");
            assert!(texts[0].max.y <= texts[1].min.y + 1.0, "{which:?}: {texts:?}");
            output.drop_without_applying_deltas();
        }
    }
}

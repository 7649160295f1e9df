//! Notices shown in the headset while the panel is closed: the radar sees nothing, or sees again.
//! Without them, no warnings would look like a room without obstacles.

use egui::{CornerRadius, Rect, Stroke, StrokeKind, Ui, pos2, vec2};

use super::health::State;
use super::{BACKGROUND, FAINT, TEXT, font, icon};

/// Width and height of the notice, pixels. Choice: up to four lines in large letters.
pub const NOTICE_SIZE: [u32; 2] = [1040, 264];

/// What the user is notified of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Notice {
    /// No sensor was found since the start.
    NoSensor,
    /// The sensor was disconnected.
    SensorGone,
    /// The sensor is connected but sends no data.
    SensorSilent,
    /// The reconstruction has stopped.
    MapStopped,
    /// The runtime refuses the display mode of the settings.
    PanelsInstead,
    /// The runtime refuses all warnings.
    CuesAlone,
    /// The fault is over.
    Recovered,
    /// The first session.
    Welcome,
}

impl Notice {
    fn state(self) -> State {
        match self {
            Self::Recovered | Self::Welcome => State::Good,
            Self::PanelsInstead => State::Fair,
            _ => State::Bad,
        }
    }

    /// The first line. Also used in the log.
    pub fn headline(self) -> &'static str {
        self.texts()[0]
    }

    fn texts(self) -> [&'static str; 2] {
        match self {
            Self::NoSensor => ["No radar sensor: no new warnings", "Plug it in. Nothing new is seen without it."],
            Self::SensorGone => ["Radar lost: no new warnings", "Plug it in again. Only known obstacles are shown."],
            Self::SensorSilent => {
                ["Radar is silent: no new warnings", "If this persists, unplug it and plug it in again."]
            }
            Self::MapStopped => ["The map stopped: no new warnings", "Restart Radar chaperone."],
            Self::PanelsInstead => {
                ["Warnings are shown as panels", "SteamVR refuses the display mode of the settings."]
            }
            Self::CuesAlone => ["SteamVR refuses to show warnings", "Tones and pulses warn instead. Restart SteamVR."],
            Self::Welcome => [
                "Radar chaperone is on",
                "Look around and nod: the radar learns the room.\nLines appear where you come close to something.\n\
                 Its panel in the dashboard has all switches.",
            ],
            Self::Recovered => ["The radar works again", "Warnings are active again."],
        }
    }
}

/// Draws the notice: the program's icon, the fault, the remedy.
pub fn notice(ui: &Ui, notice: Notice) {
    let painter = ui.painter();
    let [width, height] = NOTICE_SIZE.map(|px| px as f32);
    let card = Rect::from_min_size(pos2(0.0, 0.0), vec2(width, height)).shrink(4.0);
    let round = CornerRadius::same(28);
    let color = notice.state().color();
    painter.rect(card, round, BACKGROUND, Stroke::new(4.0, color), StrokeKind::Inside);
    icon::draw(painter, Rect::from_center_size(pos2(100.0, height / 2.0), vec2(124.0, 124.0)));
    let [headline, more] = notice.texts();
    let text = |text: &str, size, color| painter.layout_no_wrap(text.to_owned(), font(size), color);
    let (headline, more) = (text(headline, 48.0, TEXT), text(more, 34.0, FAINT));
    let top = (height - headline.size().y - 10.0 - more.size().y) / 2.0;
    let below = top + headline.size().y + 10.0;
    painter.galley(pos2(190.0, top), headline, TEXT);
    painter.galley(pos2(190.0, below), more, FAINT);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notice_texts_fit() {
        let context = egui::Context::default();
        let faults = [Notice::NoSensor, Notice::SensorGone, Notice::SensorSilent, Notice::MapStopped];
        let others = [Notice::PanelsInstead, Notice::CuesAlone, Notice::Recovered, Notice::Welcome];
        for which in faults.into_iter().chain(others) {
            let output = context.run_ui(egui::RawInput::default(), |ui| notice(ui, which));
            let texts: Vec<Rect> = output
                .shapes
                .iter()
                .filter(|shape| matches!(shape.shape, egui::Shape::Text(_)))
                .map(|shape| shape.shape.visual_bounding_rect())
                .collect();
            assert_eq!(texts.len(), 2, "{which:?}");
            let room = Rect::from_min_max(pos2(180.0, 20.0), pos2(1015.0, 244.0));
            assert!(texts.iter().all(|text| room.contains_rect(*text)), "{which:?}: {texts:?}");
            assert!(texts[0].max.y <= texts[1].min.y + 1.0, "{which:?}: {texts:?}");
            output.drop_without_applying_deltas();
        }
    }
}

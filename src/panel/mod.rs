//! The panel in SteamVR's dashboard, drawn with egui: switches, the room from above, and the state
//! of sensor and tracking. It has no window, no GPU and no clock. Its input is plain data
//! ([`PanelView`]), its output the user's actions ([`PanelActions`]).
//!
//! It is viewed at arm's length and operated with a laser pointer: large type, large targets, a
//! fixed layout.

mod confirmed_button;
mod first_steps;
mod health;
mod icon;
mod notice;
mod plan;
mod switches;

pub use health::{DisplayTrouble, Health, MountHealth, SensorHealth};
pub use icon::icon;
pub use notice::{NOTICE_SIZE, Notice, notice};
pub use plan::{Head, Plan, PlanMovingTarget, PlanObstacle, hull};

use egui::{Align2, Color32, CornerRadius, FontId, Pos2, Rect, Ui, pos2, vec2};

/// Width and height, pixels; one egui point is one pixel. Choice: at the tab's width letters of 30
/// px are easy to read, and a picture of 6 MB uploads quickly.
pub const SIZE: [u32; 2] = [1600, 1000];

const BACKGROUND: Color32 = Color32::from_rgb(15, 19, 27);
const CARD: Color32 = Color32::from_rgb(26, 32, 43);
const RAISED: Color32 = Color32::from_rgb(46, 56, 72);
const HOVERED: Color32 = Color32::from_rgb(66, 79, 100);
const TEXT: Color32 = Color32::from_rgb(236, 240, 246);
const FAINT: Color32 = Color32::from_rgb(152, 164, 182);
const ACCENT: Color32 = Color32::from_rgb(64, 210, 240);
const GOOD: Color32 = Color32::from_rgb(88, 208, 128);
const FAIR: Color32 = Color32::from_rgb(250, 190, 70);
const BAD: Color32 = Color32::from_rgb(250, 96, 84);
const ROUND: CornerRadius = CornerRadius::same(14);

/// Layout, pixels. Choice: three columns' worth of content fill the picture, with rows a laser
/// pointer hits easily.
const MARGIN: f32 = 28.0;
const HEADER: f32 = 96.0;
const SWITCHES_WIDTH: f32 = 700.0;
const HEALTH_HEIGHT: f32 = 332.0;

/// What the panel shows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PanelView {
    /// The active settings, with the keys of the settings file.
    pub settings: toml::Table,
    /// The room from above.
    pub plan: Plan,
    /// State of sensor, tracking and reconstruction.
    pub health: Health,
}

/// A setting that the user changed.
#[derive(Debug, Clone, PartialEq)]
pub struct SettingChange {
    /// Name of the setting, for example `warning.brightness`.
    pub name: &'static str,
    /// New value.
    pub value: toml::Value,
}

/// What the user did.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PanelActions {
    /// Changed settings.
    pub changes: Vec<SettingChange>,
    /// Erase the room's map.
    pub forget_room: bool,
    /// Erase the estimated time offset and mount.
    pub forget_calibration: bool,
}

/// Draws the panel and returns the user's actions of this pass.
pub fn panel(ui: &Ui, view: &PanelView) -> PanelActions {
    let painter = ui.painter();
    painter.rect_filled(whole(), CornerRadius::ZERO, BACKGROUND);
    let status_cards = view.health.status_cards();
    let warnings = view.settings.get("headset").and_then(|headset| headset.get("warnings"));
    let notice = view.health.notice(warnings.and_then(toml::Value::as_bool).unwrap_or(true));
    header(ui, &status_cards, notice.as_ref());
    health::cards(painter, health_area(), &status_cards);
    match first_steps::is_wanted(&view.health) {
        true => first_steps::draw(painter, plan_area(), &view.health),
        false => plan::draw(painter, plan_area(), &view.plan),
    }
    // An empty map cannot be erased.
    let is_known = view.health.obstacles + view.health.walls > 0;
    let forget_room =
        is_known && confirmed_button::draw(ui, confirmed_button::area_in_plan(plan_area()), "Forget the room");
    let forget_calibration = view.health.is_calibrated()
        && confirmed_button::draw(ui, confirmed_button::area_in_card(calibration_area()), "Calibrate anew");
    PanelActions { changes: switches::draw(ui, switches_area(), &view.settings), forget_room, forget_calibration }
}

/// Position of a switch, pixels from the upper left. Names: `headset.warnings`, or a part of a
/// switch: `warning.brightness+`, `warning.brightness-`, `headset.display=stereo`; or the buttons
/// `forget` and `calibrate`.
pub fn target(settings: &toml::Table, name: &str) -> Option<[f32; 2]> {
    let mut targets = switches::targets(switches_area(), settings);
    targets.push(("forget".to_owned(), confirmed_button::area_in_plan(plan_area())));
    targets.push(("calibrate".to_owned(), confirmed_button::area_in_card(calibration_area())));
    targets.into_iter().find(|(own, _)| own == name).map(|(_, rect)| [rect.center().x, rect.center().y])
}

fn whole() -> Rect {
    Rect::from_min_size(Pos2::ZERO, vec2(SIZE[0] as f32, SIZE[1] as f32))
}

fn below_header() -> Rect {
    let mut rect = whole().shrink(MARGIN);
    rect.min.y = HEADER;
    rect
}

fn switches_area() -> Rect {
    let rect = below_header();
    Rect::from_min_size(rect.min, vec2(SWITCHES_WIDTH, rect.height()))
}

fn right_column() -> Rect {
    let mut rect = below_header();
    rect.min.x += SWITCHES_WIDTH + MARGIN;
    rect
}

fn plan_area() -> Rect {
    let rect = right_column();
    Rect::from_min_max(rect.min, pos2(rect.max.x, rect.max.y - HEALTH_HEIGHT - 20.0))
}

fn health_area() -> Rect {
    let rect = right_column();
    Rect::from_min_max(pos2(rect.min.x, rect.max.y - HEALTH_HEIGHT), rect.max)
}

fn calibration_area() -> Rect {
    health::card_area(health_area(), health::CALIBRATION)
}

/// The program's name and the most severe state.
fn header(ui: &Ui, status_cards: &[health::StatusCard], notice: Option<&(health::State, String)>) {
    let painter = ui.painter();
    let middle = HEADER / 2.0 + 2.0;
    icon::draw(painter, Rect::from_center_size(pos2(MARGIN + 30.0, middle), vec2(60.0, 60.0)));
    painter.text(pos2(MARGIN + 78.0, middle), Align2::LEFT_CENTER, "Radar chaperone", font(42.0), TEXT);
    let headlines = status_cards.iter().map(|finding| (finding.state, finding.headline.as_str()));
    // At equal severity the notice wins: the others have their cards.
    let worst =
        headlines.chain(notice.map(|(state, headline)| (*state, headline.as_str()))).max_by_key(|(state, _)| *state);
    let (text, color) = match worst {
        Some((state, headline)) if state > health::State::Good => (headline, state.color()),
        _ => ("Everything works", GOOD),
    };
    let right = SIZE[0] as f32 - MARGIN;
    let drawn = painter.text(pos2(right, middle), Align2::RIGHT_CENTER, text, font(30.0), color);
    painter.circle_filled(pos2(drawn.min.x - 24.0, middle), 11.0, color);
}

fn font(size: f32) -> FontId {
    FontId::proportional(size)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> toml::Table {
        toml::from_str(switches::tests::ALL).unwrap()
    }

    fn press(context: &egui::Context, view: &PanelView, at: [f32; 2]) -> Vec<SettingChange> {
        press_at(context, view, at, 0.0).changes
    }

    fn press_at(context: &egui::Context, view: &PanelView, at: [f32; 2], time_s: f64) -> PanelActions {
        let at = pos2(at[0], at[1]);
        let button = |pressed| egui::Event::PointerButton {
            pos: at,
            button: egui::PointerButton::Primary,
            pressed,
            modifiers: egui::Modifiers::NONE,
        };
        let mut wishes = PanelActions::default();
        for events in [vec![], vec![egui::Event::PointerMoved(at)], vec![button(true)], vec![button(false)]] {
            let time = Some(time_s);
            let input = egui::RawInput { screen_rect: Some(whole()), time, events, ..Default::default() };
            let output = context.run_ui(input, |ui| {
                let PanelActions { changes, forget_room, forget_calibration } = panel(ui, view);
                wishes.changes.extend(changes);
                wishes.forget_room |= forget_room;
                wishes.forget_calibration |= forget_calibration;
            });
            assert!(!output.shapes.is_empty());
            output.drop_without_applying_deltas();
        }
        wishes
    }

    #[test]
    fn forget_room_needs_a_second_press() {
        let health = Health { obstacles: 3, ..Health::default() };
        let view = PanelView { settings: settings(), health, ..Default::default() };
        let at = target(&view.settings, "forget").unwrap();
        let context = egui::Context::default();
        let forgets = |time_s| press_at(&context, &view, at, time_s).forget_room;
        assert!(!forgets(1.0), "it asks back");
        assert!(!forgets(9.0), "that was long ago");
        assert!(forgets(10.0));
        assert!(!forgets(11.0), "once");
        let nothing = PanelView { settings: settings(), ..Default::default() };
        let context = egui::Context::default();
        assert!([1.0, 2.0, 3.0].iter().all(|time_s| !press_at(&context, &nothing, at, *time_s).forget_room));
    }

    #[test]
    fn forget_calibration_needs_a_second_press_and_something_to_forget() {
        let context = egui::Context::default();
        let view = |mount| PanelView {
            settings: settings(),
            health: Health { mount, ..Health::default() },
            ..Default::default()
        };
        let at = target(&settings(), "calibrate").unwrap();
        let forgets = |view: &PanelView, time_s| press_at(&context, view, at, time_s).forget_calibration;
        let corrected = view(MountHealth::Corrected { by_mm: 40, by_deg: 0 });
        assert!(!forgets(&corrected, 1.0) && forgets(&corrected, 2.0) && !forgets(&corrected, 3.0));
        let unknown = view(MountHealth::Unknown);
        assert!([9.0, 10.0, 11.0].iter().all(|time_s| !forgets(&unknown, *time_s)));
    }

    #[test]
    fn only_switches_change_settings() {
        let view = PanelView { settings: settings(), ..Default::default() };
        let context = egui::Context::default();
        let at = |name| target(&view.settings, name).unwrap();
        let change = |name, value: toml::Value| vec![SettingChange { name, value }];
        assert_eq!(press(&context, &view, at("headset.warnings")), change("headset.warnings", false.into()));
        assert_eq!(press(&context, &view, at("warning.brightness-")), change("warning.brightness", 0.9.into()));
        assert_eq!(press(&context, &view, at("warning.brightness+")), [], "it is at its greatest");
        assert_eq!(press(&context, &view, at("headset.display=stereo")), change("headset.display", "stereo".into()));
        assert_eq!(press(&context, &view, at("warning.style=minimal")), change("warning.style", "minimal".into()));
        assert_eq!(press(&context, &view, at("cues.sound")), change("cues.sound", true.into()));
        assert_eq!(press(&context, &view, [1590.0, 10.0]), []);
        // The full-brightness distance must stay below the fade distance, so that no press is
        // rejected.
        let mut near = view.clone();
        near.settings["warning"]["full_distance_m"] = 1.4.into();
        assert_eq!(press(&context, &near, at("warning.full_distance_m+")), []);
    }

    #[test]
    fn targets_are_large_disjoint_and_inside_the_panel() {
        let targets = switches::targets(switches_area(), &settings());
        assert!(targets.len() > 22);
        for (n, (name, rect)) in targets.iter().enumerate() {
            assert!(switches_area().contains_rect(*rect), "{name}");
            assert!(rect.width() >= 48.0 && rect.height() >= 48.0, "{name}: {rect}");
            assert!(targets[..n].iter().all(|(_, other)| !other.intersects(*rect)), "{name}");
        }
    }
}

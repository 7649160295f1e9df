//! The switches: a table of settings and their controls. To add a switch, add a row.

use egui::{Align2, Color32, CornerRadius, Id, Painter, Rect, Sense, Stroke, StrokeKind, Ui, pos2, vec2};

use super::{ACCENT, CARD, FAINT, HOVERED, RAISED, ROUND, SettingChange, TEXT, font};

/// A row: setting, label, hint and control.
struct Switch {
    name: &'static str,
    label: &'static str,
    hint: &'static str,
    control: Control,
}

enum Control {
    /// On or off.
    Toggle,
    /// A number with buttons for less and more.
    Steps { step: f64, min: f64, max: f64, unit: Unit, limit: Limit },
    /// One of several values, with labels.
    Choice(&'static [(&'static str, &'static str)]),
    /// One of several colours.
    Color(&'static [[u8; 3]]),
}

#[derive(Clone, Copy)]
enum Unit {
    Metres,
    Percent,
}

/// Another setting that this one must stay below or above, by at least one step.
enum Limit {
    None,
    Below(&'static str),
    Above(&'static str),
}

/// The table. Settings that do not exist in this version are skipped.
const SWITCHES: &[Switch] = &[
    Switch {
        name: "headset.warnings",
        label: "Warnings",
        hint: "obstacles light up in the headset",
        control: Control::Toggle,
    },
    Switch {
        name: "warning.fade_distance_m",
        label: "Warn from",
        hint: "nothing farther away lights up",
        control: Control::Steps {
            step: 0.1,
            min: 0.3,
            max: 5.0,
            unit: Unit::Metres,
            limit: Limit::Above("warning.full_distance_m"),
        },
    },
    Switch {
        name: "warning.full_distance_m",
        label: "Brightest at",
        hint: "full brightness from here on",
        control: Control::Steps {
            step: 0.1,
            min: 0.1,
            max: 4.0,
            unit: Unit::Metres,
            limit: Limit::Below("warning.fade_distance_m"),
        },
    },
    Switch {
        name: "warning.brightness",
        label: "Brightness",
        hint: "at its brightest",
        control: Control::Steps { step: 0.1, min: 0.1, max: 1.0, unit: Unit::Percent, limit: Limit::None },
    },
    Switch {
        name: "warning.color",
        label: "Colour",
        hint: "of lines and shapes",
        control: Control::Color(&[
            [64, 224, 255],
            [80, 255, 120],
            [255, 220, 60],
            [255, 120, 40],
            [255, 60, 120],
            [255, 255, 255],
        ]),
    },
    Switch {
        name: "headset.display",
        label: "Shown as",
        hint: "panels, windows or whole view",
        control: Control::Choice(&[("panels", "Panels"), ("stereo", "Windows"), ("projection", "Whole")]),
    },
    Switch {
        name: "warning.style",
        label: "Style",
        hint: "how an object is drawn",
        control: Control::Choice(&[
            ("grid", "Grid"),
            ("outline", "Outline"),
            ("solid", "Solid"),
            ("minimal", "Minimal"),
        ]),
    },
    Switch {
        name: "warning.footprints",
        label: "Footprints",
        hint: "obstacles are drawn on the floor, too",
        control: Control::Toggle,
    },
    Switch {
        name: "warning.moving",
        label: "Moving things",
        hint: "people and pets light up, too",
        control: Control::Toggle,
    },
    Switch {
        name: "warning.labels",
        label: "Distances",
        hint: "are written on what is shown",
        control: Control::Toggle,
    },
    Switch {
        name: "cues.pulse",
        label: "Controllers pulse",
        hint: "in the hand close to an obstacle",
        control: Control::Toggle,
    },
    Switch {
        name: "cues.sound",
        label: "Sound",
        hint: "soft tones from where the obstacle is",
        control: Control::Toggle,
    },
    Switch {
        name: "headset.follow_chaperone",
        label: "As SteamVR's bounds",
        hint: "its colour, distance and play area",
        control: Control::Toggle,
    },
];

/// Limits of a row's height and the gap between rows, pixels. Choice: a laser pointer hits the
/// lowest row; the highest keeps a few rows together.
const MAX_ROW_HEIGHT: f32 = 108.0;
const MIN_ROW_HEIGHT: f32 = 57.0;
const GAP: f32 = 10.0;
/// From this row height on, both lines have their full size; and the width of the controls, pixels.
/// Choice: what the texts and four choices need.
const FULL_SIZE_ROW_HEIGHT: f32 = 78.0;
const CONTROL_WIDTH: f32 = 366.0;

/// Action of a part of a control.
#[derive(Clone, Copy, PartialEq)]
enum Part {
    Toggle,
    Less,
    More,
    Choose(usize),
}

/// Draws the switches and returns the changed settings.
pub(super) fn draw(ui: &Ui, area: Rect, settings: &toml::Table) -> Vec<SettingChange> {
    let mut changes = Vec::new();
    for (switch, value, row) in rows(area, settings) {
        let painter = ui.painter();
        painter.rect_filled(row, ROUND, CARD);
        let left = row.min.x + 24.0;
        // In lower rows, both lines are smaller, to keep a distance from the edges.
        let scale = (row.height() / FULL_SIZE_ROW_HEIGHT).min(1.0);
        let line = |y: f32| pos2(left, row.center().y + y * scale);
        painter.text(line(-15.0), Align2::LEFT_CENTER, switch.label, font(31.0 * scale), TEXT);
        painter.text(line(20.0), Align2::LEFT_CENTER, switch.hint, font(19.0 * scale.max(0.9)), FAINT);
        for (part, rect) in parts(switch, row) {
            let response = ui.interact(rect, Id::unique((switch.name, target_suffix(switch, part))), Sense::click());
            draw_part(painter, switch, value, part, rect, response.hovered());
            if response.clicked()
                && let Some(new) = pressed(switch, value, part, settings)
            {
                changes.push(SettingChange { name: switch.name, value: new });
            }
        }
        if let Control::Steps { unit, .. } = switch.control {
            let middle = pos2(row.max.x - 16.0 - CONTROL_WIDTH / 2.0, row.center().y);
            painter.text(middle, Align2::CENTER_CENTER, value_text(number(value), unit), font(32.0), TEXT);
        }
    }
    changes
}

/// Every target by name, with its position.
pub(super) fn targets(area: Rect, settings: &toml::Table) -> Vec<(String, Rect)> {
    let of_row = |(switch, _, row): (&'static Switch, _, Rect)| {
        parts(switch, row)
            .into_iter()
            .map(move |(part, rect)| (format!("{}{}", switch.name, target_suffix(switch, part)), rect))
    };
    rows(area, settings).into_iter().flat_map(of_row).collect()
}

/// Switches whose settings exist, with their values and positions.
fn rows(area: Rect, settings: &toml::Table) -> Vec<(&'static Switch, &toml::Value, Rect)> {
    let there: Vec<_> = SWITCHES.iter().filter_map(|switch| Some((switch, value_of(settings, switch.name)?))).collect();
    let height = ((area.height() + GAP) / there.len().max(1) as f32 - GAP).clamp(MIN_ROW_HEIGHT, MAX_ROW_HEIGHT);
    let area_of =
        |n: usize| Rect::from_min_size(area.min + vec2(0.0, n as f32 * (height + GAP)), vec2(area.width(), height));
    there.into_iter().enumerate().map(|(n, (switch, value))| (switch, value, area_of(n))).collect()
}

/// The parts of a control, with their positions at the right of a row.
fn parts(switch: &Switch, row: Rect) -> Vec<(Part, Rect)> {
    let height = (row.height() - 28.0).clamp(48.0, 68.0);
    let right = row.max.x - 16.0;
    let at = |from: f32, width: f32| {
        Rect::from_center_size(pos2(right - CONTROL_WIDTH + from + width / 2.0, row.center().y), vec2(width, height))
    };
    let split = |count: usize, gap: f32| -> Vec<(Part, Rect)> {
        let width = (CONTROL_WIDTH - gap * (count - 1) as f32) / count as f32;
        (0..count).map(|n| (Part::Choose(n), at(n as f32 * (width + gap), width))).collect()
    };
    match switch.control {
        Control::Toggle => vec![(Part::Toggle, at(CONTROL_WIDTH - 132.0, 132.0))],
        Control::Steps { .. } => vec![(Part::Less, at(0.0, 92.0)), (Part::More, at(CONTROL_WIDTH - 92.0, 92.0))],
        Control::Choice(choices) => split(choices.len(), 6.0),
        Control::Color(colors) => split(colors.len(), 10.0),
    }
}

/// Suffix that distinguishes a part's name from the others of its row.
fn target_suffix(switch: &Switch, part: Part) -> String {
    match (part, &switch.control) {
        (Part::Less, _) => "-".to_owned(),
        (Part::More, _) => "+".to_owned(),
        (Part::Choose(n), Control::Choice(choices)) => format!("={}", choices[n].0),
        (Part::Choose(n), _) => format!("={n}"),
        (Part::Toggle, _) => String::new(),
    }
}

fn draw_part(painter: &Painter, switch: &Switch, value: &toml::Value, part: Part, rect: Rect, is_hovered: bool) {
    let ground = if is_hovered { HOVERED } else { RAISED };
    match (part, &switch.control) {
        (Part::Toggle, _) => {
            let is_on = value.as_bool() == Some(true);
            let round = CornerRadius::same((rect.height() / 2.0) as u8);
            painter.rect_filled(rect, round, if is_on { ACCENT } else { ground });
            let radius = rect.height() / 2.0 - 6.0;
            let x = if is_on { rect.max.x - radius - 6.0 } else { rect.min.x + radius + 6.0 };
            painter.circle_filled(pos2(x, rect.center().y), radius, if is_on { Color32::WHITE } else { FAINT });
            let (x, text, color) =
                if is_on { (rect.min.x + 38.0, "on", Color32::BLACK) } else { (rect.max.x - 38.0, "off", TEXT) };
            painter.text(pos2(x, rect.center().y), Align2::CENTER_CENTER, text, font(26.0), color);
        }
        (Part::Less | Part::More, _) => {
            painter.rect_filled(rect, ROUND, ground);
            let (middle, arm) = (rect.center(), 14.0);
            let stroke = Stroke::new(5.0, TEXT);
            painter.line_segment([middle - vec2(arm, 0.0), middle + vec2(arm, 0.0)], stroke);
            if part == Part::More {
                painter.line_segment([middle - vec2(0.0, arm), middle + vec2(0.0, arm)], stroke);
            }
        }
        (Part::Choose(n), Control::Color(colors)) => {
            let [r, g, b] = colors[n];
            painter.rect_filled(rect.shrink(4.0), ROUND, Color32::from_rgb(r, g, b));
            let is_chosen = value_of_color(value) == Some(colors[n]);
            if is_chosen || is_hovered {
                let stroke = Stroke::new(4.0, if is_chosen { TEXT } else { HOVERED });
                painter.rect_stroke(rect, CornerRadius::same(17), stroke, StrokeKind::Inside);
            }
        }
        (Part::Choose(n), Control::Choice(choices)) => {
            let is_chosen = value.as_str() == Some(choices[n].0);
            painter.rect_filled(rect, ROUND, if is_chosen { ACCENT } else { ground });
            let color = if is_chosen { Color32::BLACK } else { TEXT };
            let size = if choices.len() > 3 { 21.0 } else { 25.0 };
            painter.text(rect.center(), Align2::CENTER_CENTER, choices[n].1, font(size), color);
        }
        _ => {}
    }
}

/// New value after a part was pressed; `None` if it does not change.
fn pressed(switch: &Switch, value: &toml::Value, part: Part, settings: &toml::Table) -> Option<toml::Value> {
    let new = match (part, &switch.control) {
        (Part::Toggle, _) => (!value.as_bool()?).into(),
        (Part::Choose(n), Control::Choice(choices)) => choices.get(n)?.0.into(),
        (Part::Choose(n), Control::Color(colors)) => colors.get(n)?.map(i64::from).to_vec().into(),
        (_, Control::Steps { step, min, max, limit, .. }) => {
            let up = if part == Part::More { 1.0 } else { -1.0 };
            let other = |name| value_of(settings, name).map(number);
            let (min, max) = match limit {
                Limit::None => (*min, *max),
                Limit::Below(name) => (*min, other(name)?.min(*max + step) - step),
                Limit::Above(name) => (other(name)?.max(*min - step) + step, *max),
            };
            // Rounds to the grid of steps and removes binary rounding errors.
            let stepped = ((number(value) / step).round() + up) * step;
            let clamped = (stepped * 1e6).round() / 1e6;
            return (min - 1e-6..=max + 1e-6).contains(&clamped).then_some(clamped.into());
        }
        _ => return None,
    };
    (new != *value).then_some(new)
}

/// A setting by its name.
fn value_of<'s>(settings: &'s toml::Table, name: &str) -> Option<&'s toml::Value> {
    let (table, key) = name.split_once('.')?;
    settings.get(table)?.get(key)
}

fn value_of_color(value: &toml::Value) -> Option<[u8; 3]> {
    let list: Vec<u8> = value.as_array()?.iter().filter_map(|v| u8::try_from(v.as_integer()?).ok()).collect();
    list.try_into().ok()
}

fn number(value: &toml::Value) -> f64 {
    value.as_float().or_else(|| value.as_integer().map(|n| n as f64)).unwrap_or(f64::NAN)
}

fn value_text(value: f64, unit: Unit) -> String {
    match unit {
        Unit::Metres => format!("{value:.1} m"),
        Unit::Percent => format!("{:.0} %", value * 100.0),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub const ALL: &str = "[headset]\nwarnings = true\ndisplay = \"panels\"\nfollow_chaperone = true\n[warning]\n\
        fade_distance_m = 1.5\nfull_distance_m = 0.4\nbrightness = 1.0\ncolor = [64, 224, 255]\nstyle = \"grid\"\nfootprints = true\nmoving = true\n\
        labels = false\n\
        [cues]\npulse = true\nsound = false\n";

    #[test]
    fn steps_stay_on_grid_and_within_bounds() {
        let settings: toml::Table = toml::from_str(ALL).unwrap();
        let of = |name: &str| SWITCHES.iter().find(|switch| switch.name == name).unwrap();
        let step = |name: &str, value: f64, part| pressed(of(name), &value.into(), part, &settings).map(|v| number(&v));
        assert_eq!(step("warning.brightness", 0.7, Part::More), Some(0.8));
        assert_eq!(step("warning.brightness", f64::from(0.7f32), Part::More), Some(0.8));
        assert_eq!(step("warning.brightness", 0.1, Part::Less), None);
        assert_eq!(step("warning.fade_distance_m", 0.5, Part::Less), None, "the full brightness is at 0.4 m");
        assert_eq!(step("warning.fade_distance_m", 0.6, Part::Less), Some(0.5));
        assert_eq!(step("warning.full_distance_m", 1.3, Part::More), Some(1.4));
        assert_eq!(step("warning.full_distance_m", 1.4, Part::More), None);
    }
}

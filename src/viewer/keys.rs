//! The keyboard shortcuts and their help list.

use egui::{Context, Grid, InputState, Key, RichText};

use super::style;

/// Action of a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// Play or pause.
    Toggle,
    /// One frame back or forward.
    Step(i32),
    /// One second back or forward.
    Jump(i32),
    /// To the beginning.
    Home,
    /// To the end.
    End,
    /// Loop on or off.
    Loop,
    /// Faster or slower.
    Speed(i32),
    /// A view by its number.
    View(usize),
    /// The next arrangement of room and maps.
    Arrangement,
    /// Ground truth on or off.
    Truth,
    /// Warnings on or off.
    Warnings,
    /// Show the help list.
    Help,
    /// Hide the help list.
    NoHelp,
}

/// Keys as shown in the list, description, and actions.
type Entry = (&'static str, &'static str, &'static [(Key, bool, Action)]);

const KEYS: [Entry; 12] = [
    ("space", "play or pause", &[(Key::Space, false, Action::Toggle)]),
    (
        "← →",
        "one radar frame back or on",
        &[(Key::ArrowLeft, false, Action::Step(-1)), (Key::ArrowRight, false, Action::Step(1))],
    ),
    (
        "shift ← →",
        "one second back or on",
        &[(Key::ArrowLeft, true, Action::Jump(-1)), (Key::ArrowRight, true, Action::Jump(1))],
    ),
    ("Home, End", "to the beginning, to the end", &[(Key::Home, false, Action::Home), (Key::End, false, Action::End)]),
    (
        "+ −",
        "faster or slower",
        &[
            (Key::Plus, false, Action::Speed(1)),
            (Key::Equals, false, Action::Speed(1)),
            (Key::Plus, true, Action::Speed(1)),
            (Key::Equals, true, Action::Speed(1)),
            (Key::Minus, false, Action::Speed(-1)),
        ],
    ),
    ("L", "loop", &[(Key::L, false, Action::Loop)]),
    (
        "1 2 3 4",
        "overview, from above, from the side, first person",
        &[
            (Key::Num1, false, Action::View(0)),
            (Key::Num2, false, Action::View(1)),
            (Key::Num3, false, Action::View(2)),
            (Key::Num4, false, Action::View(3)),
        ],
    ),
    ("M", "view, view and maps, maps", &[(Key::M, false, Action::Arrangement)]),
    ("T", "truth on or off", &[(Key::T, false, Action::Truth)]),
    ("W", "warnings on or off", &[(Key::W, false, Action::Warnings)]),
    (
        "?, F1, Esc",
        "show, hide this list",
        &[
            (Key::Questionmark, false, Action::Help),
            (Key::Questionmark, true, Action::Help),
            (Key::Slash, true, Action::Help),
            (Key::F1, false, Action::Help),
            (Key::Escape, false, Action::NoHelp),
        ],
    ),
    ("mouse", "drag: turn; right or shift-drag: move; wheel: nearer or farther", &[]),
];

/// Actions of the keys pressed since the last pass.
pub fn pressed(input: &InputState) -> Vec<Action> {
    let mut actions = Vec::new();
    for event in &input.events {
        let egui::Event::Key { key, pressed: true, modifiers, .. } = event else { continue };
        if modifiers.ctrl || modifiers.alt || modifiers.command {
            continue;
        }
        let asked = KEYS.iter().flat_map(|entry| entry.2).find(|(of, shift, _)| of == key && *shift == modifiers.shift);
        actions.extend(asked.map(|entry| entry.2));
    }
    actions
}

/// Draws the help list over everything else.
pub fn list(context: &Context, is_open: &mut bool) {
    egui::Window::new("Keys")
        .open(is_open)
        .collapsible(false)
        .resizable(false)
        .anchor(egui::Align2::CENTER_CENTER, [0.0, 0.0])
        .show(context, |ui| {
            Grid::new("keys").num_columns(2).spacing([24.0, 6.0]).show(ui, |ui| {
                for (keys, what, _) in KEYS {
                    ui.label(RichText::new(keys).monospace().color(style::HEAD));
                    ui.label(what);
                    ui.end_row();
                }
            });
        });
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::{Event, Modifiers, RawInput};

    fn actions(keys: &[(Key, Modifiers)]) -> Vec<Action> {
        let event = |&(key, modifiers): &(Key, Modifiers)| Event::Key {
            key,
            physical_key: None,
            pressed: true,
            repeat: false,
            modifiers,
        };
        let context = Context::default();
        context.begin_pass(RawInput { events: keys.iter().map(event).collect(), ..Default::default() });
        let actions = context.input(pressed);
        context.end_pass().drop_without_applying_deltas();
        actions
    }

    #[test]
    fn keys_match_the_help_list() {
        let (plain, shift, ctrl) = (Modifiers::NONE, Modifiers::SHIFT, Modifiers::CTRL);
        let keys =
            [(Key::Space, plain), (Key::ArrowLeft, plain), (Key::ArrowLeft, shift), (Key::L, ctrl), (Key::Plus, shift)];
        assert_eq!(actions(&keys), [Action::Toggle, Action::Step(-1), Action::Jump(-1), Action::Speed(1)]);
    }

    #[test]
    fn keys_are_unique() {
        let all: Vec<_> = KEYS.iter().flat_map(|entry| entry.2).map(|(key, shift, _)| (*key, *shift)).collect();
        assert!((0..all.len()).all(|n| !all[..n].contains(&all[n])));
    }
}

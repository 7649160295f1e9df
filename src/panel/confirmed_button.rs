//! A button that erases what was learnt. It asks for confirmation: it must be pressed twice within some seconds.

use egui::{Align2, Id, Rect, Sense, Ui, pos2, vec2};

use super::{BAD, FAINT, HOVERED, RAISED, ROUND, TEXT, font};

/// Size of the text, pixels, and width and height of the button. Choice: the longer of the two texts fits; the small one fits
/// beside a card's title.
const LARGE: (f32, [f32; 2]) = (25.0, [236.0, 56.0]);
const SMALL: (f32, [f32; 2]) = (20.0, [190.0, 48.0]);
/// Time for the second press, seconds. Choice: time to read the question; later a stray press must
/// not erase anything.
const CONFIRM_WITHIN_S: f64 = 5.0;

/// Position: upper right corner of the plan.
pub(super) fn area_in_plan(plan: Rect) -> Rect {
    corner(plan, LARGE.1, 16.0)
}

/// Position: upper right corner of a card, beside its title.
pub(super) fn area_in_card(card: Rect) -> Rect {
    corner(card, SMALL.1, 6.0)
}

fn corner(of: Rect, [width, height]: [f32; 2], gap: f32) -> Rect {
    Rect::from_min_size(pos2(of.max.x - gap - width, of.min.y + gap), vec2(width, height))
}

/// Draws the button. Returns true on the second press.
pub(super) fn draw(ui: &Ui, rect: Rect, label: &'static str) -> bool {
    let (id, now_s) = (Id::unique(label), ui.input(|input| input.time));
    let asked_s: Option<f64> = ui.data(|data| data.get_temp(id));
    let is_asking = asked_s.is_some_and(|then_s| (0.0..CONFIRM_WITHIN_S).contains(&(now_s - then_s)));
    let size = if rect.height() < LARGE.1[1] { SMALL.0 } else { LARGE.0 };
    let response = ui.interact(rect, id, Sense::click());
    let ground = if response.hovered() { HOVERED } else { RAISED };
    let (text, color, ground) =
        if is_asking { ("Sure? Press again", TEXT, BAD.gamma_multiply(0.6)) } else { (label, FAINT, ground) };
    ui.painter().rect_filled(rect, ROUND, ground);
    ui.painter().text(rect.center(), Align2::CENTER_CENTER, text, font(size), color);
    if is_asking {
        // Repaints until the confirmation time is over.
        ui.ctx().request_repaint();
    }
    if !response.clicked() {
        return false;
    }
    ui.data_mut(|data| {
        if is_asking {
            data.remove::<f64>(id);
        } else {
            data.insert_temp(id, now_s);
        }
    });
    is_asking
}

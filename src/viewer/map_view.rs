//! The three cross-sections side by side at one scale, with axes, colour bar, obstacles and head.

use egui::{
    Align2, Color32, FontId, Pos2, Rect, Sense, Stroke, StrokeKind, TextureHandle, TextureOptions, Ui, Vec2, pos2, vec2,
};
use glam::DVec3;

use super::labels::Labels;
use super::maps::{Map, PLANES};
use super::style;
use super::viewport::{ViewContent, color_bar};
use crate::report::inferno;

/// Which part of the evidence is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Cut {
    /// All evidence.
    #[default]
    All,
    /// A slab around the head.
    Head,
    /// A slab around the selected obstacle.
    Selected,
}

/// Margins for labels around each plot, egui points: left, top, right, bottom. Choice: one number
/// and one line of text.
const MARGINS: [f32; 4] = [44.0, 24.0, 8.0, 34.0];

/// The inputs from which the current maps were made.
#[derive(Clone, PartialEq)]
struct MapCacheKey {
    evidence: usize,
    around: Option<DVec3>,
    bounds: [DVec3; 2],
    scale: [f32; 2],
}

/// The maps. They are only recomputed if their inputs change.
#[derive(Default)]
pub struct MapView {
    cut: Cut,
    cache_key: Option<MapCacheKey>,
    maps: Vec<(Map, TextureHandle)>,
}

impl MapView {
    /// Selects the slab to show, or everything.
    pub fn set_cut(&mut self, cut: Cut) {
        self.cut = cut;
    }

    /// Draws the row of maps in the available area.
    pub fn show(&mut self, ui: &mut Ui, shown: &ViewContent) {
        self.choice(ui, shown);
        let least = shown.layers.min_score;
        let scale = [least, shown.top_score.max(least + 1e-3)];
        self.make(ui.ctx(), shown, scale);
        let (area, _) = ui.allocate_exact_size(ui.available_size(), Sense::hover());
        let painter = ui.painter_at(area);
        let sizes_m = self.maps.iter().map(|(map, _)| map.ranges_m.map(|[low, high]| (high - low) as f32));
        let areas = layout(area, &sizes_m.collect::<Vec<_>>());
        for ((map, texture), plot) in self.maps.iter().zip(areas) {
            one(&painter, plot, map, texture, shown);
        }
    }

    fn choice(&mut self, ui: &mut Ui, shown: &ViewContent) {
        ui.horizontal_wrapped(|ui| {
            ui.style_mut().wrap_mode = Some(egui::TextWrapMode::Extend);
            ui.label(egui::RichText::new("Greatest evidence:").color(style::MUTED));
            ui.selectable_value(&mut self.cut, Cut::All, "all");
            ui.selectable_value(&mut self.cut, Cut::Head, "at the head");
            let selected = shown.layers.selected;
            ui.add_enabled_ui(selected.is_some(), |ui| {
                let name = selected.map_or("at an obstacle".into(), |id| format!("at #{id}"));
                ui.selectable_value(&mut self.cut, Cut::Selected, name)
                    .on_hover_text("Click an obstacle's number in the list");
            });
            if self.cut != Cut::All {
                let thickness_cm = super::maps::SLAB_HALF_M * 200.0;
                ui.label(egui::RichText::new(format!("within a slab of {thickness_cm:.0} cm")).color(style::MUTED));
            }
            let (bar, _) = ui.allocate_exact_size(vec2(140.0, 10.0), Sense::hover());
            color_bar(ui.painter(), bar, |share| {
                let [r, g, b] = inferno(0.08 + 0.92 * share);
                Color32::from_rgb(r, g, b)
            });
            let least = shown.layers.min_score;
            let range = format!("{} {least:.1} to {:.1}", shown.about.score_name(), shown.top_score.max(least));
            ui.label(egui::RichText::new(range).color(style::MUTED));
        });
    }

    /// The point at which the maps are cut.
    fn around(&self, shown: &ViewContent) -> Option<DVec3> {
        match self.cut {
            Cut::All => None,
            Cut::Head => shown.moment.head.map(|head| head.translation),
            Cut::Selected => {
                let mut obstacles = shown.moment.scene.obstacles.iter();
                obstacles
                    .find(|obstacle| Some(obstacle.id) == shown.layers.selected)
                    .map(|obstacle| obstacle.position_m)
            }
        }
    }

    fn make(&mut self, context: &egui::Context, shown: &ViewContent, scale: [f32; 2]) {
        let cache_key = MapCacheKey {
            evidence: std::sync::Arc::as_ptr(&shown.moment.evidence) as usize,
            around: self.around(shown),
            bounds: [shown.bounds.min, shown.bounds.max],
            scale,
        };
        if self.cache_key.as_ref() == Some(&cache_key) {
            return;
        }
        let maps = PLANES.map(|plane| Map::of(&shown.moment.evidence, plane, shown.bounds, cache_key.around, scale[0]));
        self.maps = maps
            .into_iter()
            .map(|map| {
                let image = map.image(scale[0], scale[1]);
                let texture = context.load_texture(format!("map {:?}", map.plane), image, TextureOptions::NEAREST);
                (map, texture)
            })
            .collect();
        self.cache_key = Some(cache_key);
    }
}

/// Areas of the plots, all at one scale: chooses the arrangement (columns of plots) in which they
/// are largest.
fn layout(area: Rect, sizes_m: &[[f32; 2]]) -> Vec<Rect> {
    let columns: [&[&[usize]]; 3] = [&[&[0], &[1], &[2]], &[&[0, 1, 2]], &[&[0], &[1, 2]]];
    let margins = vec2(MARGINS[0] + MARGINS[2], MARGINS[1] + MARGINS[3]);
    let total = |columns: &[&[usize]], axis: usize| {
        let of = |column: &&[usize]| {
            let each = column.iter().filter_map(|n| sizes_m.get(*n)).map(|size| size[axis]);
            if axis == 0 { each.fold(0.0, f32::max) } else { each.sum() }
        };
        let all = columns.iter().map(of);
        if axis == 0 { all.sum() } else { all.fold(0.0f32, f32::max) }
    };
    let scale = |columns: &[&[usize]]| {
        let rows = columns.iter().map(|column| column.len()).max().unwrap_or(1);
        let across = (area.width() - margins.x * columns.len() as f32) / total(columns, 0).max(0.1);
        let upright = (area.height() - margins.y * rows as f32) / total(columns, 1).max(0.1);
        across.min(upright).max(1.0)
    };
    let best = columns.into_iter().max_by(|a, b| scale(a).total_cmp(&scale(b))).unwrap_or(columns[0]);
    let px_per_m = scale(best);
    let mut areas = vec![Rect::NOTHING; sizes_m.len()];
    let mut left = area.left();
    for column in best {
        let (mut top, mut widest) = (area.top(), 0.0f32);
        for n in column.iter().filter(|n| **n < sizes_m.len()) {
            let size = vec2(sizes_m[*n][0], sizes_m[*n][1]) * px_per_m;
            areas[*n] = Rect::from_min_size(pos2(left + MARGINS[0], top + MARGINS[1]), size);
            top = areas[*n].bottom() + MARGINS[3];
            widest = widest.max(size.x);
        }
        left += margins.x + widest;
    }
    areas
}

fn one(painter: &egui::Painter, plot: Rect, map: &Map, texture: &TextureHandle, shown: &ViewContent) {
    let whole = Rect::from_min_max(Pos2::ZERO, pos2(1.0, 1.0));
    painter.image(texture.id(), plot, whole, Color32::WHITE);
    painter.rect_stroke(plot, 0.0, Stroke::new(1.0, style::GRID_METRE), StrokeKind::Outside);
    let [[left, right], [low, high]] = map.ranges_m;
    let on_plot = |[x, y]: [f64; 2]| {
        let share = [(x - left) / (right - left), (high - y) / (high - low)].map(|share| share as f32);
        plot.min + vec2(share[0] * plot.width(), share[1] * plot.height())
    };
    axes(painter, plot, map, &on_plot);
    let clipped = painter.with_clip_rect(plot);
    let at = |point: DVec3| on_plot(map.plane.project(point));
    if shown.layers.truth {
        for point in shown.about.truth.iter().flat_map(|truth| &truth.obstacles).flat_map(|o| &o.points_m) {
            clipped.circle_filled(at(*point), 1.5, style::TRUTH);
        }
    }
    if shown.layers.path {
        let path = shown.moment.path.iter().map(|(_, point)| at(*point)).collect();
        clipped.line(path, Stroke::new(1.0, style::HEAD.gamma_multiply(0.5)));
    }
    if shown.layers.obstacles {
        let obstacles = &shown.moment.scene.obstacles;
        let marks = obstacles.iter().map(|obstacle| (obstacle.id, at(obstacle.position_m)));
        numbered(&clipped, marks, shown.layers.selected);
    }
    if let Some(head) = &shown.moment.head {
        let (middle, ahead) = (at(head.translation), at(head.translation + head.forward() * 0.35));
        clipped.circle_filled(middle, 5.0, style::HEAD);
        clipped.line_segment([middle, ahead], Stroke::new(2.0, style::HEAD));
    }
}

/// Draws a ring with a number for each mark, the selected one first. Numbers without room are
/// omitted.
fn numbered(painter: &egui::Painter, marks: impl Iterator<Item = (u64, Pos2)>, selected: Option<u64>) {
    /// Radius of an obstacle's mark, egui points. Choice: easy to click, smaller than a chair at a
    /// room's scale.
    const RADIUS: f32 = 5.0;
    let mut marks: Vec<_> = marks.collect();
    marks.sort_by_key(|(id, _)| (selected != Some(*id), *id));
    let rings: Vec<Rect> = marks.iter().map(|mark| Rect::from_center_size(mark.1, Vec2::splat(2.0 * RADIUS))).collect();
    let mut labels = Labels::default();
    for ((id, middle), ring) in marks.into_iter().zip(&rings) {
        let is_selected = selected == Some(id);
        painter.circle_stroke(middle, RADIUS, Stroke::new(if is_selected { 2.5 } else { 1.5 }, style::FOUND));
        let name = painter.layout_no_wrap(format!("#{id}"), FontId::proportional(11.0), style::FOUND);
        if let Some(label) = labels.place_beside(*ring, name.size(), &rings) {
            painter.rect_filled(label.shrink2(vec2(0.0, 1.0)), 2.0, Color32::from_black_alpha(150));
            painter.galley(label.min, name, style::FOUND);
        }
    }
}

fn axes(painter: &egui::Painter, plot: Rect, map: &Map, on_plot: &impl Fn([f64; 2]) -> Pos2) {
    let [heading, across, upright] = map.plane.labels();
    let font = FontId::proportional(12.0);
    let [[left, right], [low, high]] = map.ranges_m;
    painter.text(
        plot.left_top() - vec2(0.0, 5.0),
        Align2::LEFT_BOTTOM,
        heading,
        FontId::proportional(13.0),
        style::INK,
    );
    // Above the plot, where it does not collide with the numbers.
    painter.text(
        plot.right_top() - vec2(0.0, 5.0),
        Align2::RIGHT_BOTTOM,
        format!("up: {upright}"),
        font.clone(),
        style::MUTED,
    );
    painter.text(plot.center_bottom() + vec2(0.0, 18.0), Align2::CENTER_TOP, across, font.clone(), style::MUTED);
    let step = if plot.width() / ((right - left) as f32) < 34.0 { 2 } else { 1 };
    let metres = |low: f64, high: f64| (low.ceil() as i32..=high.floor() as i32).filter(move |n| n % step == 0);
    for n in metres(left, right) {
        let at = pos2(on_plot([n.into(), low]).x, plot.bottom());
        painter.line_segment([at, at + vec2(0.0, 4.0)], Stroke::new(1.0, style::MUTED));
        painter.text(at + vec2(0.0, 5.0), Align2::CENTER_TOP, n, font.clone(), style::MUTED);
    }
    for n in metres(low, high) {
        let at = pos2(plot.left(), on_plot([left, n.into()]).y);
        painter.line_segment([at, at - vec2(4.0, 0.0)], Stroke::new(1.0, style::MUTED));
        painter.text(at - vec2(7.0, 0.0), Align2::RIGHT_CENTER, n, font.clone(), style::MUTED);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plots_are_disjoint_and_inside_the_area() {
        let sizes_m = [[4.0, 5.0], [4.0, 2.5], [5.0, 2.5]];
        for (width, height) in [(1300.0, 320.0), (400.0, 900.0), (1270.0, 850.0), (300.0, 200.0)] {
            let area = Rect::from_min_size(pos2(10.0, 20.0), vec2(width, height));
            let plots = layout(area, &sizes_m);
            let scale = plots[0].width() / 4.0;
            for (n, plot) in plots.iter().enumerate() {
                assert!(area.expand(0.5).contains_rect(*plot), "{plot:?} in {area:?}");
                assert!((plot.width() / sizes_m[n][0] - scale).abs() < 0.01);
                assert!(plots[..n].iter().all(|other| !other.intersects(*plot)), "{plots:?}");
            }
            assert!(scale > 5.0, "{width} × {height}: {scale}");
        }
        assert!(layout(Rect::from_min_size(Pos2::ZERO, vec2(10.0, 10.0)), &[]).is_empty());
    }
}

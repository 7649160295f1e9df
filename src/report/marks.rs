//! Marks over images, the same in all figures: a cross is the truth, a ring is a detection, a line
//! is the sensor's path with a dot at its start. All have a dark outline, so that they are visible
//! on dark and bright backgrounds.

use glam::DVec3;

use super::canvas::{Align, Canvas, text_width};
use super::style::{FALSE_INK, FOUND, FOUND_INK, INK, LABEL_PX, MUTED, PATH, PATH_INK, Rgb, TRUTH};

/// Positions to mark, tracking frame, metres. Non-finite ones are skipped.
#[derive(Debug, Clone, Copy, Default)]
pub struct Marks<'a> {
    /// True positions.
    pub truth_m: &'a [DVec3],
    /// Detected positions.
    pub found_m: &'a [DVec3],
    /// Positions of the sensor in order of time.
    pub path_m: &'a [DVec3],
}

impl Marks<'_> {
    /// Draws all marks at the pixels given by `project`.
    pub fn draw(&self, canvas: &mut Canvas, project: impl Fn(DVec3) -> [f64; 2]) {
        let path: Vec<[f64; 2]> = self.path_m.iter().map(|&p| project(p)).collect();
        draw_path(canvas, &path, PATH);
        for &point in self.truth_m {
            cross(canvas, project(point), 4.0, TRUTH);
        }
        for &point in self.found_m {
            ring_mark(canvas, project(point), 8.0, FOUND);
        }
    }

    /// Entries for the legend.
    pub fn legend(&self) -> Vec<(Symbol, &'static str)> {
        let all = [
            (!self.truth_m.is_empty(), Symbol::Truth, "truth"),
            (!self.found_m.is_empty(), Symbol::Found, "found"),
            (!self.path_m.is_empty(), Symbol::Path, "sensor's path, from the dot"),
        ];
        all.into_iter().filter(|entry| entry.0).map(|(_, symbol, text)| (symbol, text)).collect()
    }
}

/// Symbol of a legend entry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Symbol {
    /// White cross with a dark outline.
    Truth,
    /// Bright ring with a dark outline.
    Found,
    /// Bright line with a dot.
    Path,
    /// Grey dots: true scatterers on white.
    TruthInk,
    /// Ring on white.
    FoundInk,
    /// Crossed-out ring on white.
    FalseInk,
    /// Line with a dot, on white.
    PathInk,
    /// Faint ellipse.
    Ellipse,
    /// Faint box.
    Extent,
    /// Thick line.
    Wall,
    /// Dashed line.
    FoundWall,
    /// Coloured square.
    Square(Rgb),
    /// Coloured dot.
    Dot(Rgb),
    /// Coloured line.
    Line(Rgb),
}

/// A line with an outline, and a dot at its start.
pub fn draw_path(canvas: &mut Canvas, points: &[[f64; 2]], color: Rgb) {
    canvas.polyline(points, 3.6, [0, 0, 0]);
    canvas.polyline(points, 1.8, color);
    if let Some(&start) = points.iter().find(|p| p.iter().all(|v| v.is_finite())) {
        canvas.disc(start, 6.0, [0, 0, 0]);
        canvas.disc(start, 4.8, color);
    }
}

/// A diagonal cross with an outline.
pub fn cross(canvas: &mut Canvas, [x, y]: [f64; 2], arm: f64, color: Rgb) {
    for (width, color) in [(3.8, [0, 0, 0]), (1.8, color)] {
        canvas.line([x - arm, y - arm], [x + arm, y + arm], width, color);
        canvas.line([x - arm, y + arm], [x + arm, y - arm], width, color);
    }
}

/// A ring with an outline.
pub fn ring_mark(canvas: &mut Canvas, center: [f64; 2], radius: f64, color: Rgb) {
    canvas.ring(center, radius, 4.4, [0, 0, 0]);
    canvas.ring(center, radius, 2.4, color);
}

/// A crossed-out ring: a false detection.
pub fn false_mark(canvas: &mut Canvas, [x, y]: [f64; 2], radius: f64) {
    canvas.ring([x, y], radius, 2.4, FALSE_INK);
    let d = radius * 0.7;
    canvas.line([x - d, y + d], [x + d, y - d], 2.4, FALSE_INK);
}

/// Width of a legend entry, including its symbol and the gap after it, pixels.
pub fn legend_width(text: &str) -> f64 {
    34.0 + text_width(text, LABEL_PX) + 26.0
}

/// Draws one entry: the left end of its symbol is at `x`, its middle at `y`.
pub fn legend_entry(canvas: &mut Canvas, [x, y]: [f64; 2], symbol: Symbol, text: &str) {
    let (left, middle, right) = ([x, y], [x + 12.0, y], [x + 24.0, y]);
    match symbol {
        Symbol::Truth => cross(canvas, middle, 5.0, TRUTH),
        Symbol::Found => ring_mark(canvas, middle, 7.0, FOUND),
        Symbol::Path => draw_path(canvas, &[left, right], PATH),
        Symbol::TruthInk => canvas.disc(middle, 3.6, MUTED),
        Symbol::FoundInk => {
            canvas.ring(middle, 7.0, 2.4, FOUND_INK);
            canvas.disc(middle, 2.0, FOUND_INK);
        }
        Symbol::FalseInk => false_mark(canvas, middle, 7.0),
        Symbol::PathInk => {
            canvas.line(left, right, 1.8, PATH_INK);
            canvas.disc(left, 4.5, PATH_INK);
        }
        Symbol::Ellipse => {
            let points: Vec<[f64; 2]> = (0..24)
                .map(|n| n as f64 * std::f64::consts::TAU / 24.0)
                .map(|a| [x + 12.0 + 12.0 * a.cos(), y + 6.0 * a.sin()])
                .collect();
            canvas.convex(&points, FOUND_INK, 0.22);
        }
        Symbol::Extent => {
            canvas.outline(super::canvas::Rect::new(x + 1.0, y - 6.0, 22.0, 12.0), 1.2, FOUND_INK);
        }
        Symbol::Wall => canvas.line(left, right, 5.0, MUTED),
        Symbol::FoundWall => canvas.dashed(&[left, right], 6.0, 2.4, FOUND_INK),
        Symbol::Square(color) => canvas.fill(super::canvas::Rect::new(x + 5.0, y - 7.0, 14.0, 14.0), color),
        Symbol::Dot(color) => canvas.disc(middle, 4.2, color),
        Symbol::Line(color) => canvas.line(left, right, 2.4, color),
    }
    canvas.text([x + 34.0, y], Align::Left, text, LABEL_PX, INK);
}

/// Draws entries side by side.
pub fn legend_row(canvas: &mut Canvas, [mut x, y]: [f64; 2], entries: &[(Symbol, &str)]) {
    for &(symbol, text) in entries {
        legend_entry(canvas, [x, y], symbol, text);
        x += legend_width(text);
    }
}

//! A plot area with two axes: maps values to pixels, and draws frame, ticks and labels.

use super::canvas::{Align, Canvas, Rect, text_width};
use super::style::{GRID, HEADING_PX, INK, LABEL_PX, MUTED, TICK_PX, tick_text, ticks};

/// Width of the numbers and the label left of a plot, pixels. Choice: numbers of six characters and
/// the upright label.
pub const LEFT_MARGIN: f64 = 68.0;
/// Height of the numbers and the label below a plot, pixels. Choice: one line of numbers and one of
/// text.
pub const BOTTOM_MARGIN: f64 = 50.0;

/// Position and ranges of a plot.
#[derive(Debug, Clone, Copy)]
pub struct Plot {
    /// Frame, pixels.
    pub area: Rect,
    /// Values at the left and right edge.
    pub x: [f64; 2],
    /// Values at the lower and upper edge.
    pub y: [f64; 2],
}

impl Plot {
    /// Ranges that are empty or not finite are replaced by drawable ones.
    pub fn new(area: Rect, x: [f64; 2], y: [f64; 2]) -> Self {
        Self { area, x: drawable(x), y: drawable(y) }
    }

    /// Pixel of a pair of values.
    pub fn at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let share = |v: f64, [a, b]: [f64; 2]| (v - a) / (b - a);
        [self.area.x + share(x, self.x) * self.area.width, self.area.bottom() - share(y, self.y) * self.area.height]
    }

    /// Pixels of several pairs of values.
    pub fn all_at(&self, values: impl IntoIterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
        values.into_iter().map(|v| self.at(v)).collect()
    }

    /// Faint lines at the ticks. Draw before the content.
    pub fn grid(&self, canvas: &mut Canvas) {
        self.grid_where(canvas, [true, true]);
    }

    /// As [`Self::grid`], for one axis or both.
    pub fn grid_where(&self, canvas: &mut Canvas, [on_x, on_y]: [bool; 2]) {
        let Rect { x, y, .. } = self.area;
        for tick in self.x_ticks_where(on_x) {
            let at = self.at([tick, self.y[0]])[0];
            canvas.line([at, y], [at, self.area.bottom()], 1.0, GRID);
        }
        for tick in self.y_ticks_where(on_y) {
            let at = self.at([self.x[0], tick])[1];
            canvas.line([x, at], [self.area.right(), at], 1.0, GRID);
        }
    }

    /// Frame, numbers and labels. Draw after the content.
    pub fn axes(&self, canvas: &mut Canvas, heading: &str, x_label: &str, y_label: &str) {
        self.axes_where(canvas, heading, x_label, y_label, [true, true]);
    }

    /// As [`Self::axes`], with numbers on one axis or both.
    pub fn axes_where(
        &self,
        canvas: &mut Canvas,
        heading: &str,
        x_label: &str,
        y_label: &str,
        [on_x, on_y]: [bool; 2],
    ) {
        let Rect { x, y, .. } = self.area;
        let bottom = self.area.bottom();
        canvas.outline(self.area, 1.2, INK);
        let ticks = self.x_ticks_where(on_x);
        for &tick in &ticks {
            let at = self.at([tick, self.y[0]])[0];
            canvas.line([at, bottom], [at, bottom + 5.0], 1.2, INK);
            canvas.text([at, bottom + 15.0], Align::Center, &tick_text(tick, step(&ticks)), TICK_PX, INK);
        }
        let ticks = self.y_ticks_where(on_y);
        for &tick in &ticks {
            let at = self.at([self.x[0], tick])[1];
            canvas.line([x - 5.0, at], [x, at], 1.2, INK);
            canvas.text([x - 9.0, at], Align::Right, &tick_text(tick, step(&ticks)), TICK_PX, INK);
        }
        let [cx, cy] = self.area.center();
        canvas.text_fitted([cx, bottom + 37.0], Align::Center, x_label, LABEL_PX, self.area.width + 60.0, MUTED);
        canvas.text_upwards([x - 56.0, cy], Align::Center, y_label, LABEL_PX, MUTED);
        let over = text_width(heading, HEADING_PX) > self.area.width;
        let (at, align) = if over { (cx, Align::Center) } else { (x, Align::Left) };
        canvas.text([at, y - 14.0], align, heading, HEADING_PX, INK);
    }

    fn x_ticks_where(&self, wanted: bool) -> Vec<f64> {
        if !wanted {
            return Vec::new();
        }
        ticks(self.x[0], self.x[1], (self.area.width / 58.0).clamp(2.0, 8.0) as usize)
    }

    fn y_ticks_where(&self, wanted: bool) -> Vec<f64> {
        if !wanted {
            return Vec::new();
        }
        ticks(self.y[0], self.y[1], (self.area.height / 55.0).clamp(3.0, 8.0) as usize)
    }
}

fn step(ticks: &[f64]) -> f64 {
    ticks.windows(2).next().map_or(1.0, |pair| pair[1] - pair[0])
}

fn drawable([a, b]: [f64; 2]) -> [f64; 2] {
    let middle = 0.5 * (a + b);
    if !(middle.is_finite() && (b - a).is_finite()) || middle.abs() > 1e12 {
        return [0.0, 1.0];
    }
    let least = (1e-6 * middle.abs()).max(1e-9);
    if (b - a).abs() < least { [middle - 0.5, middle + 0.5] } else { [a, b] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plot_corners_map_and_axes_may_be_reversed() {
        let plot = Plot::new(Rect::new(10.0, 20.0, 100.0, 50.0), [0.0, 2.0], [3.0, -1.0]);
        assert_eq!(plot.at([0.0, 3.0]), [10.0, 70.0]);
        assert_eq!(plot.at([2.0, -1.0]), [110.0, 20.0]);
    }

    #[test]
    fn zero_width_ranges_are_drawable() {
        for range in [[1.0, 1.0], [f64::NAN, 2.0], [f64::NEG_INFINITY, 0.0], [1e300, 1e300]] {
            let plot = Plot::new(Rect::new(0.0, 0.0, 9.0, 9.0), range, range);
            assert!(plot.at([0.0, 0.0]).iter().all(|v| v.is_finite()), "{range:?}");
            let mut canvas = Canvas::new(9, 9);
            plot.grid(&mut canvas);
            plot.axes(&mut canvas, "", "", "");
        }
    }
}

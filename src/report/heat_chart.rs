//! Heat maps over two axes with marks: range and speed, for example.

use super::Picture;
use super::canvas::{Align, Canvas, Rect};
use super::color_map::inferno;
use super::cross_sections::color_bar;
use super::marks::{Symbol, cross, legend_row, ring_mark};
use super::plot::{BOTTOM_MARGIN, LEFT_MARGIN, Plot};
use super::style::{FOUND, INK, TITLE_PX, TRUTH};

/// Width and height, pixels. Choice: one column of a report at 96 dpi.
const SIZE: [f64; 2] = [900.0, 600.0];
/// Height of the colour scale below the axes, pixels. Choice: the bar with its numbers.
const BAR_PX: f64 = 66.0;

/// A heat map.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct HeatChart {
    /// Title of the figure.
    pub title: String,
    /// Label of x, with its unit.
    pub x_label: String,
    /// Label of y, with its unit.
    pub y_label: String,
    /// Label of the values, with their unit.
    pub quantity: String,
    /// Outer edges of the first and last column.
    pub x: [f64; 2],
    /// Outer edges of the lowest and highest row.
    pub y: [f64; 2],
    /// Number of columns.
    pub columns: usize,
    /// Values `[row][column]`, rows from the lowest, columns from the left. Non-finite values are
    /// drawn as the smallest.
    pub values: Vec<f64>,
    /// Values at the ends of the colour scale. Values beyond are clamped.
    pub scale: [f64; 2],
    /// Crosses: true positions.
    pub truth: Vec<[f64; 2]>,
    /// Rings: detected positions.
    pub found: Vec<[f64; 2]>,
}

impl HeatChart {
    /// Draws the heat map.
    pub fn draw(&self) -> Picture {
        let mut canvas = Canvas::new(SIZE[0] as usize, SIZE[1] as usize);
        canvas.text([18.0, 26.0], Align::Left, &self.title, TITLE_PX, INK);
        let marked =
            [(!self.truth.is_empty(), Symbol::Truth, "truth"), (!self.found.is_empty(), Symbol::Found, "found")];
        let legend: Vec<_> = marked.into_iter().filter(|mark| mark.0).map(|(_, symbol, text)| (symbol, text)).collect();
        legend_row(&mut canvas, [18.0, 58.0], &legend);
        let (left, top) = (LEFT_MARGIN + 6.0, 84.0);
        let area = Rect::new(left, top, SIZE[0] - left - 24.0, SIZE[1] - top - BOTTOM_MARGIN - BAR_PX);
        let plot = Plot::new(area, self.x, self.y);
        let (columns, rows) = (self.columns, self.values.len().checked_div(self.columns).unwrap_or(0));
        let [low, high] = self.scale;
        let per_span = if high > low { 1.0 / (high - low) } else { 0.0 };
        canvas.paint(area, |u, v| {
            let cell = |share: f64, count: usize| ((share * count as f64) as usize).min(count.saturating_sub(1));
            let at = cell(1.0 - v, rows) * columns + cell(u, columns);
            let value = self.values.get(at).copied().filter(|value| value.is_finite()).unwrap_or(low);
            inferno(((value - low) * per_span).clamp(0.0, 1.0))
        });
        canvas.clipped(area, |canvas| {
            self.truth.iter().for_each(|&at| cross(canvas, plot.at(at), 6.0, TRUTH));
            self.found.iter().for_each(|&at| ring_mark(canvas, plot.at(at), 10.0, FOUND));
        });
        plot.axes(&mut canvas, "", &self.x_label, &self.y_label);
        let bar = Rect::new(area.x + 0.25 * area.width, area.bottom() + BOTTOM_MARGIN + 8.0, 0.5 * area.width, 12.0);
        color_bar(&mut canvas, bar, self.scale, &self.quantity);
        canvas.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bright_cell_is_at_its_axes_position() {
        let mut values = vec![0.0; 12];
        values[4 + 2] = 1.0;
        let chart =
            HeatChart { x: [0.0, 4.0], y: [0.0, 3.0], columns: 4, values, scale: [0.0, 1.0], ..Default::default() };
        let picture = chart.draw();
        let area =
            Rect::new(LEFT_MARGIN + 6.0, 84.0, SIZE[0] - LEFT_MARGIN - 30.0, SIZE[1] - 84.0 - BOTTOM_MARGIN - BAR_PX);
        let color = |at: [f64; 2]| {
            let [x, y] = Plot::new(area, chart.x, chart.y).at(at).map(|v| v as usize);
            picture.rgb[3 * (y * picture.width + x)..][..3].to_vec()
        };
        assert_eq!((color([2.5, 1.5]), color([2.5, 0.5])), (inferno(1.0).to_vec(), inferno(0.0).to_vec()));
    }

    #[test]
    fn degenerate_data_do_not_panic() {
        for (columns, values) in [(0, vec![]), (3, vec![1.0]), (1, vec![f64::NAN; 4]), (2, vec![f64::INFINITY; 4])] {
            let bad = [[f64::NAN, 0.0], [1e300, -1e300]];
            let chart = HeatChart { columns, values, truth: bad.to_vec(), found: bad.to_vec(), ..Default::default() };
            chart.draw();
        }
    }
}

//! Line and scatter charts over two axes, linear or logarithmic: error against run time, error
//! against signal, and so on.

use super::Picture;
use super::canvas::{Align, Canvas, Rect};
use super::marks::{Symbol, legend_entry, legend_width};
use super::plot::{BOTTOM_MARGIN, LEFT_MARGIN, Plot};
use super::style::{FALSE_INK, FOUND_INK, GRID, INK, LABEL_PX, MUTED, PATH_INK, Rgb, TICK_PX, TITLE_PX, short_number};

/// Width and height, pixels. Choice: one column of a report at 96 dpi.
const SIZE: [f64; 2] = [900.0, 540.0];
pub(super) const COLORS: [Rgb; 7] =
    [FOUND_INK, FALSE_INK, PATH_INK, [204, 121, 167], [230, 159, 0], [86, 180, 233], [70, 76, 88]];

/// One curve.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Pairs of x and y. Non-finite values are skipped, and values not above 0 on a logarithmic
    /// axis.
    pub points: Vec<[f64; 2]>,
    /// Whether the points are joined by lines in their order; otherwise only dots are drawn.
    pub joined: bool,
}

/// A chart of curves.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Chart {
    /// Title of the figure.
    pub title: String,
    /// Label of x, with its unit.
    pub x_label: String,
    /// Label of y, with its unit.
    pub y_label: String,
    /// Whether x is logarithmic.
    pub x_log: bool,
    /// Whether y is logarithmic.
    pub y_log: bool,
    /// The curves. Colours repeat after seven.
    pub series: Vec<Series>,
}

impl Chart {
    /// Draws the chart.
    pub fn draw(&self) -> Picture {
        let mut canvas = Canvas::new(SIZE[0] as usize, SIZE[1] as usize);
        canvas.text([18.0, 26.0], Align::Left, &self.title, TITLE_PX, INK);
        let top = self.draw_legend(&mut canvas);
        let left = LEFT_MARGIN + 6.0;
        let area = Rect::new(left, top, SIZE[0] - left - 24.0, SIZE[1] - top - BOTTOM_MARGIN - 6.0);
        let curves: Vec<Vec<[f64; 2]>> = self.series.iter().map(|series| self.placed(&series.points)).collect();
        let plot = Plot::new(area, range(&curves, 0, self.x_log), range(&curves, 1, self.y_log));
        self.log_grid(&mut canvas, &plot);
        plot.grid_where(&mut canvas, [!self.x_log, !self.y_log]);
        for ((points, series), color) in curves.iter().zip(&self.series).zip(COLORS.iter().cycle()) {
            let points = plot.all_at(points.iter().copied());
            if series.joined {
                canvas.polyline(&points, 2.2, *color);
            }
            for &point in &points {
                canvas.disc(point, 4.2, *color);
            }
        }
        plot.axes_where(&mut canvas, "", &self.x_label, &self.y_label, [!self.x_log, !self.y_log]);
        self.log_numbers(&mut canvas, &plot);
        if curves.iter().all(Vec::is_empty) {
            canvas.text(area.center(), Align::Center, "no data", LABEL_PX, MUTED);
        }
        canvas.finish()
    }

    /// Points in axis coordinates: logarithms on a logarithmic axis.
    fn placed(&self, points: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let scaled = |v: f64, log: bool| if log { v.log10() } else { v };
        let placed = points.iter().map(|p| [scaled(p[0], self.x_log), scaled(p[1], self.y_log)]);
        placed.filter(|p| p.iter().all(|v| v.is_finite() && v.abs() < 1e12)).collect()
    }

    /// Draws the legend in as many rows as needed. Returns the top of the plot below.
    fn draw_legend(&self, canvas: &mut Canvas) -> f64 {
        let (mut x, mut y) = (18.0, 58.0);
        for (series, color) in self.series.iter().zip(COLORS.iter().cycle()) {
            let width = legend_width(&series.name);
            if x > 18.0 && x + width > SIZE[0] {
                (x, y) = (18.0, y + 26.0);
            }
            let symbol = if series.joined { Symbol::Line(*color) } else { Symbol::Dot(*color) };
            legend_entry(canvas, [x, y], symbol, &series.name);
            x += width;
        }
        (y + 26.0).min(SIZE[1] * 0.5)
    }

    fn log_grid(&self, canvas: &mut Canvas, plot: &Plot) {
        let Rect { x: left, y: top, .. } = plot.area;
        for at in self.x_log.then(|| log_ticks(plot.x)).into_iter().flatten().map(|v| plot.at([v.log10(), 0.0])[0]) {
            canvas.line([at, top], [at, plot.area.bottom()], 1.0, GRID);
        }
        for at in self.y_log.then(|| log_ticks(plot.y)).into_iter().flatten().map(|v| plot.at([0.0, v.log10()])[1]) {
            canvas.line([left, at], [plot.area.right(), at], 1.0, GRID);
        }
    }

    fn log_numbers(&self, canvas: &mut Canvas, plot: &Plot) {
        for tick in self.x_log.then(|| log_ticks(plot.x)).into_iter().flatten() {
            let (x, y) = (plot.at([tick.log10(), 0.0])[0], plot.area.bottom());
            canvas.line([x, y], [x, y + 5.0], 1.2, INK);
            canvas.text([x, y + 15.0], Align::Center, &plain(tick), TICK_PX, INK);
        }
        for tick in self.y_log.then(|| log_ticks(plot.y)).into_iter().flatten() {
            let (x, y) = (plot.area.x, plot.at([0.0, tick.log10()])[1]);
            canvas.line([x - 5.0, y], [x, y], 1.2, INK);
            canvas.text([x - 9.0, y], Align::Right, &plain(tick), TICK_PX, INK);
        }
    }
}

/// Range of all points on one axis with a margin. Starts at 0 on a linear axis if all values are
/// above 0.
pub(super) fn range(curves: &[Vec<[f64; 2]>], axis: usize, log: bool) -> [f64; 2] {
    let values = || curves.iter().flatten().map(|p| p[axis]);
    let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
    if low > high {
        return [0.0, 1.0];
    }
    let air = 0.06 * (high - low).max(if log { 0.5 } else { 1e-6 * high.abs() });
    let from_zero = !log && low >= 0.0 && low < 0.4 * high;
    [if from_zero { 0.0 } else { low - air }, high + air]
}

/// Ticks at 1, 2 and 5 of each decade within a range of logarithms; only at decades if these would
/// be too many.
pub(super) fn log_ticks([low, high]: [f64; 2]) -> Vec<f64> {
    let decades = high - low;
    let (leads, every): (&[f64], usize) = match decades {
        d if d < 2.5 => (&[1.0, 2.0, 5.0], 1),
        d if d < 9.0 => (&[1.0], 1),
        d => (&[1.0], (d / 8.0).ceil().min(1e6) as usize),
    };
    let decades = (low.floor() as i32..=high.ceil() as i32).step_by(every);
    let all = decades.flat_map(|decade| leads.iter().map(move |lead| lead * 10f64.powi(decade)));
    all.filter(|tick| (low..=high).contains(&tick.log10())).collect()
}

pub(super) fn plain(tick: f64) -> String {
    if (1e-3..1e5).contains(&tick) { format!("{}", (tick * 1e6).round() / 1e6) } else { short_number(tick) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log_ticks_cover_decades() {
        assert_eq!(log_ticks([0.0, 1.0]), [1.0, 2.0, 5.0, 10.0]);
        assert_eq!(log_ticks([-2.5, 2.5]).len(), 5);
        assert!(log_ticks([-300.0, 300.0]).len() < 12);
        assert_eq!(plain(0.02), "0.02");
    }

    #[test]
    fn axis_ranges_have_margin_and_start_at_zero() {
        assert_eq!(range(&[vec![[0.0, 1.0], [1.0, 10.0]]], 1, false)[0], 0.0);
        assert!(range(&[vec![[0.0, 9.0], [1.0, 10.0]]], 1, false)[0] > 8.0);
        assert_eq!(range(&[vec![]], 0, true), [0.0, 1.0]);
    }

    #[test]
    fn degenerate_data_do_not_panic() {
        let all = [[f64::NAN, 1.0], [0.0, 0.0], [-1.0, 1e300], [1e300, 1e-300], [2.0, 2.0]];
        for points in [Vec::new(), vec![[1.0, 1.0]], all.to_vec()] {
            for log in [false, true] {
                let series = vec![Series { name: "a".repeat(40), points: points.clone(), joined: true }; 30];
                Chart { x_log: log, y_log: log, series, ..Chart::default() }.draw();
            }
        }
        Chart::default().draw();
    }
}

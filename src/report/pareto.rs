//! Cost against error over two logarithmic axes: many variants of a computation, and their Pareto
//! front. Points on the front are numbered, and a key beside the plot lists them.

use super::Picture;
use super::canvas::{Align, Canvas, Rect};
use super::chart::{COLORS, log_ticks, plain, range};
use super::marks::{Symbol, legend_entry, legend_width};
use super::plot::{BOTTOM_MARGIN, LEFT_MARGIN, Plot};
use super::style::{GRID, HEADING_PX, INK, LABEL_PX, MUTED, PAPER, Rgb, TICK_PX, TITLE_PX, short_number};

/// Width and height, pixels. Choice: a chart with a key beside it.
const SIZE: [f64; 2] = [1240.0, 720.0];
/// Width of the key, pixels. Choice: the longest label of the benchmark's variants in small
/// letters.
const KEY_PX: f64 = 400.0;

/// Symbol of a variant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TradeOffMarker {
    /// Ring: all voxels are computed.
    Dense,
    /// Dot: only relevant voxels are computed.
    Adaptive,
    /// Diamond: adaptive, then refined.
    Refined,
    /// Square: updated with each new datum.
    Rolling,
    /// Cross: the reference computation.
    Slow,
}

impl TradeOffMarker {
    const ALL: [(Self, &'static str); 5] = [
        (Self::Dense, "every voxel"),
        (Self::Adaptive, "adaptive: same result"),
        (Self::Refined, "adaptive, then refined"),
        (Self::Rolling, "window: fresh / rolling"),
        (Self::Slow, "f64, direct formula"),
    ];

    fn draw(self, canvas: &mut Canvas, [x, y]: [f64; 2], color: Rgb) {
        let diamond = |r: f64| [[x, y - r], [x + r, y], [x, y + r], [x - r, y]];
        match self {
            Self::Dense => {
                canvas.disc([x, y], 5.0, PAPER);
                canvas.ring([x, y], 4.4, 1.8, color);
            }
            Self::Adaptive => canvas.disc([x, y], 4.6, color),
            Self::Refined => {
                canvas.convex(&diamond(8.6), PAPER, 1.0);
                canvas.convex(&diamond(7.0), color, 1.0);
            }
            Self::Rolling => canvas.fill(Rect::new(x - 4.4, y - 4.4, 8.8, 8.8), color),
            Self::Slow => {
                canvas.line([x - 5.0, y - 5.0], [x + 5.0, y + 5.0], 2.6, color);
                canvas.line([x - 5.0, y + 5.0], [x + 5.0, y - 5.0], 2.6, color);
            }
        }
    }
}

/// One variant.
#[derive(Debug, Clone, PartialEq)]
pub struct TradeOffPoint {
    /// Name of its series. A series has one colour.
    pub series: String,
    /// Its symbol.
    pub mark: TradeOffMarker,
    /// Cost and error. Points with a value that is not finite and above 0 are skipped.
    pub at: [f64; 2],
    /// Text in the key, if it is on the front.
    pub label: String,
    /// Index of the point that this one improves on. A faint line joins them.
    pub from: Option<usize>,
    /// Whether it is on the Pareto front.
    pub on_front: bool,
}

/// The figure.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TradeOff {
    /// Title of the figure.
    pub title: String,
    /// Notes above the plot, one per line.
    pub notes: Vec<String>,
    /// Label of x, with its unit.
    pub x_label: String,
    /// Label of y, with its unit.
    pub y_label: String,
    /// Unit of x, for the key.
    pub x_unit: String,
    /// Unit of y, for the key.
    pub y_unit: String,
    /// The variants.
    pub points: Vec<TradeOffPoint>,
}

/// Indices of the non-dominated points: no other point is at most as large in both values and
/// smaller in one. By ascending x; of equal points the first. Non-finite points are skipped.
pub fn pareto_front(points: &[[f64; 2]]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).filter(|&n| points[n].iter().all(|v| v.is_finite())).collect();
    order.sort_by(|&a, &b| points[a][0].total_cmp(&points[b][0]).then(points[a][1].total_cmp(&points[b][1])));
    let mut least = f64::INFINITY;
    order.retain(|&n| {
        points[n][1] < least && {
            least = points[n][1];
            true
        }
    });
    order
}

impl TradeOff {
    /// Draws the figure.
    pub fn draw(&self) -> Picture {
        let mut canvas = Canvas::new(SIZE[0] as usize, SIZE[1] as usize);
        canvas.text([18.0, 26.0], Align::Left, &self.title, TITLE_PX, INK);
        let mut top = 54.0;
        for note in &self.notes {
            canvas.text([18.0, top], Align::Left, note, LABEL_PX, MUTED);
            top += 22.0;
        }
        let series = self.series();
        top = self.draw_legend(&mut canvas, &series, top + 12.0);
        let left = LEFT_MARGIN + 6.0;
        let area = Rect::new(left, top, SIZE[0] - KEY_PX - left - 30.0, SIZE[1] - top - BOTTOM_MARGIN - 6.0);
        let placed: Vec<[f64; 2]> = self.points.iter().map(|p| p.at.map(f64::log10)).collect();
        let finite: Vec<[f64; 2]> = placed.iter().copied().filter(drawable).collect();
        let ranges = [0, 1].map(|axis| range(std::slice::from_ref(&finite), axis, true));
        let plot = Plot::new(area, ranges[0], ranges[1]);
        draw_grid(&mut canvas, &plot);
        self.draw_links(&mut canvas, &plot, &placed);
        let front = self.front(&placed);
        draw_front(&mut canvas, &plot, &front.iter().map(|&n| placed[n]).collect::<Vec<_>>());
        for (point, at) in self.points.iter().zip(&placed).filter(|(_, at)| drawable(at)) {
            let color = color_of(&series, &point.series);
            point.mark.draw(&mut canvas, plot.at(*at), color);
        }
        plot.axes_where(&mut canvas, "", &self.x_label, &self.y_label, [false, false]);
        draw_numbers(&mut canvas, &plot);
        self.draw_key(&mut canvas, &plot, &placed, &front, &series);
        if finite.is_empty() {
            canvas.text(area.center(), Align::Center, "no data", LABEL_PX, MUTED);
        }
        canvas.finish()
    }

    /// Series names in the order of their first point.
    fn series(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for point in &self.points {
            if !names.contains(&point.series.as_str()) {
                names.push(&point.series);
            }
        }
        names
    }

    /// Drawable points on the front, by ascending x.
    fn front(&self, placed: &[[f64; 2]]) -> Vec<usize> {
        let can = |&n: &usize| self.points[n].on_front && drawable(&placed[n]);
        let mut front: Vec<usize> = (0..placed.len()).filter(can).collect();
        front.sort_by(|&a, &b| placed[a][0].total_cmp(&placed[b][0]));
        front
    }

    /// Draws the legend: colours in one row, symbols in the next. Returns the top of the plot.
    fn draw_legend(&self, canvas: &mut Canvas, series: &[&str], top: f64) -> f64 {
        let (mut x, mut y) = (18.0, top);
        for name in series {
            if x > 18.0 && x + legend_width(name) > SIZE[0] {
                (x, y) = (18.0, y + 24.0);
            }
            legend_entry(canvas, [x, y], Symbol::Square(color_of(series, name)), name);
            x += legend_width(name);
        }
        (x, y) = (18.0, y + 26.0);
        for (mark, text) in
            TradeOffMarker::ALL.into_iter().filter(|(mark, _)| self.points.iter().any(|p| p.mark == *mark))
        {
            mark.draw(canvas, [x + 12.0, y], MUTED);
            canvas.text([x + 30.0, y], Align::Left, text, LABEL_PX, INK);
            x += legend_width(text) - 4.0;
        }
        (y + 26.0).min(SIZE[1] * 0.5)
    }

    fn draw_links(&self, canvas: &mut Canvas, plot: &Plot, placed: &[[f64; 2]]) {
        for (point, at) in self.points.iter().zip(placed) {
            if let Some(from) = point.from.and_then(|n| placed.get(n)).filter(|from| drawable(from) && drawable(at)) {
                canvas.line(plot.at(*from), plot.at(*at), 1.2, [196, 202, 212]);
            }
        }
    }

    /// Numbers at the points of the front, and their key.
    fn draw_key(&self, canvas: &mut Canvas, plot: &Plot, placed: &[[f64; 2]], front: &[usize], series: &[&str]) {
        let left = plot.area.right() + 26.0;
        let mut y = plot.area.y + 8.0;
        canvas.text([left, y], Align::Left, "The front: nothing else is faster and better", HEADING_PX * 0.92, INK);
        y += 30.0;
        let spacing = ((plot.area.bottom() - y) / front.len().max(1) as f64).min(46.0);
        for (number, &n) in front.iter().enumerate() {
            let (point, text) = (&self.points[n], (number + 1).to_string());
            let [px, py] = plot.at(placed[n]);
            canvas.text_rimmed([px - 11.0, py + 14.0], Align::Center, &text, TICK_PX, INK, PAPER);
            let [price, error] = point.at.map(short_number);
            canvas.disc([left + 11.0, y + 8.0], 11.0, color_of(series, &point.series));
            canvas.text([left + 11.0, y + 8.0], Align::Center, &text, TICK_PX, PAPER);
            let figures = format!("{price} {}, {error} {}", self.x_unit, self.y_unit);
            let width = KEY_PX - 40.0;
            if spacing < MIN_TWO_LINE_PX {
                let line = format!("{figures}: {}", point.label);
                canvas.text_fitted([left + 30.0, y + 8.0], Align::Left, &line, TICK_PX, width, INK);
            } else {
                canvas.text([left + 30.0, y], Align::Left, &figures, LABEL_PX, INK);
                canvas.text_fitted([left + 30.0, y + 18.0], Align::Left, &point.label, TICK_PX, width, MUTED);
            }
            y += spacing;
        }
    }
}

/// Least height of an entry of the key that takes two lines, pixels. Choice: below it the lines of
/// neighbours touch.
const MIN_TWO_LINE_PX: f64 = 38.0;

fn drawable(at: &[f64; 2]) -> bool {
    at.iter().all(|v| v.is_finite() && v.abs() < 1e12)
}

fn color_of(series: &[&str], name: &str) -> Rgb {
    let at = series.iter().position(|other| *other == name).unwrap_or(0);
    COLORS[at % COLORS.len()]
}

/// A step line: between two points of the front, the error of the faster one is reached.
fn draw_front(canvas: &mut Canvas, plot: &Plot, front: &[[f64; 2]]) {
    let corners = front.windows(2).flat_map(|pair| [pair[0], [pair[1][0], pair[0][1]]]);
    let steps: Vec<[f64; 2]> = corners.chain(front.last().copied()).collect();
    canvas.polyline(&plot.all_at(steps), 2.0, INK);
}

fn draw_grid(canvas: &mut Canvas, plot: &Plot) {
    let Rect { x: left, y: top, .. } = plot.area;
    for tick in log_ticks(plot.x) {
        let at = plot.at([tick.log10(), 0.0])[0];
        canvas.line([at, top], [at, plot.area.bottom()], 1.0, GRID);
    }
    for tick in log_ticks(plot.y) {
        let at = plot.at([0.0, tick.log10()])[1];
        canvas.line([left, at], [plot.area.right(), at], 1.0, GRID);
    }
}

fn draw_numbers(canvas: &mut Canvas, plot: &Plot) {
    for tick in log_ticks(plot.x) {
        let (x, y) = (plot.at([tick.log10(), 0.0])[0], plot.area.bottom());
        canvas.line([x, y], [x, y + 5.0], 1.2, INK);
        canvas.text([x, y + 15.0], Align::Center, &plain(tick), TICK_PX, INK);
    }
    for tick in log_ticks(plot.y) {
        let (x, y) = (plot.area.x, plot.at([0.0, tick.log10()])[1]);
        canvas.line([x - 5.0, y], [x, y], 1.2, INK);
        canvas.text([x - 9.0, y], Align::Right, &plain(tick), TICK_PX, INK);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(at: [f64; 2], from: Option<usize>) -> TradeOffPoint {
        let (series, label) = (format!("{}", at[0]), "a way ".repeat(20));
        TradeOffPoint { series, mark: TradeOffMarker::Dense, at, label, from, on_front: true }
    }

    #[test]
    fn pareto_front_is_non_dominated() {
        let points =
            [[2.0, 5.0], [1.0, 9.0], [3.0, 5.0], [2.0, 5.0], [4.0, 1.0], [f64::NAN, 0.0], [5.0, 2.0], [1.0, 10.0]];
        assert_eq!(pareto_front(&points), [1, 0, 4]);
        assert!(pareto_front(&[]).is_empty());
        for (n, a) in points.iter().enumerate() {
            let beaten = points.iter().any(|b| b[0] <= a[0] && b[1] <= a[1] && b != a);
            let kept = pareto_front(&points).iter().any(|&f| points[f] == *a);
            assert!(a[0].is_nan() || kept != beaten, "{n}");
        }
    }

    #[test]
    fn degenerate_data_do_not_panic() {
        TradeOff::default().draw();
        let all = [[f64::NAN, 1.0], [0.0, 0.0], [-1.0, 1e300], [1e300, 1e-300], [2.0, 2.0], [2.0, f64::INFINITY]];
        let points: Vec<TradeOffPoint> = (0..60).map(|n| point(all[n % 6], Some(n * 7))).collect();
        TradeOff { points, notes: vec![String::new(); 60], ..TradeOff::default() }.draw();
        TradeOff { points: vec![point([1.0, 1.0], Some(0))], ..TradeOff::default() }.draw();
    }
}

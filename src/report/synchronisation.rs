//! Time alignment of poses and radar (thesis, figures 4.10 and 5.1): the distance of a reflector
//! from both, the start of the motion enlarged, and the time offset window by window.

use super::Picture;
use super::canvas::{Align, Canvas, Rect};
use super::marks::{Symbol, legend_entry, legend_width};
use super::plot::{BOTTOM_MARGIN, LEFT_MARGIN, Plot};
use super::style::{FALSE_INK, FOUND_INK, INK, LABEL_PX, MUTED, PATH_INK, Rgb, TITLE_PX};

/// Layout, pixels. Choice: three panels below each other fit a screen's height.
const WIDTH: f64 = 1200.0;
const LEFT: f64 = 6.0 + LEFT_MARGIN;
const HEIGHTS: [f64; 3] = [220.0, 220.0, 190.0];
const TOP: f64 = 118.0;
/// Gap between a panel's lower margin and the next panel's frame, pixels. Choice: room for a
/// panel's heading.
const GAP: f64 = 44.0;
const RADAR: Rgb = [86, 180, 233];
const POSES: Rgb = [230, 159, 0];

/// A time offset and its 1σ, seconds; `None` if not estimated.
pub type OffsetMark = Option<(f64, f64)>;

/// The time offset of a part of the recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffsetSpan {
    /// Begin and end, seconds.
    pub span_s: [f64; 2],
    /// Estimated from ranges and phases.
    pub by_phases: OffsetMark,
    /// Estimated from rates.
    pub by_rates: OffsetMark,
}

/// Content of the figure. Times are seconds since the first sweep. Non-finite entries are skipped.
#[derive(Debug, Clone, Copy)]
pub struct SynchronisationPlot<'a> {
    /// Title of the figure.
    pub title: &'a str,
    /// Range from the radar: time and metres.
    pub radar_m: &'a [[f64; 2]],
    /// Distance from the poses, at their timestamps.
    pub poses_m: &'a [[f64; 2]],
    /// Time of a sweep's pose minus time of the sweep, if estimated.
    pub offset_s: Option<f64>,
    /// The offset over time.
    pub offsets: &'a [OffsetSpan],
    /// The enlarged part, seconds.
    pub enlarged_s: [f64; 2],
}

/// Draws the figure.
pub fn synchronisation_plot(plot: &SynchronisationPlot) -> Picture {
    let height = TOP + HEIGHTS.iter().sum::<f64>() + 3.0 * BOTTOM_MARGIN + 2.0 * GAP + 6.0;
    let mut canvas = Canvas::new(WIDTH as usize, height as usize);
    canvas.text_fitted([18.0, 26.0], Align::Left, plot.title, TITLE_PX, WIDTH - 36.0, INK);
    legend(&mut canvas, plot);
    let area = |n: usize| {
        let above: f64 = HEIGHTS[..n].iter().sum::<f64>() + n as f64 * (BOTTOM_MARGIN + GAP);
        Rect::new(LEFT, TOP + above, WIDTH - LEFT - 28.0, HEIGHTS[n])
    };
    let all_s = span(plot.radar_m.iter().map(|p| p[0]));
    ranges(&mut canvas, plot, area(0), all_s, "Distance of the reflector");
    ranges(&mut canvas, plot, area(1), plot.enlarged_s, "The start of the motion");
    offsets(&mut canvas, plot, area(2), all_s);
    canvas.finish()
}

fn legend(canvas: &mut Canvas, plot: &SynchronisationPlot) {
    let mut entries = vec![(Symbol::Dot(RADAR), "radar"), (Symbol::Line(POSES), "poses, as stamped")];
    if plot.offset_s.is_some() {
        entries.push((Symbol::Line(PATH_INK), "poses, corrected"));
    }
    entries.push((Symbol::Square(FOUND_INK), "offset by ranges and phases, ±1σ"));
    entries.push((Symbol::Dot(FALSE_INK), "offset by rates, ±1σ"));
    let mut x = 18.0;
    for (symbol, text) in entries {
        legend_entry(canvas, [x, 60.0], symbol, text);
        x += legend_width(text);
    }
}

fn ranges(canvas: &mut Canvas, shown: &SynchronisationPlot, area: Rect, time_s: [f64; 2], heading: &str) {
    let within = |point: &&[f64; 2]| point.iter().all(|v| v.is_finite()) && (time_s[0]..=time_s[1]).contains(&point[0]);
    let offset_s = shown.offset_s.filter(|offset_s| offset_s.is_finite()).unwrap_or(0.0);
    let radar: Vec<[f64; 2]> = shown.radar_m.iter().filter(within).copied().collect();
    let poses: Vec<[f64; 2]> = shown.poses_m.iter().filter(within).copied().collect();
    let corrected: Vec<[f64; 2]> = shown.poses_m.iter().map(|[t, m]| [t - offset_s, *m]).collect();
    let corrected: Vec<[f64; 2]> = corrected.iter().filter(within).copied().collect();
    let values = span(radar.iter().chain(&poses).map(|p| p[1]));
    let air = 0.08 * (values[1] - values[0]).max(0.01);
    let plot = Plot::new(area, time_s, [values[0] - air, values[1] + air]);
    plot.grid(canvas);
    canvas.clipped(area, |canvas| {
        for point in plot.all_at(radar.iter().copied()) {
            canvas.disc(point, 2.6, RADAR);
        }
        // The lines are drawn over the dots, which would hide them.
        joined(canvas, &plot, &poses, POSES);
        if shown.offset_s.is_some() {
            joined(canvas, &plot, &corrected, PATH_INK);
        }
    });
    plot.axes(canvas, heading, "time since the first sweep (s)", "distance (m)");
    if radar.is_empty() {
        canvas.text(area.center(), Align::Center, "no echo was detected", LABEL_PX, MUTED);
    }
}

/// Lines between neighbours, but not across pauses.
fn joined(canvas: &mut Canvas, plot: &Plot, points: &[[f64; 2]], color: Rgb) {
    /// A longer pause between two values interrupts the line, seconds. Choice: longer than lost
    /// frames, shorter than a stop.
    const PAUSE_S: f64 = 0.1;
    let mut rest = points;
    while !rest.is_empty() {
        let end = rest.windows(2).position(|pair| pair[1][0] - pair[0][0] > PAUSE_S).map_or(rest.len(), |n| n + 1);
        canvas.polyline(&plot.all_at(rest[..end].iter().copied()), 1.8, color);
        rest = &rest[end..];
    }
}

fn offsets(canvas: &mut Canvas, shown: &SynchronisationPlot, area: Rect, time_s: [f64; 2]) {
    const MS: f64 = 1e3;
    let marks = |of: fn(&OffsetSpan) -> OffsetMark| {
        let marks = shown.offsets.iter().filter_map(move |o| Some((0.5 * (o.span_s[0] + o.span_s[1]), of(o)?)));
        marks.map(|(t, (value, sigma))| (t, value * MS, sigma * MS)).filter(|m| (m.0 + m.1 + m.2).is_finite())
    };
    let both: [Vec<(f64, f64, f64)>; 2] = [marks(|o| o.by_phases).collect(), marks(|o| o.by_rates).collect()];
    // Large error bars of uncertain values must not determine the scale.
    let least = |(_, value, sigma): &(f64, f64, f64)| [value - sigma.min(5.0), value + sigma.min(5.0)];
    let values = span(both.iter().flatten().flat_map(least).chain(shown.offset_s.map(|s| s * MS)));
    let air = (0.12 * (values[1] - values[0])).max(0.5);
    let plot = Plot::new(area, time_s, [values[0] - air, values[1] + air]);
    plot.grid(canvas);
    canvas.clipped(area, |canvas| {
        if let Some(offset_s) = shown.offset_s {
            let ends = [plot.at([time_s[0], offset_s * MS]), plot.at([time_s[1], offset_s * MS])];
            canvas.dashed(&ends, 7.0, 1.6, PATH_INK);
        }
        for (n, (marks, color)) in both.iter().zip([FOUND_INK, FALSE_INK]).enumerate() {
            for &(t, value, sigma) in marks {
                let aside = if n == 0 { -4.0 } else { 4.0 };
                let [x, y] = plot.at([t, value]);
                let bar = [plot.at([t, value - sigma])[1], plot.at([t, value + sigma])[1]];
                canvas.line([x + aside, bar[0]], [x + aside, bar[1]], 1.8, color);
                match n {
                    0 => canvas.fill(Rect::new(x + aside - 4.5, y - 4.5, 9.0, 9.0), color),
                    _ => canvas.disc([x + aside, y], 4.2, color),
                }
            }
        }
    });
    plot.axes(canvas, "Time offset: pose time minus sweep time", "time since the first sweep (s)", "offset (ms)");
    if both.iter().all(Vec::is_empty) {
        canvas.text(area.center(), Align::Center, "not observable from this motion", LABEL_PX, MUTED);
    }
}

/// Smallest and largest value; 0 to 1 if there are none.
fn span(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let finite = values.filter(|v| v.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    if low <= high { [low, high] } else { [0.0, 1.0] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degenerate_data_do_not_panic() {
        let bad = [[f64::NAN, 1.0], [0.0, f64::INFINITY], [1e300, -1e300], [1.0, 1.0], [2.0, 1.0]];
        let offset = |value| OffsetSpan { span_s: [0.0, f64::NAN], by_phases: Some((value, 1.0)), by_rates: None };
        let offsets = [offset(0.02), offset(f64::NAN), OffsetSpan { span_s: [1.0, 3.0], ..offset(1e300) }];
        for (points, offset_s) in [(&[][..], None), (&bad[..], Some(f64::NAN)), (&bad[3..], Some(1e9))] {
            for enlarged_s in [[0.0, 3.0], [f64::NAN, 1.0], [5.0, 5.0]] {
                let plot = SynchronisationPlot {
                    title: "a",
                    radar_m: points,
                    poses_m: points,
                    offset_s,
                    offsets: &offsets,
                    enlarged_s,
                };
                synchronisation_plot(&plot);
                synchronisation_plot(&SynchronisationPlot { offsets: &[], ..plot });
            }
        }
    }
}

//! The sensor's path, which is the synthetic aperture (thesis, figure 3.8): from the right, from
//! above and from behind, coloured by time, and each coordinate against time.

use glam::DVec3;

use radar_sar::geometry::Aabb;

use super::Picture;
use super::canvas::{Align, Canvas, Rect, visible_indices};
use super::color_map::{mix, viridis};
use super::marks::{Symbol, legend_entry, legend_width};
use super::plot::{BOTTOM_MARGIN, LEFT_MARGIN, Plot};
use super::style::{FALSE_INK, FOUND_INK, INK, LABEL_PX, MUTED, PATH_INK, Rgb, TICK_PX, TITLE_PX, short_number};
use super::views::{VIEWS, plots};

/// Width, and height of title and time bar, pixels. Choice: as
/// in `cross_sections`.
const WIDTH: f64 = 1320.0;
const TOP: f64 = 84.0;
const COORDINATES: [(&str, Rgb); 3] = [("x, right", FALSE_INK), ("y, up", PATH_INK), ("z, back", FOUND_INK)];

/// Draws a path: time in seconds and position in the tracking frame, metres, in order of time.
/// Non-finite entries are skipped.
pub fn motion_plot(path: &[(f64, DVec3)], title: &str) -> Picture {
    let path: Vec<(f64, DVec3)> = path.iter().copied().filter(|(t, p)| t.is_finite() && p.is_finite()).collect();
    let plots = plots(&region(&path), [6.0, TOP], WIDTH - 12.0, 360.0);
    let lowest = plots.iter().map(|plot| plot.area.bottom()).fold(0.0, f64::max);
    let below = lowest + BOTTOM_MARGIN + 62.0;
    let mut canvas = Canvas::new(WIDTH as usize, (below + 170.0 + BOTTOM_MARGIN + 6.0) as usize);
    canvas.text([18.0, 26.0], Align::Left, title, TITLE_PX, INK);
    let times = time_range(&path);
    for (plot, view) in plots.iter().zip(VIEWS) {
        plot.grid(&mut canvas);
        let points = plot.all_at(path.iter().map(|&(_, position)| view.project(position)));
        draw_timed(&mut canvas, &path, &points, times);
        let [heading, x_label, y_label] = view.labels();
        plot.axes(&mut canvas, heading, x_label, y_label);
    }
    time_bar(&mut canvas, times);
    against_time(&mut canvas, &path, times, Rect::new(6.0 + LEFT_MARGIN, below, WIDTH - LEFT_MARGIN - 28.0, 170.0));
    canvas.finish()
}

/// A box around the path with a margin; no side is less than an eighth of the longest.
fn region(path: &[(f64, DVec3)]) -> Aabb {
    let Some(tight) = Aabb::around(path.iter().map(|&(_, position)| position)) else {
        return Aabb { min: DVec3::splat(-0.5), max: DVec3::splat(0.5) };
    };
    let longest = tight.size().max_element().max(0.02);
    let half = 0.5 * tight.size().max(DVec3::splat(longest / 8.0)) + 0.06 * longest;
    Aabb { min: tight.center() - half, max: tight.center() + half }
}

fn time_range(path: &[(f64, DVec3)]) -> [f64; 2] {
    match (path.first(), path.last()) {
        (Some(first), Some(last)) => [first.0, last.0],
        _ => [0.0, 1.0],
    }
}

fn time_color(time: f64, [first, last]: [f64; 2]) -> Rgb {
    let share = if last > first { (time - first) / (last - first) } else { 0.0 };
    mix(viridis(0.92 * share), [0, 0, 0], 0.08)
}

fn draw_timed(canvas: &mut Canvas, path: &[(f64, DVec3)], points: &[[f64; 2]], times: [f64; 2]) {
    for pair in visible_indices(points).windows(2) {
        canvas.line(points[pair[0]], points[pair[1]], 2.0, time_color(path[pair[0]].0, times));
    }
    if let (Some(&first), Some(&last)) = (points.first(), points.last()) {
        canvas.disc(first, 6.0, time_color(times[0], times));
        canvas.disc(last, 6.0, time_color(times[1], times));
        canvas.disc(last, 3.2, [255, 255, 255]);
    }
}

fn time_bar(canvas: &mut Canvas, times: [f64; 2]) {
    let bar = Rect::new(WIDTH - 320.0, 24.0, 200.0, 12.0);
    let [first, last] = times;
    canvas.paint(bar, |u, _| time_color(first + u * (last - first), times));
    let y = bar.center()[1];
    canvas.disc([bar.x, y], 6.0, time_color(first, times));
    canvas.disc([bar.right(), y], 6.0, time_color(last, times));
    canvas.disc([bar.right(), y], 3.2, [255, 255, 255]);
    canvas.text([bar.x - 12.0, y], Align::Right, &format!("start {} s", short_number(first)), TICK_PX, INK);
    canvas.text([bar.right() + 12.0, y], Align::Left, &format!("end {} s", short_number(last)), TICK_PX, INK);
}

/// Each coordinate minus its mean, to show how far the sensor moves.
fn against_time(canvas: &mut Canvas, path: &[(f64, DVec3)], times: [f64; 2], area: Rect) {
    let mean = path.iter().map(|&(_, position)| position).sum::<DVec3>() / path.len().max(1) as f64;
    let most = path.iter().map(|&(_, position)| (position - mean).abs().max_element()).fold(0.01, f64::max) * 1.1;
    let plot = Plot::new(area, times, [-most, most]);
    plot.grid(canvas);
    for (axis, (_, color)) in COORDINATES.into_iter().enumerate() {
        let points = plot.all_at(path.iter().map(|&(time, position)| [time, position[axis] - mean[axis]]));
        canvas.clipped(area, |canvas| canvas.polyline(&points, 2.0, color));
    }
    plot.axes(canvas, "Against time", "time (s)", "from its mean (m)");
    let mut x = area.x + 150.0;
    for (axis, (name, color)) in COORDINATES.into_iter().enumerate() {
        let text = format!("{name} (mean {:.2} m)", mean[axis]).replace('-', "−");
        legend_entry(canvas, [x, area.y - 14.0], Symbol::Line(color), &text);
        x += legend_width(&text);
    }
    if path.is_empty() {
        canvas.text(area.center(), Align::Center, "no poses", LABEL_PX, MUTED);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degenerate_paths_do_not_panic() {
        motion_plot(&[], "none");
        motion_plot(&[(0.0, DVec3::ZERO)], "one");
        motion_plot(&[(1.0, DVec3::ONE); 5], "still");
        motion_plot(&[(f64::NAN, DVec3::ONE), (0.0, DVec3::NAN), (2.0, DVec3::X), (1.0, DVec3::Y)], "bad");
        motion_plot(&[(0.0, DVec3::splat(1e300)), (1e300, DVec3::splat(-1e300))], "huge");
    }
}

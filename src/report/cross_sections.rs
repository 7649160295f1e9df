//! Accumulated cross-sections (thesis, section 4.1, figure 4.2): the values summed along x, along y
//! and along z, as if looking through a slightly transparent volume from the side, from above and
//! from behind. Each view has its own colour scale from its smallest to its largest sum. Non-finite
//! values are skipped.

use radar_sar::Volume;

use super::Picture;
use super::canvas::{Align, Canvas, Rect};
use super::color_map::inferno;
use super::marks::{Marks, Symbol, legend_row};
use super::plot::{BOTTOM_MARGIN, Plot};
use super::style::{GRID, INK, LABEL_PX, MUTED, TICK_PX, TITLE_PX, short_number};
use super::views::{VIEWS, View, plots, with_path};

/// Width, and height of title and colour scales, pixels. Choice: three views side by side on a wide
/// screen.
const WIDTH: f64 = 1320.0;
const TOP: f64 = 108.0;

/// Sums along one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Accumulated {
    /// The axis of summation: 0, 1, 2 for x, y, z.
    pub along: usize,
    /// Number of voxels on the two remaining axes, in the order x, y, z.
    pub size: [usize; 2],
    /// The sums. The first of the two axes runs fastest.
    pub sums: Vec<f64>,
}

impl Accumulated {
    /// Smallest and largest sum; `None` if there are none.
    pub fn range(&self) -> Option<[f64; 2]> {
        let low = self.sums.iter().copied().fold(f64::INFINITY, f64::min);
        let high = self.sums.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        (low <= high).then_some([low, high])
    }
}

/// Sums of a volume along axis 0, 1 or 2 (x, y, z; larger values count as 2). Non-finite values
/// count as 0.
pub fn accumulate(volume: &Volume, along: usize) -> Accumulated {
    folded(volume, along, |sum, value| sum + value)
}

/// Maximum values of a volume along axis 0, 1 or 2, and 0 where no value is above it. Non-finite
/// values count as 0.
pub fn greatest(volume: &Volume, along: usize) -> Accumulated {
    folded(volume, along, f64::max)
}

fn folded(volume: &Volume, along: usize, fold: impl Fn(f64, f64) -> f64) -> Accumulated {
    let along = along.min(2);
    let [x_count, y_count, z_count] = volume.size;
    // Index steps in the sums for a step along x, y, z.
    let (size, [x_step, y_step, z_step]) = match along {
        0 => ([y_count, z_count], [0, 1, y_count]),
        1 => ([x_count, z_count], [1, 0, x_count]),
        _ => ([x_count, y_count], [1, x_count, 0]),
    };
    let mut sums = vec![0.0; size[0] * size[1]];
    let rows = volume.values.chunks(x_count.max(1)).take(y_count * z_count).enumerate();
    for (row, values) in rows {
        let start = row % y_count * y_step + row / y_count * z_step;
        for (x, value) in values.iter().take(x_count).enumerate().filter(|(_, value)| value.is_finite()) {
            let sum = &mut sums[start + x * x_step];
            *sum = fold(*sum, f64::from(*value));
        }
    }
    Accumulated { along, size, sums }
}

/// Draws the cross-sections. `quantity` is the label of the colour scales with a unit:
/// "log-likelihood (nats)".
pub fn cross_sections(volume: &Volume, title: &str, quantity: &str, marks: &Marks) -> Picture {
    let region = with_path(&volume.region(), marks.path_m, 0.6);
    let plots = plots(&region, [6.0, TOP], WIDTH - 12.0, 470.0);
    let lowest = plots.iter().map(|plot| plot.area.bottom()).fold(0.0, f64::max);
    let mut canvas = Canvas::new(WIDTH as usize, (lowest + BOTTOM_MARGIN + 72.0) as usize);
    canvas.text([18.0, 26.0], Align::Left, title, TITLE_PX, INK);
    let mut legend = marks.legend();
    if region != volume.region() {
        legend.push((Symbol::Square(GRID), "outside the image"));
    }
    legend_row(&mut canvas, [18.0, 58.0], &legend);
    for (plot, view) in plots.iter().zip(VIEWS) {
        let sums = accumulate(volume, view.along());
        let range = sums.range().unwrap_or([0.0, 0.0]);
        heat_map(&mut canvas, plot, view, volume, &sums, range);
        canvas.clipped(plot.area, |canvas| marks.draw(canvas, |point| plot.at(view.project(point))));
        let [heading, x_label, y_label] = view.labels();
        plot.axes(&mut canvas, heading, x_label, y_label);
        let bar = Rect::new(plot.area.x, plot.area.bottom() + BOTTOM_MARGIN + 10.0, plot.area.width, 12.0);
        color_bar(&mut canvas, bar, range, &format!("{quantity}, Σ over {}", view.along_name()));
    }
    canvas.finish()
}

fn heat_map(canvas: &mut Canvas, plot: &Plot, view: View, volume: &Volume, sums: &Accumulated, [low, high]: [f64; 2]) {
    canvas.fill(plot.area, GRID);
    let region = volume.region();
    let [a, b] = [region.min, region.max].map(|corner| plot.at(view.project(corner)));
    let area = Rect::new(a[0].min(b[0]), a[1].min(b[1]), (b[0] - a[0]).abs(), (b[1] - a[1]).abs());
    let [across, down] = screen_axes(view);
    let per_span = if high > low { 1.0 / (high - low) } else { 0.0 };
    canvas.paint(area, |u, v| {
        let across = cell(across, u, volume);
        let down = cell(down, v, volume);
        let [first, second] = if across.0 < down.0 { [across.1, down.1] } else { [down.1, across.1] };
        let sum = sums.sums.get(second * sums.size[0] + first).copied().unwrap_or(low);
        inferno((sum - low) * per_span)
    });
}

/// Axis, and whether it runs backwards, to the right and down on the screen.
fn screen_axes(view: View) -> [(usize, bool); 2] {
    match view {
        View::Side => [(2, true), (1, true)],
        View::Top => [(2, true), (0, false)],
        View::Front => [(0, false), (1, true)],
    }
}

fn cell((axis, backwards): (usize, bool), share: f64, volume: &Volume) -> (usize, usize) {
    let share = if backwards { 1.0 - share } else { share };
    let count = volume.size[axis];
    (axis, ((share * count as f64) as usize).min(count.saturating_sub(1)))
}

/// A horizontal colour scale with its end values and its label.
pub(super) fn color_bar(canvas: &mut Canvas, bar: Rect, [low, high]: [f64; 2], label: &str) {
    canvas.paint(bar, |u, _| inferno(u));
    canvas.outline(bar, 1.0, INK);
    let y = bar.bottom() + 12.0;
    canvas.text([bar.x, y], Align::Left, &short_number(low), TICK_PX, INK);
    canvas.text([bar.right(), y], Align::Right, &short_number(high), TICK_PX, INK);
    canvas.text_fitted([bar.center()[0], y + 19.0], Align::Center, label, LABEL_PX, bar.width + 100.0, MUTED);
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use proptest::prelude::*;
    use radar_sar::geometry::Aabb;

    fn volume() -> Volume {
        let region = Aabb { min: DVec3::ZERO, max: DVec3::new(0.4, 0.3, 0.2) };
        let mut volume = Volume::covering(&region, 0.1);
        for (index, value) in volume.values.iter_mut().enumerate() {
            *value = index as f32;
        }
        volume
    }

    #[test]
    fn sums_are_along_the_given_axis() {
        let volume = volume();
        let along_x = accumulate(&volume, 0);
        assert_eq!(along_x.size, [3, 2]);
        assert_eq!(along_x.sums[0], 0.0 + 1.0 + 2.0 + 3.0);
        let along_y = accumulate(&volume, 1);
        assert_eq!(along_y.size, [4, 2]);
        assert_eq!(along_y.sums[4 + 1], (13 + 17 + 21) as f64);
        let along_z = accumulate(&volume, 2);
        assert_eq!(along_z.size, [4, 3]);
        assert_eq!(along_z.sums[2 * 4 + 3], (11 + 23) as f64);
        let greatest = greatest(&volume, 1);
        assert_eq!((greatest.size, greatest.sums[4 + 1]), ([4, 2], 21.0));
    }

    #[test]
    fn bright_voxel_is_at_its_axes_position() {
        let region = Aabb { min: DVec3::new(-1.0, 0.0, -2.0), max: DVec3::new(1.0, 2.0, 0.0) };
        let mut volume = Volume::covering(&region, 0.1);
        let voxel = [15, 4, 3];
        let index = volume.index(voxel);
        volume.values[index] = 1.0;
        let picture = cross_sections(&volume, "", "", &Marks::default());
        for (plot, view) in plots(&region, [6.0, TOP], WIDTH - 12.0, 470.0).iter().zip(VIEWS) {
            let [x, y] = plot.at(view.project(volume.center(voxel))).map(|v| v as usize);
            let at = 3 * (y * picture.width + x);
            assert_eq!(picture.rgb[at..at + 3], inferno(1.0), "{view:?}");
        }
    }

    #[test]
    fn degenerate_volumes_do_not_panic() {
        let empty = Volume { origin_m: DVec3::ZERO, voxel_m: 0.1, size: [0, 0, 0], values: Vec::new() };
        let flat = Volume { size: [5, 1, 1], values: vec![0.0; 5], ..empty.clone() };
        let short = Volume { size: [5, 5, 5], values: vec![1.0; 3], ..empty.clone() };
        let nowhere = Volume { origin_m: DVec3::NAN, size: [2, 2, 2], values: vec![f32::NAN; 8], voxel_m: 0.1 };
        let huge = Volume { voxel_m: 1e300, ..flat.clone() };
        let nan = [DVec3::NAN, DVec3::ONE, DVec3::splat(f64::INFINITY)];
        for volume in [empty, flat, short, nowhere, huge] {
            cross_sections(&volume, "t", "q", &Marks { truth_m: &nan, found_m: &nan, path_m: &nan });
        }
    }

    proptest! {
        #[test]
        fn totals_are_equal_for_every_axis(values in prop::collection::vec(-10.0..10.0f32, 24), hole in 0usize..24) {
            let mut volume = volume();
            volume.values = values;
            volume.values[hole] = f32::NAN;
            let total: f64 = volume.values.iter().filter(|v| v.is_finite()).map(|&v| v as f64).sum();
            for along in 0..3 {
                let sum: f64 = accumulate(&volume, along).sums.iter().sum();
                prop_assert!((sum - total).abs() < 1e-9);
            }
        }
    }
}

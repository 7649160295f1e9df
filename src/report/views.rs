//! The three views of the thesis' figure 4.2 side by side at one scale: height against depth from
//! the right, width against depth from above, height against width from behind. Depth is −z,
//! forward; width is x, to the right.

use glam::DVec3;

use radar_sar::geometry::Aabb;

use super::canvas::Rect;
use super::plot::{LEFT_MARGIN, Plot};

/// Gap between a plot and the next one's labels, pixels. Choice: numbers of neighbouring axes do
/// not touch.
const GAP: f64 = 16.0;
/// Smallest width of a plot including its labels, pixels. Choice: a heading and three ticks fit.
const MIN_SLOT_PX: f64 = 180.0;

/// A projection direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum View {
    /// From the right: depth to the right, height upwards.
    Side,
    /// From above: depth to the right, width downwards.
    Top,
    /// From behind: width to the right, height upwards.
    Front,
}

/// In the order of the thesis.
pub const VIEWS: [View; 3] = [View::Side, View::Top, View::Front];

impl View {
    /// The axis of the view: 0, 1, 2 for x, y, z.
    pub fn along(self) -> usize {
        match self {
            Self::Side => 0,
            Self::Top => 1,
            Self::Front => 2,
        }
    }

    /// Coordinates of a point on the horizontal and the vertical axis, metres.
    pub fn project(self, point: DVec3) -> [f64; 2] {
        match self {
            Self::Side => [-point.z, point.y],
            Self::Top => [-point.z, point.x],
            Self::Front => [point.x, point.y],
        }
    }

    /// Heading, and labels of the horizontal and the vertical axis.
    pub fn labels(self) -> [&'static str; 3] {
        match self {
            Self::Side => ["Side view, from the right", "depth −z (m)", "height y (m)"],
            Self::Top => ["Top view, from above", "depth −z (m)", "width x (m), right is down"],
            Self::Front => ["Front view, from behind", "width x (m)", "height y (m)"],
        }
    }

    /// Name of the axis of projection.
    pub fn along_name(self) -> &'static str {
        ["x", "y", "z"][self.along()]
    }

    fn ranges(self, region: &Aabb) -> [[f64; 2]; 2] {
        let (low, high) = (region.min, region.max);
        match self {
            Self::Side => [[-high.z, -low.z], [low.y, high.y]],
            Self::Top => [[-high.z, -low.z], [high.x, low.x]],
            Self::Front => [[low.x, high.x], [low.y, high.y]],
        }
    }
}

/// Three plots in a row `width` pixels wide including labels, none higher than `height`, starting
/// at `top_left`. All have the same scale.
pub fn plots(region: &Aabb, top_left: [f64; 2], width: f64, height: f64) -> [Plot; 3] {
    let region = drawable(region);
    let size = region.size();
    let scale = scale([size.z, size.z, size.x], width - 3.0 * (LEFT_MARGIN + GAP));
    let px_per_m = scale.min(height / size.y.max(size.x));
    let mut left = top_left[0];
    VIEWS.map(|view| {
        let [x, y] = view.ranges(&region);
        let plot_width = (x[1] - x[0]).abs() * px_per_m;
        let slot = plot_width.max(MIN_SLOT_PX);
        let x_px = left + LEFT_MARGIN + 0.5 * (slot - plot_width);
        let area = Rect::new(x_px, top_left[1], plot_width, (y[1] - y[0]).abs() * px_per_m);
        left += LEFT_MARGIN + slot + GAP;
        Plot::new(area, x, y)
    })
}

/// Scale in pixels per metre for plots of these widths (metres) that share `room` pixels, each at
/// least one slot wide.
fn scale(widths_m: [f64; 3], room: f64) -> f64 {
    let mut px_per_m = room / widths_m.iter().sum::<f64>();
    for _ in 0..2 {
        let (narrow, wide): (Vec<f64>, Vec<f64>) = widths_m.iter().partition(|&&w| w * px_per_m < MIN_SLOT_PX);
        if !wide.is_empty() {
            px_per_m = (room - narrow.len() as f64 * MIN_SLOT_PX) / wide.iter().sum::<f64>();
        }
    }
    px_per_m
}

/// The region, or a drawable replacement if it is flat, infinite or invalid.
pub fn drawable(region: &Aabb) -> Aabb {
    let sound = |v: DVec3| v.is_finite() && v.abs().max_element() < 1e9;
    if !(sound(region.min) && sound(region.max)) {
        return Aabb { min: DVec3::splat(-0.5), max: DVec3::splat(0.5) };
    }
    let (center, size) = (region.center(), region.size());
    let half = 0.5 * size.max(DVec3::splat((0.05 * size.max_element()).max(1e-3)));
    Aabb { min: center - half, max: center + half }
}

/// The region, enlarged to include a path outside it, but by at most `most_m` on each side.
pub fn with_path(region: &Aabb, path_m: &[DVec3], most_m: f64) -> Aabb {
    let near = Aabb { min: region.min - most_m, max: region.max + most_m };
    let margin = 0.05 * region.size().max_element();
    let shown = path_m.iter().filter(|p| p.is_finite()).flat_map(|&p| [p - margin, p + margin]);
    let shown = shown.map(|p| p.clamp(near.min.min(near.max), near.max.max(near.min)));
    Aabb::around(shown.chain([region.min, region.max])).unwrap_or(*region)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_share_one_scale_and_fit() {
        let region = Aabb { min: DVec3::new(-1.0, 0.0, -4.0), max: DVec3::new(1.0, 2.5, 0.5) };
        let plots = plots(&region, [0.0, 40.0], 1300.0, 460.0);
        for (plot, view) in plots.iter().zip(VIEWS) {
            let a = plot.at(view.project(DVec3::new(0.0, 1.0, -1.0)));
            let b = plot.at(view.project(DVec3::new(0.1, 1.1, -1.1)));
            assert!(((b[0] - a[0]).abs() - (b[1] - a[1]).abs()).abs() < 1e-9, "{view:?}");
            assert!(plot.area.right() <= 1300.0 && plot.area.height <= 460.5);
        }
        let narrow = Aabb { min: DVec3::new(0.8, 0.0, -4.0), ..region };
        let last = super::plots(&narrow, [0.0, 40.0], 1300.0, 460.0)[2].area;
        assert!(last.right() <= 1300.0);
        assert!(plots[0].at([2.0, 0.0])[0] > plots[0].at([1.0, 0.0])[0], "ahead is to the right");
        assert!(plots[1].at([0.0, 0.5])[1] > plots[1].at([0.0, -0.5])[1], "the right hand is down, seen from above");
    }
}

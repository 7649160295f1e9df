//! The voxels above a share of the peak as balls in a box (thesis, figure 4.1b): parallel
//! projection from above and behind the right shoulder. Far balls are drawn first, larger values
//! are larger and brighter, and balls cast a shadow on the floor.

use glam::DVec3;

use radar_sar::Volume;
use radar_sar::geometry::Aabb;

use super::Picture;
use super::canvas::{Align, Canvas, Rect};
use super::color_map::{inferno, mix};
use super::marks::{Marks, legend_row};
use super::style::{INK, LABEL_PX, MUTED, Rgb, TICK_PX, TITLE_PX, short_number, tick_text, ticks};
use super::views::{drawable, with_path};

/// Layout and colours, pixels. Choice: one picture of a report; dark, because bright balls stand
/// out on it.
const WIDTH: f64 = 960.0;
const HEIGHT: f64 = 800.0;
const SCENE: Rect = Rect { x: 14.0, y: 78.0, width: 846.0, height: 708.0 };
const GROUND: Rgb = [22, 25, 34];
const GROUND_GRID: Rgb = [62, 69, 84];
const EDGE: Rgb = [112, 122, 142];
const LETTERS: Rgb = [206, 213, 224];
/// Beyond this number of points, the weakest are skipped: they would hide each other. Choice: more
/// than 13 points would share each 100 pixels.
const MAX_POINTS: usize = 40_000;

/// Centres and values of the voxels with at least `share` of the peak, in the order of the volume.
/// Empty if the peak is not above 0. Non-finite values are skipped, also for the peak.
pub fn points_above(volume: &Volume, share: f64) -> Vec<(DVec3, f32)> {
    let voxels = volume.size.iter().product::<usize>();
    let values = || volume.values.iter().copied().enumerate().take(voxels).filter(|v| v.1.is_finite());
    let peak = values().map(|v| v.1).fold(0.0, f32::max);
    let least = (share.clamp(0.0, 1.0) * peak as f64) as f32;
    let above = values().filter(|v| v.1 > 0.0 && v.1 >= least);
    above.map(|(index, value)| (volume.center(volume.voxel(index)), value)).collect()
}

/// Draws the voxels above `share` (0 to 1) of the peak. `quantity` is the label of the values with
/// a unit.
pub fn point_cloud(volume: &Volume, title: &str, quantity: &str, share: f64, marks: &Marks) -> Picture {
    let mut points = points_above(volume, share);
    if points.len() > MAX_POINTS {
        points.sort_by(|a, b| b.1.total_cmp(&a.1));
        points.truncate(MAX_POINTS);
    }
    let range = value_range(&points);
    let camera = Camera::new(shown_region(volume, &points, marks), marks.path_m);
    let mut canvas = Canvas::new(WIDTH as usize, HEIGHT as usize);
    canvas.text([18.0, 26.0], Align::Left, title, TITLE_PX, INK);
    legend_row(&mut canvas, [18.0, 56.0], &marks.legend());
    canvas.fill(SCENE, GROUND);
    canvas.clipped(SCENE, |canvas| {
        draw_box(canvas, &camera);
        draw_points(canvas, &camera, &mut points, range, volume.voxel_m);
        marks.draw(canvas, |point| camera.at(point));
    });
    draw_labels(&mut canvas, &camera);
    let kept = kept_text(share, points.len());
    canvas.text([SCENE.right() - 12.0, SCENE.bottom() - 16.0], Align::Right, &kept, LABEL_PX, LETTERS);
    color_bar(&mut canvas, range, quantity);
    canvas.finish()
}

/// Description of the selection. If all voxels above 0 are drawn, no share is stated.
fn kept_text(share: f64, count: usize) -> String {
    match 100.0 * share.clamp(0.0, 1.0) {
        percent if percent >= 0.5 => format!("voxels above {percent:.0} % of the peak: {count}"),
        _ => format!("voxels: {count}"),
    }
}

/// The part of the volume's box that contains points or marks, with a margin; it starts at the
/// bottom of the box.
fn shown_region(volume: &Volume, points: &[(DVec3, f32)], marks: &Marks) -> Aabb {
    let whole = volume.region();
    let marked = marks.truth_m.iter().chain(marks.found_m).copied().filter(|&point| whole.contains(point));
    let Some(tight) = Aabb::around(points.iter().map(|point| point.0).chain(marked)) else { return whole };
    let air = 0.2 * tight.size().max_element().max(5.0 * volume.voxel_m);
    let min = (tight.min - air).max(whole.min);
    Aabb { min: DVec3::new(min.x, whole.min.y, min.z), max: (tight.max + air).min(whole.max) }
}

/// Parallel projection that fits a region into the scene's rectangle.
struct Camera {
    region: Aabb,
    right: DVec3,
    up: DVec3,
    /// Direction from the scene towards the eye.
    back: DVec3,
    px_per_m: f64,
    offset_px: [f64; 2],
}

impl Camera {
    fn new(region: Aabb, path_m: &[DVec3]) -> Self {
        let shown = drawable(&with_path(&region, path_m, 0.8));
        let region = drawable(&region);
        let (turn, lift) = (32f64.to_radians(), 24f64.to_radians());
        let back = DVec3::new(turn.sin() * lift.cos(), lift.sin(), turn.cos() * lift.cos());
        let right = DVec3::Y.cross(back).normalize();
        let up = back.cross(right);
        let corners = corners(&shown).into_iter().chain(corners(&region));
        let flat: Vec<[f64; 2]> = corners.map(|c| [right.dot(c), -up.dot(c)]).collect();
        let low = flat.iter().fold([f64::MAX; 2], |a, p| [a[0].min(p[0]), a[1].min(p[1])]);
        let high = flat.iter().fold([f64::MIN; 2], |a, p| [a[0].max(p[0]), a[1].max(p[1])]);
        let room = [SCENE.width - 130.0, SCENE.height - 110.0];
        let px_per_m = (room[0] / (high[0] - low[0])).min(room[1] / (high[1] - low[1]));
        let middle = [SCENE.center()[0] - 12.0, SCENE.center()[1] - 14.0];
        let offset_px = [0, 1].map(|n| middle[n] - 0.5 * (low[n] + high[n]) * px_per_m);
        Self { region, right, up, back, px_per_m, offset_px }
    }

    fn at(&self, point: DVec3) -> [f64; 2] {
        let flat = [self.right.dot(point), -self.up.dot(point)];
        [0, 1].map(|n| flat[n] * self.px_per_m + self.offset_px[n])
    }

    /// The point at the relative position `shares` within the box.
    fn corner(&self, shares: [f64; 3]) -> DVec3 {
        self.region.min + self.region.size() * DVec3::from_array(shares)
    }

    fn axis_ticks(&self, axis: usize) -> (Vec<f64>, f64) {
        let (low, high) = (self.region.min[axis], self.region.max[axis]);
        let ticks = ticks(low, high, ((high - low) * self.px_per_m / 70.0).clamp(2.0, 7.0) as usize);
        let step = ticks.windows(2).next().map_or(1.0, |pair| pair[1] - pair[0]);
        (ticks, step)
    }
}

fn corners(region: &Aabb) -> [DVec3; 8] {
    std::array::from_fn(|n| {
        let pick = |axis: usize| if n >> axis & 1 == 1 { region.max[axis] } else { region.min[axis] };
        DVec3::new(pick(0), pick(1), pick(2))
    })
}

/// Floor grid and box edges. The edges nearest to the eye are omitted, so that they do not cover
/// the points.
fn draw_box(canvas: &mut Canvas, camera: &Camera) {
    for axis in [0, 2] {
        for tick in camera.axis_ticks(axis).0 {
            let mut from = camera.corner([0.0, 0.0, 0.0]);
            let mut to = camera.corner([1.0, 0.0, 1.0]);
            from[axis] = tick;
            to[axis] = tick;
            canvas.line(camera.at(from), camera.at(to), 1.0, GROUND_GRID);
        }
    }
    const EDGES: [[[f64; 3]; 2]; 9] = [
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
        [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]],
        [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        [[1.0, 0.0, 0.0], [1.0, 0.0, 1.0]],
        [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        [[0.0, 0.0, 1.0], [0.0, 1.0, 1.0]],
        [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0]],
        [[0.0, 1.0, 0.0], [1.0, 1.0, 0.0]],
        [[0.0, 1.0, 0.0], [0.0, 1.0, 1.0]],
    ];
    for [from, to] in EDGES {
        canvas.line(camera.at(camera.corner(from)), camera.at(camera.corner(to)), 1.3, EDGE);
    }
}

fn draw_points(canvas: &mut Canvas, camera: &Camera, points: &mut [(DVec3, f32)], [low, high]: [f32; 2], voxel_m: f64) {
    let full = (0.75 * voxel_m * camera.px_per_m).clamp(1.5, 14.0);
    for &(point, _) in points.iter() {
        let floor = DVec3::new(point.x, camera.region.min.y, point.z);
        canvas.blend_disc(camera.at(floor), 0.8 * full, [0, 0, 0], 0.16);
    }
    points.sort_by(|a, b| camera.back.dot(a.0).total_cmp(&camera.back.dot(b.0)));
    for &(point, value) in points.iter() {
        let share = if high > low { ((value - low) / (high - low)) as f64 } else { 1.0 };
        let radius = full * (0.6 + 0.4 * share);
        let color = point_color(share);
        let [x, y] = camera.at(point);
        // Weak points are transparent, so that strong points behind them are visible.
        let alpha = 0.45 + 0.5 * share;
        canvas.blend_disc([x, y], radius, mix(color, [0, 0, 0], 0.45), alpha);
        canvas.blend_disc([x - 0.12 * radius, y - 0.12 * radius], 0.8 * radius, color, alpha);
    }
}

/// The darkest colours would not be visible on the dark background.
fn point_color(share: f64) -> Rgb {
    inferno(0.36 + 0.62 * share)
}

fn draw_labels(canvas: &mut Canvas, camera: &Camera) {
    // Each axis label is along an edge of the box's outline as seen by the eye.
    let axes: [(usize, [f64; 3], [f64; 2], &str); 3] = [
        (0, [0.5, 0.0, 1.0], [-0.35, 1.0], "right, x (m)"),
        (1, [1.0, 0.5, 0.0], [1.0, 0.0], "up, y (m)"),
        (2, [1.0, 0.0, 0.5], [0.8, 0.75], "z (m), ahead is −z"),
    ];
    for (axis, middle, [dx, dy], label) in axes {
        let (ticks, step) = camera.axis_ticks(axis);
        let align = if axis == 0 { Align::Right } else { Align::Left };
        for tick in ticks {
            let mut point = camera.corner(middle);
            point[axis] = tick;
            let [x, y] = camera.at(point);
            canvas.line([x, y], [x + 5.0 * dx, y + 5.0 * dy], 1.2, EDGE);
            canvas.text([x + 10.0 * dx, y + 14.0 * dy], align, &tick_text(tick, step), TICK_PX, LETTERS);
        }
        let [x, y] = camera.at(camera.corner(middle));
        if axis == 1 {
            canvas.text_upwards([x + 58.0, y], Align::Center, label, LABEL_PX, LETTERS);
        } else {
            let align = if axis == 0 { Align::Right } else { Align::Left };
            canvas.text([x + 38.0 * dx, y + 42.0 * dy], align, label, LABEL_PX, LETTERS);
        }
    }
}

fn value_range(points: &[(DVec3, f32)]) -> [f32; 2] {
    let low = points.iter().map(|p| p.1).fold(f32::INFINITY, f32::min);
    let high = points.iter().map(|p| p.1).fold(0.0, f32::max);
    [low.min(high), high]
}

fn color_bar(canvas: &mut Canvas, [low, high]: [f32; 2], quantity: &str) {
    let bar = Rect::new(SCENE.right() + 14.0, SCENE.y + 40.0, 14.0, SCENE.height - 80.0);
    canvas.paint(bar, |_, v| point_color(1.0 - v));
    canvas.outline(bar, 1.0, INK);
    canvas.text([bar.x - 2.0, bar.y - 14.0], Align::Left, &short_number(high as f64), TICK_PX, INK);
    canvas.text([bar.x - 2.0, bar.bottom() + 14.0], Align::Left, &short_number(low as f64), TICK_PX, INK);
    canvas.text_upwards([bar.right() + 18.0, bar.center()[1]], Align::Center, quantity, LABEL_PX, MUTED);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume() -> Volume {
        Volume { origin_m: DVec3::new(-0.2, 0.0, -0.4), voxel_m: 0.1, size: [4, 3, 4], values: vec![0.0; 48] }
    }

    #[test]
    fn points_above_share_are_selected() {
        let mut volume = volume();
        (volume.values[5], volume.values[6], volume.values[7]) = (10.0, 4.9, 5.0);
        volume.values[8] = f32::NAN;
        volume.values[9] = f32::INFINITY;
        let points = points_above(&volume, 0.5);
        assert_eq!(points, [(volume.center(volume.voxel(5)), 10.0), (volume.center(volume.voxel(7)), 5.0)]);
        assert!(points_above(&super::tests::volume(), 0.5).is_empty());
    }

    #[test]
    fn share_is_labelled_when_nonzero() {
        assert_eq!(kept_text(0.5, 12), "voxels above 50 % of the peak: 12");
        assert_eq!([0.0, 0.004, -1.0, f64::NAN].map(|share| kept_text(share, 7)), [(); 4].map(|()| "voxels: 7"));
    }

    #[test]
    fn degenerate_volumes_do_not_panic() {
        let nan = [DVec3::NAN, DVec3::ONE];
        let marks = Marks { truth_m: &nan, found_m: &nan, path_m: &nan };
        let mut bad = volume();
        bad.values.fill(f32::NAN);
        let empty = Volume { size: [0; 3], values: Vec::new(), ..volume() };
        let nowhere = Volume { origin_m: DVec3::NAN, ..volume() };
        let endless = Volume { voxel_m: f64::INFINITY, values: vec![1.0; 48], ..volume() };
        for volume in [volume(), bad, empty, nowhere, endless] {
            point_cloud(&volume, "t", "q", 0.5, &marks);
            point_cloud(&volume, "t", "q", f64::NAN, &Marks::default());
        }
    }

    #[test]
    fn projection_orders_depth_and_height() {
        let camera = Camera::new(volume().region(), &[]);
        let middle = camera.at(DVec3::ZERO);
        assert!(camera.at(DVec3::Z * 0.1)[1] > middle[1]);
        assert!(camera.at(DVec3::Y * 0.1)[1] < middle[1]);
        assert!(camera.at(DVec3::X * 0.1)[0] > middle[0]);
    }
}

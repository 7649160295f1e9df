//! The room from above: ground truth, detections with their uncertainty, the path of the head. x to
//! the right, −z up: forward is up.

use glam::{DMat2, DVec2, DVec3};

use radar_mapping::{Obstacle, Scene};
use radar_sar::geometry::{Aabb, Plane};
use radar_sar::truth::Truth;

use super::Picture;
use super::canvas::{Align, Canvas, Rect, text_width};
use super::marks::{Symbol, false_mark, legend_entry};
use super::plot::{BOTTOM_MARGIN, LEFT_MARGIN, Plot};
use super::score::{Limits, Verdict, verdict};
use super::style::{FALSE_INK, FOUND_INK, INK, LABEL_PX, MUTED, PATH_INK, Rgb, TICK_PX, TITLE_PX, short_number};
use super::views::drawable;

/// Heights and widths of title and legend, pixels. Choice: one title; the legend's longest line.
const TOP: f64 = 58.0;
const LEGEND_WIDTH: f64 = 290.0;

/// Content of the map.
#[derive(Debug, Clone, Copy)]
pub struct RoomMap<'a> {
    /// Title of the figure.
    pub title: &'a str,
    /// Detected scene.
    pub scene: &'a Scene,
    /// Ground truth, if known.
    pub truth: Option<&'a Truth>,
    /// Positions of the head in order of time, tracking frame, metres.
    pub path_m: &'a [DVec3],
    /// What is drawn of the room; `None`: all that is known of it.
    pub region: Option<Aabb>,
}

/// Draws the map.
pub fn room_map(map: &RoomMap) -> Picture {
    let region = map.region.unwrap_or_else(|| drawable(&region(map)));
    let size = region.size();
    let px_per_m = (800.0 / size.x).min(660.0 / size.z);
    let area = Rect::new(LEFT_MARGIN + 6.0, TOP, size.x * px_per_m, size.z * px_per_m);
    let plot = Plot::new(area, [region.min.x, region.max.x], [region.max.z, region.min.z]);
    let height = (area.bottom() + BOTTOM_MARGIN + 8.0).max(380.0);
    let width = area.right() + 24.0 + LEGEND_WIDTH;
    let mut canvas = Canvas::new(width as usize, height as usize);
    canvas.text([18.0, 26.0], Align::Left, map.title, TITLE_PX, INK);
    plot.grid(&mut canvas);
    canvas.clipped(area, |canvas| draw_room(canvas, &plot, map));
    plot.axes(&mut canvas, "", "x (m), to the right", "z (m), ahead (−z) is up");
    legend(&mut canvas, map, [area.right() + 24.0, TOP + 12.0]);
    canvas.finish()
}

fn draw_room(canvas: &mut Canvas, plot: &Plot, map: &RoomMap) {
    let at = |point: DVec3| plot.at([point.x, point.z]);
    draw_walls(canvas, plot, map);
    for found in &map.scene.obstacles {
        draw_uncertainty(canvas, plot, found, color_of(found, map));
    }
    let path: Vec<[f64; 2]> = map.path_m.iter().map(|&p| at(p)).collect();
    canvas.polyline(&path, 1.8, PATH_INK);
    if let Some(&start) = path.first() {
        canvas.disc(start, 5.5, PATH_INK);
    }
    let mut labels = Labels::new(plot.area);
    for obstacle in map.truth.iter().flat_map(|truth| &truth.obstacles) {
        for &point in &obstacle.points_m {
            canvas.disc(at(point), 3.6, MUTED);
            labels.keep_clear(at(point), 4.0);
        }
    }
    for found in &map.scene.obstacles {
        let center = at(found.position_m);
        if is_false(found, map) {
            false_mark(canvas, center, 8.0);
        } else {
            canvas.ring(center, 8.0, 2.4, FOUND_INK);
            canvas.disc(center, 2.0, FOUND_INK);
        }
        labels.keep_clear(center, 10.0);
    }
    for found in &map.scene.obstacles {
        let color = color_of(found, map);
        labels.write(canvas, at(found.position_m), 13.0, &short_number(found.evidence), LABEL_PX, color);
    }
    for obstacle in map.truth.iter().flat_map(|truth| &truth.obstacles) {
        if let Some(bounds) = Aabb::around(obstacle.points_m.iter().copied().filter(|p| p.is_finite())) {
            let [low, high] = [at(bounds.min), at(bounds.max)];
            let clearance = 0.5 * (high[1] - low[1]).abs() + 8.0;
            labels.write(canvas, at(bounds.center()), clearance, &obstacle.name, TICK_PX, MUTED);
        }
    }
}

fn draw_walls(canvas: &mut Canvas, plot: &Plot, map: &RoomMap) {
    for wall in map.truth.iter().flat_map(|truth| &truth.walls).filter(|wall| wall.plane.is_upright()) {
        let extent = Aabb { min: wall.extent.min - 0.01, max: wall.extent.max + 0.01 };
        if let Some(ends) = line_within(&wall.plane, &extent) {
            canvas.line(plot.at(ends[0].to_array()), plot.at(ends[1].to_array()), 6.0, MUTED);
        }
    }
    let shown = Aabb { min: DVec3::new(plot.x[0], 0.0, plot.y[1]), max: DVec3::new(plot.x[1], 0.0, plot.y[0]) };
    for wall in map.scene.walls.iter().filter(|wall| wall.plane.is_upright()) {
        if let Some(ends) = line_within(&wall.plane, &shown) {
            canvas.dashed(&ends.map(|end| plot.at(end.to_array())), 9.0, 2.4, FOUND_INK);
        }
    }
}

/// The 2σ ellipse of the covariance in x and z, and the box of the observed extent.
fn draw_uncertainty(canvas: &mut Canvas, plot: &Plot, found: &Obstacle, color: Rgb) {
    let c = found.covariance_m2;
    let flat = DMat2::from_cols(DVec2::new(c.x_axis.x, c.x_axis.z), DVec2::new(c.z_axis.x, c.z_axis.z));
    let center = DVec2::new(found.position_m.x, found.position_m.z);
    let ellipse: Vec<[f64; 2]> = ellipse(center, flat, 2.0).iter().map(|p| plot.at(p.to_array())).collect();
    canvas.convex(&ellipse, color, 0.18);
    let seen = Aabb::around(found.shape.iter().map(|voxel| voxel.0));
    let half = 0.5 * found.extent_m;
    let seen = seen.unwrap_or(Aabb { min: found.position_m - half, max: found.position_m + half });
    // The extent includes half a voxel around the outer voxel centres, so the box is centred on
    // their bounding box.
    let [a, b] = [seen.center() - half, seen.center() + half].map(|corner| plot.at([corner.x, corner.z]));
    if (b[0] - a[0]).abs() > 2.0 && (b[1] - a[1]).abs() > 2.0 {
        canvas.outline(Rect::new(a[0].min(b[0]), a[1].min(b[1]), (b[0] - a[0]).abs(), (b[1] - a[1]).abs()), 1.2, color);
    }
}

/// Points of the ellipse at `sigmas` standard deviations from the centre, clockwise on a screen
/// with y down. Empty if the matrix has a negative or non-finite variance.
fn ellipse(center: DVec2, covariance: DMat2, sigmas: f64) -> Vec<DVec2> {
    let (a, b, d) = (covariance.x_axis.x, 0.5 * (covariance.x_axis.y + covariance.y_axis.x), covariance.y_axis.y);
    let (mean, half) = (0.5 * (a + d), (0.5 * (a - d)).hypot(b));
    let (large, small) = (mean + half, mean - half);
    if !(large.is_finite() && large > 0.0 && small > -1e-9 * large) {
        return Vec::new();
    }
    let angle = 0.5 * (2.0 * b).atan2(a - d);
    let (major, minor) =
        (DVec2::from_angle(angle) * large.sqrt(), DVec2::from_angle(angle).perp() * small.max(0.0).sqrt());
    let turn = |n: usize| n as f64 * std::f64::consts::TAU / 64.0;
    (0..64).map(|n| center + sigmas * (major * turn(n).cos() + minor * turn(n).sin())).collect()
}

/// The end points of a vertical plane's line (x, z) within a box; `None` if it misses the box.
fn line_within(plane: &Plane, region: &Aabb) -> Option<[DVec2; 2]> {
    let normal = DVec2::new(plane.outward.x, plane.outward.z);
    let offset = plane.offset_m - plane.outward.y * region.center().y;
    let middle = normal * offset / normal.length_squared();
    let along = normal.perp().try_normalize()?;
    let (low, high) = (DVec2::new(region.min.x, region.min.z), DVec2::new(region.max.x, region.max.z));
    let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in 0..2 {
        if along[axis].abs() < 1e-12 {
            if !(low[axis]..=high[axis]).contains(&middle[axis]) {
                return None;
            }
            continue;
        }
        let (a, b) = ((low[axis] - middle[axis]) / along[axis], (high[axis] - middle[axis]) / along[axis]);
        from = from.max(a.min(b));
        to = to.min(a.max(b));
    }
    (from < to && from.is_finite() && to.is_finite()).then(|| [middle + along * from, middle + along * to])
}

fn is_false(found: &Obstacle, map: &RoomMap) -> bool {
    map.truth.is_some_and(|truth| verdict(found, truth, &Limits::default()) == Verdict::False)
}

fn color_of(found: &Obstacle, map: &RoomMap) -> Rgb {
    if is_false(found, map) { FALSE_INK } else { FOUND_INK }
}

/// Bounding box of everything with a position, with a margin.
pub(super) fn region(map: &RoomMap) -> Aabb {
    let truth = map.truth.iter();
    let walls = truth.clone().flat_map(|truth| &truth.walls).flat_map(|wall| [wall.extent.min, wall.extent.max]);
    let points = truth.flat_map(|truth| &truth.obstacles).flat_map(|obstacle| obstacle.points_m.iter().copied());
    let found = map.scene.obstacles.iter().map(|found| found.position_m);
    let all = walls.chain(points).chain(found).chain(map.path_m.iter().copied());
    let tight = Aabb::around(all.filter(|point| point.is_finite()));
    let tight = tight.unwrap_or(Aabb { min: DVec3::splat(-1.0), max: DVec3::splat(1.0) });
    let margin = 0.35;
    let half = (0.5 * tight.size() + margin).max(DVec3::splat(0.25 * tight.size().max_element()));
    Aabb { min: tight.center() - half, max: tight.center() + half }
}

fn legend(canvas: &mut Canvas, map: &RoomMap, [x, mut y]: [f64; 2]) {
    let scene = map.scene;
    let truth = map.truth.is_some();
    let entries = [
        (truth, Symbol::Wall, "wall, truth"),
        (truth, Symbol::TruthInk, "scatterers, truth"),
        (!scene.walls.is_empty(), Symbol::FoundWall, "wall, found"),
        (true, Symbol::FoundInk, "obstacle, found, with its evidence"),
        (true, Symbol::Ellipse, "its place, 2σ"),
        (true, Symbol::Extent, "its extent as seen"),
        (truth, Symbol::FalseInk, "found, but nothing there"),
        (!map.path_m.is_empty(), Symbol::PathInk, "head's path, from the dot"),
    ];
    for (_, symbol, text) in entries.into_iter().filter(|entry| entry.0) {
        legend_entry(canvas, [x, y], symbol, text);
        y += 30.0;
    }
    let wrong = scene.obstacles.iter().filter(|found| is_false(found, map)).count();
    let mut counts = vec![format!("{} reported", scene.obstacles.len())];
    if let Some(truth) = map.truth {
        counts.push(format!("{wrong} of nothing"));
        let count = truth.obstacles.len();
        counts.push(format!("{count} object{} in the room", if count == 1 { "" } else { "s" }));
    }
    for line in counts {
        canvas.text([x, y + 12.0], Align::Left, &line, LABEL_PX, MUTED);
        y += 24.0;
    }
}

/// Places labels beside their marks with the least overlap.
struct Labels {
    area: Rect,
    taken: Vec<Rect>,
}

impl Labels {
    fn new(area: Rect) -> Self {
        Self { area, taken: Vec::new() }
    }

    fn keep_clear(&mut self, [x, y]: [f64; 2], radius: f64) {
        self.taken.push(Rect::new(x - radius, y - radius, 2.0 * radius, 2.0 * radius));
    }

    fn write(&mut self, canvas: &mut Canvas, [x, y]: [f64; 2], away: f64, text: &str, height: f64, color: Rgb) {
        let (width, high) = (text_width(text, height), 0.9 * height);
        let side = away + 0.5 * width;
        let over = away + 0.5 * high;
        let spots = [
            [0.0, 0.0],
            [side, 0.0],
            [-side, 0.0],
            [0.0, -over],
            [0.0, over],
            [side, -over],
            [-side, -over],
            [side, over],
            [-side, over],
            [0.0, -over - high],
            [0.0, over + high],
        ];
        let boxes = spots.map(|[dx, dy]| Rect::new(x + dx - 0.5 * width, y + dy - 0.5 * high, width, high));
        let cost = |spot: &Rect| {
            let covered: f64 = self.taken.iter().map(|other| spot.shared_area(other)).sum();
            covered + 3.0 * (spot.width * spot.height - spot.shared_area(&self.area))
        };
        let Some(best) = boxes.into_iter().min_by(|a, b| cost(a).total_cmp(&cost(b))) else { return };
        canvas.text_rimmed(best.center(), Align::Center, text, height, color, [255, 255, 255]);
        self.taken.push(best);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;
    use proptest::prelude::*;
    use radar_mapping::{Observed, Wall};
    use radar_sar::truth::{TruthObstacle, TruthWall};

    fn found(position_m: DVec3, covariance_m2: DMat3) -> Obstacle {
        Obstacle {
            id: 1,
            position_m,
            covariance_m2,
            observed: Observed::RangeOnly,
            extent_m: DVec3::splat(0.3),
            evidence: 12.0,
            shape: Vec::new(),
            provisional: false,
            first_seen_ns: 0,
            last_seen_ns: 0,
        }
    }

    #[test]
    fn empty_and_invalid_scenes_do_not_panic() {
        let nan = DVec3::NAN;
        let wall = Wall {
            id: 0,
            plane: Plane { outward: nan, offset_m: f64::NAN },
            evidence: f64::NAN,
            seen_at: Aabb { min: nan, max: nan },
            provisional: false,
            first_seen_ns: 0,
            last_seen_ns: 0,
        };
        let bad = Scene {
            obstacles: vec![found(nan, DMat3::NAN), found(DVec3::ONE, -DMat3::IDENTITY), found(DVec3::X, DMat3::ZERO)],
            walls: vec![wall.clone(), Wall { plane: Plane { outward: DVec3::ZERO, offset_m: 0.0 }, ..wall.clone() }],
            ..Scene::default()
        };
        let truth = Truth {
            obstacles: vec![TruthObstacle {
                name: "?".into(),
                points_m: vec![nan],
                rcs_dbsm: Vec::new(),
                closest_approach_m: 0.0,
                in_beam_s: 0.0,
            }],
            walls: vec![TruthWall { name: "?".into(), plane: wall.plane, extent: wall.seen_at }],
            ..Truth::default()
        };
        for scene in [&Scene::default(), &bad] {
            room_map(&RoomMap { title: "", scene, truth: None, path_m: &[], region: None });
            room_map(&RoomMap {
                title: "",
                scene,
                truth: Some(&truth),
                path_m: &[nan, DVec3::ZERO, nan],
                region: None,
            });
        }
        room_map(&RoomMap {
            title: "",
            scene: &bad,
            truth: None,
            path_m: &[DVec3::splat(1e300), DVec3::ZERO],
            region: None,
        });
    }

    #[test]
    fn line_is_clipped_to_the_box() {
        let region = Aabb { min: DVec3::new(-2.0, 0.0, -3.0), max: DVec3::new(2.0, 2.0, 3.0) };
        let wall = Plane { outward: DVec3::NEG_Z, offset_m: 2.5 };
        let [a, b] = line_within(&wall, &region).unwrap();
        assert!((a.x.abs() - 2.0).abs() < 1e-12 && (a.y + 2.5).abs() < 1e-12 && (a.x + b.x).abs() < 1e-12);
        assert!(line_within(&Plane { outward: DVec3::X, offset_m: 2.1 }, &region).is_none());
    }

    proptest! {
        #[test]
        fn ellipse_points_are_at_two_sigma(a in 0.1..1.0f64, d in 0.1..1.0f64, r in -0.9..0.9f64) {
            let b = r * (a * d).sqrt();
            let covariance = DMat2::from_cols(DVec2::new(a, b), DVec2::new(b, d));
            for point in ellipse(DVec2::ZERO, covariance, 2.0) {
                prop_assert!((point.dot(covariance.inverse() * point) - 4.0).abs() < 1e-6);
            }
        }
    }
}

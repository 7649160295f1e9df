//! Draws one moment in 3D: floor, walls, obstacles, evidence, the head with its path and beam,
//! warnings, ground truth.

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::drawing::{Color, Drawing, circle};
use super::history::Moment;
use super::layers::Layers;
use super::recording_info::RecordingInfo;
use super::style::{self, rgba};
use crate::warning::{Panel, PanelKind, Warnings, warn};
use radar_mapping::{Evidence, MovingTarget, Observed, Obstacle, Wall};
use radar_sar::eigen;
use radar_sar::geometry::{Aabb, Plane, Pose};

/// The path is bright for this time, seconds. Choice: the mapper's window: the path that the newest
/// detections come from.
const RECENT_S: f64 = 4.0;
/// Walls extend this far beyond where they were observed, metres. Choice: walls that meet in a
/// corner do so in the picture.
const WALL_MARGIN_M: f64 = 0.4;
/// Upper edge of walls with unknown height, metres. Choice: as high as the headset's warnings of
/// walls.
const WALL_HEIGHT_M: f64 = 2.2;
/// Number of colour steps of the evidence. Choice: a few colours are easier to distinguish, and as
/// many as the colour map has visibly different ones.
const SHADES: f64 = 12.0;
/// Uncertainty is drawn at this many standard deviations, with limits of the radius, metres.
/// Choice: 95 % of a normal error along an axis; the radius stays visible and inside the room.
const SIGMAS: f64 = 2.0;
const MAX_RADIUS_M: f64 = 0.7;
const MIN_RADIUS_M: f64 = 0.008;
/// Share of its colour for an object from the saved map that was not detected again yet. Choice:
/// clearly fainter, still visible.
const RESTORED_ALPHA: f32 = 0.4;

/// Draws a moment. `bounds`: the displayed box. `top_score`: the end of the evidence colour scale.
/// `inside`: first-person view.
pub fn room(
    about: &RecordingInfo,
    moment: &Moment,
    layers: &Layers,
    bounds: &Aabb,
    top_score: f32,
    inside: bool,
) -> Drawing {
    let mut drawing = Drawing::default();
    floor(&mut drawing, bounds);
    if layers.walls {
        moment.scene.walls.iter().for_each(|seen| wall(&mut drawing, seen, bounds));
    }
    if layers.truth {
        truth(&mut drawing, about);
    }
    if layers.evidence {
        evidence(&mut drawing, &moment.evidence, layers.min_score, top_score);
    }
    if layers.obstacles {
        for found in &moment.scene.obstacles {
            obstacle(&mut drawing, found, layers.selected == Some(found.id));
        }
    }
    if layers.moving {
        moment.scene.moving.iter().for_each(|one| moving(&mut drawing, one));
    }
    let Some(head) = &moment.head else { return drawing };
    // In the first-person view, head, path and beam would block the view.
    if !inside {
        if layers.path {
            path(&mut drawing, moment);
        }
        headset(&mut drawing, head);
        if layers.beam {
            beam(&mut drawing, &(*head * about.head_from_sensor), about);
        }
    }
    if layers.warnings {
        warnings(&mut drawing, &warn(&moment.scene, head, &about.warning), about.warning.color, bounds.min.y);
    }
    drawing
}

fn floor(drawing: &mut Drawing, bounds: &Aabb) {
    let y = bounds.min.y;
    let low = (bounds.min / 0.5).floor().as_ivec3();
    let high = (bounds.max / 0.5).ceil().as_ivec3();
    let color = |n: i32| rgba(if n % 2 == 0 { style::GRID_METRE } else { style::GRID }, 1.0);
    for n in low.x..=high.x {
        let at = |z: i32| DVec3::new(f64::from(n) * 0.5, y, f64::from(z) * 0.5);
        drawing.line(at(low.z), at(high.z), 1.0, color(n));
    }
    for n in low.z..=high.z {
        let at = |x: i32| DVec3::new(f64::from(x) * 0.5, y, f64::from(n) * 0.5);
        drawing.line(at(low.x), at(high.x), 1.0, color(n));
    }
    let origin = DVec3::ZERO.with_y(y);
    for axis in DVec3::AXES {
        drawing.line(origin, origin + axis * 0.5, 2.5, rgba(style::MUTED, 1.0));
    }
}

/// End points of the axes with their names.
pub fn axis_names(bounds: &Aabb) -> [(DVec3, &'static str); 3] {
    let origin = DVec3::ZERO.with_y(bounds.min.y);
    [(origin + DVec3::X * 0.58, "x"), (origin + DVec3::Y * 0.58, "y"), (origin + DVec3::Z * 0.58, "z")]
}

fn wall(drawing: &mut Drawing, wall: &Wall, bounds: &Aabb) {
    let Plane { outward, .. } = wall.plane;
    let seen = &wall.seen_at;
    let is_level = wall.plane.is_level();
    let u = if is_level { DVec3::X } else { DVec3::Y.cross(outward).normalize_or(DVec3::X) };
    let v = if is_level { DVec3::Z } else { DVec3::Y };
    let middle = wall.plane.foot(seen.center());
    // Half the size of the observed box along a direction.
    let reach = |along: DVec3| (along.abs() * (seen.size() * 0.5)).element_sum();
    let on_wall = |a: f64, b: f64| wall.plane.foot(middle + u * a + v * b);
    let patch = |u_m: f64, v_m: [f64; 2]| {
        [on_wall(-u_m, v_m[0]), on_wall(u_m, v_m[0]), on_wall(u_m, v_m[1]), on_wall(-u_m, v_m[1])]
    };
    let u_m = reach(u) + WALL_MARGIN_M;
    let upright = [bounds.min.y - middle.y, (bounds.max.y.min(bounds.min.y + WALL_HEIGHT_M) - middle.y).max(0.3)];
    let v_m = if is_level { [-reach(v) - WALL_MARGIN_M, reach(v) + WALL_MARGIN_M] } else { upright };
    let corners = patch(u_m, v_m);
    let color = |alpha: f32| rgba(style::WALL, if wall.provisional { RESTORED_ALPHA * alpha } else { alpha });
    drawing.transparent_polygon(&corners, color(0.10));
    drawing.polyline(corners.into_iter().chain([corners[0]]), 1.5, color(0.8));
    // The area that reflected.
    drawing.transparent_polygon(&patch(reach(u) + 0.1, [-reach(v) - 0.1, reach(v) + 0.1]), color(0.22));
}

fn truth(drawing: &mut Drawing, about: &RecordingInfo) {
    let Some(truth) = &about.truth else { return };
    let color = rgba(style::TRUTH, 1.0);
    for point in truth.obstacles.iter().flat_map(|obstacle| &obstacle.points_m) {
        drawing.point(*point, 0.022, color);
    }
    for wall in &truth.walls {
        drawing.box_edges(&Pose::IDENTITY, &wall.extent, 1.0, rgba(style::TRUTH, 0.45));
    }
}

fn evidence(drawing: &mut Drawing, evidence: &Evidence, least: f32, top: f32) {
    for &(point, score) in evidence.voxels.iter().filter(|voxel| voxel.1 >= least) {
        let share = f64::from(((score - least) / (top - least).max(1e-6)).clamp(0.0, 1.0));
        // A few discrete colours are easier to distinguish.
        let color = rgba(style::evidence((share * SHADES).round() / SHADES), 1.0);
        drawing.point(point.as_dvec3(), evidence.voxel_m * (0.10 + 0.22 * share), color);
    }
}

fn obstacle(drawing: &mut Drawing, obstacle: &Obstacle, is_selected: bool) {
    let color = rgba(style::FOUND, if obstacle.provisional { RESTORED_ALPHA } else { 1.0 });
    if let Some(shape) = obstacle.around() {
        drawing.box_edges(&Pose::IDENTITY, &shape, if is_selected { 3.0 } else { 1.6 }, color);
    }
    drawing.point(obstacle.position_m, 0.022, color);
    drawing.transparent_ball(obstacle.position_m, &uncertainty(obstacle), color);
}

/// The part of the range sphere on which the target may be, the wedge in which it was observed, and
/// an arrow of its radial motion within one second.
fn moving(drawing: &mut Drawing, moving: &MovingTarget) {
    /// Corners of a quarter turn; half as many rings. Choice: it looks round.
    const PARTS: i32 = 8;
    let color = |alpha: f32| rgba(style::MOVING, alpha);
    let half_rad = moving.half_width_rad();
    // Round, like the beam.
    let at = |share: f64, turn: f64| {
        let (sin, cos) = turn.sin_cos();
        moving.place_m(half_rad * share * cos, half_rad * share * sin)
    };
    let turn = |n: i32| f64::from(n) / f64::from(4 * PARTS) * std::f64::consts::TAU;
    for (ring, n) in (0..PARTS / 2).flat_map(|ring| (0..4 * PARTS).map(move |n| (ring, n))) {
        let share = |ring: i32| f64::from(2 * ring) / f64::from(PARTS);
        let (inner, outer) = (share(ring), share(ring + 1));
        let corners = [at(inner, turn(n)), at(outer, turn(n)), at(outer, turn(n + 1)), at(inner, turn(n + 1))];
        // The most likely part is the brightest.
        drawing.transparent_polygon(&corners, color(0.30 - 0.24 * outer as f32));
    }
    drawing.polyline((0..=4 * PARTS).map(|n| at(1.0, turn(n))), 1.5, color(0.8));
    drawing.polyline(moving.arc_m(), 3.0, color(1.0));
    let from = moving.seen_from.translation;
    [-half_rad, half_rad].into_iter().for_each(|edge| drawing.line(from, moving.place_m(edge, 0.0), 1.0, color(0.5)));
    let (position, way) = (moving.position_m(), moving.seen_from.forward() * moving.speed_m_per_s);
    drawing.point(position, 0.03, color(1.0));
    drawing.line(position, position + way, 2.5, color(1.0));
}

/// Half axes of the 2σ ellipsoid, as columns.
fn uncertainty(obstacle: &Obstacle) -> DMat3 {
    if !obstacle.covariance_m2.is_finite() {
        return DMat3::from_diagonal(DVec3::splat(MAX_RADIUS_M));
    }
    let (variances, axes) = eigen(&obstacle.covariance_m2);
    let radius = |variance: f64| match variance.is_finite() {
        true => (SIGMAS * variance.max(0.0).sqrt()).clamp(MIN_RADIUS_M, MAX_RADIUS_M),
        false => MAX_RADIUS_M,
    };
    DMat3::from_cols(
        axes.x_axis * radius(variances[0]),
        axes.y_axis * radius(variances[1]),
        axes.z_axis * radius(variances[2]),
    )
}

/// Text of its label.
pub fn label(obstacle: &Obstacle, head: Option<&Pose>) -> String {
    let distance = head.map_or(String::new(), |head| format!("  {:.2} m", obstacle.distance_m(head.translation)));
    let doubt = match obstacle.observed {
        Observed::Position => "",
        Observed::RangeAndOneDirection => "  (one direction unknown)",
        Observed::RangeOnly => "  (direction unknown)",
    };
    let since = if obstacle.provisional { "  (remembered)" } else { "" };
    format!("#{}{distance}{doubt}{since}", obstacle.id)
}

fn path(drawing: &mut Drawing, moment: &Moment) {
    for pair in moment.path.windows(2) {
        let age_s = moment.time_s - pair[1].0;
        // A gap in the poses is not part of the path.
        if pair[1].1.distance(pair[0].1) < 0.5 {
            let alpha = if age_s < RECENT_S { 1.0 - 0.7 * age_s / RECENT_S } else { 0.3 };
            drawing.line(pair[0].1, pair[1].1, 2.0, rgba(style::HEAD, alpha as f32));
        }
    }
}

/// A head with a headset: the front is dark.
fn headset(drawing: &mut Drawing, tracking_from_head: &Pose) {
    let turn = DMat3::from_quat(tracking_from_head.rotation);
    let skull = tracking_from_head.transform_point(DVec3::new(0.0, 0.005, 0.095));
    drawing.solid_ball(skull, &(turn * DMat3::from_diagonal(DVec3::new(0.078, 0.105, 0.098))), rgba(style::TRUTH, 1.0));
    let aabb = |low: [f64; 3], high: [f64; 3]| Aabb { min: low.into(), max: high.into() };
    let shell = [0.86, 0.88, 0.91, 1.0];
    drawing.solid_box(tracking_from_head, &aabb([-0.09, -0.05, -0.06], [0.09, 0.05, 0.03]), shell);
    drawing.solid_box(
        tracking_from_head,
        &aabb([-0.082, -0.042, -0.066], [0.082, 0.042, -0.06]),
        [0.1, 0.12, 0.15, 1.0],
    );
    drawing.solid_box(tracking_from_head, &aabb([-0.096, -0.014, 0.0], [-0.074, 0.02, 0.16]), shell);
    drawing.solid_box(tracking_from_head, &aabb([0.074, -0.014, 0.0], [0.096, 0.02, 0.16]), shell);
    let ahead = tracking_from_head.transform_point(DVec3::NEG_Z * 0.3);
    drawing.line(tracking_from_head.transform_point(DVec3::NEG_Z * 0.07), ahead, 2.0, rgba(style::HEAD, 1.0));
}

/// The cone up to the cut-off angle, from the first to the last range.
fn beam(drawing: &mut Drawing, tracking_from_sensor: &Pose, about: &RecordingInfo) {
    let (sin, cos) = about.beam_rad.sin_cos();
    let rim = |range_m: f64, turn: f64| {
        let aside = DQuat::from_rotation_z(turn) * DVec3::X * sin;
        tracking_from_sensor.transform_point((aside + DVec3::NEG_Z * cos) * range_m)
    };
    let [first_m, last_m] = about.ranges_m;
    let color = |alpha: f32| rgba(style::BEAM, alpha);
    let turns: Vec<f64> = (0..=32).map(|n| f64::from(n) / 32.0 * std::f64::consts::TAU).collect();
    for range_m in [first_m, last_m] {
        drawing.polyline(turns.iter().map(|turn| rim(range_m, *turn)), 1.5, color(0.8));
    }
    for pair in turns.windows(2) {
        let corners = [rim(first_m, pair[0]), rim(last_m, pair[0]), rim(last_m, pair[1]), rim(first_m, pair[1])];
        drawing.transparent_polygon(&corners, color(0.06));
    }
    for turn in turns.iter().step_by(8).take(4) {
        drawing.line(rim(first_m, *turn), rim(last_m, *turn), 1.0, color(0.55));
        // Arc on the sphere of the last range, through the boresight.
        let arc = (0..=12).map(|n| {
            let (s, c) = (about.beam_rad * f64::from(n) / 12.0).sin_cos();
            let aside = DQuat::from_rotation_z(*turn) * DVec3::X * s;
            tracking_from_sensor.transform_point((aside + DVec3::NEG_Z * c) * last_m)
        });
        drawing.polyline(arc, 1.0, color(0.35));
    }
}

fn warnings(drawing: &mut Drawing, warnings: &Warnings, color: [u8; 3], floor_m: f64) {
    let [r, g, b] = color.map(|v| f32::from(v) / 255.0);
    let color = |alpha: f32| -> Color { [r, g, b, alpha] };
    for shown in &warnings.panels {
        panel(drawing, shown, color);
    }
    for footprint in &warnings.footprints {
        let corners = footprint.corners_xz_m.iter().map(|c| DVec3::new(c.x, floor_m.max(0.0) + 0.004, c.y));
        let corners: Vec<DVec3> = corners.collect();
        drawing.transparent_polygon(&corners, color(0.25 * footprint.alpha));
        drawing.polyline(corners.iter().copied().chain(corners.first().copied()), 1.5, color(footprint.alpha));
    }
}

/// A panel with its grid, as on its texture.
fn panel(drawing: &mut Drawing, panel: &Panel, color: impl Fn(f32) -> Color) {
    let half = panel.size_m / 2.0;
    let at = |x: f64, y: f64| panel.tracking_from_panel.transform_point(DVec3::new(x, y, 0.0));
    let alpha = panel.alpha;
    let step_m = 0.2;
    let lines = |half_m: f64| {
        let most = (half_m / step_m).floor().clamp(0.0, 100.0) as i32;
        (-most..=most).map(move |n| f64::from(n) * step_m)
    };
    lines(half.x).for_each(|x| drawing.line(at(x, -half.y), at(x, half.y), 1.0, color(0.5 * alpha)));
    lines(half.y).for_each(|y| drawing.line(at(-half.x, y), at(half.x, y), 1.0, color(0.5 * alpha)));
    let corners = [at(-half.x, -half.y), at(half.x, -half.y), at(half.x, half.y), at(-half.x, half.y)];
    drawing.polyline(corners.into_iter().chain([corners[0]]), 2.0, color(alpha));
    drawing.transparent_polygon(&corners, color(0.05 * alpha));
    if panel.kind == PanelKind::Object {
        for (middle, radius) in &*panel.silhouette {
            let disc = |point: DVec2| at(point.x, point.y);
            let (u, v) = (
                disc(*middle + DVec2::X * *radius) - disc(*middle),
                disc(*middle + DVec2::Y * *radius) - disc(*middle),
            );
            let rim: Vec<DVec3> = circle(disc(*middle), u, v, 12).collect();
            drawing.transparent_polygon(&rim, color(0.22 * alpha));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;
    use a121::preset;
    use radar_mapping::MapperKind;
    use radar_mapping::Scene;
    use radar_recording::Header;
    use std::sync::Arc;

    fn about() -> RecordingInfo {
        let header = Header::new("test", preset("d16").unwrap(), Pose::IDENTITY);
        RecordingInfo::new(&header, &Settings::default(), MapperKind::Rooms, 1.0)
    }

    fn obstacle(covariance_m2: DMat3) -> Obstacle {
        Obstacle {
            id: 7,
            position_m: DVec3::new(0.0, 1.0, -1.0),
            covariance_m2,
            observed: Observed::Position,
            extent_m: DVec3::splat(0.15),
            evidence: 9.0,
            shape: vec![(DVec3::new(0.0, 1.0, -0.95), 5.0), (DVec3::new(0.0, 1.1, -0.95), 5.0)],
            provisional: false,
            first_seen_ns: 0,
            last_seen_ns: 0,
        }
    }

    fn moving_target() -> MovingTarget {
        MovingTarget {
            id: 1,
            seen_from: Pose::from_translation(DVec3::new(0.0, 1.1, 0.0)),
            range_m: 1.5,
            range_sigma_m: 0.1,
            direction_sigma_rad: 0.3,
            speed_m_per_s: -0.8,
            evidence: 20.0,
            first_seen_ns: 0,
            last_seen_ns: 0,
        }
    }

    fn moment(head: Option<Pose>) -> Moment {
        let wall = Wall {
            id: 1,
            plane: Plane { outward: DVec3::NEG_Z, offset_m: 2.0 },
            evidence: 9.0,
            seen_at: Aabb { min: DVec3::new(-0.5, 1.5, -2.0), max: DVec3::new(0.5, 1.7, -2.0) },
            provisional: false,
            first_seen_ns: 0,
            last_seen_ns: 0,
        };
        let variances = DMat3::from_diagonal(DVec3::new(1e-4, 4e-4, 9e-4));
        let scene = Scene {
            time_ns: 0,
            obstacles: vec![obstacle(variances)],
            walls: vec![wall],
            moving: vec![moving_target()],
        };
        Moment {
            time_s: 1.0,
            scene: Arc::new(scene),
            evidence: Arc::new(Evidence { voxel_m: 0.05, voxels: vec![(glam::Vec3::Y, 2.5), (glam::Vec3::X, 8.0)] }),
            head,
            path: vec![(0.0, DVec3::Y), (0.5, DVec3::Y * 1.1), (1.0, DVec3::Y * 9.0)],
            health: None,
        }
    }

    fn head() -> Pose {
        Pose::from_translation(DVec3::new(0.0, 1.1, 0.0))
    }

    #[test]
    fn layers_can_be_switched_off() {
        let (about, bounds) = (about(), about().bounds([head().translation]));
        let all = Layers { truth: true, ..Layers::new(2.0) };
        let draw = |layers: &Layers| room(&about, &moment(Some(head())), layers, &bounds, 9.0, false);
        let count = |d: &Drawing| d.faces.len() + d.lines.len() + d.points.len() + d.transparent_faces.len();
        let full = count(&draw(&all));
        let off: [fn(&mut Layers); 7] = [
            |l| l.obstacles = false,
            |l| l.moving = false,
            |l| l.walls = false,
            |l| l.evidence = false,
            |l| l.beam = false,
            |l| l.path = false,
            |l| l.warnings = false,
        ];
        for (n, change) in off.iter().enumerate() {
            let mut layers = all.clone();
            change(&mut layers);
            assert!(count(&draw(&layers)) < full, "layer {n}");
        }
    }

    #[test]
    fn weak_evidence_and_path_jumps_are_not_drawn() {
        let (about, bounds) = (about(), about().bounds([]));
        let layers =
            Layers { obstacles: false, moving: false, walls: false, warnings: false, beam: false, ..Layers::new(3.0) };
        let drawing = room(&about, &moment(Some(head())), &layers, &bounds, 9.0, false);
        assert_eq!(drawing.points.len(), 1);
        let up = drawing.lines.iter().filter(|l| l.from_m == DVec3::Y || l.to_m == DVec3::Y * 9.0).count();
        assert_eq!(up, 1);
        let inside = room(&about, &moment(Some(head())), &layers, &bounds, 9.0, true);
        assert!(inside.faces.is_empty(), "one does not see one's own head");
        assert_eq!(inside.lines.len() + 1, drawing.lines.len() - 1, "nor one's path, nor where one looks");
        let without_head = room(&about, &moment(None), &Layers::new(3.0), &bounds, 9.0, false);
        assert!(without_head.faces.is_empty() && !without_head.lines.is_empty());
    }

    #[test]
    fn ellipsoids_are_two_sigma_and_distances_to_nearest_point() {
        let axes = uncertainty(&obstacle(DMat3::from_diagonal(DVec3::new(1e-4, 4e-4, 100.0))));
        let mut radii = [axes.x_axis, axes.y_axis, axes.z_axis].map(|axis| axis.length());
        radii.sort_by(f64::total_cmp);
        assert!((radii[0] - 0.02).abs() < 1e-9 && (radii[1] - 0.04).abs() < 1e-9 && radii[2] == MAX_RADIUS_M);
        assert!(uncertainty(&obstacle(DMat3::NAN)).is_finite());
        let found = obstacle(DMat3::ZERO);
        assert!((found.distance_m(head().translation) - 0.95).abs() < 1e-9);
        assert_eq!(label(&found, Some(&head())), "#7  0.95 m");
        let kept = Obstacle { provisional: true, ..found.clone() };
        assert_eq!(label(&kept, None), "#7  (remembered)");
        let alpha = |found: &Obstacle| {
            let mut drawing = Drawing::default();
            super::obstacle(&mut drawing, found, false);
            drawing.lines[0].color[3]
        };
        assert!(alpha(&kept) < alpha(&found));
        let shape = found.around().unwrap();
        assert!((shape.size() - DVec3::splat(0.15)).length() < 1e-9);
    }

    #[test]
    fn moving_targets_are_drawn_at_their_range() {
        let mut drawing = Drawing::default();
        moving(&mut drawing, &moving_target());
        let from = moving_target().seen_from.translation;
        assert!(
            drawing
                .transparent_faces
                .iter()
                .flat_map(|face| face.corners_m)
                .all(|at| (at.distance(from) - 1.5).abs() < 1e-9)
        );
        let colors = |color: Color| [color[0], color[1], color[2]];
        let all =
            drawing.transparent_faces.iter().map(|face| face.color).chain(drawing.lines.iter().map(|line| line.color));
        let own = colors(rgba(style::MOVING, 1.0));
        assert!(all.map(colors).all(|color| color == own) && own != colors(rgba(style::FOUND, 1.0)));
        // An arrow towards the sensor.
        let arrow = drawing.lines.last().unwrap();
        assert!((arrow.to_m.distance(from) - 0.7).abs() < 1e-9);
        let mut nowhere = Drawing::default();
        moving(&mut nowhere, &MovingTarget { range_m: f64::NAN, ..moving_target() });
        assert_eq!(nowhere, Drawing::default());
    }

    #[test]
    fn wall_is_drawn_on_its_plane() {
        let (about, bounds) = (about(), about().bounds([]));
        let layers = Layers { obstacles: false, moving: false, evidence: false, warnings: false, ..Layers::new(3.0) };
        let drawing = room(&about, &moment(None), &layers, &bounds, 9.0, false);
        assert!(
            drawing
                .transparent_faces
                .iter()
                .flat_map(|face| face.corners_m)
                .all(|corner| (corner.z + 2.0).abs() < 1e-9)
        );
        assert_eq!(drawing.transparent_faces.len(), 4);
    }
}

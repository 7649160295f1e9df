//! Obstacles, walls, moving targets and the beam as entities of a Foxglove scene. An entity keeps
//! its name as long as its obstacle or wall exists. Each update holds all current entities and
//! deletes those that no longer exist.

use foxglove::messages::line_primitive::Type as LineType;
use foxglove::messages::scene_entity_deletion::Type as Deletion;
use foxglove::messages::{
    Color, CubePrimitive, KeyValuePair, LinePrimitive, Point3, SceneEntity, SceneEntityDeletion, SceneUpdate,
    SpherePrimitive, TextPrimitive, TriangleListPrimitive,
};
use glam::DVec3;

use super::super::foxglove_messages::{SENSOR, TRACKING, foxglove_pose, timestamp, vector};
use super::beam::BeamCone;
use super::outlines::{BEAM, MOVING, OBSTACLE, UNCERTAINTY, WALL};
use super::shapes::{edges, moving_lines, uncertainty, wall_patch};
use super::snapshot::Snapshot;
use radar_mapping::{MovingTarget, Observed, Obstacle, Wall};
use radar_sar::geometry::Pose;

/// Limit of the drawn cells of an obstacle (the strongest), and of drawn obstacles, walls and
/// moving targets each. Choice: keeps a snapshot of a cluttered room at some hundred kilobytes;
/// twice what a map file keeps of a shape.
const MAX_CELLS: usize = 96;
const MAX_ENTITIES: usize = 200;
/// Height of a label's letters, and of the label above its box, metres. Choice: readable with a
/// whole room in view, smaller than a chair's seat.
const LABEL_HEIGHT_M: f64 = 0.08;

/// All current entities, and deletions of those in `before` that no longer exist; stores the
/// current names in `before`.
pub fn scene_update(snapshot: &Snapshot, before: &mut Vec<String>) -> SceneUpdate {
    let obstacles =
        snapshot.scene.obstacles.iter().take(MAX_ENTITIES).map(|obstacle| obstacle_entity(snapshot, obstacle));
    let walls = snapshot.scene.walls.iter().take(MAX_ENTITIES).map(|wall| wall_entity(snapshot, wall));
    let moving = snapshot.scene.moving.iter().take(MAX_ENTITIES).map(|moving| moving_entity(snapshot, moving));
    let entities: Vec<SceneEntity> = obstacles.chain(walls).chain(moving).collect();
    let names = entities.iter().map(|entity| entity.id.clone()).collect();
    let gone = std::mem::replace(before, names).into_iter().filter(|name| !before.contains(name));
    let deletion = |id: String| SceneEntityDeletion {
        timestamp: Some(timestamp(snapshot.time_ns)),
        r#type: Deletion::MatchingId.into(),
        id,
    };
    SceneUpdate { deletions: gone.map(deletion).collect(), entities }
}

/// The beam as an entity in the sensor's frame.
pub fn beam_update(time_ns: i64, beam: &BeamCone) -> SceneUpdate {
    let lines = beam.lines().into_iter().map(|corners| polyline(&corners, color(BEAM, 0.8)));
    let facts = [
        ("cut_off_deg", format!("{:.2}", beam.cut_off_rad.to_degrees())),
        ("first_range_m", format!("{:.3}", beam.ranges_m[0])),
        ("last_range_m", format!("{:.3}", beam.ranges_m[1])),
    ];
    let entity = SceneEntity {
        frame_id: SENSOR.to_owned(),
        frame_locked: true,
        lines: lines.collect(),
        ..entity(time_ns, "beam".into(), &facts)
    };
    SceneUpdate { deletions: Vec::new(), entities: vec![entity] }
}

/// Text of an obstacle's label.
fn label(obstacle: &Obstacle, head: Option<Pose>) -> String {
    let distance = head.map_or(String::new(), |head| format!("  {:.2} m", obstacle.distance_m(head.translation)));
    let doubt = match obstacle.observed {
        Observed::Position => "",
        Observed::RangeAndOneDirection => "  (one direction unknown)",
        Observed::RangeOnly => "  (direction unknown)",
    };
    format!("#{}{distance}{doubt}", obstacle.id)
}

fn obstacle_entity(snapshot: &Snapshot, obstacle: &Obstacle) -> SceneEntity {
    let observed = match obstacle.observed {
        Observed::Position => "position",
        Observed::RangeAndOneDirection => "range and one direction",
        Observed::RangeOnly => "range only",
    };
    let spread = obstacle.covariance_m2.diagonal().max(DVec3::ZERO);
    let facts = [
        ("observed", observed.to_owned()),
        ("evidence", obstacle.evidence.to_string()),
        ("standard_deviation_m", format!("{:.4} {:.4} {:.4}", spread.x.sqrt(), spread.y.sqrt(), spread.z.sqrt())),
        ("first_seen_ns", obstacle.first_seen_ns.to_string()),
        ("last_seen_ns", obstacle.last_seen_ns.to_string()),
    ];
    let around = obstacle.around();
    let top_m = around.map_or(obstacle.position_m.y, |around| around.max.y);
    let (pose, radii_m) = uncertainty(obstacle);
    let text = TextPrimitive {
        pose: Some(foxglove_pose(&Pose::from_translation(obstacle.position_m.with_y(top_m + LABEL_HEIGHT_M)))),
        billboard: true,
        font_size: LABEL_HEIGHT_M,
        scale_invariant: false,
        color: Some(color([255, 255, 255, 255], 1.0)),
        text: label(obstacle, snapshot.head),
    };
    let sphere = SpherePrimitive {
        pose: Some(foxglove_pose(&pose)),
        size: Some(vector(radii_m * 2.0)),
        color: Some(color(UNCERTAINTY, 0.5)),
    };
    SceneEntity {
        cubes: cells(obstacle),
        spheres: vec![sphere],
        lines: around.iter().map(|around| line_list(&edges(around).concat(), color(OBSTACLE, 1.0))).collect(),
        texts: vec![text],
        ..entity(snapshot.time_ns, format!("obstacle {}", obstacle.id), &facts)
    }
}

/// Edge of the cube for an obstacle without extent, metres. Choice: the coarse field's voxel.
const POINT_CUBE_M: f64 = 0.05;

/// The strongest cells of its shape; stronger cells are more opaque.
fn cells(obstacle: &Obstacle) -> Vec<CubePrimitive> {
    let mut shape: Vec<&(DVec3, f32)> = obstacle.shape.iter().collect();
    shape.sort_by(|a, b| b.1.total_cmp(&a.1));
    let strongest = shape.first().map_or(1.0, |voxel| voxel.1.max(f32::MIN_POSITIVE));
    // A single reflector is a point without extent.
    let edge_m = Some(obstacle.cell_m()).filter(|edge_m| *edge_m > 0.0).unwrap_or(POINT_CUBE_M);
    let cube = |&&(position, score): &&(DVec3, f32)| CubePrimitive {
        pose: Some(foxglove_pose(&Pose::from_translation(position))),
        size: Some(vector(DVec3::splat(edge_m))),
        color: Some(color(OBSTACLE, f64::from(0.15 + 0.55 * (score / strongest).clamp(0.0, 1.0)))),
    };
    shape.iter().take(MAX_CELLS).map(cube).collect()
}

fn wall_entity(snapshot: &Snapshot, wall: &Wall) -> SceneEntity {
    let outward = wall.plane.outward;
    let facts = [
        ("outward", format!("{:.4} {:.4} {:.4}", outward.x, outward.y, outward.z)),
        ("offset_m", wall.plane.offset_m.to_string()),
        ("evidence", wall.evidence.to_string()),
        ("first_seen_ns", wall.first_seen_ns.to_string()),
        ("last_seen_ns", wall.last_seen_ns.to_string()),
    ];
    let [a, b, c, d] = wall_patch(wall);
    let triangles = TriangleListPrimitive {
        pose: Some(foxglove_pose(&Pose::IDENTITY)),
        // Both sides, so that it is visible from inside and outside.
        points: [a, b, c, a, c, d, c, b, a, d, c, a].map(point).to_vec(),
        color: Some(color(WALL, 0.25)),
        ..Default::default()
    };
    SceneEntity {
        triangles: vec![triangles],
        lines: vec![polyline(&[a, b, c, d, a], color(WALL, 0.9))],
        ..entity(snapshot.time_ns, format!("wall {}", wall.id), &facts)
    }
}

fn moving_entity(snapshot: &Snapshot, moving: &MovingTarget) -> SceneEntity {
    let facts = [
        ("range_m", format!("{:.3}", moving.range_m)),
        ("range_standard_deviation_m", format!("{:.3}", moving.range_sigma_m)),
        ("direction_standard_deviation_deg", format!("{:.1}", moving.direction_sigma_rad.to_degrees())),
        ("own_speed_away_m_per_s", format!("{:.2}", moving.speed_m_per_s)),
        ("evidence", moving.evidence.to_string()),
        ("first_seen_ns", moving.first_seen_ns.to_string()),
        ("last_seen_ns", moving.last_seen_ns.to_string()),
    ];
    let text = TextPrimitive {
        pose: Some(foxglove_pose(&Pose::from_translation(moving.position_m() + DVec3::Y * LABEL_HEIGHT_M))),
        billboard: true,
        font_size: LABEL_HEIGHT_M,
        scale_invariant: false,
        color: Some(color([255, 255, 255, 255], 1.0)),
        text: moving.label(snapshot.head.as_ref()),
    };
    let wedge = moving_lines(moving).into_iter().map(|corners| polyline(&corners, color(MOVING, 1.0)));
    SceneEntity {
        lines: wedge.collect(),
        texts: vec![text],
        ..entity(snapshot.time_ns, format!("moving {}", moving.id), &facts)
    }
}

fn entity(time_ns: i64, id: String, facts: &[(&str, String)]) -> SceneEntity {
    let pair = |(key, value): &(&str, String)| KeyValuePair { key: (*key).to_owned(), value: value.clone() };
    SceneEntity {
        timestamp: Some(timestamp(time_ns)),
        frame_id: TRACKING.to_owned(),
        id,
        metadata: facts.iter().map(pair).collect(),
        ..Default::default()
    }
}

fn polyline(corners: &[DVec3], color: Color) -> LinePrimitive {
    lines(LineType::LineStrip, corners, color)
}

fn line_list(ends: &[DVec3], color: Color) -> LinePrimitive {
    lines(LineType::LineList, ends, color)
}

fn lines(kind: LineType, positions: &[DVec3], color: Color) -> LinePrimitive {
    LinePrimitive {
        r#type: kind.into(),
        pose: Some(foxglove_pose(&Pose::IDENTITY)),
        thickness: 2.0,
        scale_invariant: true,
        points: positions.iter().copied().map(point).collect(),
        color: Some(color),
        ..Default::default()
    }
}

fn point(p: DVec3) -> Point3 {
    Point3 { x: p.x, y: p.y, z: p.z }
}

fn color([r, g, b, _]: [u8; 4], alpha: f64) -> Color {
    let share = |c: u8| f64::from(c) / 255.0;
    Color { r: share(r), g: share(g), b: share(b), a: alpha }
}

//! Poses and results in the Foxglove schemas, so that Foxglove and Rerun show a recording as it is.

use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::scene_entity_deletion::Type as Deletion;
use foxglove::messages::{
    Color, CubePrimitive, FrameTransform, KeyValuePair, PackedElementField, PointCloud, Pose as FoxglovePose,
    PoseInFrame, Quaternion, SceneEntity, SceneEntityDeletion, SceneUpdate, Timestamp, Vector3,
};
use glam::{DQuat, DVec3};

use crate::geometry::{Aabb, Pose};
use crate::obstacles::{Observed, Obstacle, Scene, Wall};

/// Frames as they are called in Foxglove.
const TRACKING: &str = "tracking";
const HEAD: &str = "head";
const SENSOR: &str = "sensor";
/// A box thinner than this would not be seen, metres.
const LEAST_EDGE_M: f64 = 0.02;
const OBSTACLE_COLOR: Color = Color { r: 1.0, g: 0.55, b: 0.1, a: 0.6 };
const WALL_COLOR: Color = Color { r: 0.3, g: 0.6, b: 1.0, a: 0.35 };
/// x, y, z, evidence as f32.
const POINT_BYTES: u32 = 16;

/// Where the head is.
pub(super) fn head_transform(time_ns: i64, tracking_from_head: &Pose) -> FrameTransform {
    transform(time_ns, TRACKING, HEAD, tracking_from_head)
}

/// Where the sensor sits on the head.
pub(super) fn mount_transform(time_ns: i64, head_from_sensor: &Pose) -> FrameTransform {
    transform(time_ns, HEAD, SENSOR, head_from_sensor)
}

/// Where a hand is; how it is turned is not recorded.
pub(super) fn hand_pose(time_ns: i64, place_m: DVec3) -> PoseInFrame {
    PoseInFrame {
        timestamp: Some(timestamp(time_ns)),
        frame_id: TRACKING.to_owned(),
        pose: Some(foxglove_pose(&Pose::from_translation(place_m))),
    }
}

/// Obstacles and walls as boxes; each update replaces the one before.
pub(super) fn scene_update(scene: &Scene) -> SceneUpdate {
    let obstacles = scene.obstacles.iter().map(|o| obstacle_entity(scene.time_ns, o));
    let walls = scene.walls.iter().map(|w| wall_entity(scene.time_ns, w));
    let all = SceneEntityDeletion {
        timestamp: Some(timestamp(scene.time_ns)),
        r#type: Deletion::All.into(),
        id: String::new(),
    };
    SceneUpdate { deletions: vec![all], entities: obstacles.chain(walls).collect() }
}

/// The places with evidence of all obstacles; an obstacle without any is its own place. Rerun shows these, not the boxes.
pub(super) fn evidence_points(scene: &Scene) -> PointCloud {
    let places = scene.obstacles.iter().flat_map(|obstacle| {
        let alone = obstacle.shape.is_empty().then_some((obstacle.position_m, obstacle.evidence as f32));
        obstacle.shape.iter().copied().chain(alone)
    });
    let numbers = places.flat_map(|(place, score)| {
        let [x, y, z] = place.as_vec3().to_array();
        [x, y, z, score]
    });
    let field = |(index, name): (u32, &str)| PackedElementField {
        name: name.to_owned(),
        offset: index * 4,
        r#type: NumericType::Float32.into(),
    };
    PointCloud {
        timestamp: Some(timestamp(scene.time_ns)),
        frame_id: TRACKING.to_owned(),
        pose: Some(foxglove_pose(&Pose::IDENTITY)),
        point_stride: POINT_BYTES,
        fields: (0..).zip(["x", "y", "z", "evidence"]).map(field).collect(),
        data: numbers.flat_map(f32::to_le_bytes).collect(),
    }
}

fn obstacle_entity(time_ns: i64, obstacle: &Obstacle) -> SceneEntity {
    let observed = match obstacle.observed {
        Observed::Position => "position",
        Observed::RangeAndOneDirection => "range and one direction",
        Observed::RangeOnly => "range only",
    };
    let spread = obstacle.covariance_m2.diagonal();
    let facts = [
        ("observed", observed.to_owned()),
        ("evidence", obstacle.evidence.to_string()),
        ("provisional", obstacle.provisional.to_string()),
        ("standard_deviation_m", format!("{:.4} {:.4} {:.4}", spread.x.sqrt(), spread.y.sqrt(), spread.z.sqrt())),
        ("first_seen_ns", obstacle.first_seen_ns.to_string()),
        ("last_seen_ns", obstacle.last_seen_ns.to_string()),
    ];
    let around = Aabb { min: -obstacle.extent_m / 2.0, max: obstacle.extent_m / 2.0 };
    let cube = cube(obstacle.position_m, around.size(), OBSTACLE_COLOR);
    entity(time_ns, format!("obstacle {}", obstacle.id), &facts, cube)
}

fn wall_entity(time_ns: i64, wall: &Wall) -> SceneEntity {
    let facts = [
        ("outward", wall.plane.outward.to_string()),
        ("offset_m", wall.plane.offset_m.to_string()),
        ("evidence", wall.evidence.to_string()),
    ];
    let cube = cube(wall.seen_at.center(), wall.seen_at.size(), WALL_COLOR);
    entity(time_ns, format!("wall {}", wall.id), &facts, cube)
}

fn entity(time_ns: i64, id: String, facts: &[(&str, String)], cube: CubePrimitive) -> SceneEntity {
    let pair = |(key, value): &(&str, String)| KeyValuePair { key: (*key).to_owned(), value: value.clone() };
    SceneEntity {
        timestamp: Some(timestamp(time_ns)),
        frame_id: TRACKING.to_owned(),
        id,
        metadata: facts.iter().map(pair).collect(),
        cubes: vec![cube],
        ..Default::default()
    }
}

fn cube(center_m: DVec3, size_m: DVec3, color: Color) -> CubePrimitive {
    CubePrimitive {
        pose: Some(foxglove_pose(&Pose::from_translation(center_m))),
        size: Some(vector(size_m.max(DVec3::splat(LEAST_EDGE_M)))),
        color: Some(color),
    }
}

fn transform(time_ns: i64, parent: &str, child: &str, parent_from_child: &Pose) -> FrameTransform {
    FrameTransform {
        timestamp: Some(timestamp(time_ns)),
        parent_frame_id: parent.to_owned(),
        child_frame_id: child.to_owned(),
        translation: Some(vector(parent_from_child.translation)),
        rotation: Some(quaternion(parent_from_child.rotation)),
    }
}

fn foxglove_pose(pose: &Pose) -> FoxglovePose {
    FoxglovePose { position: Some(vector(pose.translation)), orientation: Some(quaternion(pose.rotation)) }
}

fn vector(v: DVec3) -> Vector3 {
    Vector3 { x: v.x, y: v.y, z: v.z }
}

fn quaternion(q: DQuat) -> Quaternion {
    Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }
}

/// Foxglove's times begin at 0; earlier ones stay there, later ones than its 32-bit seconds at their end.
fn timestamp(time_ns: i64) -> Timestamp {
    let time_ns = time_ns.max(0);
    match u32::try_from(time_ns / 1_000_000_000) {
        Ok(seconds) => Timestamp::new(seconds, (time_ns % 1_000_000_000) as u32),
        Err(_) => Timestamp::MAX,
    }
}

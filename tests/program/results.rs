//! A recording with results, read back with the published schemas: every topic holds what
//! `docs/results-format.md` says.

use std::collections::{BTreeMap, BTreeSet};

use foxglove::messages::scene_entity_deletion::Type as Deletion;
use foxglove::messages::{FrameTransform, Log, PointCloud, Quaternion, SceneEntity, SceneUpdate};
use prost::Message;
use radar_recording::results_messages as wire;

use crate::common::Folder;

/// Messages by topic, time and bytes in the order of the file, and the topics' schemas.
struct File {
    messages: BTreeMap<String, Vec<(u64, Vec<u8>)>>,
    schemas: BTreeMap<String, String>,
}

impl File {
    fn read(bytes: &[u8]) -> Self {
        let (mut messages, mut schemas) = (BTreeMap::<String, Vec<_>>::new(), BTreeMap::new());
        for message in mcap::MessageStream::new(bytes).unwrap() {
            let message = message.unwrap();
            let schema = message.channel.schema.as_ref().expect("every topic has a schema").name.clone();
            assert_eq!(message.channel.message_encoding, "protobuf");
            schemas.insert(message.channel.topic.clone(), schema);
            messages.entry(message.channel.topic.clone()).or_default().push((message.log_time, message.data.to_vec()));
        }
        Self { messages, schemas }
    }

    fn all<M: Message + Default>(&self, topic: &str) -> Vec<(u64, M)> {
        let messages = self.messages.get(topic).unwrap_or_else(|| panic!("no {topic}"));
        messages.iter().map(|(time, bytes)| (*time, M::decode(bytes.as_slice()).unwrap())).collect()
    }
}

/// The furnished room for some seconds, with results.
fn furnished(folder: &Folder) -> File {
    folder.run("simulate furnished-room --duration-s 8 --out room.mcap").succeeds();
    folder.run("replay room.mcap --results results.mcap").succeeds();
    File::read(&folder.read("results.mcap"))
}

fn assert_turn(q: &Quaternion) {
    let length = (q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w).sqrt();
    assert!((length - 1.0).abs() < 1e-9, "{q:?}");
}

/// Checks that every point is finite and in the room; returns the number of points.
fn assert_cloud(topic: &str, cloud: &PointCloud) -> usize {
    assert_eq!(cloud.frame_id, if topic == "/beam/outline" { "sensor" } else { "tracking" });
    let stride = cloud.point_stride as usize;
    assert_eq!(cloud.data.len() % stride, 0, "{topic}");
    for point in cloud.data.chunks(stride) {
        for field in &cloud.fields[..4] {
            let value = f32::from_le_bytes(point[field.offset as usize..][..4].try_into().unwrap());
            assert!(value.is_finite() && (field.name == "value" || value.abs() < 100.0), "{topic} {}", field.name);
        }
    }
    cloud.data.len() / stride
}

fn assert_entity(entity: &SceneEntity, frame: &str) {
    assert_eq!(entity.frame_id, frame);
    let cubes = entity.cubes.iter().map(|cube| (cube.pose.unwrap(), cube.size.unwrap()));
    let spheres = entity.spheres.iter().map(|sphere| (sphere.pose.unwrap(), sphere.size.unwrap()));
    for (pose, size) in cubes.chain(spheres) {
        assert_turn(&pose.orientation.unwrap());
        assert!(size.x > 0.0 && size.y > 0.0 && size.z > 0.0, "{}: {size:?}", entity.id);
    }
    let lines = entity.lines.iter().flat_map(|line| &line.points);
    let corners = entity.triangles.iter().flat_map(|list| &list.points);
    assert!(lines.chain(corners).all(|p| p.x.is_finite() && p.y.is_finite() && p.z.is_finite()), "{}", entity.id);
}

#[test]
fn results_recording_has_every_documented_topic() {
    let folder = Folder::new("results");
    let file = furnished(&folder);
    let schemas = [
        ("/beam", "foxglove.SceneUpdate"),
        ("/beam/outline", "foxglove.PointCloud"),
        ("/evidence", "foxglove.PointCloud"),
        ("/figures", "radar_chaperone.results.Figures"),
        ("/log", "foxglove.Log"),
        ("/radar/frame", "radar_chaperone.Frame"),
        ("/room", "foxglove.FrameTransform"),
        ("/scene", "foxglove.SceneUpdate"),
        ("/scene/outlines", "foxglove.PointCloud"),
        ("/scene/points", "foxglove.PointCloud"),
        ("/tracking/head", "foxglove.FrameTransform"),
        ("/tracking/head_raw", "radar_chaperone.TrackedPose"),
        ("/tracking/mount", "foxglove.FrameTransform"),
    ];
    for (topic, schema) in schemas {
        assert_eq!(file.schemas.get(topic).map(String::as_str), Some(schema), "{topic}");
    }
    for (topic, messages) in &file.messages {
        assert!(messages.windows(2).all(|pair| pair[0].0 <= pair[1].0), "{topic}: times decrease");
    }
    let mut parents = BTreeMap::new();
    for topic in ["/room", "/tracking/head", "/tracking/mount"] {
        for (_, transform) in file.all::<FrameTransform>(topic) {
            assert_turn(&transform.rotation.unwrap());
            parents.insert(transform.child_frame_id, transform.parent_frame_id);
        }
    }
    let chain = [("head", "tracking"), ("sensor", "head"), ("tracking", "room")];
    assert!(parents.iter().map(|(child, parent)| (child.as_str(), parent.as_str())).eq(chain));
    for (topic, least, most) in [
        ("/beam/outline", 100, 12_000),
        ("/evidence", 100, 2000),
        ("/scene/points", 10, 6000),
        ("/scene/outlines", 100, 12_000),
    ] {
        let clouds = file.all::<PointCloud>(topic);
        let greatest = clouds.iter().map(|(_, cloud)| assert_cloud(topic, cloud)).max().unwrap();
        assert!((least..=most).contains(&greatest), "{topic}: {greatest} points");
    }
    // A file with results is also a recording: its replay gives the same again.
    let again = folder.run("replay results.mcap --results again.mcap").succeeds();
    assert_eq!(again.out, folder.run("replay room.mcap").succeeds().out);
    assert!(folder.read("again.mcap") == folder.read("results.mcap"), "the same results from the same recording");
}

#[test]
fn scene_figures_and_log_agree() {
    let folder = Folder::new("results_agree");
    let file = furnished(&folder);
    let (updates, figures) = (file.all::<SceneUpdate>("/scene"), file.all::<wire::Figures>("/figures"));
    assert!(updates.len() >= 20 && updates.len() == figures.len(), "{} updates", updates.len());
    let mut standing = BTreeSet::new();
    let mut ever = BTreeSet::new();
    for ((time, update), (figures_time, figures)) in updates.iter().zip(&figures) {
        assert_eq!(time, figures_time);
        for deletion in &update.deletions {
            assert_eq!(deletion.r#type, i32::from(Deletion::MatchingId));
            assert!(standing.remove(&deletion.id), "{} was never in the scene", deletion.id);
        }
        let names: BTreeSet<String> = update.entities.iter().map(|entity| entity.id.clone()).collect();
        assert_eq!(names.len(), update.entities.len(), "duplicate name");
        standing.extend(names.iter().cloned());
        assert_eq!(standing, names, "removed objects must be deleted");
        ever.extend(names);
        update.entities.iter().for_each(|entity| assert_entity(entity, "tracking"));
        let obstacles = standing.iter().filter(|name| name.starts_with("obstacle ")).count();
        assert_eq!([figures.obstacles, figures.walls], [obstacles, standing.len() - obstacles].map(|n| n as f64));
        let nearest = figures.nearest_obstacle_m.min(figures.nearest_wall_m);
        assert!(figures.nearest_m == nearest || (figures.nearest_m.is_nan() && standing.is_empty()));
        assert!(figures.evidence_age_ms.is_nan() || (0.0..2000.0).contains(&figures.evidence_age_ms));
    }
    assert!(ever.len() >= 3, "found {ever:?}");
    let last = &figures.last().unwrap().1;
    assert!(last.sweeps > 7000.0 && last.nearest_m < 3.0, "{last:?}");
    let rates: Vec<f64> = figures.iter().map(|(_, f)| f.sweeps_per_s).filter(|rate| rate.is_finite()).collect();
    let usual = {
        let mut sorted = rates.clone();
        sorted.sort_by(f64::total_cmp);
        sorted[sorted.len() / 2]
    };
    assert!((900.0..1200.0).contains(&usual), "{rates:?}");
    let log: Vec<String> = file.all::<Log>("/log").into_iter().map(|(_, line)| line.message).collect();
    let logged: BTreeSet<String> =
        log.iter().filter_map(|line| line.split_once(" found ")).map(|(name, _)| name.to_owned()).collect();
    assert_eq!(logged, ever, "{log:#?}");
    let beam = file.all::<SceneUpdate>("/beam");
    assert_eq!(beam.len(), 1);
    assert_entity(&beam[0].1.entities[0], "sensor");
    assert!(beam[0].1.entities[0].frame_locked);
}

#[test]
fn single_reflectors_are_written_at_the_end() {
    let folder = Folder::new("results_reflector");
    folder.run("simulate corner-reflector --motion sphere-10cm --duration-s 2 --out reflector.mcap").succeeds();
    folder.run("replay reflector.mcap --results results.mcap").succeeds();
    let file = File::read(&folder.read("results.mcap"));
    let scenes = file.all::<SceneUpdate>("/scene");
    assert_eq!((scenes.len(), scenes[0].1.entities.len()), (1, 1));
    assert!(file.all::<PointCloud>("/evidence").iter().all(|(_, cloud)| assert_cloud("/evidence", cloud) > 0));
}

#[test]
fn recording_without_images_gives_empty_results() {
    let folder = Folder::new("results_nothing");
    folder.run("simulate nothing --duration-s 2 --out nothing.mcap").succeeds();
    folder.run("replay nothing.mcap --results results.mcap").succeeds();
    let file = File::read(&folder.read("results.mcap"));
    let figures = file.all::<wire::Figures>("/figures");
    assert!(figures.iter().all(|(_, f)| f.obstacles == 0.0 && f.nearest_obstacle_m.is_nan()), "{figures:?}");
    assert!(file.all::<SceneUpdate>("/scene").iter().all(|(_, update)| update.deletions.is_empty()));
}

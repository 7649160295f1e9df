//! Saved maps: restored unchanged, confirmed where the object is still present, removed where it is
//! not; and hands in a recording.

use a121::preset;
use glam::{DMat3, DVec3};
use radar_mapping::Event;
use radar_mapping::Mapper;
use radar_mapping::MappingSettings;
use radar_mapping::{HandsSample, SavedMap, SavedPoint, Scene};
use radar_recording::{Existing, Header, Recording, RecordingWriter};
use radar_simulation::{Scenario, Simulated};

fn room(duration_s: f64) -> (Scenario, Simulated) {
    let scenario = Scenario::new("furnished-room", "approach-chair", preset("d16").unwrap(), duration_s, 1);
    let simulated = scenario.run().unwrap();
    (scenario, simulated)
}

fn mapper(scenario: &Scenario) -> Mapper {
    Mapper::new(&scenario.config, &scenario.head_from_sensor, &MappingSettings::default())
}

/// Frames and poses by time.
fn events(simulated: &Simulated) -> Vec<Event> {
    let frames = simulated.frames.iter().map(|frame| Event::Frame(frame.clone()));
    let mut events: Vec<Event> = frames.chain(simulated.poses.iter().map(|pose| Event::Pose(*pose))).collect();
    events.sort_by_key(Event::time_ns);
    events
}

fn feed(mut mapper: Mapper, events: impl IntoIterator<Item = Event>) -> Mapper {
    mapper.push_all(events);
    mapper
}

#[test]
fn present_objects_are_confirmed_under_their_id_and_absent_ones_removed() {
    let (scenario, simulated) = room(7.0);
    let known = feed(mapper(&scenario), events(&simulated)).saved_map();
    assert!(known.places.len() >= 3 && !known.walls.is_empty(), "{known:?}");
    let text = serde_json::to_string(&known).unwrap();
    assert_eq!(serde_json::from_str::<SavedMap>(&text).unwrap(), known, "must be bit-identical");

    // A saved object that is gone, in free space a metre ahead of the player's first position.
    let first = simulated.poses[0].tracking_from_head().unwrap();
    let mut with_more = known.clone();
    let mut gone = known.places[0].clone();
    gone.id = 900;
    gone.position_m = first.translation + first.forward() * 1.0;
    gone.shape = vec![(gone.position_m, 9.0)];
    gone.strengths = gone.strengths.map(|_| known.places[0].strengths.into_iter().fold(0.0, f64::max));
    assert!(known.places.iter().all(|point| point.position_m.distance(gone.position_m) > 0.4));
    let gone_m = gone.position_m;
    with_more.places.push(gone);

    let begin = || {
        let mut mapper = mapper(&scenario);
        mapper.restore(&with_more).unwrap();
        mapper
    };
    let at_once = begin().scene();
    assert!(
        at_once.obstacles.iter().all(|obstacle| obstacle.provisional)
            && at_once.walls.iter().all(|wall| wall.provisional)
    );
    assert!(
        at_once.obstacles.iter().any(|obstacle| obstacle.position_m.distance(gone_m) < 0.05),
        "restored objects must be in the scene at once"
    );
    assert_eq!(at_once.walls.len(), known.walls.len());
    assert_eq!(begin().saved_map(), with_more, "unobserved objects must be kept unchanged");

    let after = feed(begin(), events(&simulated));
    let (scene, left) = (after.scene(), after.saved_map());
    assert!(left.places.iter().all(|point| point.id != 900), "observed and absent: must be removed");
    let chair = simulated.truth.obstacles.iter().find(|obstacle| obstacle.name == "chair").unwrap();
    let at_chair = |at: DVec3| chair.points_m.iter().any(|point| point.distance(at) < 0.2);
    let is_known = |id: u64| known.places.iter().any(|point| point.id == id && at_chair(point.position_m));
    let confirmed = scene.obstacles.iter().find(|obstacle| !obstacle.provisional && is_known(obstacle.id));
    assert!(confirmed.is_some_and(|obstacle| at_chair(obstacle.position_m)), "{:?}", summary(&scene));
    assert!(scene.walls.iter().any(|wall| !wall.provisional && known.walls.iter().any(|was| was.id == wall.id)));
    assert_eq!(feed(begin(), events(&simulated)).scene(), scene, "must be repeatable");
}

fn summary(scene: &Scene) -> Vec<(u64, DVec3, bool)> {
    scene.obstacles.iter().map(|obstacle| (obstacle.id, obstacle.position_m, obstacle.provisional)).collect()
}

#[test]
fn recorded_hands_equal_pushed_hands() {
    let (scenario, simulated) = room(5.0);
    let plain = events(&simulated);
    // A hand on the chair all the time: no new detection is accepted there.
    let chair = simulated.truth.obstacles.iter().find(|obstacle| obstacle.name == "chair").unwrap();
    let hands_m = [None, Some(chair.points_m[0])];
    let hands = simulated.poses.iter().map(|pose| HandsSample { time_ns: pose.time_ns, hands_m }).step_by(3);
    let mut with_hands: Vec<Event> = plain.iter().cloned().chain(hands.map(Event::Hands)).collect();
    with_hands.sort_by_key(Event::time_ns);

    let path = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("hands.mcap");
    let header = Header::new("test", scenario.config.clone(), scenario.head_from_sensor);
    let mut writer = RecordingWriter::create(&path, &header, Existing::Replace).unwrap();
    with_hands.iter().for_each(|event| writer.write(event).unwrap());
    let summary = writer.finish().unwrap();
    assert_eq!(summary.hands_tracked, [0, summary.hands.count]);

    let pushed = feed(mapper(&scenario), with_hands).scene();
    let replayed = feed(mapper(&scenario), Recording::open(&path).unwrap()).scene();
    assert_eq!(replayed, pushed);
    assert_ne!(feed(mapper(&scenario), plain).scene(), pushed, "hands change what is found");
}

#[test]
fn full_map_keeps_every_point_and_as_many_cells_as_a_frame_has_time_for() {
    // Every 20 cm, as shapes of 48 cells of 4 cm.
    let point = |n: u32| {
        let position_m =
            DVec3::new((n % 20).into(), (n / 400).into(), (n / 20 % 20).into()) * 0.2 - DVec3::new(2.0, 0.0, 2.0);
        let cell = |i: u32| position_m + DVec3::new((i % 4).into(), (i / 16).into(), (i / 4 % 4).into()) * 0.04;
        SavedPoint {
            id: u64::from(n) + 1,
            position_m,
            covariance_m2: DMat3::IDENTITY * 1e-4,
            score: 8.0,
            strengths: [40.0; 16],
            shape: (0..48).map(|i| (cell(i), 8.0 - i as f32 * 0.01)).collect(),
            first_ns: 5,
            last_ns: 7,
        }
    };
    let cells_of = |count: u32| {
        let (scenario, _) = room(0.1);
        let map = SavedMap { places: (0..count).map(point).collect(), walls: vec![] };
        let mut mapper = mapper(&scenario);
        mapper.restore(&map).unwrap();
        let saved = mapper.saved_map();
        assert_eq!(saved.places.len(), map.places.len());
        let is_there = |point: &SavedPoint| point.shape.iter().any(|cell| cell.0.distance(point.position_m) < 1e-9);
        assert!(saved.places.iter().all(is_there), "the strongest cell of each");
        saved.places.iter().map(|point| point.shape.len()).sum::<usize>()
    };
    assert_eq!(cells_of(100), 4800, "a room's shapes are whole");
    assert_eq!(cells_of(2000), 8000);
}

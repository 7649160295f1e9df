//! The reconstruction thread: it gives the mapper's scene, its queues are bounded, it can be
//! reset, and it ends.

use radar_mapping::{Event, MountInUse, in_time_order};
use std::time::{Duration, Instant};

use a121::preset;
use radar_chaperone::app::{Reconstruction, ReconstructionOptions};
use radar_chaperone::settings::Settings;
use radar_mapping::Mapper;
use radar_mapping::Scene;
use radar_simulation::{Scenario, Simulated};

const PATIENCE: Duration = Duration::from_secs(120);

fn room(duration_s: f64) -> (Scenario, Simulated) {
    let scenario = Scenario::new("furnished-room", "natural", preset("d16").unwrap(), duration_s, 3);
    let simulated = scenario.run().unwrap();
    (scenario, simulated)
}

/// Without estimation of the time offset, so that the result depends on the data alone, and with
/// the wait for poses that is used with a headset.
fn settings() -> Settings {
    let changes = ["tracking.estimate_time_offset=false".into(), "tracking.history.max_ahead_s=0".into()];
    Settings::from_toml("", &changes).unwrap()
}

fn start(scenario: &Scenario, settings: &Settings, options: &ReconstructionOptions) -> Reconstruction {
    Reconstruction::start(&scenario.config, &scenario.head_from_sensor, None, settings, options).unwrap()
}

fn replayed(scenario: &Scenario, simulated: &Simulated) -> Scene {
    let mut mapper = Mapper::new(&scenario.config, &scenario.head_from_sensor, &settings().mapping());
    mapper.push_all(in_time_order(simulated.frames.iter().cloned(), simulated.poses.iter().copied()));
    mapper.scene()
}

fn until(mut there: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !there() {
        assert!(begin.elapsed() < PATIENCE, "timed out");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn all_frames_processed(reconstruction: &Reconstruction, last_ns: i64) -> impl FnMut() -> bool {
    move || reconstruction.latest().newest_sweep_ns > last_ns - 1_000_000
}

#[test]
fn concurrent_streams_give_the_scene_of_a_replay() {
    let (scenario, simulated) = room(3.5);
    let expected = replayed(&scenario, &simulated);
    assert!(!expected.obstacles.is_empty());
    let reconstruction =
        start(&scenario, &settings(), &ReconstructionOptions { threads: Some(2), ..Default::default() });
    std::thread::scope(|scope| {
        scope.spawn(|| simulated.frames.iter().for_each(|frame| reconstruction.push(Event::Frame(frame.clone()))));
        scope.spawn(|| simulated.poses.iter().for_each(|pose| reconstruction.push(Event::Pose(*pose))));
    });
    reconstruction.flush();
    let last_ns = simulated.frames.last().unwrap().host_time_ns;
    until(all_frames_processed(&reconstruction, last_ns));
    let newest = reconstruction.latest();
    assert!(newest.number > 10 && newest.epoch == 0);
    let (counters, scene) = reconstruction.finish();
    assert_eq!(*scene, expected);
    let frames = simulated.frames.len() as u64;
    assert_eq!((counters.frames_dropped, counters.poses_dropped, counters.outdated), (0, 0, 0));
    assert_eq!((counters.mapper.streams.frames, counters.processed.count), (frames, frames));
    assert!(counters.scenes >= 8 && counters.scenes <= counters.published, "{counters:?}");
    // Simulated stamps lie long in the past: the ages are meaningless, but each frame has one.
    assert!((frames - 8..=frames).contains(&counters.evidence_age.count), "{counters:?}");
}

#[test]
fn data_from_before_forget_is_discarded() {
    let (scenario, simulated) = room(3.5);
    let reconstruction = start(&scenario, &settings(), &ReconstructionOptions::default());
    let push = |simulated: &Simulated| {
        simulated.poses.iter().for_each(|pose| reconstruction.push(Event::Pose(*pose)));
        simulated.frames.iter().for_each(|frame| reconstruction.push(Event::Frame(frame.clone())));
        reconstruction.flush();
    };
    let last_ns = simulated.frames.last().unwrap().host_time_ns;
    push(&simulated);
    until(all_frames_processed(&reconstruction, last_ns));
    // These are queued or being processed when everything is reset.
    push(&simulated);
    assert_eq!(reconstruction.reset(), 1);
    let newest = reconstruction.latest();
    assert_eq!((newest.epoch, newest.scene.as_ref(), newest.newest_sweep_ns), (1, &Scene::default(), 0));
    // Only data pushed from here on count. The same stamps are accepted again after the reset.
    push(&simulated);
    until(all_frames_processed(&reconstruction, last_ns));
    let (counters, scene) = reconstruction.finish();
    assert_eq!((counters.epoch, scene.as_ref()), (1, &replayed(&scenario, &simulated)));
    assert!(!scene.obstacles.is_empty());
    assert!(counters.outdated > 0, "{counters:?}");
    assert_eq!(counters.mapper.streams.frames, simulated.frames.len() as u64);
}

#[test]
fn overload_drops_the_oldest_and_counts_them() {
    let (scenario, simulated) = room(0.5);
    let options = ReconstructionOptions { max_frames: 8, max_poses: 8, ..Default::default() };
    let reconstruction = start(&scenario, &settings(), &options);
    for _ in 0..2000 {
        simulated.frames.iter().for_each(|frame| reconstruction.push(Event::Frame(frame.clone())));
        simulated.poses.iter().for_each(|pose| reconstruction.push(Event::Pose(*pose)));
    }
    let begin = Instant::now();
    let (counters, _) = reconstruction.finish();
    assert!(begin.elapsed() < PATIENCE);
    let frames = counters.mapper.streams.frames + counters.frames_dropped;
    let poses = counters.mapper.streams.poses + counters.poses_dropped;
    let (all_frames, all_poses) = (simulated.frames.len() as u64 * 2000, simulated.poses.len() as u64 * 2000);
    assert!(counters.frames_dropped > 0 && counters.poses_dropped > 0, "{counters:?}");
    assert_eq!((frames, poses), (all_frames, all_poses));
}

#[test]
fn reconstruction_ends_when_dropped_and_without_any_data() {
    let (scenario, simulated) = room(0.2);
    for n in 0..20 {
        let reconstruction = start(&scenario, &Settings::default(), &ReconstructionOptions::default());
        assert!(reconstruction.is_alive());
        simulated.poses.iter().take(n).for_each(|pose| reconstruction.push(Event::Pose(*pose)));
        match n % 2 {
            0 => drop(reconstruction),
            _ => assert_eq!(*reconstruction.finish().1, Scene::default()),
        }
    }
}

#[test]
fn forgotten_calibration_is_that_of_the_settings_and_the_map_stays() {
    let (scenario, simulated) = room(4.0);
    let mut assumed = scenario.head_from_sensor;
    assumed.translation.x += 0.05;
    // As an earlier session found it.
    let known = MountInUse { assumed, in_use: scenario.head_from_sensor, estimate: None };
    let settings = Settings::from_toml("", &["tracking.history.max_ahead_s=0".into()]).unwrap();
    let options = ReconstructionOptions { max_frames: 4096, max_poses: 8192, ..Default::default() };
    let reconstruction = Reconstruction::start(&scenario.config, &assumed, Some(known), &settings, &options).unwrap();
    for event in in_time_order(simulated.frames.iter().cloned(), simulated.poses.iter().copied()) {
        reconstruction.push(event);
    }
    reconstruction.flush();
    until(all_frames_processed(&reconstruction, simulated.frames.last().unwrap().host_time_ns));
    until(|| !reconstruction.latest().scene.obstacles.is_empty());
    let mount = || reconstruction.latest().calibration.as_ref().map(|calibration| calibration.mount);
    assert!(mount().is_some_and(|mount| mount.in_use == known.in_use));
    reconstruction.forget_calibration();
    until(|| mount().is_some_and(|mount| mount.in_use == assumed && mount.estimate.is_none()));
    let latest = reconstruction.latest();
    assert!(latest.epoch == 0 && !latest.scene.obstacles.is_empty(), "the map stays");
}

#[test]
fn a_sensor_too_slow_for_sub_apertures_is_recognised() {
    let rooms = Settings::from_toml("", &["processing.mode=rooms".into()]).unwrap().mapping();
    let lacks = |name: &str| {
        let scenario = Scenario::new("furnished-room", "natural", preset(name).unwrap(), 1.0, 3);
        let Simulated { frames, poses, .. } = scenario.run().unwrap();
        let mut mapper = Mapper::new(&scenario.config, &scenario.head_from_sensor, &rooms);
        mapper.push_all(in_time_order(frames, poses));
        mapper.counters().engine.no_subaperture().is_some()
    };
    assert!(lacks("slow-link") && !lacks("d16"));
}

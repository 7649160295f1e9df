//! The vendor's recordings of real scenes, imported at a fixed pose and mapped as `replay` maps them.
//!
//! What the program does not reach here, and what is therefore not asserted:
//! - People (`presence-*`) are not moving targets. By default 192 and 160 sweeps a second are mapped
//!   as single reflectors, and these have no moving targets. Mapped as rooms, each frame of 16 sweeps
//!   is a sub-aperture of 5 and 3 ms, in which speeds are distinguished from 0.5 and 0.8 m/s on: more
//!   than a person who stands or sits. They are one reflector at the range of the strongest echo.
//! - The level of `waste-level-full`. Noise is estimated from the sweep itself, and the 12 and 25
//!   points of its sweeps are all in echoes.
//! - Anything in `touchless_button_default`, `hand-motion-default` and `surface_velocity_1_dist`, whose
//!   sweeps have one to three points.
//! - The hand of `gesture_static_hand` and the echo at 0.18 m of `distance-5to20`: mapped as rooms, they
//!   give no obstacle.
//! - Which of the five reflectors of `parking_pole` is the pole: the recordings' index does not say.

use std::collections::BTreeSet;

use radar_mapping::MapperKind::{self, Reflectors, Rooms};
use radar_mapping::{Mapper, MappingSettings, Mode, Scene};
use radar_sar::geometry::Pose;

use super::test_files::real_recording;
use super::{Import, ImportOptions, import_h5};

/// A recording, and what is known to be in it.
struct RealScene {
    name: &'static str,
    frames: usize,
    /// How it is mapped by default.
    kind: MapperKind,
    /// Nothing in it moves.
    is_static: bool,
    /// Range of the strongest reflector, and of others, with how far off each may be, metres.
    ranges_m: &'static [(f64, f64)],
}

const fn scene(
    name: &'static str,
    frames: usize,
    kind: MapperKind,
    is_static: bool,
    ranges_m: &'static [(f64, f64)],
) -> RealScene {
    RealScene { name, frames, kind, is_static, ranges_m }
}

/// Ranges: the recordings' index. Where it has a region only, its middle and half its length. The
/// sensor's range bias is up to 6 mm; the points of `large_tank`'s profile 5 are 60 mm apart.
const SCENES: [RealScene; 18] = [
    scene("cargo_20_feet_no_lens", 21, Reflectors, true, &[]),
    scene("cargo_20_feet_utilization_and_presence", 26, Reflectors, false, &[]),
    // The reflector and its double bounce.
    scene("corner-reflector", 113, Reflectors, true, &[(0.2235, 0.006), (0.4476, 0.006)]),
    scene("distance-5to20", 58, Rooms, false, &[]),
    scene("distance_fixed_strength", 93, Reflectors, false, &[(0.28, 0.03)]),
    scene("fr10Hz-spf4", 10, Reflectors, false, &[]),
    scene("gesture_static_hand", 2500, Rooms, false, &[]),
    scene("hand-motion-default", 11, Reflectors, false, &[]),
    scene("input", 10, Reflectors, false, &[]),
    // The water. The direct leakage at 0 m is no reflector.
    scene("large_tank", 390, Reflectors, true, &[(2.16, 0.04)]),
    scene("medium_tank", 1740, Reflectors, false, &[]),
    scene("parking_pole", 86, Reflectors, false, &[]),
    // People.
    scene("presence-default", 137, Reflectors, false, &[(1.6, 1.1)]),
    scene("presence-short_range", 106, Reflectors, false, &[(0.63, 0.57)]),
    scene("surface_velocity_1_dist", 27, Rooms, false, &[]),
    scene("touchless_button_default", 89, Reflectors, false, &[]),
    // The bottom.
    scene("waste-level-empty", 104, Reflectors, true, &[(1.04, 0.01)]),
    scene("waste-level-full", 104, Reflectors, true, &[]),
];

/// The result over a recording.
struct Mapped {
    kind: MapperKind,
    /// Ranges of the reflectors, strongest first, metres.
    ranges_m: Vec<f64>,
    /// Moving targets, in how many scenes.
    moving: usize,
}

fn imported(scene: &RealScene) -> Import {
    let options = ImportOptions { fixed_pose: Some(Pose::IDENTITY), ..ImportOptions::default() };
    import_h5(&real_recording(&format!("{}.h5", scene.name)), None, &options).unwrap()
}

fn mapped(name: &str, imported: &Import, mode: Mode) -> Mapped {
    let mut settings = MappingSettings::default();
    settings.processing.mode = mode;
    let header = &imported.header;
    let mut mapper = Mapper::new(&header.config, &header.head_from_sensor, &settings);
    let mut moving = 0;
    let mut count = |scene: &Scene| moving += scene.moving.len();
    for event in imported.events() {
        mapper.push(event.unwrap()).unwrap();
        if let Some(scene) = mapper.poll_scene() {
            count(&scene);
        }
    }
    mapper.finish();
    let scene = mapper.scene();
    count(&scene);
    let streams = mapper.counters().streams;
    let hearing = header.config.subsweeps.iter().filter(|subsweep| subsweep.hears_echoes()).count();
    let sweeps = u64::from(header.config.sweeps_per_frame) * hearing as u64;
    assert_eq!(streams.observations, streams.frames * sweeps, "{name}: a sweep has no pose");
    let ranges_m = scene.obstacles.iter().map(|obstacle| obstacle.position_m.length()).collect();
    Mapped { kind: mapper.kind(), ranges_m, moving }
}

#[test]
#[ignore = "needs the vendor's recordings in ../shared/recordings"]
fn real_scenes_show_what_is_known_to_be_there() {
    for scene in &SCENES {
        let name = scene.name;
        let imported = imported(scene);
        assert_eq!(imported.vendor.frame_count(), scene.frames, "{name}");
        let found = mapped(name, &imported, Mode::Auto);
        println!("{name}: {:?}, reflectors at {:.3?} m, {} moving", found.kind, found.ranges_m, found.moving);
        assert_eq!(found.kind, scene.kind, "{name}");
        for (n, &(range_m, off_m)) in scene.ranges_m.iter().enumerate() {
            let seen = |found_m: &f64| (found_m - range_m).abs() <= off_m;
            let is_seen =
                if n == 0 { found.ranges_m.first().is_some_and(seen) } else { found.ranges_m.iter().any(seen) };
            assert!(is_seen, "{name}: nothing within {off_m} m of {range_m} m: {:?}", found.ranges_m);
        }
        if scene.is_static {
            let as_room = mapped(name, &imported, Mode::Rooms);
            assert_eq!((found.moving, as_room.moving), (0, 0), "{name}: something moves");
        }
    }
}

#[test]
#[ignore = "needs the vendor's recordings in ../shared/recordings"]
fn every_real_recording_is_in_the_table() {
    let entries = std::fs::read_dir(real_recording("")).unwrap().map(|entry| entry.unwrap().path());
    let recordings = entries.filter(|path| path.extension().is_some_and(|extension| extension == "h5"));
    let names: BTreeSet<String> =
        recordings.filter_map(|path| Some(path.file_stem()?.to_string_lossy().into_owned())).collect();
    assert_eq!(names, SCENES.iter().map(|scene| scene.name.to_owned()).collect());
}

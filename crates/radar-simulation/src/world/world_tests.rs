//! Rooms of all families, and what their furniture returns.

use std::collections::BTreeSet;

use glam::{DQuat, DVec3};

use radar_sar::Beam;
use radar_sar::geometry::Pose;

use super::object::Furniture;
use super::*;
use crate::echoes::{
    DiffuseEchoes, EchoPath, EchoScene, MovingBodies, Walk, person_shape, walking_person, wearer, wearer_shape,
};

const SEEDS: u64 = 20;

fn worlds() -> impl Iterator<Item = World> {
    Family::ALL.into_iter().flat_map(|family| (0..SEEDS).map(move |seed| World::new(family, seed)))
}

fn of_world(world: &World, removed: bool) -> EchoScene {
    EchoScene::of_world(world, removed, &DiffuseEchoes::default())
}

#[test]
fn furniture_stands_inside_the_room_and_clear_of_the_centre() {
    for world in worlds() {
        let label = format!("seed {}", world.seed);
        for object in world.objects.iter().filter(|object| object.kind != ObjectKind::Fixture) {
            for point in &object.points_m {
                assert!(world.plan.clearance_m(*point) > -0.02, "{label}: {} at {point}", object.name);
                assert!((-0.01..world.plan.ceiling_m(point.x) + 0.01).contains(&point.y), "{label}: {}", object.name);
                assert!(point.x.hypot(point.z) > 0.75, "{label}: {} at {point}", object.name);
            }
        }
    }
}

#[test]
fn every_room_has_its_chairs_and_most_have_everything() {
    for family in Family::ALL {
        let mut seen = std::collections::BTreeMap::new();
        for seed in 0..SEEDS {
            let world = World::new(family, seed);
            let kinds: BTreeSet<ObjectKind> = world.objects.iter().map(|object| object.kind).collect();
            assert!(kinds.contains(&ObjectKind::HardChair) && kinds.contains(&ObjectKind::SoftChair));
            assert_eq!(world.objects[world.removable.unwrap()].name, REMOVABLE_CHAIR);
            let at_wall = world.objects.iter().find(|object| object.name == CHAIR_AT_WALL).unwrap();
            let nearest_m = at_wall.points_m.iter().map(|p| world.plan.clearance_m(*p)).fold(f64::INFINITY, f64::min);
            assert!((0.005..0.4).contains(&nearest_m), "{family:?} {seed}: {nearest_m}");
            kinds.into_iter().for_each(|kind| *seen.entry(kind).or_insert(0) += 1);
        }
        use ObjectKind::{Fixture, Hanging, Lamp, Shelf, Sofa, Table};
        for kind in [Table, Shelf, Sofa, Lamp, Hanging, Fixture] {
            assert!(seen.get(&kind).is_some_and(|n| *n >= 13), "{family:?} {kind:?}: {seen:?}");
        }
    }
}

#[test]
fn no_two_families_share_a_builder() {
    let built = |family: Family| {
        let mut names = BTreeSet::new();
        let mut shapes = BTreeSet::new();
        for seed in 0..10 {
            for Item { furniture, .. } in family.items(&mut Draw(ChaCha8Rng::seed_from_u64(seed))) {
                let Parts { panels, edges, tubes, corners, .. } = &furniture.parts;
                if ![REMOVABLE_CHAIR, CHAIR_AT_WALL].contains(&furniture.name) {
                    names.insert(furniture.name);
                }
                shapes.insert((furniture.kind, panels.len(), edges.len(), tubes.len(), corners.len()));
            }
        }
        (names, shapes)
    };
    let [office, dining, living] = Family::ALL.map(built);
    for (a, b) in [(&office, &dining), (&dining, &living), (&office, &living)] {
        assert!(a.0.is_disjoint(&b.0), "{:?}", a.0.intersection(&b.0));
        assert!(a.1.is_disjoint(&b.1), "{:?}", a.1.intersection(&b.1));
    }
}

#[test]
fn same_seed_gives_the_same_world_and_echoes() {
    for family in Family::ALL {
        let [a, b] = [3, 3].map(|seed| World::new(family, seed));
        assert_eq!(a.objects, b.objects);
        assert_eq!(of_world(&a, false), of_world(&b, false));
        assert_ne!(a.objects, World::new(family, 4 + 3).objects);
        assert!(of_world(&a, true).counts()[2] < of_world(&a, false).counts()[2]);
    }
}

#[test]
fn removed_object_takes_its_echoes_and_leaves_the_others() {
    for seed in 0..8 {
        let world = World::new(Family::Office, seed);
        let place = world.objects[world.removable.unwrap()].points_m[0];
        let pose = Pose::looking_at(DVec3::Y * 1.6, place, DVec3::Y);
        let [before, after] = [false, true].map(|removed| of_world(&world, removed));
        let nobody = MovingBodies::default();
        let paths = |scene: &EchoScene| scene.paths(&[pose; 3], &nobody, &Beam::Lensless, 1e-4, 4.0);
        let alone = before.alone(&world, world.removable.unwrap(), &DiffuseEchoes::default());
        let own = alone.direct_paths_seen(&alone.visibility(&pose, &Beam::Lensless, 1e-4, 4.0), &[pose; 3], &nobody);
        let (with, without) = (paths(&before), paths(&after));
        assert!(own.len() > 5 && own.iter().all(|path| with.contains(path)), "seed {seed}");
        assert!(!own.iter().any(|path| without.contains(path)), "seed {seed}");
        // The rest are those that it hid.
        let kept = without.iter().filter(|path| with.contains(path)).count();
        assert!(kept as f64 > 0.9 * without.len() as f64, "seed {seed}: {kept} of {}", without.len());
    }
}

/// Cross-section of an object as a whole on the floor of its family, from an angle, m²: power of all its paths.
fn cross_section_m2(furniture: &Furniture, family: Family, azimuth_rad: f64, away_m: f64) -> f64 {
    let floor = Panel {
        center_m: DVec3::ZERO,
        half_u_m: DVec3::Z * 4.0,
        half_v_m: DVec3::X * 4.0,
        material: family.style().finish.floor,
        two_sided: false,
    };
    let shell = Parts { panels: vec![floor], ..Default::default() };
    let sampling = crate::echoes::Sampling { spacing_m: 0.05, shell_spacing_m: 0.5, diffuse_factor: 1.0, seed: 1 };
    let object = furniture.placed(DVec3::ZERO, azimuth_rad);
    let eye = DVec3::new(0.0, 1.6, away_m);
    let pose = Pose::looking_at(eye, DVec3::Y * 0.5, DVec3::Y);
    let paths = |objects: Vec<(u64, &Parts)>| {
        let scene = EchoScene::new(&shell, objects, floor.material.specular(), &sampling);
        scene.paths(&[pose; 3], &MovingBodies::default(), &Beam::Uniform, 1e-6, 6.0)
    };
    let (empty, full) = (paths(Vec::new()), paths(vec![(0, &object.parts)]));
    let same = |a: &EchoPath, b: &EchoPath| (a.range_m[1] - b.range_m[1]).abs() < 1e-9;
    let own = full.iter().filter(|path| !empty.iter().any(|other| same(path, other)));
    own.map(|path| (path.amplitude * path.range_m[1].powi(2)).powi(2)).sum()
}

#[test]
fn chairs_as_a_whole_are_as_strong_as_expected() {
    for family in Family::ALL {
        for Item { furniture, .. } in family.items(&mut Draw(ChaCha8Rng::seed_from_u64(1))) {
            let db: Vec<Vec<f64>> = [1.0, 1.7]
                .map(|away_m| {
                    let angles = (0..12).map(|n| 0.1 + std::f64::consts::TAU * f64::from(n) / 12.0);
                    let mut db: Vec<f64> = angles
                        .map(|angle| 10.0 * cross_section_m2(&furniture, family, angle, away_m).log10())
                        .collect();
                    db.sort_by(f64::total_cmp);
                    db
                })
                .to_vec();
            println!(
                "{family:?} {}: at 1.9 m {:.1} / {:.1} / {:.1} dBsm, at 2.3 m {:.1} / {:.1} / {:.1}",
                furniture.name, db[0][1], db[0][6], db[0][10], db[1][1], db[1][6], db[1][10]
            );
            if matches!(furniture.kind, ObjectKind::HardChair | ObjectKind::SoftChair) {
                assert!(db.iter().all(|db| (-32.0..-8.0).contains(&db[6])), "{} {db:?}", furniture.name);
            }
        }
    }
}

/// Prints what a room returns, and what a call costs: with `--nocapture`.
#[test]
fn furnished_rooms_return_plausible_echoes() {
    for family in Family::ALL {
        for seed in 0..4 {
            let world = World::new(family, seed);
            let started = std::time::Instant::now();
            let scene = of_world(&world, false);
            let built_ms = started.elapsed().as_secs_f64() * 1e3;
            let turn = DQuat::from_rotation_y(0.6) * DQuat::from_rotation_x(-0.35);
            let pose = Pose::new(DVec3::new(0.1, 1.62, 0.0), turn);
            let mut moving = MovingBodies::default();
            let me =
                wearer(&pose, pose.forward(), [-0.2, 0.2].map(|x| pose.transform_point(DVec3::new(x, -0.3, -0.4))));
            let walk = Walk { at_m: DVec3::new(-1.0, 0.0, -1.5), facing: DVec3::X, stride_phase_rad: 0.4, stride: 1.0 };
            let guest = walking_person(&walk);
            moving.add(&wearer_shape(1), &[me.clone(), me.clone(), me]);
            moving.add(&person_shape(2), &[guest.clone(), guest.clone(), guest]);
            // The weakest path that the receiver can tell from nothing, −40 dB of a sweep's noise of d16.
            let (least, most_m) = (3e-4, 4.5);
            // The fastest of many calls, as other work disturbs the clock.
            let mut fastest_ms = [f64::INFINITY; 2];
            let mut visibility = scene.visibility(&pose, &Beam::Lensless, least, most_m);
            let mut paths = Vec::new();
            for _ in 0..15 {
                let started = std::time::Instant::now();
                visibility = scene.visibility(&pose, &Beam::Lensless, least, most_m);
                let between = std::time::Instant::now();
                paths = scene.paths_seen(&visibility, &[pose; 3], &moving);
                let took = [between - started, between.elapsed()].map(|time| time.as_secs_f64() * 1e3);
                fastest_ms = [0, 1].map(|n| fastest_ms[n].min(took[n]));
            }
            let [visibility_ms, paths_ms] = fastest_ms;
            let links = visibility.link_counts();
            println!(
                "{family:?} {:?} {seed}: {} objects, faces, lines, points, mirrors {:?}, {} paths, links {links:?}; built in {built_ms:.1} ms, \
                 visibility {visibility_ms:.2} ms, paths {paths_ms:.2} ms",
                world.seed % 4,
                world.objects.len(),
                scene.counts(),
                paths.len()
            );
            assert!(paths.len() > 100 && paths.iter().all(|path| path.amplitude.is_finite() && path.range_m[1] > 0.0));
            assert_eq!(paths, scene.paths_seen(&visibility, &[pose; 3], &moving));
            paths.sort_by(|a, b| b.amplitude.total_cmp(&a.amplitude));
            if seed == 0 {
                for path in &paths[..20] {
                    let dbsm = 20.0 * (path.amplitude * path.range_m[1].powi(2)).log10();
                    println!("    {:.3} m, amplitude {:.4}, {dbsm:.1} dBsm", path.range_m[1], path.amplitude);
                }
            }
            // Nothing is stronger than a mirror: √π/d.
            let mirror = |path: &EchoPath| std::f64::consts::PI.sqrt() / path.range_m[1];
            assert!(paths.iter().all(|path| path.amplitude < 1.01 * mirror(path)));
        }
    }
}

#[test]
fn plaster_wall_returns_its_mirror_image_and_the_room_its_right_angles() {
    let finish = Family::Dining.style().finish;
    let plan = FloorPlan::new(RoomShape::Rectangle, [4.0, 4.6], 2.5, &mut ChaCha8Rng::seed_from_u64(3));
    let shell = Shell::new(&plan, &finish, &[]);
    let sampling = crate::echoes::Sampling { spacing_m: 0.07, shell_spacing_m: 0.25, diffuse_factor: 1.0, seed: 1 };
    let scene = EchoScene::new(&shell.parts, std::iter::empty(), finish.floor.specular(), &sampling);
    let wall = shell.walls.iter().find(|wall| wall.plane.outward.z < -0.9).unwrap();
    for away_m in [0.7, 1.4] {
        let at = DVec3::new(0.3, 1.5, away_m - wall.plane.offset_m);
        let pose = Pose::from_translation(at);
        let paths = scene.paths(&[pose; 3], &MovingBodies::default(), &Beam::Uniform, 1e-4, 4.0);
        let power_dbsm = |range_m: f64| {
            let near = paths.iter().find(|path| (path.range_m[1] - range_m).abs() < 1e-6);
            near.map(|path| 20.0 * (path.amplitude * range_m * range_m).log10())
        };
        let mirror =
            |range_m: f64, reflectivity: f64| 10.0 * (std::f64::consts::PI * range_m * range_m * reflectivity).log10();
        let gamma = finish.wall.specular();
        assert!((power_dbsm(away_m).unwrap() - mirror(away_m, gamma)).abs() < 0.01);
        let foot_m = away_m.hypot(1.5);
        let expected = mirror(foot_m, gamma * finish.floor.specular());
        assert!((power_dbsm(foot_m).unwrap() - expected).abs() < 0.01);
    }
}

#[test]
fn distance_to_an_object_is_that_to_its_surface() {
    for world in worlds().step_by(7) {
        for object in &world.objects {
            let on_it = object.points_m.iter().map(|point| object.parts.distance_m(*point));
            let farthest_m = on_it.fold(0.0, f64::max);
            assert!(farthest_m < 1e-6, "seed {}: {} has a point {farthest_m} m off", world.seed, object.name);
        }
    }
    let tube = Tube { ends_m: [DVec3::ZERO, DVec3::Y], radius_m: 0.1, material: material::METAL };
    let parts = Parts { tubes: vec![tube], ..Parts::default() };
    assert!((parts.distance_m(DVec3::new(0.5, 0.3, 0.0)) - 0.4).abs() < 1e-12);
    assert!((parts.distance_m(DVec3::new(0.0, 1.5, 0.0)) - 0.4).abs() < 1e-12);
}

//! Echoes of small scenes against their formulas.

use glam::{DQuat, DVec3};

use super::*;
use crate::world::material::{GLASS, METAL, PLASTER, TEXTILE, WOOD};
use crate::world::{Assembly, Corner, Material, Panel, Tube};

const SAMPLING: Sampling = Sampling { spacing_m: 0.05, shell_spacing_m: 0.25, diffuse_factor: 1.0, seed: 1 };

/// A sensor that looks along −z.
fn sensor(at: DVec3) -> [Pose; 3] {
    [Pose::from_translation(at); 3]
}

fn point(position_m: DVec3, rcs_dbsm: f64) -> Parts {
    Parts { corners: vec![Corner { position_m, lobe: DVec3::ZERO, rcs_dbsm }], ..Default::default() }
}

/// A smooth panel of 4 by 4 m across the z axis, its front towards +z.
fn wall(z: f64, material: Material) -> Parts {
    let (half_u_m, half_v_m) = (DVec3::X * 2.0, DVec3::Y * 2.0);
    let material = Material { diffuse_share: 0.0, ..material };
    let panel = Panel { center_m: DVec3::Z * z, half_u_m, half_v_m, material, two_sided: true };
    Parts { panels: vec![panel], ..Default::default() }
}

fn scene(shell: &Parts, objects: &[Parts]) -> EchoScene {
    EchoScene::new(shell, objects.iter().enumerate().map(|(n, parts)| (n as u64, parts)), 0.05, &SAMPLING)
}

fn paths(scene: &EchoScene, at: DVec3) -> Vec<EchoPath> {
    scene.paths(&sensor(at), &MovingBodies::default(), &Beam::Uniform, 1e-6, 20.0)
}

fn at_range(paths: &[EchoPath], range_m: f64) -> Vec<EchoPath> {
    paths.iter().filter(|path| (path.range_m[1] - range_m).abs() < 1e-9).copied().collect()
}

fn db(ratio: f64) -> f64 {
    20.0 * ratio.log10()
}

#[test]
fn wall_and_point_have_the_power_of_their_formulas_at_two_distances() {
    for d in [0.8, 2.4] {
        let found = paths(&scene(&wall(-d, PLASTER), &[]), DVec3::ZERO);
        let expected = (PI * PLASTER.reflectivity).sqrt() / d;
        assert!(db(at_range(&found, d)[0].amplitude / expected).abs() < 0.01);
        let found = paths(&scene(&Parts::default(), &[point(DVec3::NEG_Z * d, -10.0)]), DVec3::ZERO);
        assert!(db(at_range(&found, d)[0].amplitude * d * d / 0.1f64.sqrt()).abs() < 0.01);
    }
}

#[test]
fn beam_weighs_each_leg() {
    let place = DVec3::new(0.8, 0.0, -1.2);
    let scene = scene(&Parts::default(), &[point(place, 0.0)]);
    let found = scene.paths(&sensor(DVec3::ZERO), &MovingBodies::default(), &Beam::Lensless, 1e-6, 20.0);
    let expected = Beam::Lensless.amplitude(place.normalize().dot(DVec3::NEG_Z)) / place.length_squared();
    assert!(db(found[0].amplitude / expected).abs() < 0.02);
}

#[test]
fn object_by_a_wall_and_its_image_lie_where_the_mirror_puts_them() {
    let (place, rcs) = (DVec3::new(0.4, 0.2, -1.0), 0.1f64);
    let scene = scene(&wall(-2.0, GLASS), &[point(place, -10.0)]);
    let found = paths(&scene, DVec3::ZERO);
    let image = DVec3::new(0.4, 0.2, -3.0);
    let (near, far, reflection) = (place.length(), image.length(), GLASS.reflectivity.sqrt());
    let by = at_range(&found, 0.5 * (near + far));
    assert_eq!(by.len(), 1);
    assert!(db(by[0].amplitude / (2.0 * rcs.sqrt() * reflection / (near * far))).abs() < 0.01);
    let ghost = at_range(&found, far);
    assert_eq!(ghost.len(), 1);
    assert!(db(ghost[0].amplitude / (rcs.sqrt() * reflection * reflection / (far * far))).abs() < 0.01);
    // From aside the mirror point is beyond the panel's border.
    let aside = DVec3::new(5.5, 0.0, 0.0);
    let found = paths(&scene, aside);
    assert!(at_range(&found, aside.distance(place)).len() == 1 && at_range(&found, aside.distance(image)).is_empty());
}

#[test]
fn leg_by_a_wall_has_its_own_place_in_the_beam() {
    // A wall at the side: the object is ahead, its image is not.
    let place = DVec3::NEG_Z * 1.5;
    let turned = wall(0.0, GLASS).moved(&Pose::new(DVec3::X, DQuat::from_rotation_y(-PI / 2.0)));
    let scene = scene(&turned, &[point(place, 0.0)]);
    let found = scene.paths(&sensor(DVec3::ZERO), &MovingBodies::default(), &Beam::Lensless, 1e-6, 20.0);
    let image = DVec3::new(2.0, 0.0, -1.5);
    let beam = Beam::Lensless.amplitude(image.normalize().dot(DVec3::NEG_Z)).sqrt();
    let by = at_range(&found, 0.5 * (1.5 + image.length()));
    let expected = 2.0 * GLASS.reflectivity.sqrt() * beam / (1.5 * image.length());
    assert!(db(by[0].amplitude / expected).abs() < 0.05);
}

#[test]
fn opaque_panel_hides_and_cloth_attenuates() {
    let place = DVec3::new(0.3, 0.1, -2.0);
    let amplitude = |screen: Material| {
        let found = paths(&scene(&Parts::default(), &[wall(-1.0, screen), point(place, 0.0)]), DVec3::ZERO);
        at_range(&found, place.length()).first().map_or(0.0, |path| path.amplitude)
    };
    assert_eq!(amplitude(WOOD), 0.0);
    // Both ways: √t twice.
    let through = amplitude(TEXTILE) * place.length_squared();
    assert!((through - TEXTILE.transmission).abs() < 1e-6, "{through}");
}

#[test]
fn leg_of_a_tube_on_the_floor_is_a_dihedral() {
    let floor = Parts {
        panels: vec![Panel {
            center_m: DVec3::ZERO,
            half_u_m: DVec3::Z * 4.0,
            half_v_m: DVec3::X * 4.0,
            material: Material { diffuse_share: 0.0, ..WOOD },
            two_sided: false,
        }],
        ..Default::default()
    };
    let tube = Tube { ends_m: [DVec3::NEG_Z, DVec3::new(0.0, 0.45, -1.0)], radius_m: 0.011, material: METAL };
    let scene = scene(&floor, &[Parts { tubes: vec![tube], ..Default::default() }]);
    for z in [0.3, 1.5] {
        let at = DVec3::new(0.0, 1.5, z);
        let foot_m = at.distance(DVec3::NEG_Z);
        let found: Vec<EchoPath> =
            paths(&scene, at).into_iter().filter(|path| (path.range_m[1] - foot_m).abs() < 0.02).collect();
        let strongest = found.iter().map(|path| path.amplitude).fold(0.0, f64::max);
        let expected = (PI * 0.011 * foot_m * METAL.specular() * WOOD.reflectivity).sqrt() / foot_m.powi(2);
        assert!(db(strongest / expected).abs() < 0.1, "{} dB at {z}", db(strongest / expected));
    }
}

#[test]
fn near_mirror_bounces_twice_as_measured() {
    // Measured with a corner reflector at 0.2235 m: −14.4 dB at twice the range.
    let found = paths(&scene(&wall(-0.2235, METAL), &[]), DVec3::ZERO);
    let [once, twice] = [1.0, 2.0].map(|n| at_range(&found, 0.2235 * n)[0].amplitude);
    assert!((db(twice / once) + 14.4).abs() < 0.2, "{}", db(twice / once));
}

#[test]
fn wearers_head_stands_in_the_mirror_at_twice_the_walls_distance() {
    let scene = scene(&wall(-1.2, METAL), &[]);
    let head = Pose::from_translation(DVec3::Y * 0.1);
    let palms = [DVec3::new(-0.5, -0.9, 0.2), DVec3::new(0.5, -0.9, 0.2)];
    let posture = wearer(&head, DVec3::NEG_Z, palms);
    let mut moving = MovingBodies::default();
    moving.add(&wearer_shape(1), &[posture.clone(), posture.clone(), posture]);
    let at = DVec3::new(0.0, 0.12, -0.08);
    let found = scene.paths(&sensor(at), &moving, &Beam::Lensless, 1e-5, 6.0);
    let twice_m = 2.0 * (1.2 - 0.08);
    let near = found.iter().filter(|path| (path.range_m[1] - twice_m).abs() < 0.15);
    let power: f64 = near.map(|path| path.amplitude * path.amplitude).sum();
    // The head at −19 dBsm, metal mirror, and the double bounce with the headset.
    let head_db = 10.0 * (power * twice_m.powi(4)).log10();
    assert!((-22.0..-5.0).contains(&head_db), "{head_db}");
}

#[test]
fn body_shadows_what_is_behind_it() {
    let place = DVec3::new(0.0, 1.2, -3.0);
    let scene = scene(&Parts::default(), &[point(place, 0.0)]);
    let at = DVec3::Y * 1.2;
    let mut moving = MovingBodies::default();
    let walk = Walk { at_m: DVec3::NEG_Z * 1.5, facing: DVec3::X, stride_phase_rad: 0.0, stride: 0.0 };
    let posture = walking_person(&walk);
    moving.add(&person_shape(1), &[posture.clone(), posture.clone(), posture]);
    let behind =
        |moving: &MovingBodies| at_range(&scene.paths(&sensor(at), moving, &Beam::Uniform, 1e-6, 20.0), 3.0).len();
    assert_eq!((behind(&MovingBodies::default()), behind(&moving)), (1, 0));
}

#[test]
fn ranges_follow_the_sensor_and_the_bodies() {
    let mut box_and_pole = Assembly::default();
    box_and_pole.cuboid(DVec3::new(0.2, 0.0, -1.5), DVec3::splat(0.4), WOOD);
    box_and_pole.tube(DVec3::new(-0.4, -1.0, -1.0), DVec3::new(-0.4, 1.0, -1.0), 0.01, METAL);
    let scene = scene(&wall(-2.5, PLASTER), &[box_and_pole.parts]);
    let poses = [-1.0, 0.0, 1.0].map(|n| Pose::from_translation(DVec3::new(0.01 * n, 0.0, -0.02 * n)));
    let moving = MovingBodies::default();
    let together = scene.paths(&poses, &moving, &Beam::Lensless, 1e-5, 6.0);
    assert!(together.len() > 50);
    for path in &together {
        let bend = path.range_m[0] - 2.0 * path.range_m[1] + path.range_m[2];
        assert!((path.range_m[2] - path.range_m[0]).abs() < 0.09 && bend.abs() < 2e-3, "{path:?}");
    }
    // Towards the wall: 2 cm in each half.
    let wall_path = at_range(&together, 2.5)[0];
    assert!((wall_path.range_m[0] - 2.52).abs() < 1e-9 && (wall_path.range_m[2] - 2.48).abs() < 1e-9);
}

#[test]
fn paths_are_the_same_on_every_call_and_kept_visibility_loses_little() {
    let mut shelf = Assembly::default();
    shelf.cuboid(DVec3::new(0.2, 0.0, -1.5), DVec3::splat(0.4), WOOD);
    let scene = scene(&wall(-2.5, PLASTER), &[shelf.parts, point(DVec3::new(-0.3, 0.1, -1.0), -20.0)]);
    let moving = MovingBodies::default();
    let at = sensor(DVec3::ZERO);
    let first = scene.paths(&at, &moving, &Beam::Lensless, 1e-5, 6.0);
    assert_eq!(first, scene.paths(&at, &moving, &Beam::Lensless, 1e-5, 6.0));
    let before = scene.visibility(&Pose::from_translation(DVec3::new(0.03, -0.03, 0.03)), &Beam::Lensless, 1e-5, 6.0);
    let kept = scene.paths_seen(&before, &at, &moving);
    let power = |paths: &[EchoPath]| paths.iter().map(|path| path.amplitude.powi(2)).sum::<f64>();
    assert!((db(power(&kept) / power(&first)) / 2.0).abs() < 0.2);
}

#[test]
fn foot_of_a_box_is_a_dihedral_with_the_floor() {
    let mut cupboard = Assembly::default();
    cupboard.cuboid_on_floor(DVec3::NEG_Z * 1.2, DVec3::new(1.0, 0.8, 0.4), WOOD);
    let scene = scene(&Parts::default(), &[cupboard.parts]);
    for z in [0.0, 1.0] {
        let at = DVec3::new(0.1, 1.5, z);
        let away_m = (1.5f64 * 1.5 + (z + 1.0).powi(2)).sqrt();
        // The floor's specular reflectivity is 0.05 in these scenes.
        let expected = (PI * WOOD.specular() * 0.05).sqrt() / away_m;
        assert!(db(at_range(&paths(&scene, at), away_m)[0].amplitude / expected).abs() < 0.01);
    }
    // From behind, the box hides it.
    let behind = DVec3::new(0.1, 0.3, -3.0);
    let away_m = (0.3f64 * 0.3 + 2.0 * 2.0).sqrt();
    assert!(at_range(&paths(&scene, behind), away_m).is_empty());
}

#[test]
fn tube_seen_from_its_end_returns_its_cap() {
    let tube = Tube { ends_m: [DVec3::NEG_Z, DVec3::NEG_Z * 2.0], radius_m: 0.012, material: METAL };
    let scene = scene(&Parts::default(), &[Parts { tubes: vec![tube], ..Default::default() }]);
    let cap = at_range(&paths(&scene, DVec3::ZERO), 1.0);
    let expected = (PI * 0.012 * 0.012 * METAL.specular()).sqrt();
    assert!(db(cap[0].amplitude / expected).abs() < 0.01);
}

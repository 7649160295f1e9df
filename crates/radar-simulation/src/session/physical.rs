//! A play session in a physical world: the room as the truth sees it, and the echoes of its frames.

use std::collections::BTreeSet;

use glam::DVec3;

use super::super::echoes::{
    BodyShape, DiffuseEchoes, EchoPath, EchoScene, MovingBodies, Posture, Visibility, cat_shape, person_shape,
    wearer_shape,
};
use super::super::world::{ObjectKind, Parts, World, WorldObject};
use super::super::{Room, Scatterer, SceneObject, WallPanel};
use radar_sar::Beam;
use radar_sar::geometry::Pose;

/// Distance of the points that represent an object in the truth, metres. Choice: a third of the
/// distance within which a report is right.
const TRUTH_SPACING_M: f64 = 0.08;
/// Cross-section of such a point in the truth, dBsm. Choice: as visible as can be; the echoes come from
/// surfaces, so no point has one of its own.
const TRUTH_DBSM: f64 = 0.0;
/// Time for which one visibility serves, seconds. Source: the limits that it is computed for.
const VISIBILITY_S: f64 = 0.045;

/// What returns echoes in a session.
#[derive(Debug, Clone)]
pub(super) struct PhysicalRoom {
    before: EchoScene,
    after: EchoScene,
    /// Each object of the truth alone, before and after the removal, in the shadow of all others.
    alone: Vec<[EchoScene; 2]>,
    /// The surfaces of each object of the truth.
    parts: Vec<Parts>,
    wearer: BodyShape,
    visitor: BodyShape,
    pet: BodyShape,
}

/// Those who move, each in three postures; `None`: not there.
#[derive(Debug, Clone, Default)]
pub(super) struct Movers {
    pub wearer: Option<[Posture; 3]>,
    pub visitor: Option<[Posture; 3]>,
    pub pet: Option<[Posture; 3]>,
}

/// Limits of the paths that are followed.
#[derive(Debug, Clone, Copy)]
pub(super) struct PathLimits {
    pub min_amplitude: f64,
    pub max_range_m: f64,
}

impl PhysicalRoom {
    pub fn new(world: &World, diffuse: &DiffuseEchoes, seed: u64) -> Self {
        let [before, after] = [false, true].map(|removed| EchoScene::of_world(world, removed, diffuse));
        let alone = |(n, _): (usize, _)| [&before, &after].map(|scene| scene.alone(world, n, diffuse));
        Self {
            alone: free_objects(world).map(alone).collect(),
            parts: free_objects(world).map(|(_, object)| object.parts.clone()).collect(),
            before,
            after,
            wearer: wearer_shape(seed),
            visitor: person_shape(seed ^ 0x0715_1703),
            pet: cat_shape(seed),
        }
    }

    /// With or without the object that is removed.
    pub fn scene(&self, removed: bool) -> &EchoScene {
        if removed { &self.after } else { &self.before }
    }

    /// What is seen from a pose of the sensor in the room.
    pub fn visibility(&self, removed: bool, sensor: &Pose, beam: &Beam, limits: PathLimits) -> Visibility {
        self.scene(removed).visibility(sensor, beam, limits.min_amplitude, limits.max_range_m)
    }

    /// Paths while the sensor is at three poses and the bodies in three postures each.
    pub fn paths(&self, removed: bool, visibility: &Visibility, sensor: &[Pose; 3], movers: &Movers) -> Vec<EchoPath> {
        self.scene(removed).paths_seen(visibility, sensor, &self.moving(movers))
    }

    /// Direct paths of one object of the truth, by its index there, in the shadow of all else.
    pub fn direct_paths(
        &self,
        object: usize,
        removed: bool,
        sensor: &Pose,
        beam: &Beam,
        limits: PathLimits,
        movers: &Movers,
    ) -> Vec<EchoPath> {
        let scene = &self.alone[object][usize::from(removed)];
        let visibility = scene.visibility(sensor, beam, limits.min_amplitude, limits.max_range_m);
        scene.direct_paths_seen(&visibility, &[*sensor; 3], &self.moving(movers))
    }

    /// Distance from a point to the surfaces of an object of the truth, by its index there, metres.
    pub fn distance_m(&self, object: usize, point: DVec3) -> f64 {
        self.parts[object].distance_m(point)
    }

    /// Whether at least half of the field passes between two points.
    pub fn has_line_of_sight(&self, removed: bool, from_m: DVec3, to_m: DVec3) -> bool {
        self.scene(removed).transmission(from_m, to_m) >= 0.5
    }

    fn moving(&self, movers: &Movers) -> MovingBodies {
        let mut moving = MovingBodies::default();
        let Movers { wearer, visitor, pet } = movers;
        for (shape, postures) in [(&self.wearer, wearer), (&self.visitor, visitor), (&self.pet, pet)] {
            if let Some(postures) = postures {
                moving.add(shape, postures);
            }
        }
        moving
    }
}

/// Number of frames that share a visibility.
pub(super) fn frames_per_visibility(frame_period_s: f64) -> u64 {
    (VISIBILITY_S / frame_period_s).floor().max(1.0) as u64
}

/// The objects that are in the truth, with their indices in the world.
fn free_objects(world: &World) -> impl Iterator<Item = (usize, &WorldObject)> {
    world.objects.iter().enumerate().filter(|(_, object)| object.kind != ObjectKind::Fixture)
}

/// The room of a world, for the truth. What hangs on a wall belongs to the wall.
pub(super) fn truth_room(world: &World) -> Room {
    let free = free_objects(world).map(|(_, object)| object);
    let wall = |wall: &super::super::world::WorldWall| WallPanel {
        name: wall.name.clone(),
        plane: wall.plane,
        extent: wall.extent,
        reflection_db: 0.0,
    };
    Room { things: free.map(truth_object).collect(), walls: world.shell.walls.iter().map(wall).collect() }
}

fn truth_object(object: &WorldObject) -> SceneObject {
    let mut taken = BTreeSet::new();
    let cell = |point: &DVec3| (*point / TRUTH_SPACING_M).floor().as_i64vec3().to_array();
    let points = object.points_m.iter().filter(|point| taken.insert(cell(point)));
    let scatterer =
        |&position_m: &DVec3| Scatterer { position_m, rcs_dbsm: TRUTH_DBSM, lobe: DVec3::ZERO, phase_rad: 0.0 };
    let name = if object.kind == ObjectKind::SoftChair { "soft chair" } else { object.name.as_str() };
    SceneObject { name: name.into(), scatterers: points.map(scatterer).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Family;
    use glam::DQuat;

    #[test]
    fn paths_of_an_object_alone_are_among_those_of_the_whole_room() {
        let world = World::new(Family::Dining, 3);
        let room = PhysicalRoom::new(&world, &DiffuseEchoes::default(), 3);
        let limits = PathLimits { min_amplitude: 1e-4, max_range_m: 3.0 };
        let mut found = 0;
        for turn in 0..6 {
            let sensor = Pose::new(DVec3::Y * 1.5, DQuat::from_rotation_y(f64::from(turn)));
            let seen = room.visibility(false, &sensor, &Beam::Lensless, limits);
            let whole = room.scene(false).direct_paths_seen(&seen, &[sensor; 3], &MovingBodies::default());
            for object in 0..room.alone.len() {
                let alone = room.direct_paths(object, false, &sensor, &Beam::Lensless, limits, &Movers::default());
                assert!(alone.len() < whole.len());
                assert!(alone.iter().all(|path| whole.contains(path)), "object {object}, turn {turn}");
                found += alone.len();
            }
        }
        assert!(found > 100, "{found}");
    }
}

//! Which propagation paths return to the sensor: geometrical optics at 60.5 GHz. Surfaces echo from the foot of the
//! perpendicular (specular), from their edges (cylinders) and from points all over (diffuse); walls and large smooth
//! panels mirror objects; panels and bodies shadow.
//!
//! Left out: reflections between parallel walls, more than two mirror reflections, faces seen by a mirror,
//! polarisation and Brewster's angle, diffraction beyond what fades at borders.

mod beam_table;
mod bodies;
mod face;
mod fresnel;
mod line;
mod mirrors;
mod points;
mod postures;
#[cfg(test)]
mod scene_tests;
mod shadow;
mod view;
mod visibility;

use std::f64::consts::PI;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use radar_sar::Beam;
use radar_sar::geometry::Pose;
use radar_sar::math;

use crate::world::{InnerEdge, Panel, Parts, World};

pub(crate) use bodies::{BodyShape, MovingBodies, Posture};
pub(crate) use postures::{Walk, cat_shape, person_shape, walking_cat, walking_person, wearer, wearer_shape};
pub(crate) use visibility::Visibility;

use face::Face;
use line::Line;
use points::PointCloud;
use shadow::{Occluder, Occluders};
use view::View;

/// Phase of a reflection by a denser medium or metal, radians. Physics: Fresnel's equations.
const REFLECTION_PHASE_RAD: f64 = PI;
/// √σ of the headset with the sensor, seen from the front, m: −10.5 dBsm. Measured: corner-reflector.h5, 14.4 dB below
/// the reflector's echo at 0.2235 m, which at that distance returns as a mirror, σ = π d².
const HEADSET_ROOT_SIGMA_M: f64 = 0.297;
/// A panel of an object mirrors other things if both sides are at least this long, metres, and it reflects at least
/// this power. Choice: cabinets, glass doors and table tops, not boards; the Fresnel zone of 2 m is 7 cm.
const MIN_MIRROR_M: f64 = 0.45;
const MIN_MIRROR_REFLECTIVITY: f64 = 0.15;
/// A panel of the shell mirrors if both sides are at least this long, metres. Choice: a piece of wall beside a door does.
const MIN_SHELL_MIRROR_M: f64 = 0.2;
/// Doors and windows stand at most this far behind the wall around them, metres. Choice: above every reveal.
const MAX_REVEAL_M: f64 = 0.2;
/// A panel narrower than this, metres, casts no shadow. Choice: less than the Fresnel zone, it intercepts little.
const MIN_SHADOW_M: f64 = 0.06;

/// Spacing of the diffuse points of objects, metres. Choice: half the envelope of profile 3, at which a surface's
/// echo is as random as with denser points.
const OBJECT_SPACING_M: f64 = 0.07;
/// Spacing of the diffuse points of walls, floor and ceiling, metres. Choice: about two envelopes of profile 3; nearer
/// ones cost more than all furniture.
const SHELL_SPACING_M: f64 = 0.25;

/// One propagation path from the transmitter back to the receiver, over a short time (a frame, ≤ 20 ms).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct EchoPath {
    /// Half the path's length at the first, middle and last time, metres.
    pub range_m: [f64; 3],
    /// √σ · b_t · b_r / (d_t · d_r) for legs d_t, d_r (√m² / m²; = √σ·b²/d² for a direct echo), times √γ for each
    /// bounce and √transmission for each crossing of a shadowing surface: field relative to a 0 dBsm target at 1 m on
    /// the beam's axis. Both directions of a path by a mirror are one path of twice the field.
    pub amplitude: f64,
    /// Phase added by reflections, radians.
    pub phase_rad: f64,
}

/// The diffuse echoes of surfaces in a physical world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiffuseEchoes {
    /// Factor of the spacing of the points that stand for a surface. 1: 7 cm on objects, 25 cm on walls, floor and
    /// ceiling.
    pub spacing: f64,
    /// Added to the diffusely scattered power, dB. It was not measured on furniture: its materials' roughness is
    /// assumed.
    pub level_db: f64,
}

impl Default for DiffuseEchoes {
    fn default() -> Self {
        Self { spacing: 1.0, level_db: 0.0 }
    }
}

impl DiffuseEchoes {
    /// Spacings from a quarter to four times the default, levels within 40 dB of it.
    pub(crate) fn is_valid(&self) -> bool {
        (0.25..=4.0).contains(&self.spacing) && (-40.0..=40.0).contains(&self.level_db)
    }
}

/// How finely surfaces are sampled, and the seed of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sampling {
    /// Spacing of diffuse points on objects, metres.
    pub spacing_m: f64,
    /// Spacing of diffuse points on walls, floor and ceiling, metres.
    pub shell_spacing_m: f64,
    /// Factor of the diffusely scattered power.
    pub diffuse_factor: f64,
    pub seed: u64,
}

impl Sampling {
    fn of_world(world: &World, diffuse: &DiffuseEchoes) -> Self {
        Self {
            spacing_m: OBJECT_SPACING_M * diffuse.spacing,
            shell_spacing_m: SHELL_SPACING_M * diffuse.spacing,
            diffuse_factor: math::powf(10.0, diffuse.level_db / 10.0),
            seed: world.seed,
        }
    }
}

/// Everything that stands still and returns echoes.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct EchoScene {
    faces: Vec<Face>,
    /// Lines of the shell first.
    lines: Vec<Line>,
    shell_lines: usize,
    /// Points of the shell first.
    cloud: PointCloud,
    shell_points: usize,
    occluders: Occluders,
    mirrors: Vec<Face>,
}

impl EchoScene {
    /// Of a world, with all objects or without the removed one; the others' echoes are the same in both.
    pub fn of_world(world: &World, removed: bool, diffuse: &DiffuseEchoes) -> Self {
        let there = |n: &usize| !(removed && Some(*n) == world.removable);
        let objects = (0..world.objects.len()).filter(there).map(|n| (n as u64, &world.objects[n].parts));
        Self::new(&world.shell.parts, objects, world.floor_reflectivity(), &Sampling::of_world(world, diffuse))
    }

    /// One object of the world alone, by its index, in the shadow of everything in this scene.
    pub fn alone(&self, world: &World, object: usize, diffuse: &DiffuseEchoes) -> Self {
        let parts = [(object as u64, &world.objects[object].parts)];
        let alone =
            Self::new(&Parts::default(), parts, world.floor_reflectivity(), &Sampling::of_world(world, diffuse));
        Self { occluders: self.occluders.clone(), mirrors: Vec::new(), ..alone }
    }

    /// Of a room's shell, which mirrors, and of objects. Each object comes with a number of its own: its points
    /// depend on the number and the seed, not on the other objects. `floor_reflectivity` is specular.
    pub fn new<'p>(
        shell: &Parts,
        objects: impl IntoIterator<Item = (u64, &'p Parts)>,
        floor_reflectivity: f64,
        sampling: &Sampling,
    ) -> Self {
        let mut scene = Self::default();
        scene.add(shell, u64::MAX, floor_reflectivity, sampling.shell_spacing_m, sampling);
        scene.occluders.add(shell.panels.iter().filter(|p| stands_free(p, shell)).filter_map(Occluder::of));
        let wide = |face: &&Face| 2.0 * face.half_m[0].min(face.half_m[1]) >= MIN_SHELL_MIRROR_M;
        scene.mirrors = scene.faces.iter().filter(wide).copied().collect();
        (scene.shell_lines, scene.shell_points) = (scene.lines.len(), scene.cloud.points.len());
        for (number, parts) in objects {
            scene.add(parts, number, floor_reflectivity, sampling.spacing_m, sampling);
            let wide = |panel: &&Panel| panel.half_u_m.length().min(panel.half_v_m.length()) >= 0.5 * MIN_SHADOW_M;
            scene.occluders.add(parts.panels.iter().filter(wide).filter_map(Occluder::of));
            let large = parts.panels.iter().filter(|panel| {
                panel.half_u_m.length().min(panel.half_v_m.length()) >= 0.5 * MIN_MIRROR_M
                    && panel.material.specular() >= MIN_MIRROR_REFLECTIVITY
            });
            scene.mirrors.extend(large.flat_map(Face::of));
        }
        scene
    }

    fn add(&mut self, parts: &Parts, number: u64, floor_reflectivity: f64, spacing_m: f64, sampling: &Sampling) {
        let mut rng = ChaCha8Rng::seed_from_u64(sampling.seed ^ 0x5CA7_7E25);
        rng.set_stream(number);
        for panel in &parts.panels {
            self.faces.extend(Face::of(panel));
            self.cloud.add_surface(panel, spacing_m, sampling.diffuse_factor, &mut rng);
        }
        self.cloud.add_fittings(&parts.corners, &mut rng);
        self.cloud.add_tube_ends(&parts.tubes, &mut rng);
        self.lines.extend(parts.edges.iter().map(Line::of_edge));
        self.lines.extend(parts.tubes.iter().map(Line::of_tube));
        self.lines.extend(parts.inner_edges.iter().map(Line::of_inner_edge));
        self.lines.extend(parts.floor_edges.iter().map(|edge| {
            let inward = (edge.outward + glam::DVec3::Y).normalize();
            let reflectivity = edge.reflectivity * floor_reflectivity;
            Line::of_inner_edge(&InnerEdge { ends_m: edge.ends_m, inward, reflectivity })
        }));
    }

    /// What is seen from about a pose, `room_from_sensor`; good for 50 ms and bodies that move.
    pub fn visibility(&self, sensor: &Pose, beam: &Beam, min_amplitude: f64, max_range_m: f64) -> Visibility {
        Visibility::new(self, sensor, beam, min_amplitude, max_range_m)
    }

    #[cfg(test)]
    /// Paths of at least `min_amplitude` and at most `max_range_m`, for the sensor at three times; `sensor` is
    /// room_from_sensor at them; `moving` are the bodies at the same three times. Deterministic, same order on every
    /// call.
    pub fn paths(
        &self,
        sensor: &[Pose; 3],
        moving: &MovingBodies,
        beam: &Beam,
        min_amplitude: f64,
        max_range_m: f64,
    ) -> Vec<EchoPath> {
        self.paths_seen(&self.visibility(&sensor[1], beam, min_amplitude, max_range_m), sensor, moving)
    }

    /// The same, with the visibility computed up to 50 ms before.
    pub fn paths_seen(&self, visibility: &Visibility, sensor: &[Pose; 3], moving: &MovingBodies) -> Vec<EchoPath> {
        let mut view = View::new(visibility, sensor, moving);
        self.add_direct(&mut view, visibility);
        view.add_bodies(self, moving);
        view.add_double_bounces();
        for link in &visibility.point_links {
            view.add_point_link(self, link);
        }
        for link in &visibility.line_links {
            view.add_line_link(self, link);
        }
        view.add_mirrored_bodies(self, moving);
        view.paths
    }

    /// The direct paths alone, of what stands still.
    pub fn direct_paths_seen(
        &self,
        visibility: &Visibility,
        sensor: &[Pose; 3],
        moving: &MovingBodies,
    ) -> Vec<EchoPath> {
        let mut view = View::new(visibility, sensor, moving);
        self.add_direct(&mut view, visibility);
        view.paths
    }

    fn add_direct(&self, view: &mut View, visibility: &Visibility) {
        view.add_faces(self);
        view.add_lines(self);
        for cluster in &visibility.clusters {
            view.add_cluster(self, cluster);
        }
    }

    /// Field transmission along a straight path between two points.
    pub fn transmission(&self, from_m: glam::DVec3, to_m: glam::DVec3) -> f64 {
        self.occluders.transmission(from_m, to_m)
    }

    /// Numbers of faces, lines, points and mirrors.
    #[cfg(test)]
    pub fn counts(&self) -> [usize; 4] {
        [self.faces.len(), self.lines.len(), self.cloud.points.len(), self.mirrors.len()]
    }
}

/// Whether the room continues behind a panel of its shell, as behind a pillar or where a wing begins. Other walls hide
/// nothing.
fn stands_free(panel: &Panel, shell: &Parts) -> bool {
    let normal = panel.normal();
    let behind = |point: glam::DVec3| normal.dot(point - panel.center_m) < -MAX_REVEAL_M;
    shell.panels.iter().any(|other| other.corners_m().into_iter().any(behind))
}

//! The paths of one frame, collected from one sensor position.

use glam::DVec3;

use radar_sar::geometry::Pose;

use super::beam_table::BeamTable;
use super::bodies::MovingBodies;
use super::mirrors::MIN_DIRECT_M;
use super::shadow::past_capsule;
use super::visibility::{Visibility, VisibleCluster, beam_bound};
use super::{EchoPath, EchoScene, HEADSET_ROOT_SIGMA_M, REFLECTION_PHASE_RAD};

/// A limb that shadows, with the cone about it.
struct ShadowLimb {
    ends_m: [DVec3; 2],
    radius_m: f64,
    direction: DVec3,
    cos_half_angle: f64,
    nearest_m: f64,
}

/// A sensor at the first, middle and last time, and the paths found so far.
pub(super) struct View<'v> {
    pub sensor_m: [DVec3; 3],
    pub forward: DVec3,
    pub beam: &'v BeamTable,
    pub min_amplitude: f64,
    pub max_range_m: f64,
    shadows: Vec<ShadowLimb>,
    pub paths: Vec<EchoPath>,
}

/// Beyond a body's border its shadow ends within this, metres. Choice: a Fresnel radius for an arm before the sensor.
const SHADOW_BORDER_M: f64 = 0.05;

impl<'v> View<'v> {
    pub fn new(visibility: &'v Visibility, sensor: &[Pose; 3], moving: &MovingBodies) -> Self {
        let sensor_m = sensor.map(|pose| pose.translation);
        let shadows = moving.limbs.iter().filter(|limb| limb.shadows).map(|limb| {
            let (middle_m, ends_m) = (0.5 * (limb.ends_m[0] + limb.ends_m[1]), limb.ends_m);
            let reach_m = 0.5 * ends_m[0].distance(ends_m[1]) + limb.radius_m + SHADOW_BORDER_M;
            let (to, distance_m) = (middle_m - sensor_m[1], middle_m.distance(sensor_m[1]));
            let sin = (reach_m / distance_m.max(1e-3)).min(1.0);
            ShadowLimb {
                ends_m,
                radius_m: limb.radius_m,
                direction: to / distance_m.max(1e-3),
                cos_half_angle: if sin < 1.0 { (1.0 - sin * sin).sqrt() } else { -1.0 },
                nearest_m: (distance_m - reach_m).max(0.0),
            }
        });
        let (min_amplitude, max_range_m) = (visibility.min_amplitude, visibility.max_range_m);
        Self {
            sensor_m,
            forward: sensor[1].forward(),
            beam: &visibility.beam,
            min_amplitude,
            max_range_m,
            shadows: shadows.collect(),
            paths: Vec::with_capacity(1024),
        }
    }

    /// Keeps a path that is strong and near enough.
    pub fn add(&mut self, range_m: [f64; 3], amplitude: f64, phase_rad: f64) {
        if amplitude >= self.min_amplitude && range_m[1] <= self.max_range_m {
            self.paths.push(EchoPath { range_m, amplitude, phase_rad });
        }
    }

    /// Cosine off the boresight of the direction to a place.
    pub fn cos_to(&self, place_m: DVec3) -> f64 {
        (place_m - self.sensor_m[1]).normalize_or(self.forward).dot(self.forward)
    }

    /// Field that passes the bodies on the way to a place.
    pub fn past_bodies(&self, place_m: DVec3) -> f64 {
        if self.shadows.is_empty() {
            return 1.0;
        }
        let to = place_m - self.sensor_m[1];
        let distance_m = to.length();
        let mut passes = 1.0;
        for limb in &self.shadows {
            if distance_m > limb.nearest_m && to.dot(limb.direction) > limb.cos_half_angle * distance_m {
                passes *= past_capsule(self.sensor_m[1], place_m, limb.ends_m, limb.radius_m);
            }
        }
        passes
    }

    /// Field that passes everything on the way to a place.
    pub fn transmission(&self, scene: &EchoScene, place_m: DVec3) -> f64 {
        let passes = self.past_bodies(place_m);
        if passes == 0.0 { 0.0 } else { passes * scene.occluders.transmission(self.sensor_m[1], place_m) }
    }

    pub fn add_faces(&mut self, scene: &EchoScene) {
        for face in &scene.faces {
            let Some((foot_m, distance_m, root_sigma_m)) = face.echo(self.sensor_m[1]) else { continue };
            let spread = root_sigma_m / (distance_m * distance_m);
            if distance_m > self.max_range_m || spread < self.min_amplitude {
                continue;
            }
            let amplitude = spread * self.beam.two_way(self.cos_to(foot_m));
            if amplitude >= self.min_amplitude {
                let amplitude = amplitude * self.transmission(scene, foot_m).powi(2);
                self.add(self.sensor_m.map(|s| face.distance_m(s)), amplitude, REFLECTION_PHASE_RAD);
            }
        }
    }

    pub fn add_lines(&mut self, scene: &EchoScene) {
        for line in &scene.lines {
            let Some(echo) = line.echo(self.sensor_m[1]) else { continue };
            if echo.range_m > self.max_range_m || echo.spread < self.min_amplitude {
                continue;
            }
            let amplitude = echo.spread * self.beam.two_way(self.cos_to(echo.point_m));
            if amplitude >= self.min_amplitude {
                let amplitude = amplitude * self.transmission(scene, echo.point_m).powi(2);
                self.add(self.sensor_m.map(|s| line.range_m(s)), amplitude, line.phase_rad());
            }
        }
    }

    pub fn add_cluster(&mut self, scene: &EchoScene, visible: &VisibleCluster) {
        let cluster = &scene.cloud.clusters[visible.index];
        let place = [self.sensor_m[1], self.forward];
        let (beam, nearest_m) = beam_bound(self.beam, place, cluster.center_m, cluster.radius_m, 0.0);
        let nearest_m = nearest_m.max(MIN_DIRECT_M);
        if nearest_m > self.max_range_m || cluster.max_root_sigma_m * beam < self.min_amplitude * nearest_m.powi(2) {
            return;
        }
        for (point, &transmission) in scene.cloud.points[cluster.points.clone()].iter().zip(&visible.transmission) {
            let to = point.position_m - self.sensor_m[1];
            let d2 = to.length_squared().max(MIN_DIRECT_M * MIN_DIRECT_M);
            let passes = f64::from(transmission);
            if point.root_sigma_m * beam * passes * passes < self.min_amplitude * d2 {
                continue;
            }
            let distance_m = d2.sqrt();
            let direction = to / distance_m;
            let lobe = point.lobe.towards(-direction);
            let amplitude =
                point.root_sigma_m * lobe * passes * passes * self.beam.two_way(direction.dot(self.forward)) / d2;
            if amplitude >= self.min_amplitude && distance_m <= self.max_range_m {
                let amplitude = amplitude * self.past_bodies(point.position_m).powi(2);
                self.add(self.sensor_m.map(|s| s.distance(point.position_m)), amplitude, point.phase_rad);
            }
        }
    }

    pub fn add_bodies(&mut self, scene: &EchoScene, moving: &MovingBodies) {
        for limb in &moving.limbs {
            let middle_m = 0.5 * (limb.ends_m[0] + limb.ends_m[1]);
            let (half_m, distance_m) =
                (0.5 * limb.ends_m[0].distance(limb.ends_m[1]), middle_m.distance(self.sensor_m[1]));
            let nearest_m = (distance_m - half_m - limb.radius_m).max(MIN_DIRECT_M);
            if distance_m < MIN_DIRECT_M || limb.max_root_sigma_m < self.min_amplitude * nearest_m * nearest_m {
                continue;
            }
            let passes = self.transmission(scene, middle_m).powi(2);
            for point in &moving.points[limb.points.clone()] {
                let to = point.at_m[1] - self.sensor_m[1];
                let d2 = to.length_squared().max(MIN_DIRECT_M * MIN_DIRECT_M);
                let direction = to / d2.sqrt();
                let lobe = (-point.normal.dot(direction)).max(0.0);
                let beam = self.beam.two_way(direction.dot(self.forward));
                let range_m = [0, 1, 2].map(|n| point.at_m[n].distance(self.sensor_m[n]));
                self.add(range_m, point.root_sigma_m * lobe * passes * beam / d2, point.phase_rad);
            }
        }
    }

    /// Double bounces between what echoes strongly and the headset, at twice the range of the direct paths so far.
    ///
    /// With the headset's cross-section σ_h, the radar equation applied twice gives the amplitude A² √σ_h/(4π), where
    /// A = √σ/d² is that of the direct echo (Physics).
    pub fn add_double_bounces(&mut self) {
        for n in 0..self.paths.len() {
            let EchoPath { range_m, amplitude, phase_rad } = self.paths[n];
            let twice = amplitude * amplitude * HEADSET_ROOT_SIGMA_M / (4.0 * std::f64::consts::PI);
            self.add(range_m.map(|r| 2.0 * r), twice, 2.0 * phase_rad + REFLECTION_PHASE_RAD);
        }
    }
}

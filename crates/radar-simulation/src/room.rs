//! Content of a simulated room: point scatterers, each with a lobe, and smooth walls that reflect
//! specularly.

use glam::DVec3;

use radar_sar::geometry::{Aabb, Plane, Pose};
use radar_sar::math;

/// A point scatterer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scatterer {
    /// Position, tracking frame, metres.
    pub position_m: DVec3,
    /// Radar cross-section at the centre of its lobe, dBsm.
    pub rcs_dbsm: f64,
    /// Direction of its lobe; zero for an isotropic scatterer.
    pub lobe: DVec3,
    /// Phase added by the reflection, radians.
    pub phase_rad: f64,
}

/// Two-way loss of a lobe at 90° from its centre, dB. Choice: edges and tubes reflect best to one
/// side; no measurement of furniture at 60 GHz was found.
const LOBE_FALL_AT_90_DEG_DB: f64 = 8.0;
/// Highest loss of a lobe, dB. Choice: no part of furniture vanishes entirely from behind.
const LOBE_FLOOR_DB: f64 = 15.0;

impl Scatterer {
    /// Radar cross-section towards a direction (unit vector from the scatterer to the sensor),
    /// dBsm.
    pub fn rcs_towards_dbsm(&self, to_sensor: DVec3) -> f64 {
        if self.lobe == DVec3::ZERO {
            return self.rcs_dbsm;
        }
        let angle = math::acos(self.lobe.normalize().dot(to_sensor).clamp(-1.0, 1.0)) / std::f64::consts::FRAC_PI_2;
        self.rcs_dbsm - (LOBE_FALL_AT_90_DEG_DB * angle * angle).min(LOBE_FLOOR_DB)
    }

    /// The same scatterer in another frame.
    fn moved(&self, to_from: &Pose) -> Self {
        let (position_m, lobe) = (to_from.transform_point(self.position_m), to_from.transform_vector(self.lobe));
        Self { position_m, lobe, ..*self }
    }
}

/// A named group of scatterers, such as a chair or a table.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneObject {
    /// Its name.
    pub name: String,
    /// Its scatterers.
    pub scatterers: Vec<Scatterer>,
}

impl SceneObject {
    /// The same object in another frame; `to_from` transforms from the current frame.
    pub fn moved(&self, to_from: &Pose) -> Self {
        let scatterers = self.scatterers.iter().map(|scatterer| scatterer.moved(to_from)).collect();
        Self { name: self.name.clone(), scatterers }
    }
}

/// A smooth wall, floor or ceiling; its only echo comes from the foot of the perpendicular from the
/// sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct WallPanel {
    /// Its name.
    pub name: String,
    /// Its plane; the normal points out of the room.
    pub plane: Plane,
    /// Its extent, a flat box.
    pub extent: Aabb,
    /// Reflected power at normal incidence, dB (about −10 for plasterboard).
    pub reflection_db: f64,
}

impl WallPanel {
    /// Cross-section of a point that would return as much as an infinite mirror at this distance: π
    /// d² |Γ|², dBsm.
    pub fn equivalent_rcs_dbsm(&self, distance_m: f64) -> f64 {
        10.0 * math::log10(std::f64::consts::PI * distance_m * distance_m) + self.reflection_db
    }
}

/// A room.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Room {
    /// Its objects.
    pub things: Vec<SceneObject>,
    /// Its walls, floor and ceiling.
    pub walls: Vec<WallPanel>,
}

impl Room {
    /// All scatterers.
    pub fn scatterers(&self) -> impl Iterator<Item = &Scatterer> {
        self.things.iter().flat_map(|t| &t.scatterers)
    }

    /// Smallest distance from a point to any scatterer, metres; infinite in an empty room.
    pub fn clearance_m(&self, point: DVec3) -> f64 {
        self.scatterers().map(|s| s.position_m.distance(point)).fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lobe_falls_off_from_its_axis() {
        let scatterer = Scatterer { position_m: DVec3::ZERO, rcs_dbsm: -10.0, lobe: DVec3::Z, phase_rad: 0.0 };
        assert_eq!(scatterer.rcs_towards_dbsm(DVec3::Z), -10.0);
        assert!((scatterer.rcs_towards_dbsm(DVec3::X) + 18.0).abs() < 1e-9);
        assert_eq!(scatterer.rcs_towards_dbsm(DVec3::NEG_Z), -25.0);
    }

    #[test]
    fn wall_echo_loses_6_db_per_doubling_of_distance() {
        let wall = WallPanel {
            name: String::new(),
            plane: Plane { outward: DVec3::Z, offset_m: 1.0 },
            extent: Aabb { min: DVec3::ZERO, max: DVec3::ONE },
            reflection_db: 0.0,
        };
        let power = |d: f64| wall.equivalent_rcs_dbsm(d) - 40.0 * d.log10();
        assert!((power(1.0) - power(2.0) - 6.02).abs() < 0.01);
    }
}

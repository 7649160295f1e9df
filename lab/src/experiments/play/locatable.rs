//! Whether the echoes of an object could have located it: the bound for any reconstruction with this sensor.

use glam::{DMat3, DVec3};

use radar_sar::geometry::Pose;
use radar_sar::{WAVELENGTH_M, outer};

/// Least number of strong echoes. Choice: the mapper's; one or two are noise as well.
const MIN_ECHOES: usize = 3;
/// Greatest 1σ of a place, all directions together, metres. Choice: within this a report counts as that of the object.
const MAX_SIGMA_M: f64 = 0.25;

/// The echoes of one object that were strong enough, and what they told of its place.
#[derive(Debug)]
pub(super) struct Locatable {
    echoes: usize,
    /// 1/m².
    information: DMat3,
}

impl Default for Locatable {
    fn default() -> Self {
        Self { echoes: 0, information: DMat3::IDENTITY * 1e-6 }
    }
}

impl Locatable {
    /// Takes the echo of a sub-aperture that was strong enough; `displacement_m`: of the sensor, from beginning to end.
    pub fn push(&mut self, sensor: &Pose, displacement_m: DVec3, object: DVec3, range_sigma_m: f64) {
        self.echoes += 1;
        self.information += information(sensor, displacement_m, object, range_sigma_m);
    }

    /// Whether the echoes so far have located it.
    pub fn is_reached(&self) -> bool {
        let covariance = self.information.inverse();
        let variance_m2 = covariance.x_axis.x + covariance.y_axis.y + covariance.z_axis.z;
        self.echoes >= MIN_ECHOES && variance_m2 <= MAX_SIGMA_M * MAX_SIGMA_M
    }
}

/// Information of a sub-aperture, 1/m²: from its range, and from the direction against its displacement, which λ/4 of
/// change in the difference of ranges to its ends tells.
fn information(sensor: &Pose, displacement_m: DVec3, object: DVec3, range_sigma_m: f64) -> DMat3 {
    let offset = object - sensor.translation;
    let (toward, range_m) = (offset.normalize_or_zero(), offset.length().max(1e-3));
    let across = (displacement_m - toward * toward.dot(displacement_m)) * (4.0 / (WAVELENGTH_M * range_m));
    outer(toward) * range_sigma_m.powi(-2) + outer(across)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether a head on this path locates an object 1.5 m ahead.
    fn is_located(seconds: f64, path: impl Fn(f64) -> DVec3) -> bool {
        let mut locatable = Locatable::default();
        for n in 0..(seconds / 0.09) as u32 {
            let at = |s: f64| path(0.09 * f64::from(n) + s);
            let sensor = Pose { translation: at(0.045), ..Pose::IDENTITY };
            let displacement_m = at(0.09) - at(0.0);
            locatable.push(&sensor, displacement_m, DVec3::NEG_Z * 1.5, 0.07);
        }
        locatable.is_reached()
    }

    #[test]
    fn only_a_path_with_a_bend_locates() {
        assert!(!is_located(3.0, |_| DVec3::ZERO), "at rest the range alone is known");
        assert!(!is_located(3.0, |t| DVec3::X * 0.4 * t), "a straight path leaves a circle around itself");
        assert!(is_located(3.0, |t| DVec3::new((2.0 * t).sin(), (2.0 * t).cos(), 0.0) * 0.15));
        assert!(!is_located(0.2, |t| DVec3::new((9.0 * t).sin(), (9.0 * t).cos(), 0.0) * 0.15), "two echoes");
    }
}

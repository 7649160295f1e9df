//! Uncertainty volume of one window of the vendor's detector, and of our covariance.

use glam::DVec3;

use super::MAX_OFF_BORESIGHT_DEG;
use super::detector_run::{WindowWithTruth, angle_deg};
use radar_sar::math;
use radar_sar::{Refined, eigen};

/// Accuracy of the detector on a straight path, one standard deviation.
#[derive(Clone, Copy)]
pub(super) struct DetectorAccuracy {
    pub distance_m: f64,
    pub velocity_m_per_s: f64,
}

/// Possible positions after one window: a ring around the path, as far as it lies in the beam.
#[derive(Clone, Copy)]
pub(super) struct UncertaintyRing {
    /// Length, metres.
    pub length_m: f64,
    /// Volume within one standard deviation of range and speed, cm³.
    pub cm3: f64,
}

pub(super) fn ring(sight: &WindowWithTruth, point: DVec3, right: DetectorAccuracy) -> UncertaintyRing {
    let (distance_m, speed) = (sight.distance_m(point), sight.speed_m_per_s());
    let cos = math::cos(sight.angle_deg(point).to_radians());
    let half = right.velocity_m_per_s / speed;
    let band = (cos + half).min(1.0) - (cos - half).max(-1.0);
    let along = sight.sensor.velocity_m_per_s.normalize_or(DVec3::Z);
    let (a, b) = along.any_orthonormal_pair();
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    /// Corners of the drawn ring. Choice: it looks round.
    const PARTS: usize = 180;
    let on_ring = |n: usize| {
        let (y, x) = math::sin_cos(n as f64 / PARTS as f64 * std::f64::consts::TAU);
        along * cos + (a * x + b * y) * sin
    };
    let forward = sight.sensor.tracking_from_sensor.forward();
    let in_beam = (0..PARTS).filter(|&n| angle_deg(forward, on_ring(n)) < MAX_OFF_BORESIGHT_DEG).count().max(1);
    let steradians = std::f64::consts::TAU * band * in_beam as f64 / PARTS as f64;
    UncertaintyRing {
        length_m: std::f64::consts::TAU * distance_m * sin * in_beam as f64 / PARTS as f64,
        cm3: distance_m * distance_m * 2.0 * right.distance_m * steradians * 1e6,
    }
}

/// Volume within one standard deviation along each of the covariance's axes, cm³.
pub(super) fn box_cm3(refined: &Refined) -> f64 {
    8.0 * refined.covariance_m2.determinant().max(0.0).sqrt() * 1e6
}

/// Two standard deviations along the covariance's longest axis, metres.
pub(super) fn longest_m(refined: &Refined) -> f64 {
    2.0 * eigen(&refined.covariance_m2).0.into_iter().fold(0.0, f64::max).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::ROBOT;
    use super::super::detector_run::DetectorRun;
    use super::*;
    use crate::baselines::DetectorConfig;

    #[test]
    fn uncertainty_ring_is_the_shell_between_two_cones() {
        let config = DetectorConfig::default();
        let watched = DetectorRun::of("corner-reflector", ROBOT.0, &config, 2.2, 1).unwrap();
        let point = watched.recorded.truth_m;
        let sight = watched.detectable(&config, point).last().unwrap();
        let right = DetectorAccuracy { distance_m: 0.01, velocity_m_per_s: 0.003 };
        // At 0.3 m/s the cosine is known to ±0.01. The whole ring is in the beam, since the robot
        // faces its path.
        let cm3 = std::f64::consts::TAU * 0.02 * sight.distance_m(point).powi(2) * 0.02 * 1e6;
        let ring = ring(sight, point, right);
        assert!((ring.cm3 / cm3 - 1.0).abs() < 1e-6);
        // The reflector is 30 cm beside the path.
        assert!((ring.length_m - std::f64::consts::TAU * 0.3).abs() < 0.01);
        assert!((sight.angle_deg(point) - sight.off_boresight_deg(point)).abs() < 0.1);
    }
}

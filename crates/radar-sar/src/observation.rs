//! A sweep with the sensor's pose: the input of imaging.

use std::sync::Arc;

use glam::DVec3;
use num_complex::Complex32;

use super::RangeAxis;
use crate::geometry::Pose;

/// Geometry that all observations of a subsweep share.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepGeometry {
    /// Index of the subsweep in the configuration.
    pub subsweep: usize,
    /// Ranges of its points.
    pub axis: RangeAxis,
    /// Its pulse profile.
    pub pulse_fwhm_m: f64,
    /// Time between points, seconds.
    pub point_period_s: f64,
}

/// One subsweep of one sweep with the sensor's pose. Only valid data become observations: finite,
/// unsaturated, with a valid pose.
#[derive(Debug, Clone)]
pub struct Observation {
    /// Time of the middle of the sweep, host nanoseconds.
    pub mid_time_ns: i64,
    /// Pose at that time.
    pub tracking_from_sensor: Pose,
    /// Velocity of the phase centre at that time, tracking frame, m/s. The points of a sweep are
    /// measured one after the other: point n at `(n − (points − 1)/2) · point_period_s` from the
    /// middle.
    pub velocity_m_per_s: DVec3,
    /// Range axis, pulse and timing.
    pub geometry: Arc<SweepGeometry>,
    /// Complex samples, LSB, as stored; one per point of the axis.
    pub samples: Vec<Complex32>,
}

impl Observation {
    /// Time of a (fractional) point from the middle of the sweep, seconds.
    #[inline]
    pub fn point_time_s(&self, point: f64) -> f64 {
        (point - (self.geometry.axis.points as f64 - 1.0) / 2.0) * self.geometry.point_period_s
    }

    /// When its last point was measured, host nanoseconds.
    #[inline]
    pub fn end_ns(&self) -> i64 {
        let half_s = self.point_time_s(self.geometry.axis.points as f64 - 1.0);
        self.mid_time_ns.saturating_add((half_s * 1e9).round() as i64)
    }

    /// Distance to a point in space, metres, from where the sensor was when it sampled that range;
    /// the sensor moves during a sweep. Two fixed-point iterations suffice below 100 m/s.
    #[inline]
    pub fn distance_m(&self, place: DVec3) -> f64 {
        let from_mid = place - self.tracking_from_sensor.translation;
        let mut distance = from_mid.length();
        for _ in 0..2 {
            let time_s = self.point_time_s(self.geometry.axis.point_at(distance));
            distance = (from_mid - self.velocity_m_per_s * time_s).length();
        }
        distance
    }

    /// Cosine of the angle between the boresight and the direction to a point; 1 at the sensor's
    /// own position.
    #[inline]
    pub fn cos_off_boresight(&self, place: DVec3) -> f64 {
        let to = place - self.tracking_from_sensor.translation;
        let length = to.length();
        if length == 0.0 { 1.0 } else { to.dot(self.tracking_from_sensor.forward()) / length }
    }
}

//! A sweep and where the sensor was: what imaging works on.

use std::sync::Arc;

use glam::DVec3;
use num_complex::Complex32;

use super::RangeAxis;
use crate::geometry::Pose;

/// What all observations of one subsweep share.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepGeometry {
    /// Which subsweep of the configuration.
    pub subsweep: usize,
    /// Where its points lie.
    pub axis: RangeAxis,
    /// Full width at half maximum of the pulse's amplitude envelope, metres.
    pub pulse_fwhm_m: f64,
    /// Time from point to point, seconds.
    pub point_period_s: f64,
}

/// One subsweep of one sweep with the sensor's pose. Only sound data become one: finite, unsaturated, with a valid pose.
#[derive(Debug, Clone)]
pub struct Observation {
    /// Time of the middle of the sweep, host nanoseconds.
    pub mid_time_ns: i64,
    /// Pose at that time.
    pub tracking_from_sensor: Pose,
    /// Velocity of the phase centre at that time, tracking frame, m/s. Points were measured one after the other: point n
    /// lies at `(n − (points − 1)/2) · point_period_s` from the middle.
    pub velocity_m_per_s: DVec3,
    /// Range axis, pulse, timing.
    pub geometry: Arc<SweepGeometry>,
    /// Complex samples, LSB, as stored; one for each point of the axis.
    pub samples: Vec<Complex32>,
}

impl Observation {
    /// Time of a (fractional) point, seconds from the middle of the sweep.
    pub fn point_time_s(&self, point: f64) -> f64 {
        (point - (self.geometry.axis.points as f64 - 1.0) / 2.0) * self.geometry.point_period_s
    }

    /// When its last point was measured, host nanoseconds.
    pub fn end_ns(&self) -> i64 {
        let half_s = self.point_time_s(self.geometry.axis.points as f64 - 1.0);
        self.mid_time_ns.saturating_add((half_s * 1e9).round() as i64)
    }

    /// Distance to a place as the point that saw it measured it, metres: the sensor moves during a sweep, so the distance
    /// is taken from where the sensor was when the point at that range was sampled. Two steps of the fixed point suffice
    /// below 100 m/s.
    pub fn distance_m(&self, place: DVec3) -> f64 {
        let from_mid = place - self.tracking_from_sensor.translation;
        let mut distance = from_mid.length();
        for _ in 0..2 {
            let time_s = self.point_time_s(self.geometry.axis.point_at(distance));
            distance = (from_mid - self.velocity_m_per_s * time_s).length();
        }
        distance
    }

    /// Cosine of the angle between the boresight and the direction to a place; 1 when they coincide with the sensor.
    pub fn cos_off_boresight(&self, place: DVec3) -> f64 {
        let to = place - self.tracking_from_sensor.translation;
        let length = to.length();
        if length == 0.0 { 1.0 } else { to.dot(self.tracking_from_sensor.forward()) / length }
    }
}

//! Motions of a sensor on a machine: a swinging arm that rotates about one axis (thesis, 3.6) and a
//! robot arm that scans a plane row by row (thesis, 6.3). Poses are offsets in the frame of the
//! sensor at the start.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

use super::smooth::smoothstep;
use radar_sar::geometry::Pose;
use radar_sar::math;

/// Length of the arm, metres. Source: thesis, 3.6.
pub const ARM_M: f64 = 0.30;
/// Amplitude of the swing to either side, rad. Choice: the sensor passes over a third of a circle,
/// and a reflector ahead stays in its beam.
const SWING_RAD: f64 = std::f64::consts::FRAC_PI_3;
/// Period of a swing, seconds. Choice: a peak speed of about 0.5 m/s, which every preset's sweep
/// rate follows.
const SWING_S: f64 = 4.0;
/// Sharpness of the turning points: 1 is abrupt, lower is softer. Choice: near to the constant
/// speed of a stepper motor, without the infinite acceleration of 1.
const SHARPNESS: f64 = 0.95;
/// Time at rest before the swing, and time to fade it in, seconds. Choice: inertial reckoning
/// estimates its biases at rest; a jump would shake the simulated IMU.
pub const ARM_REST_S: f64 = 2.0;
const FADE_IN_S: f64 = 0.5;

/// A sensor at the tip of an upright arm that a motor swings to either side at an almost constant
/// angular velocity. The axis points ahead, in the sensor's viewing direction, so objects ahead
/// stay in its beam.
pub(super) fn swinging_arm(time_s: f64) -> Pose {
    let since_s = (time_s - ARM_REST_S).max(0.0);
    let swing = math::asin(SHARPNESS * math::sin(TAU * since_s / SWING_S)) / math::asin(SHARPNESS);
    let turn = DQuat::from_rotation_z(SWING_RAD * swing * smoothstep(since_s / FADE_IN_S));
    Pose::new(turn * (DVec3::Y * ARM_M) - DVec3::Y * ARM_M, turn)
}

/// Raster: number of rows, their length and spacing, metres; time per row and per change of row,
/// seconds. Choice: a plane of 0.5 m by 0.5 m in eleven seconds; closer rows take longer.
const ROWS: usize = 9;
const ROW_M: f64 = 0.5;
const ROW_SPACING_M: f64 = 0.0625;
const ROW_S: f64 = 1.0;
const ROW_CHANGE_S: f64 = 0.2;

/// A raster over a plane across the boresight, forth and back over the rows, without rotation.
pub(super) fn raster(time_s: f64) -> Pose {
    let step_s = ROW_S + ROW_CHANGE_S;
    let rows = 2 * (ROWS - 1);
    let at = time_s.max(0.0) / step_s;
    let (row, within_s) = (at.floor(), at.fract() * step_s);
    let coordinate_m = |n: f64| {
        let n = n.rem_euclid(rows as f64);
        n.min(rows as f64 - n)
    };
    let [this, next] =
        [coordinate_m(row), coordinate_m(row + 1.0)].map(|row| (row - 0.5 * (ROWS - 1) as f64) * ROW_SPACING_M);
    let up = this + (next - this) * smoothstep((within_s - ROW_S) / ROW_CHANGE_S);
    let side = if row.rem_euclid(2.0) < 1.0 { 1.0 } else { -1.0 };
    let along = side * ROW_M * (smoothstep(within_s / ROW_S) - 0.5);
    Pose::from_translation(DVec3::new(along, up, 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arm_tip_stays_on_its_arc() {
        assert_eq!(swinging_arm(1.9), Pose::IDENTITY);
        let axis = DVec3::NEG_Y * ARM_M;
        let angle = |t: f64| swinging_arm(t).rotation.to_scaled_axis().z;
        let rates: Vec<f64> =
            (300..1000).map(|n| f64::from(n) * 0.01).map(|t| (angle(t + 1e-3) - angle(t)) / 1e-3).collect();
        for n in 0..1000 {
            let pose = swinging_arm(f64::from(n) * 0.01);
            assert!((pose.translation.distance(axis) - ARM_M).abs() < 1e-12);
            assert!((pose.rotation * DVec3::NEG_Z).distance(DVec3::NEG_Z) < 1e-12, "it looks ahead");
        }
        let even = rates.iter().filter(|rate| (rate.abs() - 1.0).abs() < 0.25).count();
        assert!(even > rates.len() / 2, "{even} of {}", rates.len());
        assert!(rates.iter().all(|rate| rate.abs() < 2.0));
    }

    #[test]
    fn raster_is_planar_and_continuous() {
        let positions: Vec<DVec3> = (0..2500).map(|n| raster(f64::from(n) * 0.01).translation).collect();
        assert!(positions.windows(2).all(|pair| pair[0].distance(pair[1]) < 0.012));
        let reach = |axis: fn(&DVec3) -> f64| positions.iter().map(axis).fold(0.0, f64::max);
        assert!(
            (reach(|p| p.x) - 0.25).abs() < 1e-6 && (reach(|p| p.y) - 0.25).abs() < 1e-6 && reach(|p| p.z.abs()) == 0.0
        );
    }
}

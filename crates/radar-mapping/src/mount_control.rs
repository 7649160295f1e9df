//! When an estimate of the mount is applied.

use glam::{DQuat, DVec3};
use radar_sar::geometry::Pose;
use radar_sar::{Boresight, Calibration, EchoDirections};

use super::mount_estimate::MIN_CONTRADICTION_RAD;
use super::{MountCounters, MountEstimate, MountInUse};

/// An axis is corrected once its 1σ is at most this, metres. Choice: what measuring by eye leaves.
const MAX_SIGMA_M: f64 = 10e-3;
/// The mount is changed when an axis is wrong by this much, metres, and by this many 1σ. Choice: 5 mm blur no image and
/// misplace nothing by more, and each change images the last seconds again; 4σ, because jumps of the tracking leave errors
/// larger than a Gaussian's.
const MIN_CHANGE_M: f64 = 5e-3;
const SIGNIFICANT: f64 = 4.0;
/// An axis that differs by this many 1σ hints at a change. Choice: one of twenty honest estimates does.
const HINT: f64 = 2.0;
/// Least time between two changes, nanoseconds. Choice: the window that is imaged again, and a little more.
const PAUSE_NS: i64 = 5_000_000_000;

/// A mount of an earlier session that is farther from the assumed one than this is not believed, metres. Choice: five times
/// the search's 1σ.
const MAX_RESUMED_M: f64 = 0.25;

/// The mount in use, and its last estimate.
#[derive(Debug)]
pub(crate) struct MountControl {
    assumed: Pose,
    /// Whether estimates are applied.
    is_applied: bool,
    /// Shift of the mount in use against the assumed one, in the sensor's axes, metres.
    shift_m: DVec3,
    /// Its rotation, `head_from_sensor`.
    rotation: DQuat,
    estimate: Option<MountEstimate>,
    /// Whether more tracks may show that the sensor faces elsewhere.
    hints_at_turn: bool,
    next_change_ns: Option<i64>,
    counters: MountCounters,
}

impl MountControl {
    pub fn new(head_from_sensor: &Pose, is_applied: bool) -> Self {
        Self {
            assumed: *head_from_sensor,
            is_applied,
            shift_m: DVec3::ZERO,
            rotation: head_from_sensor.rotation,
            estimate: None,
            hints_at_turn: false,
            next_change_ns: None,
            counters: MountCounters::default(),
        }
    }

    /// The mount in use, `head_from_sensor`.
    pub fn in_use(&self) -> Pose {
        Pose { translation: self.assumed.transform_point(self.shift_m), rotation: self.rotation }
    }

    /// With the last estimate.
    pub fn state(&self) -> MountInUse {
        MountInUse { assumed: self.assumed, in_use: self.in_use(), estimate: self.estimate }
    }

    /// Begins from what an earlier session had in use, unless another mount was assumed then, it is no place on a head, or
    /// nothing is to be applied.
    pub fn resume(&mut self, earlier: &MountInUse) {
        let shift_m = (self.assumed.inverse() * earlier.in_use).translation;
        let turn = earlier.assumed.rotation.dot(self.assumed.rotation).abs();
        // Text rounds numbers.
        let is_same = earlier.assumed.translation.distance(self.assumed.translation) < 1e-6 && 1.0 - turn < 1e-9;
        if self.is_applied && is_same && shift_m.length() <= MAX_RESUMED_M && earlier.in_use.rotation.is_normalized() {
            (self.shift_m, self.rotation) = (shift_m, earlier.in_use.rotation);
        }
    }

    pub fn counters(&self) -> MountCounters {
        self.counters
    }

    /// Takes an estimate. Returns the distance that the sensor moves, metres, when the mount in use changes.
    pub fn update(&mut self, now_ns: i64, found: &Calibration, directions: &EchoDirections) -> Option<f64> {
        let estimate = MountEstimate::new(&self.assumed, found, directions);
        self.estimate = Some(estimate);
        let turn_rad =
            |found: Boresight| self.assumed.transform_vector(found.direction).angle_between(self.in_use().forward());
        self.hints_at_turn = directions.boresight.is_some_and(|found| turn_rad(found) > MIN_CONTRADICTION_RAD);
        // Backward times must not lengthen the pause.
        self.next_change_ns.take_if(|next_ns| next_ns.saturating_sub(now_ns) > PAUSE_NS);
        // With wrong poses the estimate means nothing.
        let is_usable = self.is_applied && directions.pose_mistake.is_none();
        if !is_usable || self.next_change_ns.is_some_and(|next_ns| now_ns < next_ns) {
            return None;
        }
        let wanted_m = self.wanted_m(found);
        let is_wrong = |axis: usize| {
            let bound_m = MIN_CHANGE_M.max(SIGNIFICANT * sigma_m(found, axis));
            (wanted_m[axis] - self.shift_m[axis]).abs() > bound_m
        };
        let is_turned = estimate.boresight.is_some_and(|boresight| boresight.observed)
            && MountEstimate { assumed: self.in_use(), ..estimate }.contradicts_direction();
        if is_turned {
            self.rotation = estimate.turned();
            self.hints_at_turn = false;
        }
        let is_shifted = (0..3).any(is_wrong);
        let moved_m = if is_shifted { wanted_m.distance(self.shift_m) } else { 0.0 };
        if is_shifted {
            self.shift_m = wanted_m;
        }
        (is_turned || is_shifted).then(|| {
            self.next_change_ns = Some(now_ns.saturating_add(PAUSE_NS));
            self.counters.changes += 1;
            moved_m
        })
    }

    /// The shift in use with the estimate's in the axes that are known.
    fn wanted_m(&self, found: &Calibration) -> DVec3 {
        let mut wanted_m = self.shift_m;
        for axis in (0..3).filter(|&axis| sigma_m(found, axis) <= MAX_SIGMA_M) {
            wanted_m[axis] = found.mount_shift_m[axis];
        }
        wanted_m
    }

    /// Whether neither an axis of an estimate nor the direction hints at a change that more data would make certain.
    pub fn is_settled(&self, found: &Calibration) -> bool {
        let off_m = found.mount_shift_m - self.shift_m;
        let is_near = |axis: usize| off_m[axis].abs() <= MIN_CHANGE_M.max(HINT * sigma_m(found, axis));
        !self.is_applied || (!self.hints_at_turn && (0..3).all(is_near))
    }
}

/// 1σ along an axis of the sensor, metres.
fn sigma_m(found: &Calibration, axis: usize) -> f64 {
    found.mount_covariance_m2.col(axis)[axis].sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DQuat};
    use radar_sar::{PoseMistake, TimeOffset};

    const S: i64 = 1_000_000_000;
    const NONE: EchoDirections = EchoDirections { boresight: None, pose_mistake: None };

    fn found(shift_m: DVec3, sigma_m: DVec3) -> Calibration {
        let time_offset = TimeOffset { offset_s: 0.0, sigma_s: 1e-3, observable: true, tracks: 9, tracks_left_out: 0 };
        Calibration {
            time_offset,
            mount_shift_m: shift_m,
            mount_covariance_m2: DMat3::from_diagonal(sigma_m * sigma_m),
            range_bias_m: 0.0,
            range_bias_sigma_m: 3e-3,
            drift_m: 1e-3,
        }
    }

    #[test]
    fn known_axes_are_corrected_in_the_heads_frame_and_others_left() {
        let assumed = Pose::new(DVec3::new(0.0, 0.02, -0.1), DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2));
        let mut mount = MountControl::new(&assumed, true);
        let moved_m = mount.update(0, &found(DVec3::new(0.03, 0.02, -0.04), DVec3::new(2e-3, 20e-3, 6e-3)), &NONE);
        assert!((moved_m.unwrap() - 0.05).abs() < 1e-12, "{moved_m:?}");
        // The sensor's x axis is the head's −z axis, its z axis the head's x axis.
        let expected_m = assumed.translation + DVec3::new(-0.04, 0.0, -0.03);
        assert!(mount.in_use().translation.distance(expected_m) < 1e-12, "{:?}", mount.in_use());
        assert_eq!(mount.in_use().rotation, assumed.rotation);
        assert_eq!(mount.state().estimate.unwrap().observed, [true, false, true]);
    }

    #[test]
    fn small_uncertain_and_frequent_changes_are_not_made() {
        let mut mount = MountControl::new(&Pose::IDENTITY, true);
        let sharp = DVec3::splat(1e-3);
        assert_eq!(mount.update(0, &found(DVec3::splat(4e-3), sharp), &NONE), None, "small");
        assert_eq!(mount.update(S, &found(DVec3::splat(15e-3), DVec3::splat(4e-3)), &NONE), None, "uncertain");
        assert!(mount.update(2 * S, &found(DVec3::X * 20e-3, sharp), &NONE).is_some());
        assert_eq!(mount.update(3 * S, &found(DVec3::X * 30e-3, sharp), &NONE), None, "so soon");
        assert!(mount.update(8 * S, &found(DVec3::X * 30e-3, sharp), &NONE).is_some());
        assert_eq!(mount.counters().changes, 2);
        assert!(mount.is_settled(&found(DVec3::new(32e-3, 9e-3, 0.0), DVec3::splat(5e-3))));
        assert!(!mount.is_settled(&found(DVec3::new(32e-3, 11e-3, 0.0), DVec3::splat(5e-3))), "it may be wrong");
        let mut fixed = MountControl::new(&Pose::IDENTITY, false);
        assert_eq!(fixed.update(0, &found(DVec3::X * 50e-3, sharp), &NONE), None);
        assert!(fixed.state().is_contradicted() && fixed.in_use() == Pose::IDENTITY);
    }

    #[test]
    fn a_sensor_that_faces_elsewhere_is_turned_once_that_is_certain() {
        let assumed = Pose::new(DVec3::new(0.0, 0.02, -0.1), DQuat::from_rotation_y(0.3));
        let mut mount = MountControl::new(&assumed, true);
        let nothing = found(DVec3::ZERO, DVec3::splat(1e-3));
        // To the left in the sensor's axes.
        let facing = |angle_rad: f64, observable: bool| {
            let direction = DQuat::from_rotation_y(angle_rad) * DVec3::NEG_Z;
            let boresight = Boresight { direction, sigma_rad: 0.11, tracks: 30, observable };
            EchoDirections { boresight: Some(boresight), pose_mistake: None }
        };
        assert_eq!(mount.update(0, &nothing, &facing(0.7, true)), None, "small");
        assert!(mount.is_settled(&nothing));
        assert_eq!(mount.update(S, &nothing, &facing(1.5, false)), None, "not observed");
        assert!(!mount.is_settled(&nothing), "it may face elsewhere");
        assert!(mount.state().is_contradicted(), "shown, not applied");
        let wrong_poses = EchoDirections { pose_mistake: Some(PoseMistake::MirroredX), ..facing(1.5, true) };
        assert_eq!(mount.update(9 * S, &found(DVec3::X, DVec3::splat(1e-3)), &wrong_poses), None);
        for turn_rad in [1.5, std::f64::consts::PI] {
            let mut mount = MountControl::new(&assumed, true);
            assert_eq!(mount.update(0, &nothing, &facing(turn_rad, true)), Some(0.0), "{turn_rad}");
            let expected = assumed.transform_vector(facing(turn_rad, true).boresight.unwrap().direction);
            assert!(mount.in_use().forward().angle_between(expected) < 1e-6);
            assert!((mount.state().correction_rad() - turn_rad).abs() < 1e-6);
            assert!(mount.in_use().translation.distance(assumed.translation) < 1e-12);
            assert!(!mount.state().is_contradicted());
            assert_eq!(mount.update(9 * S, &nothing, &facing(turn_rad, true)), None);
        }
    }

    #[test]
    fn the_mount_of_an_earlier_session_is_resumed_while_the_assumed_one_stays() {
        let assumed = Pose::new(DVec3::new(0.0, 0.02, -0.1), DQuat::from_rotation_y(0.3));
        let mut before = MountControl::new(&assumed, true);
        assert!(before.update(0, &found(DVec3::X * 30e-3, DVec3::splat(1e-3)), &NONE).is_some());
        let after = |assumed: Pose, is_applied: bool| {
            let mut mount = MountControl::new(&assumed, is_applied);
            mount.resume(&before.state());
            mount.state().correction_m()
        };
        assert!((after(assumed, true) - 30e-3).abs() < 1e-12);
        assert_eq!([after(Pose::IDENTITY, true), after(assumed, false)], [0.0, 0.0]);
        let turned = Pose { rotation: DQuat::from_rotation_y(1.8), ..before.in_use() };
        let mut mount = MountControl::new(&assumed, true);
        mount.resume(&MountInUse { in_use: turned, ..before.state() });
        assert!((mount.state().correction_rad() - 1.5).abs() < 1e-6);
        let no_rotation = Pose { rotation: DQuat::from_xyzw(f64::NAN, 0.0, 0.0, 1.0), ..turned };
        let mut mount = MountControl::new(&assumed, true);
        mount.resume(&MountInUse { in_use: no_rotation, ..before.state() });
        assert_eq!(mount.in_use(), assumed);
        for bad_m in [DVec3::X, DVec3::NAN] {
            let mut mount = MountControl::new(&assumed, true);
            mount.resume(&MountInUse { in_use: Pose::from_translation(bad_m), ..before.state() });
            assert_eq!(mount.in_use(), assumed);
        }
    }
}

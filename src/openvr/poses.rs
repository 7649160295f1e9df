//! Poses of the headset and the controllers.
//!
//! Can be read at any time from any thread. The radar uses the pose 0 s ahead, which is the current
//! one. Drawing uses the pose at the time when the light leaves the display
//! ([`Runtime::time_to_photons_s`]).

use glam::DVec3;

use super::matrix::pose;
use super::runtime::{Runtime, call};
use super::sys;
use radar_sar::geometry::Pose;

/// Reference frame of positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Universe {
    /// The play area: y = 0 on the floor. Moves when the user recentres.
    Standing,
    /// The tracking system's own frame: recentring does not move it.
    Raw,
}

impl Universe {
    pub(super) fn origin(self) -> sys::ETrackingUniverseOrigin {
        match self {
            Self::Standing => sys::ETrackingUniverseOrigin_TrackingUniverseStanding,
            Self::Raw => sys::ETrackingUniverseOrigin_TrackingUniverseRawAndUncalibrated,
        }
    }
}

/// Tracking state of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrackingState {
    /// Running and in range.
    Ok,
    /// Running, but extrapolated.
    OutOfRange,
    /// Rotation only.
    RotationOnly,
    /// Calibrating, or not tracked.
    NotTracking,
}

/// A device's pose as reported by the runtime.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DevicePose {
    /// Whether the device is connected.
    pub connected: bool,
    /// Whether the runtime marks the pose as valid.
    pub valid: bool,
    /// Tracking state.
    pub state: TrackingState,
    /// `universe_from_device`; `None` if the matrix is not a pose.
    pub pose: Option<Pose>,
    /// Velocity in the universe's frame, m/s.
    pub velocity_m_per_s: DVec3,
}

impl DevicePose {
    const NONE: Self = Self {
        connected: false,
        valid: false,
        state: TrackingState::NotTracking,
        pose: None,
        velocity_m_per_s: DVec3::ZERO,
    };

    fn of(raw: &sys::TrackedDevicePose_t) -> Self {
        let state = match raw.eTrackingResult {
            sys::ETrackingResult_TrackingResult_Running_OK => TrackingState::Ok,
            sys::ETrackingResult_TrackingResult_Running_OutOfRange => TrackingState::OutOfRange,
            sys::ETrackingResult_TrackingResult_Fallback_RotationOnly => TrackingState::RotationOnly,
            _ => TrackingState::NotTracking,
        };
        let [x, y, z] = raw.vVelocity.v.map(f64::from);
        Self {
            connected: raw.bDeviceIsConnected,
            valid: raw.bPoseIsValid,
            state,
            pose: pose(&raw.mDeviceToAbsoluteTracking),
            velocity_m_per_s: DVec3::new(x, y, z),
        }
    }

    /// The pose, if it is connected, valid and tracked.
    pub fn valid_pose(&self) -> Option<Pose> {
        self.pose.filter(|_| self.connected && self.valid && self.state == TrackingState::Ok)
    }
}

/// Poses of the user's devices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Poses {
    /// The headset.
    pub head: DevicePose,
    /// Left and right controller.
    pub hands: [DevicePose; 2],
}

/// Device indices of the controllers. They change when controllers are switched on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Hands([u32; 2]);

impl Hands {
    /// No controllers.
    pub const NONE: Self = Self([sys::NO_DEVICE; 2]);
}

/// Length of the runtime's table of tracked devices (OpenVR).
const MAX_DEVICES: usize = sys::k_unMaxTrackedDeviceCount as usize;

impl Runtime {
    /// Current device indices of the controllers.
    pub fn hands(&self) -> Hands {
        let roles = [
            sys::ETrackedControllerRole_TrackedControllerRole_LeftHand,
            sys::ETrackedControllerRole_TrackedControllerRole_RightHand,
        ];
        Hands(roles.map(|role| call!(self.system, GetTrackedDeviceIndexForControllerRole(role))))
    }

    /// Starts a haptic pulse on a hand's controller. `length_us` is below 4000, and pulses must be
    /// at least 5 ms apart. Does nothing without a controller. This legacy call needs no input
    /// bindings from the user.
    pub fn pulse(&self, hands: Hands, hand: usize, length_us: u16) {
        if let Some(index) = hands.0.get(hand).filter(|index| (**index as usize) < MAX_DEVICES) {
            call!(self.system, TriggerHapticPulse(*index, 0, length_us.min(3999)));
        }
    }

    /// Poses `ahead_s` seconds from now.
    pub fn poses(&self, universe: Universe, ahead_s: f64, hands: Hands) -> Poses {
        let mut raw = [INVALID_POSE; MAX_DEVICES];
        // Requests only the devices that are used.
        let count = hands.0.iter().filter(|index| (**index as usize) < MAX_DEVICES).max().map_or(1, |last| last + 1);
        call!(self.system, GetDeviceToAbsoluteTrackingPose(universe.origin(), ahead_s as f32, raw.as_mut_ptr(), count));
        let device = |index: u32| raw.get(index as usize).map_or(DevicePose::NONE, DevicePose::of);
        Poses { head: device(sys::HEADSET), hands: hands.0.map(device) }
    }

    /// The transform from the raw to the standing universe, as currently set by the user.
    ///
    /// The manual leaves the direction of the matrix open, so both directions are compared with the
    /// head's pose in either universe. `None` if the runtime gives no pose, or the head is not
    /// tracked.
    pub fn standing_from_raw(&self) -> Option<Pose> {
        let raw_zero = pose(&call!(self.system, GetRawZeroPoseToStandingAbsoluteTrackingPose()))?;
        let head = |universe| self.poses(universe, 0.0, Hands::NONE).head.valid_pose();
        let (raw, standing) = (head(Universe::Raw)?, head(Universe::Standing)?);
        let away = |candidate: &Pose| {
            let there = *candidate * raw;
            there.translation.distance(standing.translation) + there.rotation.angle_between(standing.rotation)
        };
        [raw_zero, raw_zero.inverse()].into_iter().min_by(|a, b| away(a).total_cmp(&away(b)))
    }
}

const INVALID_POSE: sys::TrackedDevicePose_t = sys::TrackedDevicePose_t {
    mDeviceToAbsoluteTracking: sys::HmdMatrix34_t { m: [[0.0; 4]; 3] },
    vVelocity: sys::HmdVector3_t { v: [0.0; 3] },
    vAngularVelocity: sys::HmdVector3_t { v: [0.0; 3] },
    eTrackingResult: sys::ETrackingResult_TrackingResult_Uninitialized,
    bPoseIsValid: false,
    bDeviceIsConnected: false,
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::openvr::matrix::matrix;

    #[test]
    fn pose_is_valid_only_when_all_flags_agree() {
        let good = sys::TrackedDevicePose_t {
            mDeviceToAbsoluteTracking: matrix(&Pose::from_translation(DVec3::new(0.1, 1.6, -0.2))),
            eTrackingResult: sys::ETrackingResult_TrackingResult_Running_OK,
            bPoseIsValid: true,
            bDeviceIsConnected: true,
            ..INVALID_POSE
        };
        assert!(DevicePose::of(&good).valid_pose().is_some());
        let bad: [fn(&mut sys::TrackedDevicePose_t); 5] = [
            |pose| pose.bPoseIsValid = false,
            |pose| pose.bDeviceIsConnected = false,
            |pose| pose.eTrackingResult = sys::ETrackingResult_TrackingResult_Running_OutOfRange,
            |pose| pose.eTrackingResult = sys::ETrackingResult_TrackingResult_Calibrating_InProgress,
            |pose| pose.mDeviceToAbsoluteTracking.m[0][0] = f32::NAN,
        ];
        for spoil in bad {
            let mut pose = good;
            spoil(&mut pose);
            assert_eq!(DevicePose::of(&pose).valid_pose(), None);
        }
        assert_eq!(DevicePose::of(&INVALID_POSE).valid_pose(), None);
    }
}

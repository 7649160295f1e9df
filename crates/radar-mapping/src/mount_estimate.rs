//! The sensor's position and direction on the head: assumed, in use, and as estimated.

use glam::{DMat3, DQuat, DVec3};
use radar_sar::geometry::Pose;
use radar_sar::{Calibration, EchoDirections, PoseMistake};
use serde::{Deserialize, Serialize};

/// An axis counts as observed up to this 1σ, metres. Choice: a sensor that is 1 cm off displaces a near object by as
/// much when the head turns; measuring by eye is no better.
const OBSERVED_M: f64 = 10e-3;
/// The assumed position is contradicted from this many 1σ and from this many metres on. Choice: 4σ, because jumps of
/// the tracking leave errors larger than a Gaussian's; a ruler is no better than 5 mm.
const SIGNIFICANT: f64 = 4.0;
const MIN_CONTRADICTION_M: f64 = 5e-3;
/// The assumed direction is contradicted from this angle and from this many 1σ on, rad. Choice: 45°; a sensor that is set to face
/// sideways, up, down or back is off by 90° or more, and in furnished rooms estimates were wrong by up to 32° (`lab --example
/// mount`); 3σ, because before the amplitudes tell more 1σ is 17° or more.
pub(crate) const MIN_CONTRADICTION_RAD: f64 = std::f64::consts::FRAC_PI_4;
const SIGNIFICANT_TURN: f64 = 3.0;

/// Where the sensor faces.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BoresightEstimate {
    /// Unit vector in the head's frame.
    pub direction: DVec3,
    /// 1σ of a turn about the less certain axis, rad.
    pub sigma_rad: f64,
    /// Whether it is known better than the side, well enough to turn the mount.
    #[serde(default)]
    pub observed: bool,
}

/// Where the sensor is on the head.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MountEstimate {
    /// Position of the sensor's phase centre in the head's frame, metres.
    pub position_m: DVec3,
    /// Covariance of that, m². An axis that the motion did not make observable has its prior variance.
    pub covariance_m2: DMat3,
    /// The assumed `head_from_sensor`: of the settings, else of the recording.
    pub assumed: Pose,
    /// Whether the motion made it observable along the head's x, y and z axes.
    pub observed: [bool; 3],
    /// `None` while not even the side is known.
    #[serde(default)]
    pub boresight: Option<BoresightEstimate>,
    /// What is wrong with the poses, when they do not fit the ranges; the rest means nothing then.
    #[serde(default)]
    pub pose_mistake: Option<PoseMistake>,
}

impl MountEstimate {
    /// From the corrections and the directions of a sensor that was assumed at `assumed`, a `head_from_sensor`.
    pub fn new(assumed: &Pose, found: &Calibration, directions: &EchoDirections) -> Self {
        let head_from_axes = DMat3::from_quat(assumed.rotation);
        let position_m = assumed.translation + head_from_axes * found.mount_shift_m;
        let covariance_m2 = head_from_axes * found.mount_covariance_m2 * head_from_axes.transpose();
        let boresight = directions.boresight.map(|found| BoresightEstimate {
            direction: assumed.transform_vector(found.direction),
            sigma_rad: found.sigma_rad,
            observed: found.observable,
        });
        let [x, y, z] = covariance_m2.to_cols_array_2d();
        let observed = [x[0], y[1], z[2]].map(|variance_m2| variance_m2 <= OBSERVED_M * OBSERVED_M);
        let pose_mistake = directions.pose_mistake;
        Self { position_m, covariance_m2, assumed: *assumed, observed, boresight, pose_mistake }
    }

    /// 1σ along the head's axes, metres.
    pub fn sigma_m(&self) -> DVec3 {
        let [x, y, z] = self.covariance_m2.to_cols_array_2d();
        DVec3::new(x[0], y[1], z[2]).map(f64::sqrt)
    }

    /// By how much the position differs from the assumed one, metres.
    pub fn shift_m(&self) -> DVec3 {
        self.position_m - self.assumed.translation
    }

    /// The axes in which it contradicts the assumed position. An axis need not be known well to show that the origin is wrong.
    pub fn contradicts(&self) -> [bool; 3] {
        let (shift_m, sigma_m) = (self.shift_m().to_array(), self.sigma_m().to_array());
        std::array::from_fn(|k| shift_m[k].abs() > (SIGNIFICANT * sigma_m[k]).max(MIN_CONTRADICTION_M))
    }

    /// Angle from the assumed direction, rad.
    pub fn turn_rad(&self) -> Option<f64> {
        self.boresight.map(|boresight| boresight.direction.angle_between(self.assumed.forward()))
    }

    /// Whether it contradicts the assumed direction.
    pub fn contradicts_direction(&self) -> bool {
        let bound_rad =
            |boresight: BoresightEstimate| (SIGNIFICANT_TURN * boresight.sigma_rad).max(MIN_CONTRADICTION_RAD);
        self.boresight.is_some_and(|boresight| self.turn_rad() > Some(bound_rad(boresight)))
    }

    /// The assumed rotation, turned the shortest way to the estimated direction.
    pub fn turned(&self) -> DQuat {
        let turn = |boresight: BoresightEstimate| DQuat::from_rotation_arc(self.assumed.forward(), boresight.direction);
        self.boresight.map_or(self.assumed.rotation, |boresight| (turn(boresight) * self.assumed.rotation).normalize())
    }
}

/// The mount that sweeps get their poses with, and where it comes from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MountInUse {
    /// The assumed `head_from_sensor`: of the settings, else of the recording.
    pub assumed: Pose,
    /// The `head_from_sensor` in use: the assumed one, or corrected by estimates.
    pub in_use: Pose,
    /// The last estimate, applied or not; `None` when there was none.
    pub estimate: Option<MountEstimate>,
}

impl MountInUse {
    /// Distance of the mount in use from the assumed one, metres.
    pub fn correction_m(&self) -> f64 {
        self.in_use.translation.distance(self.assumed.translation)
    }

    /// Angle of the direction in use from the assumed one, rad.
    pub fn correction_rad(&self) -> f64 {
        self.in_use.forward().angle_between(self.assumed.forward())
    }

    /// Whether the mount in use differs from the assumed one.
    pub fn is_corrected(&self) -> bool {
        self.in_use != self.assumed
    }

    /// Whether the last estimate contradicts the mount in use in an axis of the head, or its direction, or the poses.
    pub fn is_contradicted(&self) -> bool {
        let against = |estimate: MountEstimate| MountEstimate { assumed: self.in_use, ..estimate };
        let contradicts = |it: MountEstimate| it.contradicts().contains(&true) || it.contradicts_direction();
        self.pose_mistake().is_some() || self.estimate.map(against).is_some_and(contradicts)
    }

    /// What is wrong with the poses, by the last estimate.
    pub fn pose_mistake(&self) -> Option<PoseMistake> {
        self.estimate.and_then(|estimate| estimate.pose_mistake)
    }

    /// Whether the motion made the position observable in each axis of the head.
    pub fn is_observed(&self) -> bool {
        self.estimate.is_some_and(|estimate| !estimate.observed.contains(&false))
    }
}

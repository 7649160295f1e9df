//! Poses as returned by the runtime.

use radar_sar::geometry::Pose;

use crate::sys;
use crate::world::World;

/// The runtime's matrix of a pose.
pub fn matrix(a_from_b: &Pose) -> sys::HmdMatrix34_t {
    let columns = glam::DMat3::from_quat(a_from_b.rotation).to_cols_array_2d();
    let translation = a_from_b.translation.to_array();
    let row = |r: usize| [columns[0][r] as f32, columns[1][r] as f32, columns[2][r] as f32, translation[r] as f32];
    sys::HmdMatrix34_t { m: [row(0), row(1), row(2)] }
}

/// The pose of a matrix.
///
/// # Errors
/// A number is not finite, or the axes are not orthonormal to a thousandth.
pub fn pose(matrix: &sys::HmdMatrix34_t) -> Result<Pose, String> {
    let m = matrix.m.map(|row| row.map(f64::from));
    if !m.iter().flatten().all(|v| v.is_finite()) {
        return Err(format!("numbers that are not finite: {:?}", matrix.m));
    }
    let column = |c: usize| glam::DVec3::new(m[0][c], m[1][c], m[2][c]);
    let rotation = glam::DMat3::from_cols(column(0), column(1), column(2));
    let excess = rotation.transpose() * rotation - glam::DMat3::IDENTITY;
    if excess.to_cols_array().iter().any(|v| v.abs() > 1e-3) || rotation.determinant() < 0.0 {
        return Err(format!("not a rotation: {:?}", matrix.m));
    }
    Ok(Pose::new(column(3), glam::DQuat::from_mat3(&rotation)))
}

impl World {
    /// A device's pose as returned to the client, in a universe given by its pose relative to the
    /// world.
    pub fn tracked_pose(
        &mut self,
        device: usize,
        time_ns: i64,
        universe_from_world: &Pose,
    ) -> sys::TrackedDevicePose_t {
        let mut handed_out = no_pose();
        if device >= self.devices.len() || !self.server.alive(crate::clock::now_ns()) {
            return handed_out;
        }
        handed_out.bDeviceIsConnected = true;
        handed_out.eTrackingResult = sys::ETrackingResult_TrackingResult_Running_OutOfRange;
        if let Some(motion) = self.devices.motion(device, time_ns) {
            let velocity = universe_from_world.transform_vector(motion.velocity_m_s);
            let turn = universe_from_world.transform_vector(motion.angular_velocity_rad_s);
            handed_out.mDeviceToAbsoluteTracking = matrix(&(*universe_from_world * motion.pose));
            handed_out.vVelocity.v = velocity.to_array().map(|v| v as f32);
            handed_out.vAngularVelocity.v = turn.to_array().map(|v| v as f32);
            handed_out.eTrackingResult = sys::ETrackingResult_TrackingResult_Running_OK;
            handed_out.bPoseIsValid = true;
        }
        handed_out
    }
}

/// The pose of a device that does not exist.
pub fn no_pose() -> sys::TrackedDevicePose_t {
    sys::TrackedDevicePose_t {
        mDeviceToAbsoluteTracking: matrix(&Pose::IDENTITY),
        vVelocity: sys::HmdVector3_t { v: [0.0; 3] },
        vAngularVelocity: sys::HmdVector3_t { v: [0.0; 3] },
        eTrackingResult: sys::ETrackingResult_TrackingResult_Uninitialized,
        bPoseIsValid: false,
        bDeviceIsConnected: false,
    }
}

//! Poses as the runtime hands them out.

use radar_sar::geometry::Pose;

use crate::sys;
use crate::track::Motion;
use crate::world::World;

/// A rigid matrix of the runtime.
pub fn matrix(a_from_b: &Pose) -> sys::HmdMatrix34_t {
    let columns = glam::DMat3::from_quat(a_from_b.rotation).to_cols_array_2d();
    let translation = a_from_b.translation.to_array();
    let row = |r: usize| [columns[0][r] as f32, columns[1][r] as f32, columns[2][r] as f32, translation[r] as f32];
    sys::HmdMatrix34_t { m: [row(0), row(1), row(2)] }
}

/// The pose that a matrix means.
///
/// # Errors
/// Numbers that are none, or axes that are not at right angles and of length one to a thousandth, in words.
pub fn pose(matrix: &sys::HmdMatrix34_t) -> Result<Pose, String> {
    let m = matrix.m.map(|row| row.map(f64::from));
    if !m.iter().flatten().all(|v| v.is_finite()) {
        return Err(format!("numbers that are none: {:?}", matrix.m));
    }
    let column = |c: usize| glam::DVec3::new(m[0][c], m[1][c], m[2][c]);
    let rotation = glam::DMat3::from_cols(column(0), column(1), column(2));
    let excess = rotation.transpose() * rotation - glam::DMat3::IDENTITY;
    if excess.to_cols_array().iter().any(|v| v.abs() > 1e-3) || rotation.determinant() < 0.0 {
        return Err(format!("no rotation: {:?}", matrix.m));
    }
    Ok(Pose::new(column(3), glam::DQuat::from_mat3(&rotation)))
}

impl World {
    /// The time on a device's track.
    fn track_time_ns(&self, time_ns: i64) -> i64 {
        if self.config.track_is_relative { time_ns - self.start_ns } else { time_ns }
    }

    /// Where a device really is in the world, whether tracking sees it or not; `None` in a gap of its track.
    pub fn device_in_world(&self, device: usize, time_ns: i64) -> Option<Pose> {
        Some(self.devices.get(device)?.at(self.track_time_ns(time_ns))?.pose)
    }

    /// How a device moves in the world; `None` where tracking has lost it.
    pub fn motion(&self, device: usize, time_ns: i64) -> Option<Motion> {
        let lost = crate::clock::now_ns() < self.invalid_until_ns;
        self.devices.get(device).filter(|_| !lost)?.at(self.track_time_ns(time_ns))
    }

    /// A device's pose as handed out, in a universe that lies in the world.
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
        if let Some(motion) = self.motion(device, time_ns) {
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

/// What is handed out for a device that is not there.
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

//! Inertial poses: the samples of an inertial measurement unit (IMU), dead reckoning with it, and
//! its fusion with optical poses.
//!
//! Frames as everywhere: `tracking` has +y up, `body` is what is tracked. The unit is at the body's
//! origin with its axes.

mod fusion;
mod imu;
mod simulated_imu;
mod strapdown;

pub use fusion::{FusionCounters, FusionRefusal, FusionSettings, PoseFusion};
pub use imu::{GRAVITY_M_PER_S2, ICM_42688, INSTABILITY_TIME_S, ImuSample, ImuSpec, MPU_6050, TACTICAL, TriadSpec};
pub use simulated_imu::{simulated_imu, true_state};
pub use strapdown::{NavState, Strapdown};

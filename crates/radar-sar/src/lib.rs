//! Synthetic aperture imaging from arbitrary motion: radar sweeps and the sensor's poses in,
//! statistics over space out.
//!
//! One coherent sensor with a wide beam moves through a room, as on a head; every sweep has its own
//! pose. The crate images points and planes, refines their positions, and estimates the time offset
//! between sweeps and poses. It is not a detector (see the crate radar-mapping), needs no straight
//! or regular path, and does not correct unknown poses (autofocus).
//!
//! - [`Observation`]: a sweep with the sensor's pose, the input of all else. [`PoseHistory`] gives
//!   the pose at a time from tracked poses.
//! - [`Statistic`]: what is summed at a place. [`backprojection`] sums it over whole sweeps: dense,
//!   or by adaptive search. [`subaperture`] has the coherent statistic for furniture in
//!   front of walls.
//! - [`refine`]: from a voxel to a position with its covariance; [`cramer_rao_bound`]: how well it
//!   could be known.
//! - [`SelfCalibration`]: time offset between poses and sweeps, and the sensor's position on the head and its direction,
//!   from echoes.
//! - [`Preselector`] and [`Selection`]: which sweeps to use.
//! - [`Oracle`]: every statistic slowly, straight from its formula, in f64. All fast paths are
//!   tested against it.
//!
//! Frames and units: right-handed, +y up, −z forward (the boresight), metres, as OpenVR.
//! `a_from_b` maps points of frame `b` to frame `a`. Samples are in LSB, times in nanoseconds of the
//! host's monotonic clock. Phase grows with range: +4πr/λ, [`PHASE_RAD_PER_M`].
//!
//! Results are the same bits on any number of threads and on any processor.
//!
//! # Example
//!
//! A reflector's echo along a winding path, imaged and refined:
//!
//! ```
//! use std::sync::Arc;
//!
//! use glam::DVec3;
//! use num_complex::Complex32;
//! use radar_sar::backprojection::{BrickGrid, SweepStack, dense_volume};
//! use radar_sar::geometry::{Aabb, Pose};
//! use radar_sar::{Beam, Observation, PHASE_RAD_PER_M, RangeAxis, Statistic, SweepGeometry};
//! use radar_sar::{PositionErrors, RangePower, envelope, refine};
//!
//! let reflector_m = DVec3::new(0.12, -0.05, -1.0);
//! let axis = RangeAxis { first_m: 0.2, step_m: 0.06, points: 50 };
//! let geometry = Arc::new(SweepGeometry { subsweep: 0, axis, pulse_fwhm_m: 0.14, point_period_s: 0.0 });
//! let sweep = |k: i32| {
//!     let t = 0.01 * f64::from(k);
//!     let sensor_m = 0.3 * DVec3::new((2.1 * t).sin(), (3.4 * t).cos(), (2.7 * t + 0.5).sin());
//!     let distance_m = sensor_m.distance(reflector_m);
//!     let phase = (PHASE_RAD_PER_M * distance_m) as f32;
//!     // 100 LSB, and as a stand-in for noise a weak ripple.
//!     let sample = |n: usize| {
//!         let echo = 100.0 * envelope(geometry.pulse_fwhm_m, axis.range_m(n) - distance_m) as f32;
//!         Complex32::from_polar(echo, phase) + Complex32::from_polar(2.0, (n * n) as f32 + phase)
//!     };
//!     Observation {
//!         mid_time_ns: i64::from(k) * 10_000_000,
//!         tracking_from_sensor: Pose::from_translation(sensor_m),
//!         velocity_m_per_s: DVec3::ZERO, // it stops for each sweep
//!         geometry: Arc::clone(&geometry),
//!         samples: (0..axis.points).map(sample).collect(),
//!     }
//! };
//! let observations: Vec<Observation> = (0..200).map(sweep).collect();
//!
//! let beam = Beam::Lensless;
//! let region = Aabb { min: DVec3::new(-0.3, -0.3, -1.3), max: DVec3::new(0.3, 0.3, -0.7) };
//! let grid = BrickGrid::covering(&region, 0.02);
//! let (stack, refused) = SweepStack::of(Statistic::Ls, &beam, &observations, grid.middle_m());
//! assert_eq!(refused, 0);
//! let volume = dense_volume(&stack, &grid).volume;
//! let (index, _) = volume.peak().expect("an echo");
//! let peak_m = volume.center(volume.voxel(index));
//! assert!(peak_m.distance(reflector_m) < 0.1); // broad: by range alone
//!
//! let power = RangePower::new(&observations, &beam, 0.2);
//! let refined = refine(&power, peak_m, None, &PositionErrors::default()).expect("enough sweeps");
//! assert!(refined.position_m.distance(reflector_m) < 0.005);
//! ```

#![deny(missing_docs)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod backprojection;
mod beam;
mod bound;
mod compression;
mod cubic;
mod false_alarm;
mod frame_step;
pub mod geometry;
mod local_fit;
pub mod math;
mod noise;
mod observation;
mod oracle;
mod oracle_volume;
mod pose_history;
mod pose_jumps;
mod pose_sample;
mod range_axis;
mod range_power;
mod refine;
mod selection;
mod self_calibration;
mod setting_bounds;
mod signal;
mod simd;
mod statistic;
pub mod subaperture;
mod symmetric;
#[cfg(any(test, feature = "test-data"))]
pub mod test_data;
pub mod truth;
mod volume;

pub use beam::{Beam, BeamError};
pub use bound::{BoundSight, cramer_rao_bound};
pub use compression::{CompressedSweep, RangeCompressor};
pub use false_alarm::{NoiseMaxima, noise_like, sum_from_surprisal, surprisal};
pub use frame_step::strayed_s;
pub use noise::{subaperture_noise_rms, sweep_noise_rms};
pub use observation::{Observation, SweepGeometry};
pub use oracle::Oracle;
pub use oracle_volume::oracle_volume;
pub use pose_history::{FollowedJump, HistorySettings, NoPose, PoseHistory, SmoothPose};
pub use pose_sample::{PoseRefusal, PoseSample, TrackingResult};
pub use range_axis::RangeAxis;
pub use range_power::RangePower;
pub use refine::{JointFit, PositionErrors, Refined, best_pair, refine, split};
pub use selection::{
    Candidate, Preselection, PreselectionCounters, Preselector, Selection, UnknownSelection, farthest_points, random,
};
pub use self_calibration::{
    Boresight, Calibration, CalibrationSettings, EchoDirections, PoseMistake, SelfCalibration, TimeOffset,
};
pub use setting_bounds::{BoundedSettings, SettingBound, SettingOutOfBounds};
pub use signal::{distance_falloff, envelope, template};
pub use simd::{INSTRUCTIONS_VARIABLE, InstructionSet, UnknownInstructionSet};
pub use statistic::{Statistic, UnknownStatistic};
pub use subaperture::subaperture_volume;
pub use symmetric::{eigen, outer};
pub use volume::Volume;

/// Carrier frequency, Hz. Source: A121 data sheet.
pub const CARRIER_HZ: f64 = 60.5e9;
/// Speed of light, m/s. Physics: exact by the definition of the metre.
pub const SPEED_OF_LIGHT_M_PER_S: f64 = 299_792_458.0;
/// Wavelength, metres. Phase turns once for half of it in range, and grows with range (+4πr/λ, measured).
pub const WAVELENGTH_M: f64 = SPEED_OF_LIGHT_M_PER_S / CARRIER_HZ;
/// Radians of phase for a metre of range: 4π/λ.
pub const PHASE_RAD_PER_M: f64 = 4.0 * std::f64::consts::PI / WAVELENGTH_M;
/// The same in half turns, as the kernels count it.
pub(crate) const HALF_TURNS_PER_M: f64 = 4.0 / WAVELENGTH_M;

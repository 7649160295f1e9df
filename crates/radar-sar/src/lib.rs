//! Sweeps and poses → statistics over space: images, ranges, refined positions, time offset.
//!
//! `oracle` computes every statistic slowly, straight from its formula, in f64. All fast paths are
//! tested against it.

#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod backprojection;
mod beam;
mod bound;
mod compression;
mod cubic;
mod false_alarm;
pub mod geometry;
mod local_fit;
pub mod math;
mod noise;
mod observation;
mod oracle;
mod oracle_volume;
mod pose_history;
mod pose_sample;
mod range_axis;
mod range_power;
mod refine;
mod selection;
mod signal;
mod simd;
mod statistic;
pub mod subaperture;
mod symmetric;
#[cfg(any(test, feature = "test-data"))]
pub mod test_data;
mod time_offset;
pub mod truth;
mod volume;

pub use beam::{Beam, BeamError};
pub use bound::{BoundSight, cramer_rao_bound};
pub use compression::{CompressedSweep, RangeCompressor};
pub use false_alarm::{NoiseMaxima, noise_like, sum_from_surprisal, surprisal};
pub use noise::{subaperture_noise_rms, sweep_noise_rms};
pub use observation::{Observation, SweepGeometry};
pub use oracle::Oracle;
pub use oracle_volume::oracle_volume;
pub use pose_history::{HistorySettings, NoPose, PoseHistory, SmoothPose};
pub use pose_sample::{PoseRefusal, PoseSample, TrackingResult};
pub use range_axis::RangeAxis;
pub use range_power::{MaskedRange, RangePower};
pub use refine::{JointFit, PositionErrors, Refined, best_pair, refine, split};
pub use selection::{
    Preselection, PreselectionCounters, Preselector, Selection, THRESHOLD_COEFFICIENT, UnknownSelection,
    above_threshold, d_optimal, farthest_points, hull_above_threshold, hull_vertices, random,
};
pub use signal::{distance_falloff, envelope, template};
pub use simd::{INSTRUCTIONS_VARIABLE, InstructionSet, UnknownInstructionSet};
pub use statistic::{Statistic, UnknownStatistic};
pub use subaperture::subaperture_volume;
pub use symmetric::eigen;
pub use time_offset::{TimeOffset, TimeOffsetEstimator, TimeOffsetSettings};
pub use volume::Volume;

/// Carrier frequency, Hz.
pub const CARRIER_HZ: f64 = 60.5e9;
/// Speed of light, m/s.
pub const SPEED_OF_LIGHT_M_PER_S: f64 = 299_792_458.0;
/// Wavelength, metres. Phase turns once for half of it in range, and grows with range (+4πr/λ, measured).
pub const WAVELENGTH_M: f64 = SPEED_OF_LIGHT_M_PER_S / CARRIER_HZ;
/// Radians of phase for a metre of range: 4π/λ.
pub const PHASE_RAD_PER_M: f64 = 4.0 * std::f64::consts::PI / WAVELENGTH_M;

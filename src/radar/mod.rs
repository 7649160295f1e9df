//! What an A121 measures, without any I/O: its configuration and rules, frames, sweeps, range axis, signal model.
//!
//! Figures come from the vendor's exploration tool (v7.18) and its recordings unless a line says otherwise.

mod beam;
mod config;
mod equation;
mod frame;
mod link;
mod observation;
mod presets;
mod prf;
mod profile;
mod range_axis;
mod rules;
mod signal;
mod timing;

pub use beam::{Beam, BeamError};
pub use config::{IdleState, SensorConfig, Subsweep};
pub use equation::{noise_rms_lsb, rcs_dbsm_for_snr, snr_db};
pub use frame::{Frame, FrameLayout, Sweep};
pub use link::{LineSpeed, LinkCapacity, LinkPrediction, LinkRequirement};
pub use observation::{Observation, SweepGeometry};
pub use presets::{PRESETS, preset, preset_purpose};
pub use prf::Prf;
pub use profile::Profile;
pub use range_axis::RangeAxis;
pub use rules::ConfigError;
pub use signal::{distance_falloff, envelope, template};
pub use timing::{FrameTiming, frame_timing};

/// Distance between neighbouring range points at step 1, metres (every recording of the vendor).
pub const BASE_STEP_M: f64 = 0.002_502_274_001_017_21;
/// Carrier frequency, Hz.
pub const CARRIER_HZ: f64 = 60.5e9;
/// Speed of light, m/s.
pub const SPEED_OF_LIGHT_M_PER_S: f64 = 299_792_458.0;
/// Wavelength, metres. Phase turns once for half of it in range, and grows with range (+4πr/λ, measured).
pub const WAVELENGTH_M: f64 = SPEED_OF_LIGHT_M_PER_S / CARRIER_HZ;
/// Radians of phase for a metre of range: 4π/λ.
pub const PHASE_RAD_PER_M: f64 = 4.0 * std::f64::consts::PI / WAVELENGTH_M;

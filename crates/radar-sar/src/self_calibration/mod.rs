//! Calibration from ordinary motion: the time offset between the pose stream and the sweep stream, the sensor's
//! position on the head, and the bias of its ranges.
//!
//! Each makes the ranges of a stationary object disagree with the path: an offset by speed × offset, a wrong position
//! by what the head's rotation moves it. Sweeps → echoes (range, and the time its point was sampled) → tracks → for
//! each track a fit of its reflector, a point or a plane, and of the slow tracking error, which are then eliminated →
//! the corrections that all tracks share, with their covariance, by Gauss–Newton. How large the slow tracking error is
//! is estimated from the tracks as well.
//!
//! Amplitudes are not used for these; they show where the sensor faces, as the head turns reflectors through the beam.
//! Range changes show the side that echoes come from, echoes that move with the head, which are left out, and poses that do not
//! fit.
//!
//! It works on echoes alone and does not use the map, so a wrong map cannot mislead it. What the motion does not
//! make observable keeps its prior standard deviation: without rotation the position is not observed, and along a straight path
//! at constant speed an offset looks like depth.

mod basis;
mod boresight;
mod combination;
mod corrections;
mod descent;
mod echoes;
mod estimator;
mod fitted_track;
mod information;
mod mean_direction;
mod normal_equations;
mod path;
mod reflector;
mod solver;
mod track_fit;
mod tracks;

pub use boresight::{Boresight, EchoDirections};
pub use estimator::{Calibration, CalibrationSettings, SelfCalibration, TimeOffset};
pub use mean_direction::PoseMistake;

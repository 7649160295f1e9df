//! Estimates the time offset between the pose stream and the sweep stream from the data. A wrong
//! offset makes the range to a stationary object disagree with the path by speed × offset.
//!
//! Sweeps → echoes (range, and the time its point was sampled) → tracks → for each track a joint
//! fit of its reflector, a point or a plane, and the offset → the offset over all tracks with its
//! 1σ. It works on ranges alone, so tracks that cross or interfere lose accuracy and show as
//! misfit. A path along which an offset looks like depth leaves a large 1σ.

mod echoes;
mod estimator;
mod fit;
mod least_squares;
mod path;
mod tracks;

pub use estimator::{TimeOffset, TimeOffsetEstimator, TimeOffsetSettings};

//! The time between the pose stream and the sweep stream, from the data: where it is wrong, the range to a thing that
//! stands still disagrees with the path by speed × offset.
//!
//! Sweeps → echoes (range, when its point was sampled) → tracks → for each track a fit of what returned it, a point or a
//! mirror, jointly with the offset → the offset of all tracks with its 1σ. Works on ranges alone, so tracks that cross or
//! beat cost accuracy and show as misfit; a path along which an offset looks like depth leaves the 1σ wide.

mod echoes;
mod estimator;
mod fit;
mod least_squares;
mod path;
mod tracks;

pub use estimator::{TimeOffset, TimeOffsetEstimator, TimeOffsetSettings};

//! Recordings: MCAP out and in, import of the vendor's .h5 and of pose tracks.

mod truth;

pub use truth::{Truth, TruthObstacle, TruthWall};

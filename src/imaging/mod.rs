//! Sweeps and poses → evidence in space.

mod volume;

pub use volume::Volume;

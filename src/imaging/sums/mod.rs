//! Sums over sweeps, as fast as the machine goes: dense, adaptive and rolling, all from the same bricks.
//!
//! A [`SweepStack`] holds the sweeps, a [`BrickGrid`] the voxels.

mod alive;
mod beam_table;
mod bounds;
mod bricks;
mod dense;
pub(in crate::imaging) mod dispatch;
mod grid;
pub(in crate::imaging) mod lanes;
mod power;
mod rolling;
mod search;
mod sight;
mod stack;
mod waiting;
mod weighted;

pub use dense::{DenseVolume, dense_volume};
pub use dispatch::instruction_set;
pub use grid::BrickGrid;
pub use rolling::{RollingError, RollingImage, RollingSettings, RollingSize, RollingWork};
pub use search::{Found, SearchWork, Threshold, search};
pub use stack::{SweepRefusal, SweepStack, ls_step};

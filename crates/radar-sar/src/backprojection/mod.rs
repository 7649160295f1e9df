//! Backprojection statistics: sums over sweeps at every voxel, computed dense or adaptively from
//! the same bricks; with feature `rolling` also updated sweep by sweep.
//!
//! A [`SweepStack`] holds the sweeps, a [`BrickGrid`] the voxels.

mod beam_table;
mod bounds;
mod brick_geometry;
mod curves;
mod dense;
mod edge_geometry;
mod grid;
mod places;
mod power;
#[cfg(feature = "rolling")]
mod rolling;
mod search;
mod sweep_stack;
mod weighted;

pub use beam_table::BeamTable;
pub use dense::{DenseVolume, dense_volume};
pub use grid::BrickGrid;
#[cfg(feature = "rolling")]
pub use rolling::{RollingError, RollingImage, RollingSettings, RollingSize, RollingWork};
pub use search::{Found, SearchWork, Threshold, search};
pub use sweep_stack::{SweepRefusal, SweepStack, ls_step};

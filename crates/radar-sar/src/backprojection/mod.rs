//! Backprojection statistics: sums over sweeps at every voxel, computed dense, adaptively or
//! rolling, all from the same bricks.
//!
//! A [`SweepStack`] holds the sweeps, a [`BrickGrid`] the voxels.

mod beam_table;
mod bounds;
mod brick_geometry;
mod bricks;
mod dense;
pub(crate) mod dispatch;
mod grid;
pub(crate) mod lanes;
mod octree_bounds;
mod power;
mod priority_buckets;
mod rolling;
mod search;
mod sweep_stack;
mod weighted;

pub use dense::{DenseVolume, dense_volume};
pub use dispatch::instruction_set;
pub use grid::BrickGrid;
pub use rolling::{RollingError, RollingImage, RollingSettings, RollingSize, RollingWork};
pub use search::{Found, SearchWork, Threshold, search};
pub use sweep_stack::{SweepRefusal, SweepStack, ls_step};

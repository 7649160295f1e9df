//! Sweeps and poses → evidence in space.
//!
//! `oracle` is the slow, obvious f64 computation of every statistic; everything else here is tested against it.

pub mod blocks;
mod bound;
mod compression;
mod cubic;
mod dense;
mod noise;
mod oracle;
mod range_power;
mod refine;
mod selection;
mod statistic;
#[cfg(test)]
pub(crate) mod test_data;
mod volume;

pub use blocks::blocks_volume;
pub use bound::{BoundSight, cramer_rao_bound};
pub use compression::{CompressedSweep, RangeCompressor};
pub use dense::{ls_volume, oracle_volume};
pub use noise::{block_noise_rms, sweep_noise_rms};
pub use oracle::Oracle;
pub use range_power::{ClaimedRange, RangePower};
pub use refine::{JointFit, PositionErrors, Refined, best_pair, refine, split};
pub use selection::farthest_points;
pub use statistic::{Statistic, UnknownStatistic};
pub use volume::Volume;

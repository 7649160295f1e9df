//! Sweeps and poses → evidence in space.
//!
//! `oracle` is the slow, obvious f64 computation of every statistic; everything else here is tested against it.

pub mod backprojection;
mod bound;
mod compression;
mod cubic;
mod false_alarm;
mod noise;
mod oracle;
mod oracle_volume;
mod range_power;
mod refine;
mod selection;
mod simd;
mod statistic;
pub mod subaperture;
mod symmetric;
#[cfg(test)]
pub(crate) mod test_data;
mod time_offset;
mod volume;

pub use bound::{BoundSight, cramer_rao_bound};
pub use compression::{CompressedSweep, RangeCompressor};
pub use false_alarm::{NoiseMaxima, noise_like, sum_from_surprisal, surprisal};
pub use noise::{subaperture_noise_rms, sweep_noise_rms};
pub use oracle::Oracle;
pub use oracle_volume::oracle_volume;
pub use range_power::{MaskedRange, RangePower};
pub use refine::{JointFit, PositionErrors, Refined, best_pair, refine, split};
pub use selection::{
    Preselection, PreselectionCounters, Preselector, Selection, THRESHOLD_COEFFICIENT, UnknownSelection,
    above_threshold, d_optimal, farthest_points, hull_above_threshold, hull_vertices, random,
};
pub use simd::{INSTRUCTIONS_VARIABLE, InstructionSet, UnknownInstructionSet};
pub use statistic::{Statistic, UnknownStatistic};
pub use subaperture::subaperture_volume;
pub use symmetric::eigen;
pub use time_offset::{TimeOffset, TimeOffsetEstimator, TimeOffsetSettings};
pub use volume::Volume;

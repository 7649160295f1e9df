//! Block scores: coherent inside 50–100 ms, each block against its own incoherent energy, summed over blocks.
//!
//! What finds furniture before a wall: power that adds up in phase is compared with power that does not, block by block, so
//! a strong wall in the same range does not drown a chair.

mod brick;
mod dense;
mod field;
mod fine;
mod fine_image;
mod interval;
mod kernel;
mod lanes;
mod leaf;
mod mti;
mod planes;
mod score_null_distribution;
mod settings;
mod wall_cancellation;

pub use dense::subaperture_volume;
pub use field::{Field, Peak};
pub use fine::{FineCounters, FineField, FineSettings};
pub use fine_image::{FineImage, connected_region, fine_image};
pub use interval::{PointSubaperture, Subaperture, SubapertureBuilder};
pub use kernel::{Coherence, PlaneAt};
pub use mti::{MtiEcho, MtiFilter, MtiResult};
pub use planes::{PlaneField, PlanePeak};
pub use score_null_distribution::NoiseTail;
pub use settings::{SubapertureSettings, partition, taper};

/// Mean of ln(1 + m) when m is exponential with mean 1, as noise makes it: e·E₁(1).
pub const MEAN_LOG_OF_NOISE: f64 = 0.596_347;

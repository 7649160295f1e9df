//! Sub-aperture statistic: coherent within 50–100 ms of sweeps, each sub-aperture normalised by its
//! own incoherent energy, summed over sub-apertures.
//!
//! It finds furniture in front of a wall. Coherent power is compared with incoherent power one
//! sub-aperture at a time, so a strong wall at the same range does not mask a chair.

mod brick;
mod dense;
mod field;
mod fine;
mod fine_image;
mod interval;
mod kernel;
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
pub use kernel::{Coherence, ParallelPlanes, PlaneAt};
pub use mti::{MtiEcho, MtiFilter, MtiResult};
pub use planes::{PlaneField, PlanePeak};
pub use score_null_distribution::NoiseTail;
pub use settings::{SubapertureSettings, partition, taper};

/// Mean of ln(1 + m) for m exponential with mean 1, its distribution under noise. Physics: e·E₁(1).
pub const MEAN_LOG_OF_NOISE: f64 = 0.596_347;

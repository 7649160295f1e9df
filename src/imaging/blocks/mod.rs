//! Block scores: coherent inside 50–100 ms, each block against its own incoherent energy, summed over blocks.
//!
//! What finds furniture before a wall: power that adds up in phase is compared with power that does not, block by block, so
//! a strong wall in the same range does not drown a chair.

mod block;
mod brick;
mod dense;
mod field;
mod fine;
mod kernel;
mod lanes;
mod mirrors;
mod movers;
mod null;
mod planes;
mod settings;
mod shape;
mod subapertures;

pub use block::{Block, BlockBuilder, PlaceBlock};
pub use dense::blocks_volume;
pub use field::{Field, Peak};
pub use fine::{FineCounters, FineField, FineSettings};
pub use kernel::{Coherence, PlaneAt};
pub use movers::{MoverFinder, Movers, MovingEcho};
pub use null::NoiseTail;
pub use planes::{PlaneField, PlanePeak};
pub use settings::{BlockSettings, partition, taper};
pub use shape::{FineImage, fine_image, shape};

/// Mean of ln(1 + m) when m is exponential with mean 1, as noise makes it: e·E₁(1).
pub const MEAN_LOG_OF_NOISE: f64 = 0.596_347;

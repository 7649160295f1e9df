//! Parameters of a rolling image, why it may be refused, and what it counts.

use crate::Statistic;

/// Parameters of a rolling image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RollingSettings {
    /// `ls` or `log`.
    pub statistic: Statistic,
    /// Sweeps in the window.
    pub window: usize,
    /// Least number of sweeps before the image is evaluated.
    pub min_sweeps: usize,
    /// Voxels of at least this share of the peak are kept,
    pub share_of_peak: f64,
    /// and at least this many standard deviations above the mean sum of noise.
    pub min_sigma: f64,
    /// A brick becomes idle, and opened cubes are closed, below this share of the threshold.
    pub drop_share: f64,
    /// Limit per sweep of (voxel, sweep) pairs for catching up and opening; a (cube, sweep) pair
    /// counts as four.
    pub max_opening: u64,
    /// Greatest number of bricks in memory, rolling and idle: 300 bytes each.
    pub max_bricks: usize,
    /// Noise of a sample, rms, LSB.
    pub noise_rms_lsb: f64,
}

impl Default for RollingSettings {
    fn default() -> Self {
        Self {
            statistic: Statistic::Ls,
            window: 200,
            min_sweeps: 100,
            share_of_peak: 0.5,
            min_sigma: 7.0,
            drop_share: 0.85,
            max_opening: 1_200_000,
            max_bricks: 250_000,
            noise_rms_lsb: 20.0,
        }
    }
}

/// Why a rolling image cannot be created.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RollingError {
    /// A statistic that is not a sum of integers.
    #[error("statistic {} is not available for rolling images: use ls or log", .0.name())]
    Statistic(Statistic),
    /// An empty window, or one too large for the memory.
    #[error("a rolling window of {0} sweeps is not possible: use 1 to {MAX_WINDOW}")]
    Window(usize),
}

/// Choice: greatest window; tables and range maxima take 40 kB per sweep.
pub(super) const MAX_WINDOW: usize = 4096;

/// Work done so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RollingWork {
    /// Sweeps added.
    pub sweeps: u64,
    /// Sweeps refused: not finite, or of unknown geometry.
    pub refused: u64,
    /// (voxel, sweep) pairs added or subtracted.
    pub updates: u64,
    /// (cube, sweep) pairs bounded.
    pub bounds: u64,
    /// Bricks opened.
    pub opened: u64,
    /// Idle bricks caught up.
    pub caught_up: u64,
    /// Bricks dropped.
    pub dropped: u64,
    /// Deferred cubes and bricks, summed over sweeps.
    pub carried_over: u64,
}

/// Size of a rolling image.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RollingSize {
    /// Cubes of the octree.
    pub cubes: usize,
    /// Bricks updated with every sweep.
    pub rolling_bricks: usize,
    /// Idle bricks, caught up when they may reach the threshold again.
    pub idle_bricks: usize,
}

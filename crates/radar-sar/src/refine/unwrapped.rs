//! Unwrapped phases: what phase unwrapping passes to the fit.

/// A sweep's phase.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Phase {
    pub variance_m2: f64,
    /// Not joined to earlier phases: a new offset.
    pub begins: bool,
}

/// Unwrapped phases.
#[derive(Debug, Clone)]
pub(super) struct Unwrapped {
    /// One per sweep; `None` where it has no phase.
    pub phases: Vec<Option<Phase>>,
    /// Lengths from the phases, one per sweep, for each hypothesis; the likeliest first.
    pub guesses: Vec<Vec<f64>>,
}

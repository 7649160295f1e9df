//! The visible layers.

/// The visible layers.
#[derive(Debug, Clone, PartialEq)]
pub struct Layers {
    /// Obstacles with their uncertainty and distance.
    pub obstacles: bool,
    /// Moving targets.
    pub moving: bool,
    /// Walls, floor and ceiling.
    pub walls: bool,
    /// Evidence.
    pub evidence: bool,
    /// The radar's beam.
    pub beam: bool,
    /// The path of the head.
    pub path: bool,
    /// Warnings as the user sees them.
    pub warnings: bool,
    /// Ground truth.
    pub truth: bool,
    /// Evidence below this is hidden.
    pub min_score: f32,
    /// The obstacle at which the maps are cut; none: no cut.
    pub selected: Option<u64>,
}

impl Layers {
    /// The default layers. `min_score` depends on the noise of the search mode.
    pub fn new(min_score: f32) -> Self {
        Self {
            obstacles: true,
            moving: true,
            walls: true,
            evidence: true,
            beam: true,
            path: true,
            warnings: true,
            truth: false,
            min_score,
            selected: None,
        }
    }
}

//! Which layers are shown.

/// What is shown and what is not.
#[derive(Debug, Clone, PartialEq)]
pub struct Layers {
    /// Obstacles with their uncertainty and distance.
    pub obstacles: bool,
    /// What moves by itself.
    pub moving: bool,
    /// Walls, floor and ceiling.
    pub walls: bool,
    /// Where there is evidence.
    pub evidence: bool,
    /// The radar's beam.
    pub beam: bool,
    /// The way the head took.
    pub path: bool,
    /// Warnings as the player sees them.
    pub warnings: bool,
    /// What is really there.
    pub truth: bool,
    /// Evidence below this is not shown.
    pub min_score: f32,
    /// The obstacle that maps are cut at; none: everything.
    pub selected: Option<u64>,
}

impl Layers {
    /// What a newcomer sees first; `min_score` as the search's noise wants it.
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

//! What the stages of the mapper share and none changes.

use radar_sar::{Beam, PositionErrors};

use super::RoomMapperSettings;

/// Settings, and what follows from them.
#[derive(Debug, Clone)]
pub(super) struct RoomConfig {
    pub settings: RoomMapperSettings,
    /// Accuracy of the poses.
    pub errors: PositionErrors,
    pub beam: Beam,
    /// Cosine to the boresight from which on points are in the beam.
    pub min_cos: f64,
}

impl RoomConfig {
    pub fn new(settings: RoomMapperSettings, beam: &Beam, errors: PositionErrors) -> Self {
        Self { settings, errors, beam: beam.clone(), min_cos: settings.subapertures.min_cos(beam) }
    }

    /// Length of the window, nanoseconds.
    pub fn window_ns(&self) -> i64 {
        (self.settings.clean.window_s * 1e9) as i64
    }
}

//! What the stages of the mapper share and none changes.

use radar_sar::{Beam, PositionErrors};

use super::RoomMapperSettings;
use crate::clean::SubapertureQuery;

/// Settings, and what follows from them.
#[derive(Debug, Clone)]
pub(super) struct RoomConfig {
    pub settings: RoomMapperSettings,
    /// Accuracy of the poses.
    pub errors: PositionErrors,
    pub beam: Beam,
    /// Cosine to the boresight from which on points are in the beam.
    pub min_cos: f64,
    /// Same of planes.
    pub plane_min_cos: f64,
}

impl RoomConfig {
    pub fn new(settings: RoomMapperSettings, beam: &Beam, errors: PositionErrors) -> Self {
        let (min_cos, plane_min_cos) = (settings.subapertures.min_cos(beam), settings.subapertures.plane_min_cos(beam));
        Self { settings, errors, beam: beam.clone(), min_cos, plane_min_cos }
    }

    pub fn query(&self) -> SubapertureQuery<'_> {
        SubapertureQuery::new(&self.settings.subapertures, &self.beam, [self.min_cos, self.plane_min_cos])
    }

    /// Length of the window, nanoseconds.
    pub fn window_ns(&self) -> i64 {
        (self.settings.clean.window_s * 1e9) as i64
    }
}

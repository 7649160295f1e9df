//! Which kind of room a session is played in.

use serde::{Deserialize, Serialize};

use super::super::world::Family;

/// A kind of room. The three furnished physical ones differ in how everything in them is built, so that what was
/// trained or tuned on one is not measured on its like.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlayWorld {
    /// Point scatterers and smooth walls, without multipath and shadows.
    #[default]
    Points,
    /// Offices of panels and tubes with multipath and shadows: to train on.
    Office,
    /// Dining rooms, likewise: to tune on.
    Dining,
    /// Living rooms, likewise: to take figures from.
    Living,
    /// A bare room, likewise, whose player looks about in a corner, as a guided calibration asks for.
    Corner,
}

/// Unknown world.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("world \"{0}\" is not known: use {list}", list = PlayWorld::NAMES.join(", "))]
pub struct PlayWorldError(pub String);

impl PlayWorld {
    /// Names of all worlds.
    pub const NAMES: [&str; 5] = ["points", "office", "dining", "living", "corner"];

    /// The world with this name.
    ///
    /// # Errors
    /// Unknown name.
    pub fn from_name(name: &str) -> Result<Self, PlayWorldError> {
        match name {
            "points" => Ok(Self::Points),
            "office" => Ok(Self::Office),
            "dining" => Ok(Self::Dining),
            "living" => Ok(Self::Living),
            "corner" => Ok(Self::Corner),
            other => Err(PlayWorldError(other.into())),
        }
    }

    /// Family of the physical worlds; `None` for point scatterers.
    pub(super) fn family(self) -> Option<Family> {
        match self {
            Self::Points => None,
            Self::Office => Some(Family::Office),
            Self::Dining => Some(Family::Dining),
            Self::Living => Some(Family::Living),
            Self::Corner => Some(Family::Bare),
        }
    }
}

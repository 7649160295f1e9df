//! Headsets by how well they are tracked.

use serde::{Deserialize, Serialize};

use super::TrackingErrors;

/// A kind of tracking, with the errors that were published of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Headset {
    /// Poses without errors.
    Perfect,
    /// Errors as small as the default settings of the reconstruction expect.
    #[default]
    Nominal,
    /// Base stations: little noise, a frame bent by millimetres, a new offset after each loss.
    Lighthouse,
    /// Cameras on the headset: a slow error of millimetres, and jumps when the map is corrected.
    InsideOut,
    /// Cameras in a scene that is hard for them: larger errors, losses, late stamps.
    Poor,
}

/// Unknown headset.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("headset \"{0}\" is not known: use {list}", list = Headset::NAMES.join(", "))]
pub struct HeadsetError(pub String);

impl Headset {
    /// Names of all headsets.
    pub const NAMES: [&str; 5] = ["perfect", "nominal", "lighthouse", "inside-out", "poor"];

    /// The headset with this name.
    ///
    /// # Errors
    /// Unknown name.
    pub fn from_name(name: &str) -> Result<Self, HeadsetError> {
        match name {
            "perfect" => Ok(Self::Perfect),
            "nominal" => Ok(Self::Nominal),
            "lighthouse" => Ok(Self::Lighthouse),
            "inside-out" => Ok(Self::InsideOut),
            "poor" => Ok(Self::Poor),
            other => Err(HeadsetError(other.into())),
        }
    }

    /// Its tracking errors.
    ///
    /// Sources: noise of 50 µm a metre of a lighthouse tracker (Yates), offsets after brief losses
    /// (Niehorster 2017), centimetres of distortion over a room (Bauer 2021; the slope within a
    /// step is what matters here); below 1 cm inside-out (ImmerCom 2024), twice that without texture
    /// (ISMAR 2025). Choice: the rest; intervals between jumps and errors of the stamps were not
    /// published.
    pub fn errors(self) -> TrackingErrors {
        let nominal = TrackingErrors::default();
        match self {
            Self::Perfect => TrackingErrors::none(),
            Self::Nominal => nominal,
            Self::Lighthouse => TrackingErrors {
                jitter_m: 0.1e-3,
                wander_m: 0.5e-3,
                distortion_m: 5e-3,
                dropouts_per_minute: 0.5,
                jump_m: 10e-3,
                jump_deg: 0.1,
                stamp_s: 0.1e-3,
                ..nominal
            },
            Self::InsideOut => TrackingErrors {
                wander_m: 4e-3,
                rotation_deg: 0.2,
                distortion_m: 5e-3,
                jumps_per_minute: 7.5,
                jump_m: 8e-3,
                jump_deg: 0.2,
                stamp_s: 0.5e-3,
                ..nominal
            },
            Self::Poor => TrackingErrors {
                jitter_m: 0.5e-3,
                wander_m: 5e-3,
                rotation_deg: 0.3,
                distortion_m: 10e-3,
                dropouts_per_minute: 1.0,
                jumps_per_minute: 7.5,
                jump_m: 20e-3,
                jump_deg: 0.5,
                stamp_s: 1e-3,
                ..nominal
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_to_headsets_that_get_worse() {
        let errors = Headset::NAMES.map(|name| Headset::from_name(name).unwrap().errors());
        assert_eq!((errors[0], errors[1]), (TrackingErrors::none(), TrackingErrors::default()));
        assert!(errors[2..].windows(2).all(|pair| pair[0].wander_m < pair[1].wander_m));
        assert!(Headset::from_name("rift").unwrap_err().to_string().contains("inside-out"));
    }
}

//! The five pulse profiles: longer pulses carry more energy and have a coarser resolution.

use serde::{Deserialize, Serialize};

/// Profile 1 (shortest pulse) to 5 (longest).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "Spelling", into = "u8")]
pub enum Profile {
    /// Envelope 4 cm.
    P1,
    /// Envelope 7 cm.
    P2,
    /// Envelope 14 cm.
    P3,
    /// Envelope 19 cm.
    P4,
    /// Envelope 32 cm.
    P5,
}

/// Serialised form: 3 in the protocol, "PROFILE_3" in the vendor's session files.
#[derive(Deserialize)]
#[serde(untagged)]
enum Spelling {
    Number(u8),
    Name(String),
}

impl TryFrom<Spelling> for Profile {
    type Error = String;
    fn try_from(spelling: Spelling) -> Result<Self, String> {
        let number = match &spelling {
            Spelling::Number(number) => Some(*number),
            Spelling::Name(name) => name.strip_prefix("PROFILE_").unwrap_or(name).parse().ok(),
        };
        number.and_then(Self::from_number).ok_or_else(|| match spelling {
            Spelling::Number(number) => format!("profile {number} does not exist; it is 1 to 5"),
            Spelling::Name(name) => format!("profile \"{name}\" does not exist; it is 1 to 5"),
        })
    }
}

impl From<Profile> for u8 {
    fn from(profile: Profile) -> u8 {
        profile as u8 + 1
    }
}

impl Profile {
    /// All profiles, shortest pulse first.
    pub const ALL: [Profile; 5] = [Self::P1, Self::P2, Self::P3, Self::P4, Self::P5];

    /// The profile with this number, 1 to 5.
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL.get(usize::from(number).checked_sub(1)?).copied()
    }

    /// Full width at half maximum of the AMPLITUDE envelope, metres. Data of the vendor; 0.039 and
    /// 0.138 measured for profiles 1 and 3.
    pub fn envelope_fwhm_m(self) -> f64 {
        [0.04, 0.07, 0.14, 0.19, 0.32][self as usize]
    }

    /// Radar loop gain, dB: SNR of 0 dBsm at 1 m with one average (data sheet).
    pub fn loop_gain_db(self) -> f64 {
        [11.3, 13.7, 19.0, 20.5, 21.6][self as usize]
    }

    /// Duration of one hardware average, and overhead of a point, at a PRF of 15.6 MHz, seconds.
    pub(super) fn sample_and_overhead_s_at_15_6_mhz(self) -> (f64, f64) {
        match self {
            Self::P1 => (1795e-9, 2102e-9),
            Self::P2 => (1344e-9, 1612e-9),
            Self::P3 | Self::P4 | Self::P5 => (1026e-9, 1282e-9),
        }
    }
}

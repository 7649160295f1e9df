//! Pulse repetition frequencies. A higher one measures faster and to a shorter range.

use serde::{Deserialize, Serialize};

/// Pulse repetition frequency.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Prf {
    /// 19.5 MHz, profile 1 only.
    #[serde(rename = "19_5_MHz", alias = "PRF_19_5_MHz")]
    Mhz19_5,
    /// 15.6 MHz.
    #[serde(rename = "15_6_MHz", alias = "PRF_15_6_MHz")]
    Mhz15_6,
    /// 13.0 MHz.
    #[serde(rename = "13_0_MHz", alias = "PRF_13_0_MHz")]
    Mhz13_0,
    /// 8.7 MHz.
    #[serde(rename = "8_7_MHz", alias = "PRF_8_7_MHz")]
    Mhz8_7,
    /// 6.5 MHz.
    #[serde(rename = "6_5_MHz", alias = "PRF_6_5_MHz")]
    Mhz6_5,
    /// 5.2 MHz.
    #[serde(rename = "5_2_MHz", alias = "PRF_5_2_MHz")]
    Mhz5_2,
}

impl Prf {
    /// The frequency, Hz.
    pub fn hz(self) -> f64 {
        match self {
            Self::Mhz19_5 => 19.5e6,
            Self::Mhz15_6 => 15.6e6,
            Self::Mhz13_0 => 13.0e6,
            Self::Mhz8_7 => 8.7e6,
            Self::Mhz6_5 => 6.5e6,
            Self::Mhz5_2 => 5.2e6,
        }
    }

    /// Farthest range of a point, metres.
    pub fn max_measurable_m(self) -> f64 {
        match self {
            Self::Mhz19_5 => 3.1,
            Self::Mhz15_6 => 5.1,
            Self::Mhz13_0 => 7.0,
            Self::Mhz8_7 => 12.7,
            Self::Mhz6_5 => 18.5,
            Self::Mhz5_2 => 24.3,
        }
    }
}

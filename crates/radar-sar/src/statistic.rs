//! Statistics of evidence over sweeps. Definitions: the table in docs/method.md; computed literally
//! in `oracle`.

use serde::{Deserialize, Serialize};

/// A statistic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Statistic {
    /// Eq. 3.1 of the thesis: every range point against the template.
    ThesisFull,
    /// Eq. 3.2 of the thesis: only the range point nearest to the position.
    Thesis,
    /// Σ |z|²: least squares with a free amplitude in each sweep.
    Ls,
    /// Σ ln(1 + |z|²/σ²): the same, less dominated by strong sweeps.
    Log,
    /// Σ |z| w / √Σ w²: likelihood ratio with one amplitude for all sweeps.
    Glrt,
    /// |Σ z w e^{−j4πd/λ}| / √Σ w²: all sweeps coherent.
    Coherent,
    /// Coherent within sub-apertures of 50–100 ms, each normalised by its own incoherent energy,
    /// summed over sub-apertures.
    #[serde(alias = "blocks")]
    Subaperture,
}

/// The name of [`Statistic::Subaperture`] in older settings and commands.
const FORMER_SUBAPERTURE_NAME: &str = "blocks";

/// Unknown name of a statistic.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("statistic \"{0}\" is not known: use {list}", list = Statistic::ALL.map(Statistic::name).join(", "))]
pub struct UnknownStatistic(pub String);

impl Statistic {
    /// All statistics.
    pub const ALL: [Statistic; 7] =
        [Self::ThesisFull, Self::Thesis, Self::Ls, Self::Log, Self::Glrt, Self::Coherent, Self::Subaperture];

    /// Name in settings and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::ThesisFull => "thesis-full",
            Self::Thesis => "thesis",
            Self::Ls => "ls",
            Self::Log => "log",
            Self::Glrt => "glrt",
            Self::Coherent => "coherent",
            Self::Subaperture => "subaperture",
        }
    }

    /// Unit of its values.
    pub fn unit(self) -> &'static str {
        match self {
            Self::ThesisFull | Self::Thesis => "LSB/m²",
            Self::Ls => "LSB²",
            Self::Log => "nats",
            Self::Glrt | Self::Coherent => "LSB",
            Self::Subaperture => "1",
        }
    }
}

impl std::str::FromStr for Statistic {
    type Err = UnknownStatistic;
    fn from_str(name: &str) -> Result<Self, UnknownStatistic> {
        let name = if name == FORMER_SUBAPERTURE_NAME { Self::Subaperture.name() } else { name };
        Self::ALL.into_iter().find(|s| s.name() == name).ok_or_else(|| UnknownStatistic(name.into()))
    }
}

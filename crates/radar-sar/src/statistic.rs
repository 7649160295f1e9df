//! The sums that evidence can be made of. Definitions: the table in ARCHITECTURE.md; computed literally in `oracle`.

use serde::{Deserialize, Serialize};

/// Which sum.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Statistic {
    /// Eq. 3.1 of the thesis: every range point against the template.
    ThesisFull,
    /// Eq. 3.2: the range point nearest to the place alone.
    Thesis,
    /// Σ |z|²: least squares with a free amplitude for each sweep.
    Ls,
    /// Σ ln(1 + |z|²/σ²): the same, less led by strong sweeps.
    Log,
    /// Σ |z| w / √Σ w²: likelihood ratio with one amplitude for all.
    Glrt,
    /// |Σ z w e^{−j4πd/λ}| / √Σ w²: all sweeps in phase.
    Coherent,
    /// Coherent inside blocks of 50–100 ms, each against its own incoherent energy, summed over blocks.
    #[serde(alias = "blocks")]
    Subaperture,
}

/// The name of [`Statistic::Subaperture`] in settings and commands of before.
const FORMER_SUBAPERTURE_NAME: &str = "blocks";

/// No such statistic.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("statistic \"{0}\" is not known: use {list}", list = Statistic::ALL.map(Statistic::name).join(", "))]
pub struct UnknownStatistic(pub String);

impl Statistic {
    /// All of them.
    pub const ALL: [Statistic; 7] =
        [Self::ThesisFull, Self::Thesis, Self::Ls, Self::Log, Self::Glrt, Self::Coherent, Self::Subaperture];

    /// As settings and the command line spell it.
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

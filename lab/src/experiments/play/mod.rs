//! Play sessions: simulated players in furnished rooms through the whole chain from sweeps to
//! warnings. Measures approaches warned of in time, false warnings, and how long a removed object
//! stays reported.

mod figures;
mod locatable;
pub mod moving;
mod present;
mod reports;
mod run;
mod scorer;
mod target;

pub use figures::{Approach, Cause, Detected, FalseReport, Figures, InMap, Rates, RemovalOutcome};
pub use moving::MovingFigures;
pub use present::{by_headset, by_kind, curve, false_reports, missed, totals};
pub(in crate::experiments) use run::for_each_update;
pub use run::{PlayError, PlayTrial, PlayerSetup, play};

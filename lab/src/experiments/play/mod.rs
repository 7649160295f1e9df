//! Play sessions: simulated players in furnished rooms, the whole chain from sweeps to warnings, and what it is worth to them:
//! approaches warned of in time, warnings of nothing, how long a thing that is gone is still believed in.

mod figures;
mod present;
mod run;
mod scorer;

pub use figures::{Approach, Cause, FalseReport, Figures, Rates, RemovalOutcome};
pub use present::{by_kind, curve, totals};
pub(in crate::experiments) use run::for_each_update;
pub use run::{PlayError, PlayTrial, play};

//! Trials of the whole chain against the truth: simulated, imaged, timed, compared.

mod benchmark;
mod play;

pub use benchmark::{Benchmark, BenchmarkError, Case, Plan, Row, Search, present};
pub use play::{
    Approach, Cause, FalseReport, Figures, Forgetting, PlayError, PlayTrial, Rates, by_kind, curve, play, totals,
};

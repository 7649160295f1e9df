//! Trials of the whole chain against the truth: simulated, imaged, timed, compared.

mod acceptance;
mod benchmark;
mod play;
mod recorded;
mod thesis;

pub use acceptance::Lessons;
pub use benchmark::{Benchmark, BenchmarkError, Case, Plan, Row, Search, present};
pub use play::{
    Approach, Cause, FalseReport, Figures, Forgetting, PlayError, PlayTrial, Rates, by_kind, curve, play, totals,
};
pub use thesis::{
    ALL as EXPERIMENTS, Drawn, Experiment, ExperimentError, Finding, Outcome, OutputFile,
    markdown as experiments_markdown, report as experiments_report,
};

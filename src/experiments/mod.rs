//! Trials of the whole chain against the truth: simulated, imaged, timed, compared.

mod acceptance;
mod benchmark;
mod play;
mod recorded;
mod room_noise;
mod thesis;

pub use acceptance::Lessons;
pub use benchmark::{Benchmark, BenchmarkError, Case, Plan, Row, Search, present};
pub use play::{
    Approach, Cause, FalseReport, Figures, Forgetting, PlayError, PlayTrial, Rates, by_kind, curve, play, totals,
};
pub use room_noise::{RoomNoise, SAME_M, SAME_S, at_most_an_hour};
pub use thesis::{
    ALL as EXPERIMENTS, Drawn, Experiment, ExperimentError, Finding, Outcome, OutputFile,
    markdown as experiments_markdown, report as experiments_report,
};

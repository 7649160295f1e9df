//! Experiments: the whole processing chain on simulated data, scored against the truth and timed.

pub mod accuracy;
mod benchmark;
mod classifier_training;
mod live_latency;
mod noise_alarms;
mod pipeline_cost;
mod play;
mod room_noise;
mod thesis;
mod trial_recording;

pub use benchmark::{Benchmark, BenchmarkError, Case, Plan, Row, Search, present};
pub use classifier_training::{CsvError, TrainingSet};
pub use live_latency::LiveLatency;
pub use noise_alarms::NoiseAlarms;
pub use pipeline_cost::PipelineCost;
pub use play::{
    Approach, Cause, Detected, FalseReport, Figures, InMap, MovingFigures, PlayError, PlayTrial, PlayerSetup, Rates,
    RemovalOutcome, by_headset, by_kind, curve, false_reports, missed, moving, play, totals,
};
pub use room_noise::{RoomNoise, SAME_ALARM_M, SAME_ALARM_S, rate_upper_bound_per_h};
pub use thesis::{
    ALL as EXPERIMENTS, Experiment, ExperimentError, Finding, NamedPicture, Outcome, OutputFile,
    markdown as experiments_markdown, report as experiments_report,
};

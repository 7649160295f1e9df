//! Trials of the whole chain against the truth: simulated, imaged, timed, compared.

mod benchmark;

pub use benchmark::{Benchmark, BenchmarkError, Case, Plan, Row, Search, present};

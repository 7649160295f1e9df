//! The lab's commands, run as a person runs them.

mod benchmark;
#[path = "../../../tests/common/mod.rs"]
#[allow(dead_code)]
mod common;
mod experiment;
mod results;

/// The program under test.
const PROGRAM: &str = env!("CARGO_BIN_EXE_lab");

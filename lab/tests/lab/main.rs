//! Tests of the lab in one binary, which saves linking the program for each of them: its commands,
//! run as a person runs them, the rolling image and the vendor's detector.

mod benchmark;
#[path = "../../../tests/common/mod.rs"]
#[allow(dead_code)]
mod common;
mod experiment;
mod results;
mod rolling;
mod vendor_detector;

/// The vendor's recordings, beside the repository.
const RECORDINGS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/recordings");
/// The program under test.
const PROGRAM: &str = env!("CARGO_BIN_EXE_lab");

/// The first value in the quick suite, the second with `RADAR_CHAPERONE_LONG=1`.
fn quick_or_long<T>(quick: T, thorough: T) -> T {
    if std::env::var_os("RADAR_CHAPERONE_LONG").is_some_and(|value| value != "0") { thorough } else { quick }
}

//! The program: see `radar-chaperone --help`.

use std::process::ExitCode;

fn main() -> ExitCode {
    radar_chaperone::cli::run()
}

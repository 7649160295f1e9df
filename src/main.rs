//! The program: see `radar-chaperone --help`.
//!
//! Memory is given out by mimalloc. In the system's allocator a thread that frees what another one made takes that one's lock; held by
//! a reconstruction of low priority that has no core just then, it cost the frame loop 5 to 15 ms, a few times a minute.

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    radar_chaperone::cli::run()
}

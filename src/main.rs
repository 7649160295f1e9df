//! The program: see `radar-chaperone --help`.
//!
//! Uses the allocator mimalloc. In the system's allocator, a thread that frees another thread's
//! memory takes that thread's lock. When a low-priority reconstruction thread held the lock without
//! having a core, it cost the frame loop 5 to 15 ms, a few times a minute.

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    radar_chaperone::cli::run()
}

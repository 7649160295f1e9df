//! The program: see `radar-chaperone --help`.
//!
//! Uses the allocator mimalloc. In the system's allocator, a thread that frees another thread's
//! memory takes that thread's lock. When a low-priority reconstruction thread held the lock without
//! having a core, it cost the frame loop 5 to 15 ms, a few times a minute.

use std::ffi::{c_int, c_long};
use std::process::ExitCode;

use libmimalloc_sys::{mi_option_get, mi_option_set_default};

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// mimalloc's option `purge_delay`, and its value if nothing sets it, milliseconds (mimalloc 3, mimalloc.h and options.c).
const PURGE_DELAY: c_int = 15;
const PURGE_DELAY_UNSET_MS: c_long = 1000;
/// How long freed memory is kept, milliseconds. Measured over 60 s of the furnished room: with a second, the system gives and
/// clears the memory of the map's updates again and again, 9 % of the processor time of a replay; the peak grows from 205 MB to at
/// most 240.
const PURGE_DELAY_MS: c_long = 10_000;

/// Sets what the environment does not. Options have no names in the allocator's interface: where this number has another value,
/// it may be another option, and nothing is set.
fn keep_freed_memory() {
    // SAFETY: the calls take numbers alone; they are not thread-safe, and there is no other thread yet.
    unsafe {
        if mi_option_get(PURGE_DELAY) == PURGE_DELAY_UNSET_MS {
            mi_option_set_default(PURGE_DELAY, PURGE_DELAY_MS);
        }
    }
}

fn main() -> ExitCode {
    keep_freed_memory();
    radar_chaperone::cli::run()
}

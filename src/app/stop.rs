//! Signals that end a long-running command.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::Result;

/// Ctrl-C, termination, and closing of the terminal.
#[cfg(unix)]
const ENDING_SIGNALS: [i32; 3] =
    [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP];
/// Ctrl-C and termination.
#[cfg(not(unix))]
const ENDING_SIGNALS: [i32; 2] = [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM];

/// Set by the first signal; a second one ends the program at once.
pub fn stop_flag() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in ENDING_SIGNALS {
        signal_hook::flag::register_conditional_shutdown(signal, 1, Arc::clone(&stop))?;
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    Ok(stop)
}

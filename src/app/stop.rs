//! What ends a long-running command.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::{Context, Result};

use super::platform;

/// Set by the first request of the user or the system to end; a second one ends the program at once.
///
/// # Errors
/// The system refuses; on Windows, a second flag in the process.
pub fn stop_flag() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    platform::stop_when_asked(&stop).context("cannot handle Ctrl-C")?;
    Ok(stop)
}

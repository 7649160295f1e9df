//! Allows one instance at a time: two would compete for the sensor's port and the overlays.

use std::fs::{File, OpenOptions, TryLockError};
use std::path::PathBuf;

use anyhow::{Context, Result, bail};

use super::folders::{open_own_file, user_folder};

/// Held while this program runs with SteamVR. The system releases the lock however the program
/// ends.
pub struct Instance {
    _lock: File,
}

impl Instance {
    /// # Errors
    /// Another instance is running.
    pub fn claim() -> Result<Self> {
        let path = lock_path()?;
        let about = || format!("cannot write {}", path.display());
        let lock = open_own_file(OpenOptions::new().truncate(false).write(true), &path).with_context(about)?;
        match lock.try_lock() {
            Ok(()) => Ok(Self { _lock: lock }),
            Err(TryLockError::WouldBlock) => {
                bail!("another radar-chaperone runs with SteamVR already: end that one first")
            }
            Err(TryLockError::Error(error)) => Err(error).with_context(about),
        }
    }
}

fn lock_path() -> Result<PathBuf> {
    let folder = user_folder("XDG_STATE_HOME", ".local/state").context("there is no home folder: set HOME")?;
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    Ok(folder.join("run.lock"))
}

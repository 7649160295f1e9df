//! Whether this user has seen the notice of the first session: an empty file in the user's folder.

use std::path::PathBuf;

use anyhow::{Context, Result};
use radar_recording::{Existing, Readers, write_whole};

use super::folders::user_folder;

fn file() -> Option<PathBuf> {
    Some(user_folder("XDG_DATA_HOME", ".local/share")?.join("welcomed"))
}

/// Whether the user has seen it. Without a folder for the user's files it cannot be known, and is not shown.
pub(super) fn is_done() -> bool {
    file().is_none_or(|file| file.exists())
}

/// The user has seen it.
///
/// # Errors
/// The file cannot be written.
pub(super) fn set_done() -> Result<()> {
    let Some(file) = file().filter(|file| !file.exists()) else { return Ok(()) };
    write_whole(&file, &[], Readers::Owner, Existing::Replace)
        .with_context(|| format!("cannot write {}", file.display()))
}

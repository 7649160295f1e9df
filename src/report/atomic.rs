//! Atomic file writes, with the errors of reports.

use std::path::Path;

use radar_recording::{Existing, Readers, write_whole};

use super::ReportError;

/// Writes `bytes` to `path`: a reader never sees half a file, and the old file survives a failure. Missing folders are created.
///
/// # Errors
/// A folder or file cannot be created, written or renamed.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), ReportError> {
    write_whole(path, bytes, Readers::Usual, Existing::Replace)
        .map_err(|source| ReportError::File { path: path.to_owned(), source })
}

//! Atomic file writes: to a temporary file in the same folder, which is renamed when complete. A
//! reader never sees half a file, and the old file survives a failure.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use super::ReportError;

/// Writes `bytes` to `path`. Missing folders are created.
///
/// # Errors
/// A folder or file cannot be created, written or renamed.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), ReportError> {
    let failed = |source| ReportError::File { path: path.to_owned(), source };
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        fs::create_dir_all(folder).map_err(failed)?;
    }
    let neighbour = neighbour(path);
    let written = fs::write(&neighbour, bytes).and_then(|()| fs::rename(&neighbour, path));
    written.map_err(|source| {
        // The first failure is the one to report.
        let _ = fs::remove_file(&neighbour);
        failed(source)
    })
}

fn neighbour(path: &Path) -> PathBuf {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let number = NEXT.fetch_add(1, Ordering::Relaxed);
    path.with_file_name(format!(".{name}.{}-{number}.tmp", std::process::id()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn atomic_write_replaces_and_cleans_up() {
        let folder = std::env::temp_dir().join(format!("report-atomic-{}", std::process::id()));
        let path = folder.join("deep/file.txt");
        write_atomically(&path, b"one").unwrap();
        write_atomically(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
        let refused = write_atomically(&path.join("below a file"), b"three").unwrap_err();
        assert!(refused.to_string().contains("below a file"), "{refused}");
        fs::remove_dir_all(&folder).unwrap();
    }
}

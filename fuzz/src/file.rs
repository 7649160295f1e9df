//! Passes bytes to code that reads files: one file per process, in a memory file system if
//! available.

use std::path::PathBuf;
use std::sync::OnceLock;

/// Writes the bytes to a temporary file, which is valid until the next call.
pub fn temp_file_with(bytes: &[u8]) -> &'static PathBuf {
    static PATH: OnceLock<PathBuf> = OnceLock::new();
    let path = PATH.get_or_init(|| temp_path(""));
    std::fs::write(path, bytes).expect("a temporary file");
    path
}

/// A path in a memory file system if available; each process and suffix has its own.
pub fn temp_path(suffix: &str) -> PathBuf {
    let memory = PathBuf::from("/dev/shm");
    let folder = if memory.is_dir() { memory } else { std::env::temp_dir() };
    folder.join(format!("radar-chaperone-fuzz-{}{suffix}", std::process::id()))
}

//! Hands bytes to code that reads files: one file a process, in memory where the system has such a place.

use std::path::PathBuf;
use std::sync::OnceLock;

/// A file that holds these bytes until the next call.
pub fn temp_file_with(bytes: &[u8]) -> &'static PathBuf {
    static PATH: OnceLock<PathBuf> = OnceLock::new();
    let path = PATH.get_or_init(|| {
        let memory = PathBuf::from("/dev/shm");
        let folder = if memory.is_dir() { memory } else { std::env::temp_dir() };
        folder.join(format!("radar-chaperone-fuzz-{}", std::process::id()))
    });
    std::fs::write(path, bytes).expect("a temporary file");
    path
}

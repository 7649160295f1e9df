//! Reads files of settings and the like, which are short, without trusting that they are.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Longest file, bytes. Choice: many times what a file of settings has.
pub const MAX_SMALL_BYTES: u64 = 1 << 20;

/// Text of a short file.
///
/// # Errors
/// The system refuses; it is a folder, a device or a pipe, which might never end or never begin; it is longer than
/// [`MAX_SMALL_BYTES`], or no UTF-8.
pub fn read_small_text(path: &Path) -> io::Result<String> {
    if !std::fs::metadata(path)?.is_file() {
        return Err(io::Error::other("it is a folder, a device or a pipe, not a file"));
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(MAX_SMALL_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MAX_SMALL_BYTES {
        return Err(io::Error::other(format!("it is longer than {MAX_SMALL_BYTES} bytes")));
    }
    // As Windows' PowerShell 5 writes by `>`.
    if bytes.starts_with(&[0xFF, 0xFE]) || bytes.starts_with(&[0xFE, 0xFF]) {
        return Err(io::Error::other("it is text in UTF-16: save it as UTF-8"));
    }
    String::from_utf8(bytes).map_err(|_| io::Error::new(io::ErrorKind::InvalidData, "it is no text in UTF-8"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_files::TestFile;

    #[test]
    fn short_text_is_read_and_nothing_else() {
        let file = TestFile::with("radar = 1\n".as_bytes());
        assert_eq!(read_small_text(&file.0).unwrap(), "radar = 1\n");
        let long = TestFile::with(&vec![b' '; MAX_SMALL_BYTES as usize + 1]);
        assert!(read_small_text(&long.0).unwrap_err().to_string().contains("longer than"));
        assert!(read_small_text(&std::env::temp_dir()).unwrap_err().to_string().contains("folder"));
        assert!(read_small_text(&TestFile::with(b"\xff").0).unwrap_err().to_string().contains("no text in UTF-8"));
        for utf16 in [b"\xff\xfer\0", b"\xfe\xff\0r"] {
            assert!(read_small_text(&TestFile::with(utf16).0).unwrap_err().to_string().contains("UTF-16"));
        }
        assert_eq!(read_small_text(&TestFile::new().0).unwrap_err().kind(), io::ErrorKind::NotFound);
        // A link to a device that never ends.
        #[cfg(unix)]
        {
            let link = TestFile::new();
            std::os::unix::fs::symlink("/dev/zero", &link.0).unwrap();
            assert!(read_small_text(&link.0).unwrap_err().to_string().contains("device"));
        }
    }
}

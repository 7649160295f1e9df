//! A file that stands under its name while it is written, and what becomes of it when the name is taken away meanwhile.

use std::fs::File;
use std::io::{self, Seek};
use std::path::{Path, PathBuf};

use same_file::Handle;

use super::whole_file::{Readers, create_new, first_free, sync_folder};

/// The file, whatever its name leads to.
#[derive(Debug)]
pub(super) struct LiveFile {
    path: PathBuf,
    file: Handle,
}

/// Where a live file is when it is complete.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Kept {
    /// Under its name.
    InPlace,
    /// It was removed, renamed or replaced: this is a copy.
    Copied(PathBuf),
}

impl LiveFile {
    /// A new file, readable by the user alone, and the handle to write to.
    ///
    /// # Errors
    /// It is there already, or the system refuses.
    pub fn create(path: &Path) -> io::Result<(Self, File)> {
        let file = create_new(path, Readers::Owner)?;
        sync_folder(path);
        Ok((Self { path: path.to_owned(), file: Handle::from_file(file.try_clone()?)? }, file))
    }

    /// Where the complete file is; one that has lost its name is copied to a free one. That it has another cannot be relied on:
    /// network file systems keep a removed file under a name of their own until it is closed.
    ///
    /// # Errors
    /// It cannot be copied.
    pub fn keep(self) -> io::Result<Kept> {
        match Handle::from_path(&self.path) {
            Ok(there) if there == self.file => return Ok(Kept::InPlace),
            // There is a file that may not be opened.
            Err(_) if self.path.symlink_metadata().is_ok() => return Ok(Kept::InPlace),
            _ => {}
        }
        let copied = first_free(&self.path, |name| {
            let mut copy = create_new(name, Readers::Owner)?;
            let mut file = self.file.as_file();
            let copied = file.rewind().and_then(|()| io::copy(&mut file, &mut copy)).and_then(|_| copy.sync_all());
            copied.inspect_err(|_| drop(std::fs::remove_file(name)))
        })?;
        sync_folder(&copied);
        Ok(Kept::Copied(copied))
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::fs;
    use std::io::Write;

    use super::*;
    use crate::test_files::TestFile;

    #[test]
    fn a_file_that_loses_its_name_is_kept() {
        let folder = TestFile::new().0.clone();
        fs::create_dir_all(&folder).unwrap();
        let (path, other, copy) = (folder.join("r.mcap"), folder.join("other.mcap"), folder.join("r-2.mcap"));
        let harms: [(&dyn Fn(), Kept); 4] = [
            (&|| {}, Kept::InPlace),
            (&|| fs::rename(&path, &other).unwrap(), Kept::Copied(copy.clone())),
            (&|| fs::remove_file(&path).unwrap(), Kept::Copied(copy.clone())),
            (&|| fs::write(&other, b"theirs").and_then(|()| fs::rename(&other, &path)).unwrap(), {
                Kept::Copied(copy.clone())
            }),
        ];
        for (harm, expected) in harms {
            let (live, mut file) = LiveFile::create(&path).unwrap();
            file.write_all(b"recorded").unwrap();
            harm();
            let found = live.keep().unwrap();
            assert_eq!(found, expected);
            let kept = match &found {
                Kept::InPlace => &path,
                Kept::Copied(copy) => copy,
            };
            assert_eq!(fs::read(kept).unwrap(), b"recorded");
            [&path, &other, &copy].into_iter().for_each(|path| drop(fs::remove_file(path)));
        }
        fs::remove_dir_all(&folder).unwrap();
    }
}

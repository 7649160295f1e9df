//! Files that appear under their name once they are complete: written to a neighbour in the same folder, passed to the disk,
//! renamed. A reader never sees half a file, what stood there before survives a failure, and no other name of it (a link) is
//! written to.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Who may read a new file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Readers {
    /// Whoever the user's system lets read new files.
    Usual,
    /// The user alone: rooms are private. Folders that are made for it are the user's alone as well.
    Owner,
}

/// A file under construction; dropped before [`Self::finish`], nothing is left of it.
#[derive(Debug)]
pub struct WholeFile {
    neighbour: PathBuf,
    path: PathBuf,
    is_finished: bool,
}

impl WholeFile {
    /// A new neighbour of `path`, and the file to write to.
    ///
    /// # Errors
    /// The system refuses, or there is a folder, a device or a pipe, which no file may replace.
    pub fn create(path: &Path, readers: Readers) -> io::Result<(Self, File)> {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        if fs::metadata(path).is_ok_and(|there| !there.is_file()) {
            return Err(io::Error::other("it is a folder, a device or a pipe, not a file"));
        }
        let start = neighbour_start(path, std::process::id()).ok_or(io::ErrorKind::InvalidInput)?;
        loop {
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            let neighbour = path.with_file_name(format!("{start}{number}{NEIGHBOUR_END}"));
            match create_new(&neighbour, readers) {
                // One that a killed process of the same number left.
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                file => return Ok((Self { neighbour, path: path.to_owned(), is_finished: false }, file?)),
            }
        }
    }

    /// Gives the written file its name.
    ///
    /// # Errors
    /// The system refuses; nothing is left then.
    pub fn finish(self, file: &File) -> io::Result<()> {
        file.sync_all()?;
        self.rename()
    }

    /// Gives a file its name that has been passed to the disk.
    pub(super) fn rename(mut self) -> io::Result<()> {
        fs::rename(&self.neighbour, &self.path)?;
        self.is_finished = true;
        sync_folder(&self.path);
        Ok(())
    }
}

/// How the names of a process' neighbours of a file begin and end.
fn neighbour_start(path: &Path, process: u32) -> Option<String> {
    Some(format!(".{}.{process}-", path.file_name()?.to_string_lossy()))
}
const NEIGHBOUR_END: &str = ".tmp";

/// Removes what a process that was killed had written of a file.
pub fn remove_unfinished(path: &Path, process: u32) {
    let (Some(start), Some(folder)) = (neighbour_start(path, process), path.parent()) else { return };
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    for file in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = file.file_name();
        let name = name.to_string_lossy();
        if name.starts_with(&start) && name.ends_with(NEIGHBOUR_END) {
            // The process' end is the failure to report.
            let _ = fs::remove_file(file.path());
        }
    }
}

impl Drop for WholeFile {
    fn drop(&mut self) {
        if !self.is_finished {
            // The failure that led here is the one to report.
            let _ = fs::remove_file(&self.neighbour);
        }
    }
}

/// Writes a whole file, and makes its folder if need be. A device or a pipe is written to as it is; a link is replaced.
///
/// # Errors
/// The system refuses; what was there before remains.
pub fn write_whole(path: &Path, bytes: &[u8], readers: Readers) -> io::Result<()> {
    if fs::metadata(path).is_ok_and(|there| !there.is_file() && !there.is_dir()) {
        return fs::write(path, bytes);
    }
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        create_folders(folder, readers)?;
    }
    let (whole, mut file) = WholeFile::create(path, readers)?;
    file.write_all(bytes)?;
    whole.finish(&file)
}

/// As [`write_whole`], for a file that the user names: a link stays, and what it leads to is replaced.
///
/// # Errors
/// As [`write_whole`].
pub fn write_whole_through_links(path: &Path, bytes: &[u8], readers: Readers) -> io::Result<()> {
    write_whole(&fs::canonicalize(path).unwrap_or_else(|_| path.to_owned()), bytes, readers)
}

/// Creates a file that is not there yet.
///
/// # Errors
/// It is there already, or the system refuses.
pub fn create_new(path: &Path, readers: Readers) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    if readers == Readers::Owner {
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    }
    // Elsewhere the user's folders are the user's alone.
    #[cfg(not(unix))]
    let _ = readers;
    options.open(path)
}

fn create_folders(folder: &Path, readers: Readers) -> io::Result<()> {
    let mut builder = fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    if readers == Readers::Owner {
        std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    }
    #[cfg(not(unix))]
    let _ = readers;
    builder.create(folder)
}

/// Passes a file's name to the disk: without this, a power cut may undo that it was created or renamed. Some network folders
/// cannot, and the file is there all the same.
pub(super) fn sync_folder(path: &Path) {
    #[cfg(unix)]
    if let Some(folder) = path.parent() {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let _ = File::open(folder).and_then(|folder| folder.sync_all());
    }
    #[cfg(not(unix))]
    let _ = path;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_files::TestFile;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
        let mut names: Vec<String> = entries.map(|name| name.to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn file_appears_whole_or_not_at_all() {
        let folder = TestFile::new().0.clone();
        let path = folder.join("deep/file");
        write_whole(&path, b"one", Readers::Usual).unwrap();
        let (unfinished, mut file) = WholeFile::create(&path, Readers::Usual).unwrap();
        file.write_all(b"two").unwrap();
        assert_eq!((fs::read(&path).unwrap(), names(path.parent().unwrap()).len()), (b"one".to_vec(), 2));
        drop(unfinished);
        assert_eq!(
            (fs::read(&path).unwrap(), names(path.parent().unwrap())),
            (b"one".to_vec(), vec!["file".to_owned()])
        );
        write_whole(&path, b"two", Readers::Usual).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert!(write_whole(&path.join("below a file"), b"three", Readers::Usual).is_err());
        // What a killed process has left is in nobody's way.
        let (unfinished, _) = WholeFile::create(&path, Readers::Usual).unwrap();
        let number: u64 = unfinished.neighbour.to_str().unwrap().rsplit(['-', '.']).nth(1).unwrap().parse().unwrap();
        let stale =
            (number + 1..number + 200).map(|n| path.with_file_name(format!(".file.{}-{n}.tmp", std::process::id())));
        let stale: Vec<PathBuf> = stale.collect();
        stale.iter().for_each(|stale| fs::write(stale, b"").unwrap());
        write_whole(&path, b"two", Readers::Usual).unwrap();
        stale.iter().for_each(|stale| fs::remove_file(stale).unwrap());
        drop(unfinished);
        assert_eq!(names(path.parent().unwrap()), ["file"]);
        fs::remove_dir_all(&folder).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn other_names_of_the_file_keep_their_content() {
        let folder = TestFile::new().0.clone();
        let (hard, soft, origin) = (folder.join("hard"), folder.join("soft"), folder.join("origin"));
        write_whole(&origin, b"one", Readers::Usual).unwrap();
        fs::hard_link(&origin, &hard).unwrap();
        std::os::unix::fs::symlink(&origin, &soft).unwrap();
        for link in [&hard, &soft] {
            write_whole(link, b"two", Readers::Usual).unwrap();
            assert_eq!((fs::read(&origin).unwrap(), fs::read(link).unwrap()), (b"one".to_vec(), b"two".to_vec()));
        }
        fs::remove_file(&soft).unwrap();
        std::os::unix::fs::symlink(&origin, &soft).unwrap();
        write_whole_through_links(&soft, b"three", Readers::Usual).unwrap();
        assert!(fs::symlink_metadata(&soft).unwrap().is_symlink());
        assert_eq!((fs::read(&origin).unwrap(), fs::read(&hard).unwrap()), (b"three".to_vec(), b"two".to_vec()));
        fs::remove_dir_all(&folder).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn devices_are_written_to_and_never_replaced() {
        let folder = TestFile::new().0.clone();
        fs::create_dir_all(&folder).unwrap();
        let device = folder.join("null");
        std::os::unix::fs::symlink("/dev/null", &device).unwrap();
        write_whole(&device, b"one", Readers::Usual).unwrap();
        assert!(WholeFile::create(&device, Readers::Usual).is_err());
        assert!(fs::symlink_metadata(&device).unwrap().is_symlink());
        assert_eq!(names(&folder), ["null"]);
        fs::remove_dir_all(&folder).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn rooms_are_the_users_alone() {
        use std::os::unix::fs::PermissionsExt;
        let folder = TestFile::new().0.clone();
        write_whole(&folder.join("maps/room"), b"", Readers::Owner).unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o077;
        assert_eq!((mode(&folder.join("maps")), mode(&folder.join("maps/room"))), (0, 0));
        fs::remove_dir_all(&folder).unwrap();
    }
}

//! Files that appear under their name once they are complete: written to a neighbour in the same folder, passed to the disk,
//! renamed. A reader never sees half a file, what stood there before survives a failure, and no other name of it (a link) is
//! written to.

use std::ffi::OsStr;
use std::fs::{self, File, OpenOptions, TryLockError};
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

/// What becomes of a file that has the name already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Existing {
    /// It stays, also one that appears while the new one is written.
    Keep,
    /// It is replaced.
    Replace,
}

/// A file under construction; dropped before [`Self::finish`], nothing is left of it.
#[derive(Debug)]
pub struct WholeFile {
    neighbour: PathBuf,
    path: PathBuf,
    existing: Existing,
    is_finished: bool,
}

impl WholeFile {
    /// A new neighbour of `path`, and the file to write to. Neighbours that killed processes left of this file are removed.
    ///
    /// # Errors
    /// The system refuses; there is a folder, a device or a pipe, which no file may replace, or a file that is to be kept.
    pub fn create(path: &Path, readers: Readers, existing: Existing) -> io::Result<(Self, File)> {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        if fs::metadata(path).is_ok_and(|there| !there.is_file()) {
            return Err(io::Error::other("it is a folder, a device or a pipe, not a file"));
        }
        if existing == Existing::Keep && path.symlink_metadata().is_ok() {
            return Err(io::Error::new(io::ErrorKind::AlreadyExists, "it is there already"));
        }
        remove_unfinished(path);
        let (start, process) = (neighbour_start(path).ok_or(io::ErrorKind::InvalidInput)?, std::process::id());
        loop {
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            let neighbour = path.with_file_name(format!("{start}{process}-{number}{NEIGHBOUR_END}"));
            let file = match create_new(&neighbour, readers) {
                // Of a process of the same number, on another computer or in another container.
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => continue,
                file => file?,
            };
            // The lock shows to others that it is being written. Who saw it before that removes it. File systems without locks
            // refuse it to others as well, and nobody removes anything.
            let is_taken = matches!(file.try_lock(), Err(TryLockError::WouldBlock));
            if !is_taken && neighbour.symlink_metadata().is_ok() {
                return Ok((Self { neighbour, path: path.to_owned(), existing, is_finished: false }, file));
            }
        }
    }

    /// Gives the written file its name.
    ///
    /// # Errors
    /// The system refuses; nothing is left then. A file that is to be kept has appeared meanwhile: the error names the file
    /// beside it that holds what was written.
    pub fn finish(self, file: &File) -> io::Result<()> {
        file.sync_all()?;
        self.rename()?;
        // On Windows nobody can read a locked file. Where there are no locks, there is nothing to undo.
        let _ = file.unlock();
        Ok(())
    }

    /// Gives a file its name that has been passed to the disk.
    pub(super) fn rename(mut self) -> io::Result<()> {
        let renamed = match self.existing {
            Existing::Replace => fs::rename(&self.neighbour, &self.path),
            Existing::Keep => rename_new(&self.neighbour, &self.path),
        };
        if self.existing == Existing::Keep && is_there_already(&renamed) {
            self.is_finished = true;
            let kept = first_free(&self.path, |name| rename_new(&self.neighbour, name));
            let text = format!(
                "another program has made a file of this name meanwhile: it stays, and what was written is in {}",
                kept.as_ref().unwrap_or(&self.neighbour).display()
            );
            return Err(io::Error::new(io::ErrorKind::AlreadyExists, text));
        }
        renamed?;
        self.is_finished = true;
        sync_folder(&self.path);
        Ok(())
    }
}

fn is_there_already<T>(made: &io::Result<T>) -> bool {
    made.as_ref().is_err_and(|error| error.kind() == io::ErrorKind::AlreadyExists)
}

/// Renames a file unless there is one of the new name.
fn rename_new(from: &Path, to: &Path) -> io::Result<()> {
    match fs::hard_link(from, to) {
        // The file has its name; the other one is removed with the next file written there.
        Ok(()) => drop(fs::remove_file(from)),
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => return Err(error),
        // Some file systems have no links. There an empty file takes the name, and is replaced.
        Err(_) => {
            drop(create_new(to, Readers::Usual)?);
            fs::rename(from, to).inspect_err(|_| drop(fs::remove_file(to)))?;
        }
    }
    Ok(())
}

/// Makes a file of the first free name beside `path`: its own with a number.
pub(super) fn first_free(path: &Path, make: impl Fn(&Path) -> io::Result<()>) -> io::Result<PathBuf> {
    const MAX_NUMBER: u32 = 10_000;
    const MAX_EXTENSION_BYTES: usize = 40;
    let text = |name: Option<&OsStr>| name.unwrap_or_default().to_string_lossy().into_owned();
    let (stem, extension) = match text(path.extension()) {
        extension if extension.is_empty() || extension.len() > MAX_EXTENSION_BYTES => {
            (text(path.file_name()), String::new())
        }
        extension => (text(path.file_stem()), format!(".{extension}")),
    };
    for number in 2..MAX_NUMBER {
        let name = path.with_file_name(format!("{}-{number}{extension}", shortened(&stem)));
        let made = make(&name);
        if !is_there_already(&made) {
            return made.map(|()| name);
        }
    }
    Err(io::ErrorKind::AlreadyExists.into())
}

/// Longest part of a file's own name in that of a neighbour, bytes. Choice: with two numbers it fits the 255 bytes of a name.
const MAX_NAME_BYTES: usize = 200;

fn shortened(name: &str) -> &str {
    &name[..name.floor_char_boundary(MAX_NAME_BYTES)]
}

/// How the names of a file's neighbours begin; a process' number, a hyphen, another number and [`NEIGHBOUR_END`] follow.
fn neighbour_start(path: &Path) -> Option<String> {
    Some(format!(".{}.", shortened(&path.file_name()?.to_string_lossy())))
}
const NEIGHBOUR_END: &str = ".tmp";

fn is_neighbour(name: &str, start: &str) -> bool {
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let numbers = name.strip_prefix(start).and_then(|rest| rest.strip_suffix(NEIGHBOUR_END));
    numbers.and_then(|numbers| numbers.split_once('-')).is_some_and(|(a, b)| is_number(a) && is_number(b))
}

/// Removes what processes that ended before they had written a file have left of it.
pub fn remove_unfinished(path: &Path) {
    let (Some(start), Some(folder)) = (neighbour_start(path), path.parent()) else { return };
    for file in fs::read_dir(or_here(folder)).into_iter().flatten().flatten() {
        let is_file = || file.file_type().is_ok_and(|kind| kind.is_file());
        if file.file_name().to_str().is_some_and(|name| is_neighbour(name, &start)) && is_file() {
            // It is in nobody's way.
            let _ = remove_abandoned(&file.path());
        }
    }
}

/// Removes the user's own file, unless a process still writes it: that holds its lock until it ends.
fn remove_abandoned(neighbour: &Path) -> io::Result<()> {
    let file = OpenOptions::new().write(true).open(neighbour)?;
    #[cfg(unix)]
    if std::os::unix::fs::MetadataExt::uid(&file.metadata()?) != rustix::process::geteuid().as_raw() {
        return Ok(());
    }
    match file.try_lock() {
        Ok(()) => fs::remove_file(neighbour),
        Err(_) => Ok(()),
    }
}

/// The folder of a path without one is the current one.
fn or_here(folder: &Path) -> &Path {
    if folder.as_os_str().is_empty() { Path::new(".") } else { folder }
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
/// The system refuses; what was there before remains. As [`WholeFile::finish`].
pub fn write_whole(path: &Path, bytes: &[u8], readers: Readers, existing: Existing) -> io::Result<()> {
    if fs::metadata(path).is_ok_and(|there| !there.is_file() && !there.is_dir()) {
        return fs::write(path, bytes);
    }
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        create_folders(folder, readers)?;
    }
    let (whole, mut file) = WholeFile::create(path, readers, existing)?;
    file.write_all(bytes)?;
    whole.finish(&file)
}

/// As [`write_whole`], for a file that the user names: a link stays, and what it leads to is replaced.
///
/// # Errors
/// As [`write_whole`].
pub fn write_whole_through_links(path: &Path, bytes: &[u8], readers: Readers, existing: Existing) -> io::Result<()> {
    write_whole(&fs::canonicalize(path).unwrap_or_else(|_| path.to_owned()), bytes, readers, existing)
}

/// Creates a file that is not there yet.
///
/// # Errors
/// It is there already, or the system refuses.
pub(super) fn create_new(path: &Path, readers: Readers) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create_new(true);
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
        let _ = File::open(or_here(folder)).and_then(|folder| folder.sync_all());
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
        write_whole(&path, b"one", Readers::Usual, Existing::Replace).unwrap();
        let (unfinished, mut file) = WholeFile::create(&path, Readers::Usual, Existing::Replace).unwrap();
        file.write_all(b"two").unwrap();
        assert_eq!((fs::read(&path).unwrap(), names(path.parent().unwrap()).len()), (b"one".to_vec(), 2));
        drop(unfinished);
        assert_eq!(
            (fs::read(&path).unwrap(), names(path.parent().unwrap())),
            (b"one".to_vec(), vec!["file".to_owned()])
        );
        write_whole(&path, b"two", Readers::Usual, Existing::Replace).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert!(write_whole(&path.join("below a file"), b"three", Readers::Usual, Existing::Replace).is_err());
        assert_eq!(names(path.parent().unwrap()), ["file"]);
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_file_that_appears_meanwhile_stays_and_nothing_is_lost() {
        let folder = TestFile::new().0.clone();
        fs::create_dir_all(&folder).unwrap();
        for name in ["my.room.mcap".to_owned(), "x".repeat(250), format!("{}.mcap", "ü".repeat(120))] {
            let path = folder.join(&name);
            for round in 0..2 {
                let (whole, mut file) = WholeFile::create(&path, Readers::Usual, Existing::Keep).unwrap();
                file.write_all(b"ours").unwrap();
                fs::write(&path, b"theirs").unwrap();
                let error = whole.finish(&file).unwrap_err();
                let kept = PathBuf::from(error.to_string().split(" is in ").nth(1).unwrap());
                assert_eq!(
                    (fs::read(&path).unwrap(), fs::read(&kept).unwrap()),
                    (b"theirs".to_vec(), b"ours".to_vec())
                );
                assert!(kept.to_str().unwrap().contains(&format!("-{}", round + 2)), "{}", kept.display());
                let refused = WholeFile::create(&path, Readers::Usual, Existing::Keep).unwrap_err();
                assert_eq!(refused.kind(), io::ErrorKind::AlreadyExists);
                fs::remove_file(&path).unwrap();
            }
            write_whole(&path, b"alone", Readers::Usual, Existing::Keep).unwrap();
            assert_eq!(fs::read(&path).unwrap(), b"alone");
        }
        assert_eq!(names(&folder).len(), 9, "{:?}", names(&folder));
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn what_killed_processes_left_is_removed_and_nothing_else() {
        let folder = TestFile::new().0.clone();
        fs::create_dir_all(&folder).unwrap();
        let path = folder.join("room.mcap");
        let (_written, _held) = WholeFile::create(&path, Readers::Usual, Existing::Replace).unwrap();
        let written = names(&folder);
        let others =
            [".room.mcap.1.tmp", ".room.mcap.1-2-3.tmp", ".room.mcap.-2.tmp", ".room.mcap.1-2", "room.mcap.1-2.tmp"];
        let others = others.into_iter().chain([".room.mcap.x.1-2.tmp", ".room.mcap2.1-2.tmp"]);
        others.for_each(|name| fs::write(folder.join(name), b"").unwrap());
        fs::create_dir(folder.join(".room.mcap.7-7.tmp")).unwrap();
        let left = names(&folder);
        for left in [format!(".room.mcap.{}-900000.tmp", std::process::id()), ".room.mcap.4194305-0.tmp".to_owned()] {
            fs::write(folder.join(left), b"half").unwrap();
        }
        write_whole(&path, b"whole", Readers::Usual, Existing::Replace).unwrap();
        fs::remove_file(&path).unwrap();
        assert_eq!(names(&folder), left);
        assert!(left.contains(&written[0]), "it is still being written");
        fs::remove_dir_all(&folder).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn other_names_of_the_file_keep_their_content() {
        let folder = TestFile::new().0.clone();
        let (hard, soft, origin) = (folder.join("hard"), folder.join("soft"), folder.join("origin"));
        write_whole(&origin, b"one", Readers::Usual, Existing::Replace).unwrap();
        fs::hard_link(&origin, &hard).unwrap();
        std::os::unix::fs::symlink(&origin, &soft).unwrap();
        for link in [&hard, &soft] {
            write_whole(link, b"two", Readers::Usual, Existing::Replace).unwrap();
            assert_eq!((fs::read(&origin).unwrap(), fs::read(link).unwrap()), (b"one".to_vec(), b"two".to_vec()));
        }
        fs::remove_file(&soft).unwrap();
        std::os::unix::fs::symlink(&origin, &soft).unwrap();
        write_whole_through_links(&soft, b"three", Readers::Usual, Existing::Replace).unwrap();
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
        write_whole(&device, b"one", Readers::Usual, Existing::Replace).unwrap();
        assert!(WholeFile::create(&device, Readers::Usual, Existing::Replace).is_err());
        assert!(fs::symlink_metadata(&device).unwrap().is_symlink());
        assert_eq!(names(&folder), ["null"]);
        fs::remove_dir_all(&folder).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn rooms_are_the_users_alone() {
        use std::os::unix::fs::PermissionsExt;
        let folder = TestFile::new().0.clone();
        write_whole(&folder.join("maps/room"), b"", Readers::Owner, Existing::Replace).unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o077;
        assert_eq!((mode(&folder.join("maps")), mode(&folder.join("maps/room"))), (0, 0));
        fs::remove_dir_all(&folder).unwrap();
    }
}

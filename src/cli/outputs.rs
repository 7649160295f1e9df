//! The files that a command writes: checked against those that it reads and against each other before any work.

use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;

use radar_recording::{Existing, Readers, write_whole};

/// Links that are followed before a path is taken as it is. Choice: as Linux.
const MAX_LINKS: u32 = 40;

/// Command-line argument of commands that write files.
#[derive(Debug, Clone, Copy, Default, Args)]
pub(super) struct ReplaceArgument {
    /// Replaces files that are there already
    #[arg(long)]
    force: bool,
}

/// Whether a file that is there was made by the command that writes it, which then replaces it unasked.
pub(super) type IsOwn = fn(&Path) -> bool;

/// Of outputs whose old files look like others': none is replaced unasked.
pub(super) fn never(_: &Path) -> bool {
    false
}

/// Of outputs that are inputs as well: what they hold was read and is written again.
pub(super) fn always(_: &Path) -> bool {
    true
}

/// All files of a command.
#[derive(Debug, Default)]
pub(super) struct CommandFiles {
    inputs: Vec<PathBuf>,
    outputs: Vec<Output>,
}

#[derive(Debug)]
struct Output {
    path: PathBuf,
    is_own: IsOwn,
    /// Whether its folder must be there; others are made.
    needs_folder: bool,
}

impl CommandFiles {
    /// Adds files that the command reads.
    pub fn reads<P: Into<PathBuf>>(mut self, files: impl IntoIterator<Item = P>) -> Self {
        self.inputs.extend(files.into_iter().map(P::into));
        self
    }

    /// Adds files that it writes, and makes the folders of.
    pub fn writes<P: Into<PathBuf>>(self, files: impl IntoIterator<Item = P>, is_own: IsOwn) -> Self {
        self.and_outputs(files, is_own, false)
    }

    /// Adds files that it writes bit by bit, into folders that are there.
    pub fn records<P: Into<PathBuf>>(self, files: impl IntoIterator<Item = P>, is_own: IsOwn) -> Self {
        self.and_outputs(files, is_own, true)
    }

    fn and_outputs<P: Into<PathBuf>>(
        mut self,
        files: impl IntoIterator<Item = P>,
        is_own: IsOwn,
        needs_folder: bool,
    ) -> Self {
        let output = |file: P| Output { path: file.into(), is_own, needs_folder };
        self.outputs.extend(files.into_iter().map(output));
        self
    }

    /// Checks that no output is an input or another output, however it is named, that none replaces a file of others unless
    /// the user wants it, and that the folders are there or can be made.
    pub fn check(self, replace: ReplaceArgument) -> Result<Outputs> {
        self.check_with(replace.force, "give --force to replace it")
    }

    /// The same for a command that takes no --force.
    pub fn check_new(self) -> Result<Outputs> {
        self.check_with(false, "remove it")
    }

    fn check_with(self, is_forced: bool, otherwise: &str) -> Result<Outputs> {
        self.check_distinct()?;
        let mut replaced = Vec::new();
        for Output { path: output, is_own, needs_folder } in self.outputs {
            if output.is_dir() {
                bail!("{} is a folder: give the file to write", output.display());
            }
            if is_device(&output) {
                continue;
            }
            if output.symlink_metadata().is_err() {
                check_folder(&output, needs_folder)?;
                continue;
            }
            if !is_forced && !is_own(&output) {
                bail!("{} is there already: choose another name, or {otherwise}", output.display());
            }
            replaced.push(output);
        }
        Ok(Outputs { replaced, is_forced })
    }

    fn check_distinct(&self) -> Result<()> {
        let inputs: Vec<(&Path, String)> = self.inputs.iter().map(|path| (path.as_path(), place(path))).collect();
        let mut outputs: Vec<(&Path, String)> = Vec::new();
        for output in self.outputs.iter().map(|output| output.path.as_path()).filter(|output| !is_device(output)) {
            let own = place(output);
            if let Some((input, _)) = inputs.iter().find(|(_, place)| *place == own) {
                bail!("{} is {} itself: choose another name for what is written", output.display(), input.display());
            }
            if let Some((other, _)) = outputs.iter().find(|(_, place)| *place == own) {
                bail!("{} and {} are one file: give each output its own name", other.display(), output.display());
            }
            outputs.push((output, own));
        }
        Ok(())
    }
}

/// The checked outputs of a command.
#[derive(Debug)]
pub(super) struct Outputs {
    replaced: Vec<PathBuf>,
    is_forced: bool,
}

impl Outputs {
    /// What becomes of a file that is there: without --force, one that has appeared since the check stays.
    pub fn existing(&self, output: &Path) -> Existing {
        match self.is_forced || self.replaced.iter().any(|path| path == output) {
            true => Existing::Replace,
            false => Existing::Keep,
        }
    }

    /// Writes a whole file, and makes its folder if need be.
    pub fn write(&self, output: &Path, bytes: &[u8]) -> Result<()> {
        write_whole(output, bytes, Readers::Usual, self.existing(output))
            .with_context(|| format!("cannot write {}", output.display()))
    }
}

/// Refuses an output whose folder is not there although it must be, or cannot be made because something above it is no folder:
/// better before hours of work than after.
fn check_folder(output: &Path, needs_folder: bool) -> Result<()> {
    let path = std::path::absolute(output).unwrap_or_else(|_| output.to_owned());
    match path.ancestors().skip(1).find(|above| above.symlink_metadata().is_ok()) {
        Some(above) if !above.is_dir() => {
            bail!("{}: {} is no folder: choose another name", output.display(), above.display())
        }
        Some(above) if needs_folder && path.parent() != Some(above) => {
            let folder = output.parent().unwrap_or(above);
            bail!("there is no folder {}: make it, or choose another name", folder.display())
        }
        _ => Ok(()),
    }
}

/// Whether a file begins like this.
pub(super) fn begins_with(file: &Path, beginning: &[u8]) -> bool {
    let mut start = vec![0; beginning.len()];
    let is_file = std::fs::metadata(file).is_ok_and(|metadata| metadata.is_file());
    let mut read = || std::fs::File::open(file)?.read_exact(&mut start);
    is_file && read().is_ok() && start == beginning
}

/// Whether a file is a picture.
pub(super) fn is_png(file: &Path) -> bool {
    begins_with(file, b"\x89PNG\r\n\x1a\n")
}

/// Whether it is a device or a pipe: those are written to, and nothing is lost.
fn is_device(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|there| !there.is_file() && !there.is_dir())
}

/// Where a path leads, also one to a file that is not there yet; the same for all its spellings.
fn place(path: &Path) -> String {
    // On Windows this drops the blanks and dots at a name's end, which do not count there.
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let place = followed(&path, MAX_LINKS).to_string_lossy().into_owned();
    // Their file systems do not distinguish between capital and small letters.
    if cfg!(any(windows, target_os = "macos")) { place.to_lowercase() } else { place }
}

/// A path without links and `..`, as far as there is anything.
fn followed(path: &Path, links: u32) -> PathBuf {
    if let Ok(real) = path.canonicalize() {
        return real;
    }
    let Some(folder) = path.parent() else { return path.to_owned() };
    let Some(name) = path.file_name() else {
        // It ends in `..` behind a folder that is not there.
        let folder = followed(folder, links);
        return folder.parent().unwrap_or(&folder).to_owned();
    };
    match path.read_link() {
        Ok(target) if links > 0 => followed(&folder.join(target), links - 1),
        _ => followed(folder, links).join(name),
    }
}

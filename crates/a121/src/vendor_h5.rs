//! Reads recordings of the vendor's exploration tool (HDF5, A121 generation): first session, first
//! group, first sensor.
//!
//! Layout: `server_info` (JSON); `session` or `sessions/session_0` with `session_config` (JSON) and
//! `group_0/entry_0/{sensor_id, metadata (JSON), result/…}`. `result/` holds `frame` [frame, sweep,
//! point] of {real, imag: i16}, and per frame `tick`, `temperature` and three flags. There are no
//! host times: a frame's time is its tick, counted from the first one.
//!
//! The vendor's tool writes the index of a file (groups, shapes, places of the chunks) and its JSON
//! texts when it closes the file. What is on the disk before that are compressed chunks without
//! configuration, ticks and order, of which no frame can be made; such a file is refused as
//! [not closed](VendorFileError::NotClosed). A file that was flushed holds everything up to then and
//! is read as far as it goes: see [`Unfinished`].
//!
//! Nothing in a file is trusted: each length is compared with the configuration, with the size of
//! the file and with a limit before memory is taken. Frames are read as they are asked for.
//!
//! ```no_run
//! use a121::vendor_h5::VendorRecording;
//!
//! let recording = VendorRecording::open("tank.h5")?;
//! println!("{} frames of {} points", recording.frame_count(), recording.config.points_per_frame());
//! for frame in recording.frames() {
//!     println!("{} °C", frame?.temperature_c);
//! }
//! # Ok::<(), a121::vendor_h5::VendorFileError>(())
//! ```

mod file;
mod frames;
mod superblock;

use std::fmt;
use std::io::Read;
use std::path::{Path, PathBuf};

use self::file::VendorFile;
use self::frames::StoredFrames;
use crate::{ConfigError, Frame, SensorConfig};

/// Limit of a file, bytes; it is held in memory. Choice: about 80 minutes of the fastest preset.
const MAX_BYTES: u64 = 1 << 30;

/// A file of the vendor's tool that cannot be read. Each message says what happened and what to do.
#[derive(Debug, thiserror::Error)]
pub enum VendorFileError {
    /// The system refused a file operation.
    #[error("cannot read {path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A directory or device instead of a file.
    #[error("{0} is a folder or a device: give the file itself")]
    NotAFile(PathBuf),
    /// Larger than anything that the vendor's tool records at once.
    #[error("{path}: {what} is {bytes} bytes, more than the {max} bytes that are imported: record in shorter pieces")]
    TooBig {
        /// The file.
        path: PathBuf,
        /// The file, data set or chunk.
        what: String,
        /// Its size, bytes.
        bytes: u64,
        /// The limit, bytes.
        max: u64,
    },
    /// More frames than are imported at once.
    #[error("{path}: {at} holds {count} frames, more than the {max} that are imported: record in shorter pieces")]
    TooManyFrames {
        /// The file.
        path: PathBuf,
        /// The object in the file.
        at: String,
        /// How many.
        count: u64,
        /// The limit.
        max: u64,
    },
    /// Not an HDF5 file, or truncated or damaged.
    #[error("{path} cannot be read as HDF5 (at {at}): {reason}; it is damaged, cut short or of another format")]
    Hdf5 {
        /// The file.
        path: PathBuf,
        /// The object in the file.
        at: String,
        /// The HDF5 reader's message.
        reason: String,
    },
    /// The writer ended without closing the file, and what is in it cannot be read.
    #[error("{path} was not closed by its writer (at {at}: {reason}): {remedy}")]
    NotClosed {
        /// The file.
        path: PathBuf,
        /// The object in the file.
        at: String,
        /// What is missing.
        reason: String,
        /// Text: what is left of the recording, and what to do.
        remedy: &'static str,
    },
    /// An HDF5 file with another layout than the vendor's exploration tool writes.
    #[error("{path}: {at} {reason}; is it a recording of the vendor's A121 exploration tool?")]
    Layout {
        /// The file.
        path: PathBuf,
        /// The object in the file.
        at: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The configuration breaks a rule of the sensor.
    #[error("{path}: the sensor configuration breaks a rule of the sensor: {source}")]
    Config {
        /// The file.
        path: PathBuf,
        /// The broken rule.
        source: ConfigError,
    },
}

/// How many parts a file holds, of which the first are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Contents {
    /// Sessions of the file.
    pub sessions: usize,
    /// Groups of the first session.
    pub groups: usize,
    /// Sensors of its first group.
    pub sensors: usize,
}

impl Contents {
    /// Whether the file holds more than what is read.
    pub fn has_more(&self) -> bool {
        self.sessions.max(self.groups).max(self.sensors) > 1
    }
}

/// What is missing at the end of a recording whose writer was interrupted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unfinished {
    /// Whether the writer did not close the file; otherwise it stopped between the parts of a frame.
    pub not_closed: bool,
    /// Frames that lack some of their parts, or whose space was reserved and never written.
    pub incomplete_frames: u64,
    /// Bytes after the end of what was flushed; the index does not cover them.
    pub unindexed_bytes: u64,
}

/// An open recording of the vendor's tool: the first sensor of the first group of the first session.
pub struct VendorRecording {
    /// Configuration of the sensor; breaks no rule of the sensor. Its frame rate is the session's
    /// update rate where the server paced the frames.
    pub config: SensorConfig,
    /// Ticks of the board's clock per second.
    pub ticks_per_second: u32,
    /// Distance between range points at step length 1, metres; older files lack it.
    pub base_step_length_m: Option<f64>,
    /// Name of the board, such as "xc120"; older files lack it.
    pub board: Option<String>,
    /// Version of the sensor's software; older files lack it.
    pub rss_version: Option<String>,
    /// What the file holds.
    pub contents: Contents,
    /// What is missing at its end; `None` if the writer finished it.
    pub unfinished: Option<Unfinished>,
    frames: StoredFrames,
}

impl VendorRecording {
    /// Opens a file and reads all but its samples.
    ///
    /// # Errors
    /// The file cannot be opened, is of another kind, damaged or too big, or its configuration
    /// breaks a rule of the sensor.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, VendorFileError> {
        let path = path.as_ref();
        VendorFile::new(path, bytes_of(path)?)?.recording()
    }

    /// How many complete frames it holds.
    pub fn frame_count(&self) -> usize {
        self.frames.times_ns().len()
    }

    /// Their times, nanoseconds since the first one's tick, in the order of the file.
    pub fn times_ns(&self) -> impl ExactSizeIterator<Item = i64> {
        self.frames.times_ns()
    }

    /// The complete frames in the order of the file. Nothing follows an error: the file is damaged there.
    pub fn frames(&self) -> impl Iterator<Item = Result<Frame, VendorFileError>> {
        self.frames.iter()
    }
}

impl fmt::Debug for VendorRecording {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let mut text = f.debug_struct("VendorRecording");
        text.field("config", &self.config).field("board", &self.board).field("frames", &self.frame_count());
        text.finish_non_exhaustive()
    }
}

/// Content of a file.
fn bytes_of(path: &Path) -> Result<Vec<u8>, VendorFileError> {
    let io_error = |source| VendorFileError::Io { path: path.to_owned(), source };
    let metadata = std::fs::metadata(path).map_err(io_error)?;
    if !metadata.is_file() {
        return Err(VendorFileError::NotAFile(path.to_owned()));
    }
    too_big_unless(metadata.len() <= MAX_BYTES, path, "the file", metadata.len(), MAX_BYTES)?;
    // Read here, to separate errors of the system from errors of the parser.
    let mut bytes = Vec::new();
    // As long as it is, and one more in which its end is found: growing on the way takes up to three times that.
    bytes.try_reserve_exact(metadata.len() as usize + 1).map_err(|error| io_error(error.into()))?;
    let file = std::fs::File::open(path).map_err(io_error)?;
    file.take(MAX_BYTES).read_to_end(&mut bytes).map_err(io_error)?;
    Ok(bytes)
}

fn too_big_unless(fits: bool, path: &Path, what: &str, bytes: u64, max: u64) -> Result<(), VendorFileError> {
    if fits {
        Ok(())
    } else {
        Err(VendorFileError::TooBig { path: path.to_owned(), what: what.to_owned(), bytes, max })
    }
}

#[cfg(test)]
#[path = "vendor_h5_tests.rs"]
mod tests;

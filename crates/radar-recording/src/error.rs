//! Errors of recordings and imports. Each message states what happened and what to do.

use std::path::PathBuf;

use a121::ConfigError;
use a121::vendor_h5::VendorFileError;

/// A recording that cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The system refused a file operation.
    #[error("cannot {doing} {path}: {source}")]
    Io {
        /// The operation: "open", "read", "create", "write".
        doing: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A new recording would replace a file.
    #[error("{0} is there already: choose another name, or remove it")]
    AlreadyThere(PathBuf),
    /// A live recording was removed, renamed or replaced by others.
    #[error("{path} was removed, renamed or replaced while it was recorded: the complete recording is in {copy}")]
    Displaced {
        /// Its name.
        path: PathBuf,
        /// Where the recording is now.
        copy: PathBuf,
    },
    /// A directory or device instead of a file.
    #[error("{0} is a folder or a device: give the recording's file")]
    NotAFile(PathBuf),
    /// An empty file.
    #[error("{0} is empty: the recording ended before anything was written; record again")]
    Empty(PathBuf),
    /// Not an MCAP file.
    #[error("{path} is not a recording: it does not begin as an MCAP file; {hint}")]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// What to do.
        hint: &'static str,
    },
    /// An MCAP file without the header of a recording.
    #[error(
        "{path} is an MCAP file, but holds no radar-chaperone header ({found}): it comes from another program or was cut \
         right at its start"
    )]
    NoHeader {
        /// The file.
        path: PathBuf,
        /// What was found instead of the header.
        found: String,
    },
    /// The header and its copies are lost, and what was recorded is not.
    #[error(
        "{path} has lost its header ({reason}), but holds frames or poses: give a recording of the same sensor with the same \
         settings as `radar-chaperone recover {path} --header-of OTHER.mcap --out NEW.mcap`"
    )]
    HeaderLost {
        /// The file.
        path: PathBuf,
        /// What was found instead of the header.
        reason: String,
    },
    /// The file has a newer format.
    #[error("the recording has format {found}, this program reads up to {known}: update radar-chaperone")]
    NewerFormat {
        /// Format of the file.
        found: u32,
        /// Newest supported format.
        known: u32,
    },
    /// A header field is missing or invalid.
    #[error("the recording's header field {field} is unusable: {reason}")]
    HeaderField {
        /// The field.
        field: &'static str,
        /// What is wrong with it.
        reason: String,
    },
    /// The configuration breaks a rule of the sensor.
    #[error("the recording's sensor configuration breaks a rule of the sensor: {0}")]
    Config(#[from] ConfigError),
}

/// A recording of another program, or a track, that cannot be imported.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// A recording of the vendor's tool that cannot be read.
    #[error(transparent)]
    Vendor(#[from] VendorFileError),
    /// The recording that is written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
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
    /// Larger than a track of hours.
    #[error("{path}: {what} is {bytes} bytes, more than the {max} bytes that are imported: record in shorter pieces")]
    TooBig {
        /// The file.
        path: PathBuf,
        /// What is too big.
        what: String,
        /// Its size, bytes.
        bytes: u64,
        /// The limit, bytes.
        max: u64,
    },
    /// A recording that is too long for poses of a sensor at rest.
    #[error(
        "{path} lasts {span_s:.0} s by its ticks; a fixed pose is given for at most {max_s:.0} s: give a track instead"
    )]
    TooLongAtRest {
        /// The file.
        path: PathBuf,
        /// Time between its first and last frame, seconds.
        span_s: f64,
        /// The limit, seconds.
        max_s: f64,
    },
    /// An invalid line of a track.
    #[error("{path}, line {line}: {reason}; {example}")]
    TrackLine {
        /// The file.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// What is wrong with it.
        reason: String,
        /// Text: an example of a valid line.
        example: &'static str,
    },
}

//! What can go wrong with recordings and imports: each message says what happened and what to do.

use std::path::PathBuf;

use a121::ConfigError;

/// A recording that cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The system refused the file.
    #[error("cannot {doing} {path}: {source}")]
    Io {
        /// "open", "read", "create", "write".
        doing: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A folder or a device where a file should be.
    #[error("{0} is a folder or a device: give the recording's file")]
    NotAFile(PathBuf),
    /// No bytes.
    #[error("{0} is empty: the recording ended before anything was written; record again")]
    Empty(PathBuf),
    /// Another format.
    #[error("{path} is not a recording: it does not begin as an MCAP file; {hint}")]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// What to do.
        hint: &'static str,
    },
    /// MCAP, but without the records that say how it was measured.
    #[error(
        "{path} is an MCAP file, but holds no radar-chaperone header ({found}): it comes from another program or was cut \
         right at its start"
    )]
    NoHeader {
        /// The file.
        path: PathBuf,
        /// What stood where the header should be.
        found: String,
    },
    /// Written by a later program.
    #[error("the recording has format {found}, this program reads up to {known}: update radar-chaperone")]
    NewerFormat {
        /// What the file says.
        found: u32,
        /// What this program knows.
        known: u32,
    },
    /// A header field that is missing or makes no sense.
    #[error("the recording's header field {field} is unusable: {reason}")]
    HeaderField {
        /// Which.
        field: &'static str,
        /// Why.
        reason: String,
    },
    /// A configuration that no sensor takes.
    #[error("the recording's sensor configuration breaks a rule of the sensor: {0}")]
    Config(#[from] ConfigError),
}

/// A foreign recording or track that cannot be imported.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The system refused the file.
    #[error("cannot read {path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A folder or a device where a file should be.
    #[error("{0} is a folder or a device: give the file itself")]
    NotAFile(PathBuf),
    /// Larger than anything the vendor's tool records in one go.
    #[error("{path}: {what} is {bytes} bytes, more than the {max} bytes that are imported: record in shorter pieces")]
    TooBig {
        /// The file.
        path: PathBuf,
        /// File, data set or chunk.
        what: String,
        /// Its size.
        bytes: u64,
        /// The bound.
        max: u64,
    },
    /// Not HDF5, or cut, or damaged.
    #[error("{path} cannot be read as HDF5 (at {at}): {reason}; it is damaged, cut short or of another format")]
    Hdf5 {
        /// The file.
        path: PathBuf,
        /// Which object.
        at: String,
        /// The reader's reason.
        reason: String,
    },
    /// HDF5, but not as the vendor's exploration tool writes it.
    #[error("{path}: {at} {reason}; is it a recording of the vendor's A121 exploration tool?")]
    Layout {
        /// The file.
        path: PathBuf,
        /// Which object.
        at: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A configuration that no sensor takes.
    #[error("{path}: the sensor configuration breaks a rule of the sensor: {source}")]
    Config {
        /// The file.
        path: PathBuf,
        /// The rule.
        source: ConfigError,
    },
    /// A line of a track that is no pose.
    #[error("{path}, line {line}: {reason}; {example}")]
    TrackLine {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What is wrong with it.
        reason: String,
        /// What a track of this format looks like.
        example: &'static str,
    },
}

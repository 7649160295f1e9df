//! What can go wrong when a report is written.

use std::path::PathBuf;

/// Why a file of a report was not written or not read back.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The file system said no.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// The file in question.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A picture that the PNG encoder refused.
    #[error("a picture of {width} × {height} pixels does not make a PNG: {source}")]
    Png {
        /// Pixels across.
        width: usize,
        /// Pixels down.
        height: usize,
        /// What the encoder said.
        source: image::ImageError,
    },
    /// A number that no file of ours may hold.
    #[error("{what} is {value}, which is not a finite number")]
    NotFinite {
        /// Which number, as a path into the data: `obstacles[2].position_m`.
        what: String,
        /// Its value.
        value: f64,
    },
    /// A value that does not become JSON.
    #[error("{path}: {source}", path = path.display())]
    Json {
        /// The file in question.
        path: PathBuf,
        /// What the serializer said.
        source: serde_json::Error,
    },
    /// A volume whose sizes do not fit its values.
    #[error("a volume of {size:?} voxels (x, y, z) has {values} values")]
    VolumeSize {
        /// Voxels along x, y, z.
        size: [usize; 3],
        /// Number of values.
        values: usize,
    },
    /// An extra entry that would hide one of the file's own.
    #[error("the extra entry \"{0}\" has the name of one that the file has anyway")]
    ExtraKey(String),
    /// A file that is not the .npy volume it should be.
    #[error("{path}: no little-endian f32 volume in C order: {reason}", path = path.display())]
    NotNpy {
        /// The file in question.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A file that is not the .ply cloud it should be.
    #[error("{path}: no point cloud of ours: {reason}", path = path.display())]
    NotPly {
        /// The file in question.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}

//! Errors of writing and reading reports.

use std::path::PathBuf;

/// Errors of writing and reading reports.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A file system error.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The PNG encoder rejected an image.
    #[error("a picture of {width} × {height} pixels cannot be written as PNG: {source}")]
    Png {
        /// Width, pixels.
        width: usize,
        /// Height, pixels.
        height: usize,
        /// The encoder's error.
        source: image::ImageError,
    },
    /// A film has no pictures, or the GIF encoder rejected one.
    #[error("a film of {frames} pictures cannot be written as GIF: {source}")]
    Gif {
        /// Number of pictures.
        frames: usize,
        /// The encoder's error.
        source: image::ImageError,
    },
    /// A number that must be finite is not.
    #[error("{what} is {value}, which is not a finite number")]
    NotFinite {
        /// Path of the number in the data: `obstacles[2].position_m`.
        what: String,
        /// Its value.
        value: f64,
    },
    /// A value cannot be converted to JSON.
    #[error("{path}: {source}", path = path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// The serializer's error.
        source: serde_json::Error,
    },
    /// The size of a volume does not match its number of values.
    #[error("a volume of {size:?} voxels (x, y, z) has {values} values")]
    VolumeSize {
        /// Voxels along x, y, z.
        size: [usize; 3],
        /// Number of values.
        values: usize,
    },
    /// An extra entry has the name of a standard entry.
    #[error("the extra entry \"{0}\" has the name of a standard entry")]
    ExtraKey(String),
    /// The file is not the expected .npy volume.
    #[error("{path}: no little-endian f32 volume in C order: {reason}", path = path.display())]
    NotNpy {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
    /// The file is not the expected .ply point cloud.
    #[error("{path}: not a point cloud of this program: {reason}", path = path.display())]
    NotPly {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
}

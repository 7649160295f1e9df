//! Errors of rendering.

/// What replaces a graphics card where that is one command.
const SOFTWARE_RENDERER: &str = if cfg!(target_os = "linux") {
    ", or a software renderer (Debian and Ubuntu: `apt install mesa-vulkan-drivers libvulkan1`)"
} else {
    ""
};

/// Errors of rendering. Callers continue without images.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RenderError {
    /// Neither a graphics card nor a software renderer offers Vulkan.
    #[error("no graphics adapter offers Vulkan: install a GPU driver{SOFTWARE_RENDERER}")]
    NoAdapter,
    /// The adapter is there but cannot be used.
    #[error("graphics adapter {adapter} provides no device: {cause}")]
    NoDevice {
        /// Name of the adapter.
        adapter: String,
        /// Error text of the driver.
        cause: String,
    },
    /// The image has no pixels or is larger than the device allows.
    #[error("picture of {width} × {height} pixels: each side must be from 1 to {greatest}")]
    ImageSize {
        /// Requested width, pixels.
        width: u32,
        /// Requested height, pixels.
        height: u32,
        /// Largest side that the device supports, pixels.
        greatest: u32,
    },
    /// The eye's projection is degenerate.
    #[error(
        "eye with tangents left, right, top, bottom {tangents:?} at {position_m:?} m: left must be below right, top below bottom, all finite"
    )]
    View {
        /// The tangents as given.
        tangents: [f64; 4],
        /// Position of the eye, tracking frame, metres.
        position_m: [f64; 3],
    },
    /// The device is lost: the driver was reset or updated, or the card was removed. Nothing on it
    /// is usable any more; a new renderer on a new device is.
    #[error("graphics adapter {adapter} lost its device: {cause}")]
    DeviceLost {
        /// Name of the adapter.
        adapter: String,
        /// Error text of the driver.
        cause: String,
    },
    /// The device rejected an operation.
    #[error("the graphics device failed: {0}")]
    Device(String),
}

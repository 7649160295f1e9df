//! Why nothing could be drawn.

/// Errors of drawing; the rest of a run goes on without pictures.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RenderError {
    /// Neither a graphics card nor a software renderer offers Vulkan.
    #[error(
        "no graphics adapter offers Vulkan: install a GPU driver, or the software renderer with \
         `apt install mesa-vulkan-drivers libvulkan1`"
    )]
    NoAdapter,
    /// The adapter is there but cannot be used.
    #[error("graphics adapter {adapter} gives no device: {cause}")]
    NoDevice {
        /// Its name.
        adapter: String,
        /// What it said.
        cause: String,
    },
    /// A picture without pixels, or with more than the device can hold.
    #[error("picture of {width} × {height} pixels: each side must be from 1 to {greatest}")]
    ImageSize {
        /// Width asked for.
        width: u32,
        /// Height asked for.
        height: u32,
        /// The device's limit.
        greatest: u32,
    },
    /// An eye that looks nowhere.
    #[error(
        "eye with tangents left, right, top, bottom {tangents:?} at {position_m:?} m: left must be below right, top below bottom, all finite"
    )]
    View {
        /// The tangents as given.
        tangents: [f64; 4],
        /// Where the eye is.
        position_m: [f64; 3],
    },
    /// The device is gone: the driver was reset or updated, or the card was pulled. Nothing on it can be used any more; a new
    /// renderer on a new device can.
    #[error("graphics adapter {adapter} lost its device: {cause}")]
    DeviceLost {
        /// Its name.
        adapter: String,
        /// What it said.
        cause: String,
    },
    /// The device refused work.
    #[error("the graphics device failed: {0}")]
    Device(String),
}

//! Errors of the desktop view.

use crate::render::RenderError;

/// Errors of the desktop view.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// There is no desktop.
    #[error(
        "no window can be opened: {0}. A view needs a desktop (on Linux an X server named by DISPLAY); --view-shot DIR draws pictures without one"
    )]
    NoDesktop(String),
    /// The desktop does not create a window.
    #[error("the desktop provides no window: {0}")]
    NoWindow(String),
    /// The window has no drawable surface.
    #[error("the window cannot be drawn to: {0}")]
    NoSurface(String),
    /// Rendering failed.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// An image cannot be encoded.
    #[error("a picture of the view cannot be encoded as PNG: {0}")]
    Png(String),
    /// The thread of the pipeline stopped.
    #[error("the reconstruction stopped: {0}")]
    Stopped(String),
}

//! Why there is no view.

use crate::render::RenderError;

/// Errors of the view.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The desktop cannot be reached.
    #[error(
        "no window can be opened: {0}. A view needs a desktop (on Linux an X server named by DISPLAY); --view-shot DIR draws pictures without one"
    )]
    NoDesktop(String),
    /// The desktop is there but gives no window.
    #[error("the desktop gives no window: {0}")]
    NoWindow(String),
    /// The window cannot be drawn to.
    #[error("the window cannot be drawn to: {0}")]
    NoSurface(String),
    /// Nothing can be drawn.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A picture cannot be written.
    #[error("cannot write {path}: {cause}")]
    Write {
        /// Where to.
        path: String,
        /// What went wrong.
        cause: String,
    },
    /// The pipeline's thread stopped working.
    #[error("the reconstruction stopped: {0}")]
    Stopped(String),
}

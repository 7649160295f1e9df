//! Warnings as pictures, by wgpu: panel textures and where the panels stand, and a preview of what each eye sees.
//!
//! Two parts that can be used apart. [`Renderer::quads`] draws textures and says where they stand: all that a SteamVR overlay
//! needs. [`Renderer::preview`] shows these quads in a dark room as an eye would see them: for reports, and without a headset.
//! No window. The same input gives the same bytes on the same machine.

mod error;
mod eye;
mod gpu;
mod painter;
mod preview;
mod quads;
mod renderer;

pub use error::RenderError;
pub use eye::EyeView;
pub use gpu::needed_limits;
pub use quads::Quad;
pub use renderer::Renderer;

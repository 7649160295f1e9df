//! Renders warnings with wgpu: panel textures with their poses, stereo windows, eye images, and a
//! preview.
//!
//! The parts can be used separately. [`Renderer::quads`] draws textures and returns their poses,
//! which is all that a SteamVR overlay needs. [`Renderer::window`] and [`Renderer::eye`] draw
//! panels and obstacle shapes as one eye sees them, for displays with a separate image per eye.
//! [`Renderer::preview`] shows quads in a dark room, for reports and without a headset. No desktop
//! window is opened. The same input gives the same bytes on the same machine.

mod error;
mod eye;
mod eye_renderer;
mod gpu;
mod label;
mod painter;
mod preview;
mod quads;
mod renderer;
mod stereo;

pub use error::RenderError;
pub use eye::EyeView;
pub(crate) use gpu::Gpu;
pub use gpu::needed_limits;
pub use quads::{Quad, QuadKind};
pub use renderer::Renderer;
pub use stereo::{StereoScene, Window};

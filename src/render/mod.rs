//! Warnings as pictures, by wgpu: panel textures and where the panels stand, and a preview of what each eye sees.
//!
//! Parts that can be used apart. [`Renderer::quads`] draws textures and says where they stand: all that a SteamVR overlay
//! needs. [`Renderer::window`] and [`Renderer::eye`] draw them, with the shapes of obstacles, as an eye sees them, for displays that
//! show each eye its own picture. [`Renderer::preview`] shows quads in a dark room: for reports, and without a headset. Nothing
//! opens a window of the desktop. The same input gives the same bytes on the same machine.

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
pub use gpu::needed_limits;
pub use quads::{Quad, QuadKind};
pub use renderer::Renderer;
pub use stereo::{StereoScene, Window};

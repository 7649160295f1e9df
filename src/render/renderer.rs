//! The renderer: a device, the painter of textures with its cache, and the preview.

use glam::DVec3;
use image::RgbaImage;

use super::error::RenderError;
use super::eye::EyeView;
use super::gpu::Gpu;
use super::painter::Painter;
use super::preview::Previewer;
use super::quads::{Quad, QuadCache};
use crate::warning::{WarningSettings, Warnings};

/// Draws warnings, without a window.
pub struct Renderer {
    gpu: Gpu,
    painter: Painter,
    previewer: Previewer,
    cache: QuadCache,
}

impl Renderer {
    /// Opens a graphics card, or a software renderer where there is none.
    ///
    /// # Errors
    /// [`RenderError::NoAdapter`] when the machine has neither; [`RenderError::NoDevice`] when what it has cannot be used.
    pub fn new() -> Result<Self, RenderError> {
        Self::on(Gpu::headless()?)
    }

    /// On a device that someone else opened: SteamVR wants its own extensions on it. It must allow four samples a pixel and
    /// one storage buffer in fragment shaders. `name` is for messages.
    ///
    /// # Errors
    /// [`RenderError::Device`] when it cannot hold the pipelines.
    pub fn from_device(device: wgpu::Device, queue: wgpu::Queue, name: &str) -> Result<Self, RenderError> {
        Self::on(Gpu::of(device, queue, name.to_owned()))
    }

    fn on(gpu: Gpu) -> Result<Self, RenderError> {
        let (painter, previewer) = (Painter::new(&gpu), Previewer::new(&gpu));
        gpu.check()?;
        Ok(Self { gpu, painter, previewer, cache: QuadCache::default() })
    }

    /// Name of the graphics adapter.
    pub fn adapter_name(&self) -> &str {
        &self.gpu.name
    }

    /// Where each warning stands and its texture; only textures whose content changed are drawn. Footprints first, then panels
    /// in the order given.
    ///
    /// # Errors
    /// [`RenderError::Device`] when the device failed since the last call.
    pub fn quads(&mut self, warnings: &Warnings, style: &WarningSettings) -> Result<Vec<Quad>, RenderError> {
        let quads = self.cache.quads(&self.gpu, &self.painter, warnings, style);
        self.gpu.check()?;
        Ok(quads)
    }

    /// Number of textures drawn since the start.
    pub fn textures_drawn(&self) -> u64 {
        self.cache.drawn
    }

    /// A quad's texture as a picture: colour multiplied by alpha, row 0 on top.
    ///
    /// # Errors
    /// [`RenderError::Device`] when the device failed.
    pub fn picture_of(&self, quad: &Quad) -> Result<RgbaImage, RenderError> {
        self.gpu.read(&quad.texture)
    }

    /// What an eye sees of the warnings in a dark room with a floor grid of one metre. `truth`: places and radii (metres) of what
    /// is really there, drawn as dim dots.
    ///
    /// # Errors
    /// [`RenderError::View`] and [`RenderError::ImageSize`] for an eye that makes no picture; [`RenderError::Device`] when the
    /// device failed.
    pub fn preview(
        &mut self,
        warnings: &Warnings,
        style: &WarningSettings,
        view: &EyeView,
        truth: &[(DVec3, f64)],
    ) -> Result<RgbaImage, RenderError> {
        let quads = self.quads(warnings, style)?;
        self.previewer.draw(&self.gpu, &quads, view, truth)
    }
}

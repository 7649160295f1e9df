//! The preview: warnings as one eye sees them, in a dark room with a 1 m floor grid and dots at the
//! true objects.

use glam::DVec3;
use image::RgbaImage;

use super::error::RenderError;
use super::eye::EyeView;
use super::eye_renderer::{Canvas, EyeRenderer};
use super::gpu::{FORMAT, Gpu};
use super::quads::Quad;

/// The image of one eye. `truth`: points and radii, metres.
pub(super) fn preview(
    gpu: &Gpu,
    viewer: &EyeRenderer,
    quads: &[Quad],
    view: &EyeView,
    truth: &[(DVec3, f64)],
) -> Result<RgbaImage, RenderError> {
    view.check()?;
    gpu.check_size(view.size_px)?;
    let sight = viewer.draw_list(gpu, view, truth, &[], &quads.iter().collect::<Vec<_>>());
    let picture = gpu.target(view.size_px, FORMAT, 1);
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    {
        let mut pass = Canvas::new(gpu, view.size_px).begin(&mut encoder, &picture);
        viewer.draw_backdrop(&mut pass, &sight);
        viewer.draw_objects(&mut pass, &sight);
    }
    gpu.queue.submit([encoder.finish()]);
    gpu.read(&picture)
}

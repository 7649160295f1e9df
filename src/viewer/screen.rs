//! Renders one pass of the window's content to a texture: first the image of the room, then egui.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use super::app::App;
use super::space::Space;
use super::style;
use crate::render::{RenderError, needed_limits};

/// The device and its resources.
pub struct Screen {
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// egui's context.
    pub context: egui::Context,
    renderer: egui_wgpu::Renderer,
    space: Space,
    texture: egui::TextureId,
    first_error: Arc<Mutex<Option<String>>>,
}

/// What a pass requests.
pub struct PassOutput {
    /// Cursor, clipboard.
    pub platform: egui::PlatformOutput,
    /// Time until the next pass.
    pub again_after: Duration,
}

/// An adapter that can draw to the surface, or to textures.
///
/// # Errors
/// There is none.
pub fn adapter(instance: &wgpu::Instance, surface: Option<&wgpu::Surface>) -> Result<wgpu::Adapter, RenderError> {
    let wanted = wgpu::RequestAdapterOptions {
        power_preference: wgpu::PowerPreference::LowPower,
        compatible_surface: surface,
        ..Default::default()
    };
    pollster::block_on(instance.request_adapter(&wanted)).map_err(|_| RenderError::NoAdapter)
}

impl Screen {
    /// Opens a device on an adapter. `format`: format of the target textures.
    ///
    /// # Errors
    /// The adapter cannot open a device.
    pub fn new(adapter: &wgpu::Adapter, format: wgpu::TextureFormat) -> Result<Self, RenderError> {
        let described = wgpu::DeviceDescriptor {
            label: Some("radar-chaperone view"),
            required_limits: needed_limits(&adapter.limits()),
            // As in `render`: allocates memory in blocks of 8 MB instead of 128 MB.
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            ..Default::default()
        };
        let refused = |error: wgpu::RequestDeviceError| RenderError::NoDevice {
            adapter: adapter.get_info().name,
            cause: error.to_string(),
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&described)).map_err(refused)?;
        let first_error = Arc::new(Mutex::new(None));
        let keep = Arc::clone(&first_error);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| note(&keep, error.to_string())));
        let keep = Arc::clone(&first_error);
        device.set_device_lost_callback(move |reason, message| {
            // A device that is destroyed in order is no error.
            if reason != wgpu::DeviceLostReason::Destroyed {
                note(&keep, format!("the device was lost: {message}"));
            }
        });
        // Without dithering, images of the same state are equal and compress well.
        let options = egui_wgpu::RendererOptions { dithering: false, ..Default::default() };
        let mut renderer = egui_wgpu::Renderer::new(&device, format, options);
        let space = Space::new(&device);
        let empty = device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: 1, height: 1, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: super::space::FORMAT,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        let view = empty.create_view(&Default::default());
        let texture = renderer.register_native_texture(&device, &view, wgpu::FilterMode::Linear);
        let context = egui::Context::default();
        style::apply(&context);
        Ok(Self { device, queue, context, renderer, space, texture, first_error })
    }

    /// The texture with the image of the room.
    pub fn texture(&self) -> egui::TextureId {
        self.texture
    }

    /// Renders one pass to a target with this size in pixels.
    ///
    /// # Errors
    /// The device reported an error.
    pub fn pass(
        &mut self,
        app: &mut App,
        input: egui::RawInput,
        target: &wgpu::TextureView,
        size_in_pixels: [u32; 2],
    ) -> Result<PassOutput, RenderError> {
        let mut output = self.context.run_ui(input, |ui| app.ui(ui));
        let pixels_per_point = output.pixels_per_point;
        let jobs = self.context.tessellate(std::mem::take(&mut output.shapes), pixels_per_point);
        let mut encoder = self.device.create_command_encoder(&Default::default());
        if let Some(wanted) = app.take_room_request() {
            self.draw_room(&mut encoder, &wanted, pixels_per_point);
        }
        for (id, deltas) in output.textures_delta.set.drain() {
            for delta in deltas {
                self.renderer.update_texture(&self.device, &self.queue, id, &delta);
            }
        }
        let screen = egui_wgpu::ScreenDescriptor { size_in_pixels, pixels_per_point };
        let mut commands = self.renderer.update_buffers(&self.device, &self.queue, &mut encoder, &jobs, &screen);
        {
            let mut pass = begin(&mut encoder, target).forget_lifetime();
            self.renderer.render(&mut pass, &jobs, &screen);
        }
        commands.push(encoder.finish());
        self.queue.submit(commands);
        for id in output.textures_delta.free.drain() {
            self.renderer.free_texture(&id);
        }
        self.check()?;
        let again_after = output.viewport_output.values().map(|viewport| viewport.repaint_delay).min();
        Ok(PassOutput { platform: output.platform_output, again_after: again_after.unwrap_or(Duration::MAX) })
    }

    fn draw_room(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        wanted: &super::app::RoomRequest,
        pixels_per_point: f32,
    ) {
        let greatest = self.device.limits().max_texture_dimension_2d;
        let pixels = |points: f32| ((points * pixels_per_point).round() as u32).clamp(1, greatest);
        let size_px = [pixels(wanted.size.x), pixels(wanted.size.y)];
        let room = (&wanted.eye, &wanted.drawing);
        let (picture, is_new) = self.space.draw(&self.device, &self.queue, encoder, size_px, room);
        if is_new {
            let view = picture.create_view(&Default::default());
            let filter = wgpu::FilterMode::Linear;
            self.renderer.update_egui_texture_from_wgpu_texture(&self.device, &view, filter, self.texture);
        }
    }

    /// # Errors
    /// The first error that the device reported.
    pub fn check(&self) -> Result<(), RenderError> {
        let first_error = self.first_error.lock().unwrap_or_else(PoisonError::into_inner).take();
        first_error.map_or(Ok(()), |cause| Err(RenderError::Device(cause)))
    }
}

fn note(first_error: &Mutex<Option<String>>, text: String) {
    first_error.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(text);
}

fn begin<'e>(encoder: &'e mut wgpu::CommandEncoder, target: &wgpu::TextureView) -> wgpu::RenderPass<'e> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: target,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store },
        })],
        ..Default::default()
    })
}

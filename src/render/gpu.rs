//! The graphics device: found without a window, or taken over from someone who opened it (SteamVR wants its own extensions).

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use image::RgbaImage;

use super::error::RenderError;

/// Format of every picture: 8 bits a channel, sRGB curve.
pub(super) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;

/// The limits that a device must have been opened with to serve a renderer, of those that its adapter offers.
pub fn needed_limits(offered: &wgpu::Limits) -> wgpu::Limits {
    wgpu::Limits::downlevel_defaults().using_resolution(offered.clone())
}

/// A device, its queue, and what it complained of.
pub(super) struct Gpu {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub name: String,
    complaints: Arc<Mutex<Complaints>>,
}

#[derive(Default)]
struct Complaints {
    /// The first error since the last check.
    error: Option<String>,
    /// Why the device was lost; it stays so.
    lost: Option<String>,
}

impl Gpu {
    /// Opens the fastest Vulkan adapter, a software one if there is no other.
    pub fn headless() -> Result<Self, RenderError> {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = wgpu::Backends::VULKAN;
        let instance = wgpu::Instance::new(descriptor);
        let wanted = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..Default::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&wanted)).map_err(|_| RenderError::NoAdapter)?;
        let name = adapter.get_info().name;
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("radar-chaperone"),
            required_limits: needed_limits(&adapter.limits()),
            ..Default::default()
        }))
        .map_err(|error| RenderError::NoDevice { adapter: name.clone(), cause: error.to_string() })?;
        Ok(Self::of(device, queue, name))
    }

    /// Takes over an open device.
    pub fn of(device: wgpu::Device, queue: wgpu::Queue, name: String) -> Self {
        let complaints = Arc::new(Mutex::new(Complaints::default()));
        let keep = Arc::clone(&complaints);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            hold(&keep).error.get_or_insert(error.to_string());
        }));
        let keep = Arc::clone(&complaints);
        device.set_device_lost_callback(move |reason, message| {
            let why = if message.is_empty() { format!("{reason:?}").to_lowercase() } else { message };
            hold(&keep).lost.get_or_insert(why);
        });
        Self { device, queue, name, complaints }
    }

    /// Whether the device still works: its first complaint since the last call, if any. Also lets it free what it is done with.
    pub fn check(&self) -> Result<(), RenderError> {
        let polled = self.device.poll(wgpu::PollType::Poll);
        let mut complaints = hold(&self.complaints);
        if let Some(cause) = &complaints.lost {
            return Err(RenderError::DeviceLost { adapter: self.name.clone(), cause: cause.clone() });
        }
        if let Some(cause) = complaints.error.take() {
            return Err(RenderError::Device(cause));
        }
        polled.map(|_| ()).map_err(device_error)
    }

    /// A buffer that holds these bytes, a multiple of four. Written by the queue: to map a new buffer of a lost device panics.
    pub fn buffer(&self, contents: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: contents.len() as u64,
            usage: usage | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        if !contents.is_empty() {
            self.queue.write_buffer(&buffer, 0, contents);
        }
        buffer
    }

    /// Whether a picture of this size can be made.
    pub fn check_size(&self, [width, height]: [u32; 2]) -> Result<(), RenderError> {
        let greatest = self.device.limits().max_texture_dimension_2d;
        let fits = (1..=greatest).contains(&width) && (1..=greatest).contains(&height);
        if fits { Ok(()) } else { Err(RenderError::ImageSize { width, height, greatest }) }
    }

    /// A texture to draw into, with `samples` a pixel.
    pub fn target(&self, [width, height]: [u32; 2], format: wgpu::TextureFormat, samples: u32) -> wgpu::Texture {
        self.texture([width, height], format, samples, 1)
    }

    /// A texture to draw into and, when it has one sample a pixel, to read from.
    pub fn texture(
        &self,
        [width, height]: [u32; 2],
        format: wgpu::TextureFormat,
        samples: u32,
        mip_level_count: u32,
    ) -> wgpu::Texture {
        let read = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_SRC;
        let read = if samples == 1 { read } else { wgpu::TextureUsages::empty() };
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count,
            sample_count: samples,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | read,
            view_formats: &[],
        })
    }

    /// The finest level of a texture in [`FORMAT`], as a picture.
    pub fn read(&self, texture: &wgpu::Texture) -> Result<RgbaImage, RenderError> {
        let (width, height) = (texture.width(), texture.height());
        let row = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(row) * u64::from(height),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None },
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
        self.queue.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, .., |_| {});
        let waited = self.device.poll(wgpu::PollType::wait_indefinitely());
        self.check()?;
        waited.map_err(device_error)?;
        let mapped = buffer.get_mapped_range(..).map_err(device_error)?;
        let pixels = mapped.chunks(row as usize).flat_map(|line| &line[..4 * width as usize]).copied().collect();
        RgbaImage::from_raw(width, height, pixels).ok_or_else(|| RenderError::Device("picture came back short".into()))
    }
}

fn hold(complaints: &Mutex<Complaints>) -> MutexGuard<'_, Complaints> {
    complaints.lock().unwrap_or_else(PoisonError::into_inner)
}

fn device_error(error: impl std::fmt::Display) -> RenderError {
    RenderError::Device(error.to_string())
}

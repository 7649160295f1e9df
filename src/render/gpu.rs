//! The graphics device: opened without a window, or taken over from a caller that opened it with
//! the extensions of SteamVR.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ash::vk;
use image::RgbaImage;
use wgpu::hal::api::Vulkan;

use super::error::RenderError;

/// Format of every image: 8 bits per channel, sRGB curve.
pub(super) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;

/// Limits with which a device must be opened to be usable by a renderer, given the limits of its
/// adapter.
pub fn needed_limits(offered: &wgpu::Limits) -> wgpu::Limits {
    wgpu::Limits::downlevel_defaults().using_resolution(offered.clone())
}

/// A device, its queue, and the errors that it reported.
pub(crate) struct Gpu {
    /// Declared first: dropped before its device.
    probe: Option<LossProbe>,
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub name: String,
    /// Whether the adapter computes on the processor.
    pub is_software: bool,
    errors: Arc<Mutex<DeviceErrors>>,
}

/// A fence that is never signalled. Its status query returns whether the device is lost.
struct LossProbe {
    device: ash::Device,
    fence: vk::Fence,
}

impl LossProbe {
    /// `None` if the device is not a Vulkan device or cannot create a fence.
    fn of(device: &wgpu::Device) -> Option<Self> {
        // SAFETY: the handle is used only to create a fence and query its state. The owner of the
        // probe keeps the device alive.
        let device = unsafe { device.as_hal::<Vulkan>()?.raw_device().clone() };
        // SAFETY: the device is alive.
        let fence = unsafe { device.create_fence(&vk::FenceCreateInfo::default(), None) }.ok()?;
        Some(Self { device, fence })
    }

    fn is_device_lost(&self) -> bool {
        // SAFETY: the fence belongs to this device.
        let state = unsafe { self.device.get_fence_status(self.fence) };
        state == Err(vk::Result::ERROR_DEVICE_LOST)
    }
}

impl Drop for LossProbe {
    fn drop(&mut self) {
        // SAFETY: the fence was never submitted, and the device is dropped after it.
        unsafe { self.device.destroy_fence(self.fence, None) }
    }
}

#[derive(Default)]
struct DeviceErrors {
    /// First error since the last check.
    error: Option<String>,
    /// Why the device was lost. Never reset.
    lost: Option<String>,
}

impl Gpu {
    /// Opens the fastest Vulkan adapter, or a software renderer if there is no other.
    pub fn headless() -> Result<Self, RenderError> {
        Self::headless_with(needed_limits)
    }

    /// The same with limits that follow from the adapter's.
    pub fn headless_with(limits: impl Fn(&wgpu::Limits) -> wgpu::Limits) -> Result<Self, RenderError> {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = wgpu::Backends::VULKAN;
        let instance = wgpu::Instance::new(descriptor);
        let wanted = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..Default::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&wanted)).map_err(|_| RenderError::NoAdapter)?;
        let (name, kind) = (adapter.get_info().name, adapter.get_info().device_type);
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("radar-chaperone"),
            required_limits: limits(&adapter.limits()),
            // Allocates memory in blocks of 8 MB instead of 128 MB.
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            ..Default::default()
        }))
        .map_err(|error| RenderError::NoDevice { adapter: name.clone(), cause: error.to_string() })?;
        let is_software = kind == wgpu::DeviceType::Cpu;
        Ok(Self { is_software, ..Self::of(device, queue, name) })
    }

    /// Takes over an open device.
    pub fn of(device: wgpu::Device, queue: wgpu::Queue, name: String) -> Self {
        let errors = Arc::new(Mutex::new(DeviceErrors::default()));
        let keep = Arc::clone(&errors);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            lock_errors(&keep).error.get_or_insert(error.to_string());
        }));
        let keep = Arc::clone(&errors);
        device.set_device_lost_callback(move |reason, message| {
            let why = if message.is_empty() { format!("{reason:?}").to_lowercase() } else { message };
            lock_errors(&keep).lost.get_or_insert(why);
        });
        let probe = LossProbe::of(&device);
        Self { probe, device, queue, name, is_software: false, errors }
    }

    /// Waits until all submitted work is done.
    pub fn wait(&self) -> Result<(), RenderError> {
        self.poll(wgpu::PollType::wait_indefinitely())
    }

    /// First error of the device since the last call, if any. Also lets wgpu free resources that
    /// are no longer in use.
    pub fn check(&self) -> Result<(), RenderError> {
        self.poll(wgpu::PollType::Poll)
    }

    /// As [`Self::check`], for any poll type. wgpu panics when a wait discovers a lost device, so
    /// the loss is checked before, and a panic in between is caught.
    fn poll(&self, kind: wgpu::PollType) -> Result<(), RenderError> {
        self.take_error()?;
        if self.probe.as_ref().is_some_and(LossProbe::is_device_lost) {
            lock_errors(&self.errors).lost.get_or_insert("reported by the driver".to_owned());
            return self.take_error();
        }
        let polled = catch_unwind(AssertUnwindSafe(|| self.device.poll(kind)));
        if polled.is_err() {
            lock_errors(&self.errors).lost.get_or_insert("lost while the GPU was working".to_owned());
        }
        self.take_error()?;
        polled.map_or(Ok(()), |polled| polled.map(drop).map_err(device_error))
    }

    /// First error since the last call, if any.
    fn take_error(&self) -> Result<(), RenderError> {
        let mut errors = lock_errors(&self.errors);
        if let Some(cause) = &errors.lost {
            return Err(RenderError::DeviceLost { adapter: self.name.clone(), cause: cause.clone() });
        }
        errors.error.take().map_or(Ok(()), |cause| Err(RenderError::Device(cause)))
    }

    /// A buffer with these bytes, whose length must be a multiple of four. The queue writes it,
    /// because mapping a new buffer of a lost device panics.
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

    /// A buffer into which work on the device copies what [`Self::read_buffer`] reads.
    pub fn readable(&self, bytes: u64) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: bytes,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        })
    }

    /// The first bytes of a buffer from [`Self::readable`], when all submitted work is done.
    pub fn read_buffer<T>(
        &self,
        buffer: &wgpu::Buffer,
        bytes: u64,
        read: impl FnOnce(&[u8]) -> T,
    ) -> Result<T, RenderError> {
        buffer.map_async(wgpu::MapMode::Read, ..bytes, |_| {});
        self.wait()?;
        let mapped = buffer.get_mapped_range(..bytes).map_err(device_error)?;
        let done = read(&mapped);
        drop(mapped);
        buffer.unmap();
        Ok(done)
    }

    /// Checks that an image of this size is possible.
    pub fn check_size(&self, [width, height]: [u32; 2]) -> Result<(), RenderError> {
        let greatest = self.device.limits().max_texture_dimension_2d;
        let fits = (1..=greatest).contains(&width) && (1..=greatest).contains(&height);
        if fits { Ok(()) } else { Err(RenderError::ImageSize { width, height, greatest }) }
    }

    /// A render target with `samples` samples per pixel.
    pub fn target(&self, [width, height]: [u32; 2], format: wgpu::TextureFormat, samples: u32) -> wgpu::Texture {
        self.texture([width, height], format, samples, 1)
    }

    /// A render target. With one sample per pixel, it can also be read.
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

    /// The finest level of a texture in [`FORMAT`], as an image.
    pub fn read(&self, texture: &wgpu::Texture) -> Result<RgbaImage, RenderError> {
        let (width, height) = (texture.width(), texture.height());
        let row = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = self.readable(u64::from(row) * u64::from(height));
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
        let pixels = self.read_buffer(&buffer, buffer.size(), |bytes| {
            bytes.chunks(row as usize).flat_map(|line| &line[..4 * width as usize]).copied().collect()
        })?;
        RgbaImage::from_raw(width, height, pixels).ok_or_else(|| RenderError::Device("image has too few pixels".into()))
    }
}

fn lock_errors(errors: &Mutex<DeviceErrors>) -> MutexGuard<'_, DeviceErrors> {
    errors.lock().unwrap_or_else(PoisonError::into_inner)
}

fn device_error(error: impl std::fmt::Display) -> RenderError {
    RenderError::Device(error.to_string())
}

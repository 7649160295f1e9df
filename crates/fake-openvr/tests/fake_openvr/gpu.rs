//! Textures made with wgpu and submitted as a program does.

use ash::vk::Handle;
use wgpu::hal::api::Vulkan;

use crate::runtime::{Runtime, call};
use crate::sys;

/// An open device. Textures must live until Cleanup.
pub struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
    handles: sys::VRVulkanTextureData_t,
}

impl Gpu {
    /// Opens a device; a software renderer will do.
    pub fn open() -> Self {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = wgpu::Backends::VULKAN;
        let instance = wgpu::Instance::new(descriptor);
        let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))
            .expect("a Vulkan adapter; ./setup.sh installs a software renderer");
        let wanted = wgpu::DeviceDescriptor { required_limits: adapter.limits(), ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&wanted)).unwrap();
        let handles = {
            // SAFETY: the handles are only read; the device outlives all of their uses.
            let hal = unsafe { device.as_hal::<Vulkan>() }.unwrap();
            sys::VRVulkanTextureData_t {
                m_nImage: 0,
                m_pDevice: hal.raw_device().handle().as_raw() as *mut _,
                m_pPhysicalDevice: hal.raw_physical_device().as_raw() as *mut _,
                m_pInstance: hal.shared_instance().raw_instance().handle().as_raw() as *mut _,
                m_pQueue: hal.raw_queue().as_raw() as *mut _,
                m_nQueueFamilyIndex: hal.queue_family_index(),
                m_nWidth: 0,
                m_nHeight: 0,
                m_nFormat: 0,
                m_nSampleCount: 1,
            }
        };
        Self { device, queue, handles }
    }

    /// The physical device and the instance, as numbers.
    pub fn physical_device_and_instance(&self) -> (u64, *mut sys::VkInstance_T) {
        (self.handles.m_pPhysicalDevice as u64, self.handles.m_pInstance)
    }

    /// A texture with these pixels, ready to be submitted.
    pub fn texture(
        &self,
        [width, height]: [u32; 2],
        format: wgpu::TextureFormat,
        pixel: impl Fn(u32, u32) -> [u8; 4],
    ) -> wgpu::Texture {
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
        let texture = self.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::COPY_SRC
                | wgpu::TextureUsages::COPY_DST
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        });
        let bytes: Vec<u8> =
            (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).flat_map(|(x, y)| pixel(x, y)).collect();
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * width), rows_per_image: None };
        self.queue.write_texture(texture.as_image_copy(), &bytes, layout, size);
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let ready =
            wgpu::wgt::TextureTransition { texture: &texture, selector: None, state: wgpu::wgt::TextureUses::COPY_SRC };
        encoder.transition_resources(std::iter::empty(), std::iter::once(ready));
        self.queue.submit([encoder.finish()]);
        texture
    }

    /// Submits a texture. Returns the error code.
    pub fn show(&self, runtime: &Runtime, overlay: u64, texture: &wgpu::Texture) -> u32 {
        // SAFETY: the handle is only read; the texture outlives all of its uses.
        let image = unsafe { texture.as_hal::<Vulkan>().unwrap().raw_handle() };
        let mut data = sys::VRVulkanTextureData_t {
            m_nImage: image.as_raw(),
            m_nWidth: texture.width(),
            m_nHeight: texture.height(),
            m_nFormat: match texture.format() {
                wgpu::TextureFormat::Rgba8UnormSrgb => 43,
                wgpu::TextureFormat::Rgba8Unorm => 37,
                wgpu::TextureFormat::Bgra8UnormSrgb => 50,
                other => panic!("{other:?} is not used here"),
            },
            ..self.handles
        };
        let data: *mut sys::VRVulkanTextureData_t = &mut data;
        let mut texture = sys::Texture_t {
            handle: data.cast(),
            eType: sys::ETextureType_TextureType_Vulkan,
            eColorSpace: sys::EColorSpace_ColorSpace_Auto,
        };
        call!(runtime.overlay, SetOverlayTexture, overlay, &mut texture)
    }
}

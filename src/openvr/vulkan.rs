//! A graphics device that meets the requirements of a VR runtime, and the handles with which the
//! runtime takes textures.
//!
//! A runtime copies our textures on our own queue. It therefore requires extensions on the instance
//! and the device, and names the headset's adapter. wgpu alone cannot add these extensions, but its
//! Vulkan layer can: it adds them in callbacks, and the result is then converted to ordinary wgpu
//! objects. The runtime's requirements come in as plain numbers and names; this file does not
//! depend on OpenVR.

use std::collections::BTreeSet;
use std::ffi::{CStr, CString};
use std::sync::{Mutex, PoisonError};

use ash::vk::Handle;
use wgpu::hal::vulkan::{Adapter, Api as Vulkan, Instance};
use wgpu::hal::{ExposedAdapter, InstanceDescriptor, OpenDevice};

use crate::render::needed_limits;

/// Requirements of a runtime. Handles are Vulkan handles as numbers.
pub struct VulkanRequirements<'a> {
    /// Instance extensions.
    pub instance_extensions: Vec<CString>,
    /// Maps a `VkPhysicalDevice` to the device extensions required on it.
    pub device_extensions: &'a dyn Fn(u64) -> Vec<CString>,
    /// Maps the `VkInstance` to the headset's `VkPhysicalDevice`. If it returns `None`, the fastest
    /// adapter is used.
    pub adapter: &'a dyn Fn(u64) -> Option<u64>,
}

/// Why the device could not be opened.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum VulkanError {
    /// There is no Vulkan loader, or it creates no instance.
    #[error("no Vulkan on this machine: {0}. Install the graphics driver (Linux: with its Vulkan part and libvulkan1)")]
    NoVulkan(String),
    /// The loader or driver lacks instance extensions that the runtime requires.
    #[error("Vulkan here lacks {}, which the VR runtime asks for: update the graphics driver", .0.join(", "))]
    InstanceExtensions(Vec<String>),
    /// The runtime named an adapter that does not exist.
    #[error("the VR runtime names a graphics adapter that wgpu does not offer; it offers {}", joined(.0))]
    NoSuchAdapter(Vec<String>),
    /// There is no adapter.
    #[error("no graphics adapter offers Vulkan: install the graphics driver")]
    NoAdapter,
    /// The adapter lacks device extensions that the runtime requires.
    #[error("graphics adapter {adapter} lacks {}, which the VR runtime asks for: update its driver", .missing.join(", "))]
    DeviceExtensions {
        /// Name of the adapter.
        adapter: String,
        /// Names of the missing extensions.
        missing: Vec<String>,
    },
    /// The adapter could not open a device.
    #[error("graphics adapter {adapter} provides no device: {cause}")]
    NoDevice {
        /// Name of the adapter.
        adapter: String,
        /// Error text of the driver.
        cause: String,
    },
}

/// An open device, with the handles that a runtime needs.
#[derive(Debug)]
pub struct VulkanDevice {
    /// The device, usable for [`crate::render::Renderer::from_device`].
    pub device: wgpu::Device,
    /// Its queue. The runtime submits on it too, so all calls that hand over textures must be on
    /// the thread that submits.
    pub queue: wgpu::Queue,
    /// Name of the adapter.
    pub name: String,
    handles: Handles,
}

#[derive(Debug, Clone, Copy)]
struct Handles {
    instance: u64,
    physical_device: u64,
    device: u64,
    queue: u64,
    queue_family: u32,
}

/// Vulkan handles of a texture: all that a runtime needs to copy it. Valid as long as the texture
/// and its device live.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VulkanTexture {
    /// `VkImage`.
    pub image: u64,
    /// `VkInstance`.
    pub instance: u64,
    /// `VkPhysicalDevice`.
    pub physical_device: u64,
    /// `VkDevice`.
    pub device: u64,
    /// `VkQueue`.
    pub queue: u64,
    /// Queue family index.
    pub queue_family: u32,
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// `VkFormat`.
    pub format: u32,
    /// Samples per pixel.
    pub samples: u32,
}

/// Opens the device that the runtime requires.
///
/// # Errors
/// Vulkan, the adapter or an extension is missing, or the driver rejects the call.
pub fn open(requirements: &VulkanRequirements) -> Result<VulkanDevice, VulkanError> {
    let hal_instance = open_instance(&requirements.instance_extensions)?;
    let raw_instance = hal_instance.shared_instance().raw_instance().handle().as_raw();
    let adapter = choose_adapter(&hal_instance, (requirements.adapter)(raw_instance))?;
    let name = adapter.info.name.clone();
    let no_device = |cause: String| VulkanError::NoDevice { adapter: name.clone(), cause };
    let physical_device = adapter.adapter.raw_physical_device().as_raw();
    let limits = needed_limits(&adapter.capabilities.limits);
    let extensions = (requirements.device_extensions)(physical_device);
    let opened = open_device(&adapter, &limits, extensions)?;

    // SAFETY: the instance was just created by wgpu's own Vulkan layer and is moved in whole.
    let instance = unsafe { wgpu::Instance::from_hal::<Vulkan>(hal_instance) };
    // SAFETY: the adapter was enumerated from this instance.
    let adapter = unsafe { instance.create_adapter_from_hal(adapter) };
    let described = wgpu::DeviceDescriptor {
        label: Some("radar-chaperone for a VR runtime"),
        required_limits: limits,
        ..Default::default()
    };
    // SAFETY: the device was opened from this adapter with the limits and features described.
    let (device, queue) =
        unsafe { adapter.create_device_from_hal(opened, &described) }.map_err(|error| no_device(error.to_string()))?;
    let handles = handles_of(&device, raw_instance).ok_or_else(|| no_device("it is no Vulkan device".into()))?;
    Ok(VulkanDevice { device, queue, name, handles })
}

impl VulkanDevice {
    /// Handles of one of this device's textures; `None` for a destroyed texture and for a format
    /// that no runtime accepts.
    pub fn texture_handles(&self, texture: &wgpu::Texture) -> Option<VulkanTexture> {
        let Handles { instance, physical_device, device, queue, queue_family } = self.handles;
        // SAFETY: the handle is only read.
        let image = unsafe { texture.as_hal::<Vulkan>()?.raw_handle() }.as_raw();
        Some(VulkanTexture {
            image,
            instance,
            physical_device,
            device,
            queue,
            queue_family,
            width: texture.width(),
            height: texture.height(),
            format: vulkan_format(texture.format())?,
            samples: texture.sample_count(),
        })
    }
}

/// An instance with the extensions that wgpu and the runtime need.
fn open_instance(wanted: &[CString]) -> Result<Instance, VulkanError> {
    let wanted = interned(wanted);
    let mut missing = Vec::new();
    let described = InstanceDescriptor {
        name: "radar-chaperone",
        flags: wgpu::InstanceFlags::default(),
        memory_budget_thresholds: wgpu::MemoryBudgetThresholds::default(),
        backend_options: wgpu::BackendOptions::default(),
        telemetry: None,
        display: None,
    };
    let missing_names = &mut missing;
    let add = Box::new(move |args: wgpu::hal::vulkan::CreateInstanceCallbackArgs| {
        // SAFETY: the loader is open, and no layer is requested.
        let offered = unsafe { args.entry.enumerate_instance_extension_properties(None) }.unwrap_or_default();
        for name in wanted {
            if !offered.iter().any(|offer| offer.extension_name_as_c_str() == Ok(name)) {
                missing_names.push(name.to_string_lossy().into_owned());
            } else if !args.extensions.contains(&name) {
                args.extensions.push(name);
            }
        }
    });
    // SAFETY: the callback only adds extensions that the loader offers.
    let instance = unsafe { Instance::init_with_callback(&described, Some(add)) };
    if !missing.is_empty() {
        return Err(VulkanError::InstanceExtensions(missing));
    }
    instance.map_err(|error| VulkanError::NoVulkan(error.to_string()))
}

/// The adapter with this handle, or the fastest one if none is named.
fn choose_adapter(instance: &Instance, named: Option<u64>) -> Result<ExposedAdapter<Vulkan>, VulkanError> {
    // SAFETY: no surface is given that would have to belong to this instance.
    let mut offered = unsafe { wgpu::hal::Instance::enumerate_adapters(instance, None) };
    let Some(named) = named else {
        let slowness = |kind| match kind {
            wgpu::DeviceType::DiscreteGpu => 0,
            wgpu::DeviceType::IntegratedGpu => 1,
            wgpu::DeviceType::VirtualGpu => 2,
            wgpu::DeviceType::Other => 3,
            wgpu::DeviceType::Cpu => 4,
        };
        return offered.into_iter().min_by_key(|a| slowness(a.info.device_type)).ok_or(VulkanError::NoAdapter);
    };
    match offered.iter().position(|a| a.adapter.raw_physical_device().as_raw() == named) {
        Some(at) => Ok(offered.swap_remove(at)),
        None => Err(VulkanError::NoSuchAdapter(offered.into_iter().map(|a| a.info.name).collect())),
    }
}

fn open_device(
    adapter: &ExposedAdapter<Vulkan>,
    limits: &wgpu::Limits,
    wanted: Vec<CString>,
) -> Result<OpenDevice<Vulkan>, VulkanError> {
    let name = &adapter.info.name;
    let wanted = interned(&wanted);
    let missing = missing_extensions(&adapter.adapter, &wanted);
    if !missing.is_empty() {
        return Err(VulkanError::DeviceExtensions { adapter: name.clone(), missing });
    }
    let add = Box::new(move |args: wgpu::hal::vulkan::CreateDeviceCallbackArgs| {
        let new: Vec<_> = wanted.into_iter().filter(|name| !args.extensions.contains(name)).collect();
        args.extensions.extend(new);
    });
    // A game needs the GPU memory: allocates in blocks of 8 MB instead of 128 MB.
    let (features, hints) = (wgpu::Features::empty(), wgpu::MemoryHints::MemoryUsage);
    // SAFETY: the callback only adds extensions that the adapter offers.
    unsafe { adapter.adapter.open_with_callback(features, limits, &hints, Some(add)) }
        .map_err(|error| VulkanError::NoDevice { adapter: name.clone(), cause: error.to_string() })
}

fn missing_extensions(adapter: &Adapter, wanted: &[&'static CStr]) -> Vec<String> {
    let offers = adapter.physical_device_capabilities();
    let missing = wanted.iter().filter(|name| !offers.supports_extension(name));
    missing.map(|name| name.to_string_lossy().into_owned()).collect()
}

fn handles_of(device: &wgpu::Device, instance: u64) -> Option<Handles> {
    // SAFETY: the handles are only read.
    let open = unsafe { device.as_hal::<Vulkan>() }?;
    Some(Handles {
        instance,
        physical_device: open.raw_physical_device().as_raw(),
        device: open.raw_device().handle().as_raw(),
        queue: open.raw_queue().as_raw(),
        queue_family: open.queue_family_index(),
    })
}

/// Interns names for the lifetime of the process, as wgpu requires: each only once, however often a
/// device is opened.
fn interned(names: &[CString]) -> Vec<&'static CStr> {
    static INTERNED: Mutex<BTreeSet<&'static CStr>> = Mutex::new(BTreeSet::new());
    let mut interned = INTERNED.lock().unwrap_or_else(PoisonError::into_inner);
    let mut wanted: Vec<&'static CStr> = Vec::new();
    for name in names.iter().filter(|name| !name.is_empty()) {
        let known = interned.get(name.as_c_str()).copied();
        let name = known.unwrap_or_else(|| Box::leak(name.clone().into_boxed_c_str()));
        interned.insert(name);
        if !wanted.contains(&name) {
            wanted.push(name);
        }
    }
    wanted
}

/// The texture formats that a runtime accepts.
fn vulkan_format(format: wgpu::TextureFormat) -> Option<u32> {
    let format = match format {
        wgpu::TextureFormat::Rgba8UnormSrgb => ash::vk::Format::R8G8B8A8_SRGB,
        wgpu::TextureFormat::Rgba8Unorm => ash::vk::Format::R8G8B8A8_UNORM,
        _ => return None,
    };
    u32::try_from(format.as_raw()).ok()
}

fn joined(names: &[String]) -> String {
    if names.is_empty() { "none".into() } else { names.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::Renderer;
    use crate::warning::{WarningSettings, Warnings};

    /// Typical requirements that every driver meets.
    fn requirements() -> VulkanRequirements<'static> {
        VulkanRequirements {
            instance_extensions: vec![c"VK_KHR_external_memory_capabilities".into(), c"VK_KHR_surface".into()],
            device_extensions: &|_| vec![c"VK_KHR_external_memory".into(), c"VK_KHR_dedicated_allocation".into()],
            adapter: &|_| None,
        }
    }

    /// The device; a software renderer will do.
    fn opened(requirements: &VulkanRequirements) -> VulkanDevice {
        open(requirements).unwrap_or_else(|error| panic!("{error}; ./setup.sh installs a software renderer"))
    }

    #[test]
    fn device_has_requested_extensions_and_texture_handles() {
        let device = opened(&requirements());
        // SAFETY: the names are only read.
        let enabled = unsafe { device.device.as_hal::<Vulkan>() }.unwrap().enabled_device_extensions().to_vec();
        assert!(enabled.contains(&c"VK_KHR_external_memory") && enabled.contains(&c"VK_KHR_dedicated_allocation"));
        let texture = device.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: 64, height: 32, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8UnormSrgb,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let handed = device.texture_handles(&texture).unwrap();
        assert!(
            [handed.image, handed.instance, handed.physical_device, handed.device, handed.queue]
                .iter()
                .all(|h| *h != 0)
        );
        // VK_FORMAT_R8G8B8A8_SRGB.
        assert_eq!((handed.width, handed.height, handed.format, handed.samples), (64, 32, 43, 1));
        assert_eq!(handed, device.texture_handles(&texture).unwrap());
        texture.destroy();
        assert_eq!(device.texture_handles(&texture), None);
    }

    #[test]
    fn named_adapter_is_used_and_unknown_adapter_rejected() {
        let first = opened(&requirements());
        // A physical device's handle belongs to its instance, so it must be looked up again in
        // each.
        let named = std::cell::Cell::new(0);
        let lister = |physical: u64| {
            named.set(physical);
            Vec::new()
        };
        let any = VulkanRequirements { device_extensions: &lister, ..requirements() };
        assert_eq!(open(&any).unwrap().handles.physical_device, named.get());
        let wrong = VulkanRequirements { adapter: &|_| Some(0xdead_beef), ..requirements() };
        let error = open(&wrong).unwrap_err();
        assert!(matches!(&error, VulkanError::NoSuchAdapter(offered) if offered.contains(&first.name)), "{error}");
    }

    #[test]
    fn missing_extensions_are_named() {
        opened(&requirements());
        let instance = VulkanRequirements { instance_extensions: vec![c"VK_XX_nothing".into()], ..requirements() };
        assert_eq!(open(&instance).unwrap_err(), VulkanError::InstanceExtensions(vec!["VK_XX_nothing".into()]));
        let device = VulkanRequirements {
            device_extensions: &|_| vec![c"VK_KHR_external_memory".into(), c"VK_XX_none".into()],
            ..requirements()
        };
        let error = open(&device).unwrap_err();
        assert!(
            matches!(&error, VulkanError::DeviceExtensions { missing, .. } if missing == &["VK_XX_none"]),
            "{error}"
        );
        assert!(error.to_string().contains("VK_XX_none"), "{error}");
    }

    #[test]
    fn interned_names_are_unique() {
        let twice = interned(&[c"VK_A".into(), c"VK_A".into(), c"".into()]);
        assert_eq!(twice, [c"VK_A"]);
        assert!(std::ptr::eq(twice[0], interned(&[c"VK_A".into()])[0]));
    }

    #[test]
    fn renderer_works_on_opened_device() {
        let device = opened(&requirements());
        let mut renderer = Renderer::from_device(device.device.clone(), device.queue.clone(), &device.name).unwrap();
        assert!(renderer.quads(&Warnings::default(), &WarningSettings::default()).unwrap().is_empty());
    }
}

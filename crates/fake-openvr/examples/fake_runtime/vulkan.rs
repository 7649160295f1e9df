//! Copies the client's textures into host memory on the client's own queue, as SteamVR does. A copy
//! is read only when an image is requested. Submitting a texture never waits for the GPU.

use std::ffi::CStr;
use std::sync::Arc;

use ash::vk;
use ash::vk::Handle;

use crate::sys;

/// Limit of copies, in progress or kept. Choice: more than the overlays that a runtime allows at
/// once.
const MAX_SLOTS: usize = 160;
/// From this number on, copies of another size are freed before a new one is allocated. Choice:
/// bounds graphics memory while a client changes the sizes of its textures.
const SLOTS_BEFORE_EVICTION: usize = 48;
/// Limit of the wait for each copy at the end, nanoseconds. Choice: a copy takes milliseconds even
/// in software; a hung device must not hang a test.
const MAX_WAIT_NS: u64 = 2_000_000_000;
/// The same when an image is requested. Choice: a software renderer whose cores are taken was seen to
/// need more than 2 s, and the test would wait for the image in vain.
const MAX_IMAGE_WAIT_NS: u64 = 60_000_000_000;

/// Loads the Vulkan library, which the client has loaded already.
fn entry() -> Result<ash::Entry, String> {
    // SAFETY: the system's Vulkan loader, which the client uses too.
    unsafe { ash::Entry::load() }.map_err(|error| format!("libvulkan: {error}"))
}

/// The functions of the client's instance.
fn load_instance(entry: &ash::Entry, instance: *mut sys::VkInstance_T) -> Result<ash::Instance, String> {
    if instance.is_null() {
        return Err("the instance is null".into());
    }
    // SAFETY: the client guarantees a live instance, as with SteamVR.
    Ok(unsafe { ash::Instance::load(entry.static_fn(), vk::Instance::from_raw(instance as u64)) })
}

/// The physical device that drives the headset: the first one, or the first whose name contains
/// `wanted`.
///
/// # Errors
/// Why there is none.
pub fn output_device(instance: *mut sys::VkInstance_T, wanted: Option<&str>) -> Result<u64, String> {
    let instance = load_instance(&entry()?, instance)?;
    // SAFETY: the instance is alive.
    let devices = unsafe { instance.enumerate_physical_devices() }.map_err(|error| error.to_string())?;
    let matches = |device: &vk::PhysicalDevice| {
        // SAFETY: a device of that instance; its name is a zero-terminated text.
        let properties = unsafe { instance.get_physical_device_properties(*device) };
        let name = properties.device_name_as_c_str().map(CStr::to_string_lossy).unwrap_or_default();
        wanted.is_none_or(|wanted| name.contains(wanted))
    };
    let found = devices.into_iter().find(matches).ok_or_else(|| format!("no device named {wanted:?}"))?;
    Ok(found.as_raw())
}

/// The checked description of a texture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Image {
    pub image: vk::Image,
    pub width: u32,
    pub height: u32,
    pub format: vk::Format,
}

/// The client's handles, which must stay the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Handles {
    instance: *mut sys::VkInstance_T,
    physical_device: *mut sys::VkPhysicalDevice_T,
    device: *mut sys::VkDevice_T,
    queue: *mut sys::VkQueue_T,
    queue_family: u32,
}

impl Handles {
    /// The handles of a texture.
    pub fn of(data: &sys::VRVulkanTextureData_t) -> Self {
        Self {
            instance: data.m_pInstance,
            physical_device: data.m_pPhysicalDevice,
            device: data.m_pDevice,
            queue: data.m_pQueue,
            queue_family: data.m_nQueueFamilyIndex,
        }
    }

    /// Whether any of them is null.
    pub fn any_null(&self) -> bool {
        self.instance.is_null() || self.physical_device.is_null() || self.device.is_null() || self.queue.is_null()
    }
}

/// Host memory for a copy of a texture, and the state of the copy.
pub struct Slot {
    device: ash::Device,
    buffer: vk::Buffer,
    memory: vk::DeviceMemory,
    mapped: *const u8,
    capacity: u64,
    commands: vk::CommandBuffer,
    fence: vk::Fence,
}

// SAFETY: handles, which any thread may use, and memory that only the GPU writes and that is read
// after its fence is signalled.
unsafe impl Send for Slot {}
// SAFETY: as above; nothing is written through a shared slot.
unsafe impl Sync for Slot {}

/// A texture and its copy.
#[derive(Clone)]
pub struct Copied {
    pub image: Image,
    slot: Arc<Slot>,
}

impl Copied {
    /// The pixels, row by row. Waits for the copy.
    ///
    /// # Errors
    /// The copy does not finish.
    pub fn read(&self) -> Result<Vec<u8>, String> {
        let Slot { device, fence, mapped, .. } = &*self.slot;
        // SAFETY: the device lives until Cleanup, which waits for readers.
        unsafe { device.wait_for_fences(&[*fence], true, MAX_IMAGE_WAIT_NS) }.map_err(|error| error.to_string())?;
        let bytes = bytes_of(&self.image) as usize;
        // SAFETY: the memory is mapped, has at least this many bytes, and the GPU has finished
        // writing.
        Ok(unsafe { std::slice::from_raw_parts(*mapped, bytes) }.to_vec())
    }
}

fn bytes_of(image: &Image) -> u64 {
    u64::from(image.width) * u64::from(image.height) * 4
}

/// Copies the textures of one device.
pub struct Copier {
    /// Keeps the Vulkan library loaded.
    _entry: ash::Entry,
    handles: Handles,
    device: ash::Device,
    queue: vk::Queue,
    memory: vk::PhysicalDeviceMemoryProperties,
    pool: vk::CommandPool,
    slots: Vec<Arc<Slot>>,
    /// Whether the device has reported its loss: nothing on it is usable any more.
    is_lost: bool,
}

// SAFETY: the handles are only compared; the objects are used under the world's lock.
unsafe impl Send for Copier {}

impl Copier {
    /// For a client's device.
    ///
    /// # Errors
    /// The error of Vulkan.
    pub fn new(handles: Handles) -> Result<Self, String> {
        let entry = entry()?;
        let instance = load_instance(&entry, handles.instance)?;
        let physical_device = vk::PhysicalDevice::from_raw(handles.physical_device as u64);
        // SAFETY: the client guarantees live handles that belong together, as with SteamVR.
        let (device, memory) = unsafe {
            let device = ash::Device::load(instance.fp_v1_0(), vk::Device::from_raw(handles.device as u64));
            (device, instance.get_physical_device_memory_properties(physical_device))
        };
        let info = vk::CommandPoolCreateInfo::default()
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER)
            .queue_family_index(handles.queue_family);
        // SAFETY: the device is alive, and the queue family is one of its own.
        let pool = unsafe { device.create_command_pool(&info, None) }.map_err(|error| error.to_string())?;
        let queue = vk::Queue::from_raw(handles.queue as u64);
        Ok(Self { _entry: entry, handles, device, queue, memory, pool, slots: Vec::new(), is_lost: false })
    }

    /// Handles of the device.
    pub fn handles(&self) -> Handles {
        self.handles
    }

    /// Whether the device is lost, as known from earlier copies or from the fence of the newest
    /// one.
    pub fn is_lost(&mut self) -> bool {
        if let Some(slot) = self.slots.last().filter(|_| !self.is_lost) {
            // SAFETY: a fence of that device, which lives until Cleanup even if the device is lost.
            self.is_lost = unsafe { self.device.get_fence_status(slot.fence) } == Err(vk::Result::ERROR_DEVICE_LOST);
        }
        self.is_lost
    }

    /// Starts copying an image in the layout TRANSFER_SRC_OPTIMAL; `None` if too many copies are in
    /// progress.
    ///
    /// # Errors
    /// The error of Vulkan.
    pub fn copy(&mut self, image: Image) -> Result<Option<Copied>, String> {
        let Some(slot) = self.free_slot(bytes_of(&image)).map_err(|error| error.to_string())? else {
            return Ok(None);
        };
        if let Err(error) = self.submit(&slot, &image) {
            self.is_lost |= error == vk::Result::ERROR_DEVICE_LOST;
            // Its fence may never be signalled, and the GPU does not use it.
            self.slots.retain(|other| !Arc::ptr_eq(other, &slot));
            self.destroy(&slot);
            return Err(error.to_string());
        }
        Ok(Some(Copied { image, slot }))
    }

    /// A large enough slot that nobody holds and that the GPU has finished.
    fn free_slot(&mut self, bytes: u64) -> Result<Option<Arc<Slot>>, vk::Result> {
        let free = |slot: &Arc<Slot>| {
            // SAFETY: a fence of that device.
            Arc::strong_count(slot) == 1 && unsafe { self.device.get_fence_status(slot.fence) } == Ok(true)
        };
        let fits = |slot: &Arc<Slot>| slot.capacity >= bytes && slot.capacity <= 4 * bytes.max(1 << 16);
        if let Some(slot) = self.slots.iter().find(|slot| fits(slot) && free(slot)) {
            return Ok(Some(slot.clone()));
        }
        if self.slots.len() >= SLOTS_BEFORE_EVICTION
            && let Some(index) = self.slots.iter().position(free)
        {
            let slot = self.slots.swap_remove(index);
            self.destroy(&slot);
        }
        if self.slots.len() >= MAX_SLOTS {
            return Ok(None);
        }
        let slot = Arc::new(self.new_slot(bytes)?);
        self.slots.push(slot.clone());
        Ok(Some(slot))
    }

    fn new_slot(&self, bytes: u64) -> Result<Slot, vk::Result> {
        let device = self.device.clone();
        let buffer_info = vk::BufferCreateInfo::default().size(bytes).usage(vk::BufferUsageFlags::TRANSFER_DST);
        let commands_info = vk::CommandBufferAllocateInfo::default().command_pool(self.pool).command_buffer_count(1);
        // SAFETY: the device is alive; everything is created for it, and freed by `destroy`.
        unsafe {
            let buffer = device.create_buffer(&buffer_info, None)?;
            let needs = device.get_buffer_memory_requirements(buffer);
            let memory_info = vk::MemoryAllocateInfo::default()
                .allocation_size(needs.size)
                .memory_type_index(self.memory_type(needs.memory_type_bits)?);
            let memory = device.allocate_memory(&memory_info, None)?;
            device.bind_buffer_memory(buffer, memory, 0)?;
            let mapped = device.map_memory(memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty())?;
            let commands = device.allocate_command_buffers(&commands_info)?[0];
            let fence = device.create_fence(&vk::FenceCreateInfo::default(), None)?;
            Ok(Slot { device, buffer, memory, mapped: mapped.cast(), capacity: bytes, commands, fence })
        }
    }

    /// A host-visible coherent memory type, preferably cached.
    fn memory_type(&self, allowed: u32) -> Result<u32, vk::Result> {
        let visible = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        let types = self.memory.memory_types_as_slice();
        let find = |wanted: vk::MemoryPropertyFlags| {
            (0..types.len()).find(|i| allowed & (1 << i) != 0 && types[*i].property_flags.contains(wanted))
        };
        let found = find(visible | vk::MemoryPropertyFlags::HOST_CACHED).or_else(|| find(visible));
        found.map(|index| index as u32).ok_or(vk::Result::ERROR_OUT_OF_HOST_MEMORY)
    }

    fn submit(&self, slot: &Slot, image: &Image) -> Result<(), vk::Result> {
        let commands = [slot.commands];
        let submit = vk::SubmitInfo::default().command_buffers(&commands);
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the slot is free (its fence is signalled or new). The caller is the client's
        // thread, the only one that submits to the queue.
        unsafe {
            self.device.begin_command_buffer(slot.commands, &begin)?;
            self.record(slot, image);
            self.device.end_command_buffer(slot.commands)?;
            self.device.reset_fences(&[slot.fence])?;
            self.device.queue_submit(self.queue, &[submit], slot.fence)
        }
    }

    /// Records the copy: after all previous work in the queue, and with the bytes made visible to
    /// the host.
    ///
    /// # Safety
    /// The slot's command buffer is being recorded; the image lives until it has been executed.
    unsafe fn record(&self, slot: &Slot, image: &Image) {
        let layers = vk::ImageSubresourceLayers {
            aspect_mask: vk::ImageAspectFlags::COLOR,
            layer_count: 1,
            ..Default::default()
        };
        let before = vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::MEMORY_WRITE)
            .dst_access_mask(vk::AccessFlags::TRANSFER_READ);
        let region = vk::BufferImageCopy {
            image_subresource: layers,
            image_extent: vk::Extent3D { width: image.width, height: image.height, depth: 1 },
            ..Default::default()
        };
        let after = vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::TRANSFER_WRITE)
            .dst_access_mask(vk::AccessFlags::HOST_READ);
        let (all, transfer, host) =
            (vk::PipelineStageFlags::ALL_COMMANDS, vk::PipelineStageFlags::TRANSFER, vk::PipelineStageFlags::HOST);
        let (layout, none) = (vk::ImageLayout::TRANSFER_SRC_OPTIMAL, vk::DependencyFlags::empty());
        // SAFETY: guaranteed by the caller.
        unsafe {
            self.device.cmd_pipeline_barrier(slot.commands, all, transfer, none, &[before], &[], &[]);
            self.device.cmd_copy_image_to_buffer(slot.commands, image.image, layout, slot.buffer, &[region]);
            self.device.cmd_pipeline_barrier(slot.commands, transfer, host, none, &[after], &[], &[]);
        }
    }

    fn destroy(&self, slot: &Slot) {
        // SAFETY: nobody holds the slot, and the GPU has finished with it.
        unsafe {
            self.device.destroy_fence(slot.fence, None);
            self.device.free_command_buffers(self.pool, &[slot.commands]);
            self.device.destroy_buffer(slot.buffer, None);
            self.device.free_memory(slot.memory, None);
        }
    }

    /// Waits for copies in progress and frees everything. The client's device must still live.
    pub fn free(self) {
        for slot in &self.slots {
            // SAFETY: a fence of that device.
            match unsafe { self.device.wait_for_fences(&[slot.fence], true, MAX_WAIT_NS) } {
                Ok(()) | Err(vk::Result::ERROR_DEVICE_LOST) => {}
                Err(error) => {
                    return eprintln!("fake runtime: a copy did not finish, its resources are leaked: {error}");
                }
            }
        }
        self.slots.iter().for_each(|slot| self.destroy(slot));
        // SAFETY: its command buffers are freed.
        unsafe { self.device.destroy_command_pool(self.pool, None) };
    }
}

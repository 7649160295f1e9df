//! The functions that the layer intercepts: creation and destruction, and those that report a lost
//! device.

use std::ffi::{CStr, c_char, c_void};

use ash::vk;
use ash::vk::Handle;

use crate::address;
use crate::chain::{device_link, instance_link};
use crate::devices::{Device, Instance, add_device, add_instance, device_of, instance_of, remove_device};

const LOST: vk::Result = vk::Result::ERROR_DEVICE_LOST;

/// A function of an instance.
///
/// # Safety
/// The name is zero-terminated; the instance is alive or null.
pub unsafe fn of_instance(instance: vk::Instance, name: *const c_char) -> vk::PFN_vkVoidFunction {
    // SAFETY: the text is zero-terminated.
    let text = unsafe { CStr::from_ptr(name) };
    if let Some(own) = own_of_instance(text).or_else(|| own_of_device(text)) {
        return address(own);
    }
    let next = Some(instance).filter(|instance| !instance.is_null()).and_then(instance_of)?;
    // SAFETY: the next layer's function, for its own instance.
    unsafe { (next.get_instance_proc_addr)(instance, name) }
}

/// A function of a device.
///
/// # Safety
/// The name is zero-terminated; the device is alive.
pub unsafe fn of_device(device: vk::Device, name: *const c_char) -> vk::PFN_vkVoidFunction {
    // SAFETY: the text is zero-terminated.
    let text = unsafe { CStr::from_ptr(name) };
    // SAFETY: the next layer's function, for its own device.
    let next = device_of(device).and_then(|known| unsafe { (known.get_device_proc_addr)(device, name) })?;
    // Functions that the driver lacks are not intercepted.
    own_of_device(text).map_or(Some(next), address)
}

fn own_of_instance(name: &CStr) -> Option<*const c_void> {
    Some(match name.to_bytes() {
        b"vkGetInstanceProcAddr" => crate::get_instance_proc_addr as *const c_void,
        b"vkCreateInstance" => create_instance as *const c_void,
        b"vkCreateDevice" => create_device as *const c_void,
        _ => return None,
    })
}

fn own_of_device(name: &CStr) -> Option<*const c_void> {
    Some(match name.to_bytes() {
        b"vkGetDeviceProcAddr" => crate::get_device_proc_addr as *const c_void,
        b"vkDestroyDevice" => destroy_device as *const c_void,
        b"vkQueueSubmit" => queue_submit as *const c_void,
        b"vkQueueSubmit2" | b"vkQueueSubmit2KHR" => queue_submit2 as *const c_void,
        b"vkQueueWaitIdle" => queue_wait_idle as *const c_void,
        b"vkDeviceWaitIdle" => device_wait_idle as *const c_void,
        b"vkWaitForFences" => wait_for_fences as *const c_void,
        b"vkGetFenceStatus" => get_fence_status as *const c_void,
        b"vkWaitSemaphores" | b"vkWaitSemaphoresKHR" => wait_semaphores as *const c_void,
        b"vkGetSemaphoreCounterValue" | b"vkGetSemaphoreCounterValueKHR" => semaphore_value as *const c_void,
        _ => return None,
    })
}

unsafe extern "system" fn create_instance(
    info: *const vk::InstanceCreateInfo,
    allocator: *const vk::AllocationCallbacks,
    instance: *mut vk::Instance,
) -> vk::Result {
    // SAFETY: the loader calls with the documented arguments: a chain of its structures, and a
    // place for the handle. A function of that name has that type.
    unsafe {
        let Some(get_instance_proc_addr) = instance_link(info) else { return vk::Result::ERROR_INITIALIZATION_FAILED };
        let create = get_instance_proc_addr(vk::Instance::null(), c"vkCreateInstance".as_ptr());
        let Some(create) = create else { return vk::Result::ERROR_INITIALIZATION_FAILED };
        let create: vk::PFN_vkCreateInstance = std::mem::transmute(create);
        let made = create(info, allocator, instance);
        if made == vk::Result::SUCCESS {
            add_instance(Instance { instance: *instance, get_instance_proc_addr });
        }
        made
    }
}

unsafe extern "system" fn create_device(
    physical_device: vk::PhysicalDevice,
    info: *const vk::DeviceCreateInfo,
    allocator: *const vk::AllocationCallbacks,
    device: *mut vk::Device,
) -> vk::Result {
    // SAFETY: as in `create_instance`.
    unsafe {
        let (Some((get_instance_proc_addr, get_device_proc_addr)), Some(instance)) =
            (device_link(info), instance_of(physical_device))
        else {
            return vk::Result::ERROR_INITIALIZATION_FAILED;
        };
        let create = get_instance_proc_addr(instance.instance, c"vkCreateDevice".as_ptr());
        let Some(create) = create else { return vk::Result::ERROR_INITIALIZATION_FAILED };
        let create: vk::PFN_vkCreateDevice = std::mem::transmute(create);
        let made = create(physical_device, info, allocator, device);
        if made == vk::Result::SUCCESS {
            let of = |name: &CStr| {
                get_device_proc_addr(*device, name.as_ptr()).map_or(std::ptr::null(), |f| f as *const c_void)
            };
            add_device(*device, ash::Device::load_with(of, *device), get_device_proc_addr);
        }
        made
    }
}

unsafe extern "system" fn destroy_device(device: vk::Device, allocator: *const vk::AllocationCallbacks) {
    if device.is_null() {
        return;
    }
    if let Some(known) = remove_device(device) {
        // SAFETY: forwards the client's call.
        unsafe { (known.next.fp_v1_0().destroy_device)(device, allocator) }
    }
}

/// Reports the device as lost, or forwards the call.
fn unless_lost(handle: impl Handle, pass: impl FnOnce(&Device) -> vk::Result) -> vk::Result {
    match device_of(handle) {
        Some(device) if !device.is_lost() => pass(&device),
        _ => LOST,
    }
}

unsafe extern "system" fn queue_submit(
    queue: vk::Queue,
    count: u32,
    submits: *const vk::SubmitInfo,
    fence: vk::Fence,
) -> vk::Result {
    // SAFETY: here and below: forwards the client's call unchanged.
    unless_lost(queue, |device| unsafe { (device.next.fp_v1_0().queue_submit)(queue, count, submits, fence) })
}

unsafe extern "system" fn queue_submit2(
    queue: vk::Queue,
    count: u32,
    submits: *const vk::SubmitInfo2,
    fence: vk::Fence,
) -> vk::Result {
    // SAFETY: see `queue_submit`.
    unless_lost(queue, |device| unsafe { (device.next.fp_v1_3().queue_submit2)(queue, count, submits, fence) })
}

unsafe extern "system" fn queue_wait_idle(queue: vk::Queue) -> vk::Result {
    // SAFETY: see `queue_submit`.
    unless_lost(queue, |device| unsafe { (device.next.fp_v1_0().queue_wait_idle)(queue) })
}

unsafe extern "system" fn device_wait_idle(device: vk::Device) -> vk::Result {
    // SAFETY: see `queue_submit`.
    unless_lost(device, |known| unsafe { (known.next.fp_v1_0().device_wait_idle)(device) })
}

unsafe extern "system" fn wait_for_fences(
    device: vk::Device,
    count: u32,
    fences: *const vk::Fence,
    wait_all: vk::Bool32,
    timeout_ns: u64,
) -> vk::Result {
    // SAFETY: see `queue_submit`.
    unless_lost(device, |known| unsafe {
        (known.next.fp_v1_0().wait_for_fences)(device, count, fences, wait_all, timeout_ns)
    })
}

unsafe extern "system" fn get_fence_status(device: vk::Device, fence: vk::Fence) -> vk::Result {
    // SAFETY: see `queue_submit`.
    unless_lost(device, |known| unsafe { (known.next.fp_v1_0().get_fence_status)(device, fence) })
}

unsafe extern "system" fn wait_semaphores(
    device: vk::Device,
    info: *const vk::SemaphoreWaitInfo,
    timeout_ns: u64,
) -> vk::Result {
    // SAFETY: see `queue_submit`.
    unless_lost(device, |known| unsafe { (known.next.fp_v1_2().wait_semaphores)(device, info, timeout_ns) })
}

unsafe extern "system" fn semaphore_value(device: vk::Device, semaphore: vk::Semaphore, value: *mut u64) -> vk::Result {
    // SAFETY: see `queue_submit`.
    unless_lost(device, |known| unsafe { (known.next.fp_v1_2().get_semaphore_counter_value)(device, semaphore, value) })
}

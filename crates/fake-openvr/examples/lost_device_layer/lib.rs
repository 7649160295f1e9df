//! A Vulkan layer that loses devices on demand, to test programs against a driver reset or a
//! removed card.
//!
//! It forwards everything until the file named by `LOST_DEVICE_FILE` exists. From then on, every
//! device answers submissions, waits and status queries with VK_ERROR_DEVICE_LOST permanently.
//! Devices created later work until the content of the file changes. Before the first such answer,
//! the layer waits for the driver, so that nothing of a lost device is still running when the
//! program frees it. docs/fake-runtime.md describes its use.
//!
//! Reference for layers and for the loader's structures: "Layer Interface to the Loader" of the
//! Vulkan loader (`vk_layer.h`), for which no other Rust binding exists.

mod chain;
mod devices;
mod functions;

use std::ffi::{c_char, c_void};

use ash::vk;

use chain::NegotiateLayerInterface;

/// Newest version of the layer interface that this layer supports.
const INTERFACE_VERSION: u32 = 2;

/// First call of the loader: receives this layer's entry points.
///
/// # Safety
/// `agreed` is null or the loader's own structure.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn vkNegotiateLoaderLayerInterfaceVersion(
    agreed: *mut NegotiateLayerInterface,
) -> vk::Result {
    // SAFETY: null, or the loader's own structure, which nobody else uses during the call.
    let Some(agreed) = (unsafe { agreed.as_mut() }) else { return vk::Result::ERROR_INITIALIZATION_FAILED };
    if agreed.loader_layer_interface_version < INTERFACE_VERSION {
        return vk::Result::ERROR_INITIALIZATION_FAILED;
    }
    agreed.loader_layer_interface_version = INTERFACE_VERSION;
    agreed.get_instance_proc_addr = Some(get_instance_proc_addr);
    agreed.get_device_proc_addr = Some(get_device_proc_addr);
    agreed.get_physical_device_proc_addr = None;
    vk::Result::SUCCESS
}

/// A function of an instance: the layer's own, or that of the next layer.
unsafe extern "system" fn get_instance_proc_addr(
    instance: vk::Instance,
    name: *const c_char,
) -> vk::PFN_vkVoidFunction {
    // SAFETY: the loader passes a zero-terminated text.
    unsafe { functions::of_instance(instance, name) }
}

/// A function of a device: the layer's own, or that of the next layer.
unsafe extern "system" fn get_device_proc_addr(device: vk::Device, name: *const c_char) -> vk::PFN_vkVoidFunction {
    // SAFETY: as above.
    unsafe { functions::of_device(device, name) }
}

/// Converts a function pointer to the loader's type.
fn address(function: *const c_void) -> vk::PFN_vkVoidFunction {
    // SAFETY: a function pointer or null, which has the same representation as an optional function
    // pointer.
    unsafe { std::mem::transmute(function) }
}

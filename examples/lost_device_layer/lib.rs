//! A Vulkan layer that loses devices on demand, to try programs against what a driver's reset or a pulled card does to them.
//!
//! It passes everything through until the file that `LOST_DEVICE_FILE` names is there. From then on every device answers its
//! submissions, waits and questions with VK_ERROR_DEVICE_LOST, for good; devices that are made later work, until the file's content
//! changes. Before the first such answer the driver is waited for, so that nothing of a lost device is still at work when the program
//! lets go of it. docs/stand-in.md tells how a program is run with it.
//!
//! What a layer is, and the structures through which it and Vulkan's loader find each other: the loader's "Layer Interface to the
//! Loader" (`vk_layer.h`), which has no other binding in Rust.

mod chain;
mod devices;
mod functions;

use std::ffi::{c_char, c_void};

use ash::vk;

use chain::NegotiateLayerInterface;

/// The newest agreement between loader and layers that this layer knows.
const INTERFACE_VERSION: u32 = 2;

/// Called first by the loader: tells it this layer's entry points.
///
/// # Safety
/// The loader hands over its own structure, which is filled in.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn vkNegotiateLoaderLayerInterfaceVersion(
    agreed: *mut NegotiateLayerInterface,
) -> vk::Result {
    // SAFETY: null, or the loader's own structure, which nobody else holds during the call.
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

/// A function of an instance: the layer's own, or the next one's in the chain.
unsafe extern "system" fn get_instance_proc_addr(
    instance: vk::Instance,
    name: *const c_char,
) -> vk::PFN_vkVoidFunction {
    // SAFETY: the loader's promise: a text that ends in 0.
    unsafe { functions::of_instance(instance, name) }
}

/// The same of a device.
unsafe extern "system" fn get_device_proc_addr(device: vk::Device, name: *const c_char) -> vk::PFN_vkVoidFunction {
    // SAFETY: as above.
    unsafe { functions::of_device(device, name) }
}

/// A function as the loader wants it.
fn address(function: *const c_void) -> vk::PFN_vkVoidFunction {
    // SAFETY: a pointer to a function or null, which an optional pointer to a function has the same bits for.
    unsafe { std::mem::transmute(function) }
}

//! Structures of the Vulkan loader (`vk_layer.h`) that link a layer to the next one in the chain.

use std::ffi::c_void;

use ash::vk;

type GetPhysicalDeviceProcAddr =
    unsafe extern "system" fn(vk::Instance, *const std::ffi::c_char) -> vk::PFN_vkVoidFunction;

/// `VkLayerFunction` value of a link to the next layer.
const LINK: i32 = 0;

/// `VkNegotiateLayerInterface`.
#[repr(C)]
pub struct NegotiateLayerInterface {
    structure_type: i32,
    next: *mut c_void,
    pub loader_layer_interface_version: u32,
    pub get_instance_proc_addr: Option<vk::PFN_vkGetInstanceProcAddr>,
    pub get_device_proc_addr: Option<vk::PFN_vkGetDeviceProcAddr>,
    pub get_physical_device_proc_addr: Option<GetPhysicalDeviceProcAddr>,
}

/// `VkLayerInstanceLink`.
#[repr(C)]
pub struct InstanceLink {
    next: *mut InstanceLink,
    pub get_instance_proc_addr: vk::PFN_vkGetInstanceProcAddr,
    _get_physical_device_proc_addr: Option<GetPhysicalDeviceProcAddr>,
}

/// `VkLayerDeviceLink`.
#[repr(C)]
pub struct DeviceLink {
    next: *mut DeviceLink,
    pub get_instance_proc_addr: vk::PFN_vkGetInstanceProcAddr,
    pub get_device_proc_addr: vk::PFN_vkGetDeviceProcAddr,
}

/// `VkLayerInstanceCreateInfo` and `VkLayerDeviceCreateInfo`, which differ only in the link type.
#[repr(C)]
struct LayerCreateInfo<L> {
    structure_type: vk::StructureType,
    next: *const c_void,
    function: i32,
    link: *mut L,
}

/// Takes this layer's link from a chain of structures, and advances the chain for the next layer.
///
/// # Safety
/// The chain was made by the loader.
unsafe fn take_link<L>(
    mut at: *const c_void,
    wanted: vk::StructureType,
    next_of: impl Fn(&L) -> *mut L,
) -> Option<*mut L> {
    while !at.is_null() {
        let info = at.cast_mut().cast::<LayerCreateInfo<L>>();
        // SAFETY: every structure of a chain begins with its type and the next pointer. Structures
        // of this type also have a function value, and with that value a link.
        unsafe {
            if (*info).structure_type == wanted && (*info).function == LINK {
                let link = (*info).link;
                (*info).link = next_of(&*link);
                return Some(link);
            }
            at = (*info).next;
        }
    }
    None
}

/// The next `vkGetInstanceProcAddr` for an instance that is being created.
///
/// # Safety
/// `info` comes from the loader.
pub unsafe fn instance_link(info: *const vk::InstanceCreateInfo) -> Option<vk::PFN_vkGetInstanceProcAddr> {
    // SAFETY: the loader's structures are alive during the call.
    unsafe {
        let link =
            take_link::<InstanceLink>((*info).p_next, vk::StructureType::LOADER_INSTANCE_CREATE_INFO, |l| l.next)?;
        Some((*link).get_instance_proc_addr)
    }
}

/// The next functions for a device that is being created.
///
/// # Safety
/// `info` comes from the loader.
pub unsafe fn device_link(
    info: *const vk::DeviceCreateInfo,
) -> Option<(vk::PFN_vkGetInstanceProcAddr, vk::PFN_vkGetDeviceProcAddr)> {
    // SAFETY: the loader's structures are alive during the call.
    unsafe {
        let link = take_link::<DeviceLink>((*info).p_next, vk::StructureType::LOADER_DEVICE_CREATE_INFO, |l| l.next)?;
        Some(((*link).get_instance_proc_addr, (*link).get_device_proc_addr))
    }
}

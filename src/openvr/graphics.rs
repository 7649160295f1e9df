//! Opens the graphics device with the extensions and adapter that the runtime requests: passes
//! these to [`super::vulkan`].

use std::ffi::{CString, c_char};

use super::runtime::{Runtime, call};
use super::sys;
use super::vulkan::{VulkanDevice, VulkanError, VulkanRequirements, open};

/// Limit of an extension list, bytes. Choice: a list has a few hundred bytes; a runtime that
/// reports nonsense must not take memory.
const MAX_LIST_BYTES: u32 = 1 << 16;

impl Runtime {
    /// Opens a device on the headset's adapter, with all extensions needed to hand over textures.
    ///
    /// # Errors
    /// Vulkan, the adapter or an extension is missing.
    pub fn open_device(&self) -> Result<VulkanDevice, VulkanError> {
        let Some(compositor) = self.compositor else {
            return Err(VulkanError::NoVulkan("the VR runtime has no compositor".to_owned()));
        };
        let on_instance =
            extensions(|text, length| call!(compositor, GetVulkanInstanceExtensionsRequired(text, length)));
        let on_device = |physical_device: u64| {
            let device = physical_device as usize as *mut sys::VkPhysicalDevice_T;
            extensions(|text, length| call!(compositor, GetVulkanDeviceExtensionsRequired(device, text, length)))
        };
        let adapter = |instance: u64| {
            let (mut device, kind) = (0u64, sys::ETextureType_TextureType_Vulkan);
            call!(self.system, GetOutputDevice(&mut device, kind, instance as usize as *mut sys::VkInstance_T));
            (device != 0).then_some(device)
        };
        open(&VulkanRequirements { instance_extensions: on_instance, device_extensions: &on_device, adapter: &adapter })
    }
}

/// Splits a space-separated list of names, which `ask` writes into a buffer. `ask` returns the
/// length of the list in bytes.
fn extensions(ask: impl Fn(*mut c_char, u32) -> u32) -> Vec<CString> {
    let length = ask(std::ptr::null_mut(), 0).min(MAX_LIST_BYTES);
    let mut text = vec![0u8; length as usize];
    if length > 0 {
        ask(text.as_mut_ptr().cast(), length);
    }
    let until = text.iter().position(|byte| *byte == 0).unwrap_or(text.len());
    let names = text[..until].split(|byte| *byte == b' ').filter(|name| !name.is_empty());
    names.filter_map(|name| CString::new(name).ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Behaves like the runtime: returns the length of the list, and writes it if there is room.
    fn given(list: &'static str) -> impl Fn(*mut c_char, u32) -> u32 {
        move |text, length| {
            let needed = list.len() as u32 + u32::from(!list.is_empty());
            if length >= needed && !text.is_null() && !list.is_empty() {
                // SAFETY: there is room for the list and its terminator.
                unsafe {
                    text.cast::<u8>().copy_from_nonoverlapping(list.as_ptr(), list.len());
                    *text.add(list.len()) = 0;
                }
            }
            needed
        }
    }

    #[test]
    fn extension_lists_are_split() {
        assert_eq!(extensions(given("VK_KHR_a VK_EXT_b")), [c"VK_KHR_a".to_owned(), c"VK_EXT_b".to_owned()]);
        assert_eq!(extensions(given(" VK_KHR_a  ")), [c"VK_KHR_a".to_owned()]);
        assert!(extensions(given("")).is_empty());
        // An impossible length: the request is limited to the maximum.
        assert!(extensions(|_, _| u32::MAX).is_empty());
    }
}

//! SteamVR: bindings, the runtime's loader, a session with it. Foreign types never leave this room.

mod sys;
mod vulkan;

pub use vulkan::{VulkanDevice, VulkanError, VulkanNeeds, VulkanTexture, open};

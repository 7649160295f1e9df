//! SteamVR: the runtime's library found and loaded, poses, display, events, overlays, the user's settings for the chaperone, and
//! this program in SteamVR's list. Foreign types never leave this room.
//!
//! The interfaces are those of Valve's header, bound by bindgen (build.rs). Without SteamVR all else works:
//! nothing is loaded before [`Runtime::start`]. Positions and turns come out as poses in f64, `universe_from_device`.

mod applications;
mod chaperone;
mod dashboard;
mod display;
mod error;
mod events;
mod graphics;
mod matrix;
mod overlay;
mod poses;
mod runtime;
mod runtime_paths;
mod sys;
mod vulkan;

pub use applications::{APP_KEY, Registration, manifest};
pub use chaperone::Chaperone;
pub use dashboard::{DashboardTab, TabEvent};
pub use display::{DisplayTiming, HeadsetEye};
pub use error::OpenVrError;
pub use events::Event;
pub use overlay::{EyeSide, Overlay};
pub use poses::{DevicePose, Hands, Poses, TrackingState, Universe};
pub use runtime::{Role, Runtime};
pub use runtime_paths::RuntimePaths;
pub use vulkan::{VulkanDevice, VulkanError, VulkanRequirements, VulkanTexture, open};

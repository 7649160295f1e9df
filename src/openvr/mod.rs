//! SteamVR: finds and loads the runtime's library; poses, display, events, overlays, the user's
//! chaperone settings, and the registration of this program. Foreign types do not leave this
//! module.
//!
//! The interfaces are those of Valve's header, bound by bindgen (build.rs). Everything else works
//! without SteamVR: nothing is loaded before [`Runtime::start`]. Positions and rotations are
//! returned as poses in f64, `universe_from_device`.

mod applications;
mod chaperone;
mod dashboard;
mod display;
mod error;
mod events;
mod graphics;
mod interfaces;
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
pub use events::RuntimeEvent;
pub use overlay::{EyeSide, Overlay};
pub use poses::{DevicePose, Hands, Poses, TrackingState, Universe};
pub use runtime::{Role, Runtime, time_in_runtime_ns};
pub use runtime_paths::RuntimePaths;
pub use vulkan::{VulkanDevice, VulkanError, VulkanRequirements, VulkanTexture, open};

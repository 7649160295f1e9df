//! The graphics device on the headset's adapter, with what draws on it; opened again when it is lost.

use crate::render::{RenderError, Renderer};
use crate::steamvr::{Runtime, VulkanDevice, VulkanError};

/// Between two tries to open a lost device, nanoseconds.
const RETRY_NS: i64 = 2_000_000_000;

/// Why there is nothing to draw with.
#[derive(Debug, thiserror::Error)]
pub enum GraphicsError {
    /// No device.
    #[error(transparent)]
    Device(#[from] VulkanError),
    /// It cannot draw what is drawn.
    #[error(transparent)]
    Render(#[from] RenderError),
}

/// A device and its renderer.
pub(super) struct Graphics {
    pub device: VulkanDevice,
    pub renderer: Renderer,
}

impl Graphics {
    pub fn open(runtime: &Runtime) -> Result<Self, GraphicsError> {
        let device = runtime.open_device()?;
        let renderer = Renderer::from_device(device.device.clone(), device.queue.clone(), &device.name)?;
        Ok(Self { device, renderer })
    }
}

/// When to try again.
#[derive(Debug, Default)]
pub(super) struct Retry {
    next_ns: i64,
}

impl Retry {
    /// Whether it is time; the next time is a while later.
    pub fn is_due(&mut self, now_ns: i64) -> bool {
        let is_due = now_ns >= self.next_ns;
        if is_due {
            self.next_ns = now_ns.saturating_add(RETRY_NS);
        }
        is_due
    }
}

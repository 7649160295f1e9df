//! The graphics device on the headset's adapter with its renderer; reopened after a loss.

use crate::openvr::{Runtime, VulkanDevice, VulkanError};
use crate::render::{RenderError, Renderer};

/// Interval of attempts to reopen a lost device, nanoseconds. Choice: an attempt holds up the frame
/// loop, and a driver that restarts needs seconds.
const RETRY_NS: i64 = 2_000_000_000;
/// A device that refuses work for this long without a success counts as lost, nanoseconds. Choice:
/// single refusals come with a compositor's restart; after this long the wearer has no warnings.
const MAX_REFUSING_NS: i64 = 1_000_000_000;
/// Number of lost devices kept. Choice: a session survives several driver resets, and a driver that
/// fails for ever does not fill memory.
const RETAINED_DEVICES: usize = 4;

/// Why there is no renderer.
#[derive(Debug, thiserror::Error)]
pub enum GraphicsError {
    /// No device.
    #[error(transparent)]
    Device(#[from] VulkanError),
    /// The device cannot draw the warnings.
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

/// Schedules attempts to reopen.
#[derive(Debug, Default)]
pub(super) struct Retry {
    next_ns: i64,
    last_logged: Option<String>,
}

impl Retry {
    /// Whether an attempt is due; schedules the next one.
    pub fn is_due(&mut self, now_ns: i64) -> bool {
        let is_due = now_ns >= self.next_ns;
        if is_due {
            self.next_ns = now_ns.saturating_add(RETRY_NS);
        }
        is_due
    }

    /// Logs a failed attempt, once per reason.
    pub fn failed(&mut self, error: &GraphicsError) {
        let text = error.to_string();
        if self.last_logged.as_ref() != Some(&text) {
            log::warn!("warnings cannot be drawn: {text}. Retrying every {} s", RETRY_NS / 1_000_000_000);
            self.last_logged = Some(text);
        }
    }
}

/// Decides which drawing errors mean that the device is lost.
#[derive(Debug, Default)]
pub(super) struct DrawFaults {
    /// Since when the device has refused all work.
    refused_since_ns: Option<i64>,
    last_logged: Option<String>,
}

impl DrawFaults {
    /// Something was drawn.
    pub fn drawn(&mut self) {
        self.refused_since_ns = None;
    }

    /// Takes an error; true when the device is lost. Other errors are logged once, not every frame.
    pub fn is_lost(&mut self, now_ns: i64, error: &RenderError) -> bool {
        let is_lost = match error {
            RenderError::DeviceLost { .. } => true,
            RenderError::Device(_) => {
                now_ns.saturating_sub(*self.refused_since_ns.get_or_insert(now_ns)) >= MAX_REFUSING_NS
            }
            // A picture that cannot be made is not the device's fault.
            _ => false,
        };
        let text = error.to_string();
        if is_lost {
            *self = Self::default();
        } else if self.last_logged.as_ref() != Some(&text) {
            log::warn!("a picture was not drawn: {text}");
            self.last_logged = Some(text);
        }
        is_lost
    }
}

/// Lost devices, kept until the session is over: the runtime has its own objects on them and frees
/// them at any time. Beyond a limit the oldest are dropped.
#[derive(Default)]
pub(super) struct LostDevices(Vec<Graphics>);

impl LostDevices {
    pub fn keep(&mut self, lost: Graphics) {
        if self.0.len() == RETAINED_DEVICES {
            self.0.remove(0);
        }
        self.0.push(lost);
    }
}

/// The graphics device of a session, which may be lost and opened again.
pub(super) struct DrawDevice {
    /// `None` while the device is lost.
    graphics: Option<Graphics>,
    retry: Retry,
    faults: DrawFaults,
    lost: LostDevices,
}

impl DrawDevice {
    pub fn new(graphics: Graphics) -> Self {
        let (retry, faults, lost) = Default::default();
        Self { graphics: Some(graphics), retry, faults, lost }
    }

    pub fn get(&self) -> Option<&Graphics> {
        self.graphics.as_ref()
    }

    pub fn get_mut(&mut self) -> Option<&mut Graphics> {
        self.graphics.as_mut()
    }

    /// Reopens a lost device when a retry is due.
    pub fn reopen(&mut self, runtime: &Runtime, now_ns: i64) {
        if self.graphics.is_none() && self.retry.is_due(now_ns) {
            match Graphics::open(runtime) {
                Ok(graphics) => {
                    log::info!("drawing on {}", graphics.device.name);
                    self.graphics = Some(graphics);
                }
                Err(error) => self.retry.failed(&error),
            }
        }
    }

    /// Records an error of drawing; returns whether the device is lost.
    pub fn is_lost(&mut self, now_ns: i64, error: &RenderError) -> bool {
        self.faults.is_lost(now_ns, error)
    }

    /// Drawing has succeeded.
    pub fn drawn(&mut self) {
        self.faults.drawn();
    }

    /// Closes a lost device. It is kept until the session is over, because the runtime may have
    /// objects on it.
    pub fn lose(&mut self) {
        if let Some(lost) = self.graphics.take() {
            self.lost.keep(lost);
        }
    }

    /// What must outlive the session.
    pub fn end(self) -> (Option<Graphics>, LostDevices) {
        (self.graphics, self.lost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_lost_or_refusing_devices_are_reopened() {
        let mut faults = DrawFaults::default();
        let second_ns = 1_000_000_000;
        let lost = RenderError::DeviceLost { adapter: "card".into(), cause: "pulled".into() };
        let refused = RenderError::Device("out of memory".into());
        let size = RenderError::ImageSize { width: 0, height: 1, greatest: 2 };
        assert!(faults.is_lost(0, &lost));
        assert!(!faults.is_lost(0, &refused) && !faults.is_lost(second_ns / 2, &refused));
        faults.drawn();
        assert!(!faults.is_lost(second_ns, &refused), "it has drawn in between");
        assert!((0..1000).all(|frame| !faults.is_lost(frame * second_ns, &size)));
        assert!(faults.is_lost(2 * second_ns, &refused));
        assert!(!faults.is_lost(2 * second_ns, &refused), "the next one begins anew");
    }
}

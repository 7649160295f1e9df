//! Events that the client has not polled yet.

use std::collections::VecDeque;

use crate::sys;

/// Limit of the queue; the oldest events are dropped. Choice: seconds of events for a client that
/// does not poll.
const MAX_EVENTS: usize = 256;

/// The event queue.
#[derive(Clone, Default)]
pub struct Events {
    waiting: VecDeque<(i64, sys::VREvent_t)>,
}

/// An event about a device, or about none (`u32::MAX`).
pub fn event(kind: sys::EVREventType, device: u32) -> sys::VREvent_t {
    // SAFETY: plain numbers and unions of numbers, for which all zero bits are valid.
    let mut event: sys::VREvent_t = unsafe { std::mem::zeroed() };
    event.eventType = kind;
    event.trackedDeviceIndex = device;
    event
}

/// The universe has changed or moved.
pub fn universe_changed(universe: u64) -> sys::VREvent_t {
    let mut changed =
        event(sys::EVREventType_VREvent_ChaperoneUniverseHasChanged, sys::k_unTrackedDeviceIndexInvalid as u32);
    // SAFETY: the bytes of the union are zero; `chaperone` starts with two 64-bit numbers, the
    // previous and the current universe.
    unsafe { (&raw mut changed.data).cast::<u64>().add(1).write_unaligned(universe) };
    changed
}

impl Events {
    /// Adds an event. Returns false if an old one was dropped.
    pub fn push(&mut self, time_ns: i64, event: sys::VREvent_t) -> bool {
        let full = self.waiting.len() == MAX_EVENTS;
        if full {
            self.waiting.pop_front();
        }
        self.waiting.push_back((time_ns, event));
        !full
    }

    /// The oldest event, with its age.
    pub fn pop(&mut self, now_ns: i64) -> Option<sys::VREvent_t> {
        let (time_ns, mut event) = self.waiting.pop_front()?;
        event.eventAgeSeconds = ((now_ns - time_ns) as f64 * 1e-9) as f32;
        Some(event)
    }
}

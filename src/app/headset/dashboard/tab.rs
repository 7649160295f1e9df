//! The tab in SteamVR's dashboard: whether it is open, and the pointer on it.

use std::sync::Arc;
use std::sync::mpsc::SyncSender;

use super::WorkerInput;
use crate::openvr::{DashboardTab, OpenVrError, Runtime, TabEvent, VulkanTexture};
use crate::panel;

/// Interval of visibility checks, nanoseconds; an event triggers one at once. Choice: catches a
/// missed event before one notices, at four calls of the runtime a second.
const CHECK_INTERVAL_NS: i64 = 250_000_000;
/// Events taken per frame. Choice: bounds the time in a frame; a pointer sends a few events a
/// frame, the rest waits for the next.
const MAX_EVENTS: usize = 64;

/// The tab.
pub(super) struct Tab {
    /// `None`: the runtime provides none.
    tab: Option<DashboardTab>,
    is_open: bool,
    checked_ns: i64,
}

impl Tab {
    pub fn new(runtime: &Arc<Runtime>) -> Self {
        let tab = DashboardTab::new(runtime, "radar-chaperone.dashboard", "Radar chaperone", panel::SIZE);
        let tab = tab.inspect_err(|error| log::warn!("no panel in the dashboard: {error}")).ok();
        Self { tab, is_open: false, checked_ns: i64::MIN }
    }

    pub fn is_open(&self) -> bool {
        self.is_open
    }

    /// Forwards pointer and visibility to the worker.
    pub fn update(&mut self, now_ns: i64, to_worker: &SyncSender<WorkerInput>) {
        self.take_events(to_worker);
        self.check_visibility(now_ns, to_worker);
    }

    fn take_events(&mut self, to_worker: &SyncSender<WorkerInput>) {
        let Some(tab) = &self.tab else { return };
        for _ in 0..MAX_EVENTS {
            match tab.next_event() {
                None => break,
                Some(TabEvent::Visibility) => self.checked_ns = i64::MIN,
                Some(TabEvent::Other) => {}
                Some(event) => drop(to_worker.try_send(WorkerInput::Pointer(event))),
            }
        }
    }

    fn check_visibility(&mut self, now_ns: i64, to_worker: &SyncSender<WorkerInput>) {
        let Some(tab) = self.tab.as_ref().filter(|_| now_ns.saturating_sub(self.checked_ns) >= CHECK_INTERVAL_NS)
        else {
            return;
        };
        self.checked_ns = now_ns;
        let is_open = tab.is_visible();
        if is_open != self.is_open && to_worker.try_send(WorkerInput::Open(is_open)).is_ok() {
            self.is_open = is_open;
        }
    }

    /// # Errors
    /// The runtime refuses.
    pub fn set_picture(&self, texture: &VulkanTexture) -> Result<(), OpenVrError> {
        self.tab.as_ref().map_or(Ok(()), |tab| tab.set_picture(texture))
    }

    /// # Errors
    /// The runtime refuses.
    pub fn set_thumbnail(&self, texture: &VulkanTexture) -> Result<(), OpenVrError> {
        self.tab.as_ref().map_or(Ok(()), |tab| tab.set_thumbnail(texture))
    }
}

//! The notice outside the dashboard: which one is wanted, and its picture's way from the worker to
//! the overlay.

use std::sync::Arc;
use std::sync::mpsc::SyncSender;

use super::WorkerInput;
use super::facts::Facts;
use super::fault_monitor::FaultMonitor;
use super::notice_overlay::NoticeOverlay;
use super::welcome::Welcome;
use crate::openvr::{OpenVrError, Runtime, VulkanTexture};
use crate::panel::Notice;

/// The notices.
pub(super) struct Notices {
    /// `None`: the runtime provides none.
    overlay: Option<NoticeOverlay>,
    faults: FaultMonitor,
    welcome: Welcome,
    /// The notice to show, and the one last requested from the worker.
    wanted: Option<Notice>,
    requested: Option<Notice>,
    /// The last notice logged: a repeated notice is not logged again.
    logged: Option<Notice>,
}

impl Notices {
    /// `welcome`: the notice of the first session is due.
    pub fn new(runtime: &Arc<Runtime>, welcome: bool) -> Self {
        let overlay =
            NoticeOverlay::new(runtime).inspect_err(|error| log::warn!("no notices in the headset: {error}")).ok();
        Self {
            overlay,
            faults: FaultMonitor::default(),
            welcome: Welcome::new(welcome),
            wanted: None,
            requested: None,
            logged: None,
        }
    }

    /// Whether there is a notice to show.
    pub fn is_wanted(&self) -> bool {
        self.wanted.is_some()
    }

    /// Shows the current notice once its picture is ready; none while the tab is open.
    ///
    /// # Errors
    /// The runtime refuses.
    pub fn update(
        &mut self,
        now_ns: i64,
        facts: &Facts,
        is_tab_open: bool,
        to_worker: &SyncSender<WorkerInput>,
    ) -> Result<(), OpenVrError> {
        let trouble = self.faults.update(now_ns, facts.sensor, facts.is_alive, facts.output);
        let may_notify = facts.may_notify && !is_tab_open;
        let may_welcome = may_notify && trouble.is_none() && facts.sensor.is_some_and(|sensor| sensor.sweeps > 0);
        let welcome = self.welcome.update(now_ns, may_welcome);
        self.wanted = trouble.or(welcome).filter(|_| may_notify);
        let Some(overlay) = &mut self.overlay else { return Ok(()) };
        if let Some(notice) = self.wanted.filter(|_| self.wanted != self.logged) {
            // A recovery is logged as what it recovers from is.
            let level = if notice == Notice::Welcome { log::Level::Info } else { log::Level::Warn };
            log::log!(level, "notice in the headset: {}", notice.headline());
            self.logged = self.wanted;
        }
        let has_faded = overlay.update(now_ns, self.wanted);
        if let Some(notice) = self.wanted.filter(|_| self.wanted != self.requested && matches!(has_faded, Ok(true)))
            && to_worker.try_send(WorkerInput::Notice(notice)).is_ok()
        {
            self.requested = Some(notice);
        }
        has_faded.map(drop)
    }

    /// Whether the notice of the first session has been shown.
    pub fn has_welcomed(&self) -> bool {
        self.welcome.is_done()
    }

    /// Takes the picture of a notice.
    ///
    /// # Errors
    /// The runtime refuses.
    pub fn set_picture(&mut self, notice: Notice, texture: &VulkanTexture) -> Result<(), OpenVrError> {
        self.overlay.as_mut().map_or(Ok(()), |overlay| overlay.set_picture(notice, texture))
    }

    /// Drops the picture after the device was lost.
    pub fn drop_picture(&mut self) {
        self.requested = None;
        if let Some(overlay) = &mut self.overlay {
            overlay.drop_picture();
        }
    }
}

//! The frame loop's side of the panel in SteamVR's dashboard: the tab, its pointer, and the
//! handover of pictures. Also the notice that is shown outside the dashboard when the radar has
//! failed.
//!
//! A worker thread lays the panel out and prepares its pictures. The loop forwards user input,
//! submits a prepared picture and passes it to the runtime once the graphics card has finished it.
//! One picture is in flight at a time, and the loop waits for none. While the tab is hidden and
//! there is no notice, nothing is drawn.

mod facts;
mod fault_monitor;
mod notice_overlay;
mod worker;

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};

pub(super) use facts::Facts;
pub(super) use worker::{PanelSources, PanelWorker};

use self::fault_monitor::FaultMonitor;
use self::notice_overlay::NoticeOverlay;
use super::graphics::Graphics;
use crate::openvr::{DashboardTab, OpenVrError, Runtime, TabEvent};
use crate::panel;
use crate::panel::Notice;
use crate::render::RenderError;

/// Interval of visibility checks, nanoseconds; an event triggers one at once. Choice: catches a
/// missed event before one notices, at four calls of the runtime a second.
const CHECK_INTERVAL_NS: i64 = 250_000_000;
/// Events taken per frame. Choice: bounds the time in a frame; a pointer sends a few events a
/// frame, the rest waits for the next.
const MAX_EVENTS: usize = 64;
/// Bound of messages to the worker. Choice: several frames of the most events; the worker empties
/// it every 15 ms.
const MAX_INPUTS: usize = 256;
/// Pictures kept alive after they were replaced, because the runtime copies them on our queue.
/// Choice: as many as the worker rotates, so none is overwritten while it may be copied.
const RETAINED_PICTURES: usize = 3;

/// Messages to the worker.
enum WorkerInput {
    Open(bool),
    Pointer(TabEvent),
    /// A notice to draw.
    Notice(Notice),
    /// A device to draw with, by number; the previous one is gone.
    Device(u64, wgpu::Device, wgpu::Queue),
    /// The picture in flight was shown or dropped.
    PictureDone,
}

/// Content of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Picture {
    Panel,
    Thumbnail,
    Notice(Notice),
}

/// A picture that is ready to be submitted.
struct PreparedPicture {
    device: u64,
    commands: Vec<wgpu::CommandBuffer>,
    picture: Picture,
    texture: Arc<wgpu::Texture>,
}

/// The loop's side.
pub(super) struct Dashboard {
    /// `None`: the runtime provides none.
    tab: Option<DashboardTab>,
    /// `None`: the runtime provides none.
    notice_overlay: Option<NoticeOverlay>,
    faults: FaultMonitor,
    /// The notice to show, and the one last requested from the worker.
    wanted: Option<Notice>,
    requested: Option<Notice>,
    /// The last notice logged: a repeated notice is not logged again.
    logged: Option<Notice>,
    to_worker: SyncSender<WorkerInput>,
    drawings: Receiver<PreparedPicture>,
    facts: Arc<Mutex<Facts>>,
    forget_room: Arc<AtomicBool>,
    is_open: bool,
    checked_ns: i64,
    /// The device's number, and whether the worker has it.
    device: u64,
    has_device: bool,
    under_way: Option<(PreparedPicture, Arc<AtomicBool>)>,
    shown: VecDeque<Arc<wgpu::Texture>>,
    refusal_logged: bool,
}

impl Dashboard {
    /// Creates the tab and its worker.
    pub fn new(runtime: &Arc<Runtime>) -> (Self, PanelWorker) {
        let tab = DashboardTab::new(runtime, "radar-chaperone.dashboard", "Radar chaperone", panel::SIZE);
        let tab = tab.inspect_err(|error| log::warn!("no panel in the dashboard: {error}")).ok();
        let notice_overlay =
            NoticeOverlay::new(runtime).inspect_err(|error| log::warn!("no notices in the headset: {error}")).ok();
        let (to_worker, inputs) = sync_channel(MAX_INPUTS);
        let (to_loop, drawings) = sync_channel(1);
        let facts = Arc::new(Mutex::default());
        let forget_room = Arc::<AtomicBool>::default();
        let work = PanelWorker::new(inputs, to_loop, Arc::clone(&facts), Arc::clone(&forget_room));
        let dashboard = Self {
            tab,
            notice_overlay,
            faults: FaultMonitor::default(),
            wanted: None,
            requested: None,
            logged: None,
            to_worker,
            drawings,
            facts,
            forget_room,
            is_open: false,
            checked_ns: i64::MIN,
            device: 0,
            has_device: false,
            under_way: None,
            shown: VecDeque::new(),
            refusal_logged: false,
        };
        (dashboard, work)
    }

    /// Whether there is something to draw: the tab is open or there is a notice.
    pub fn needs_graphics(&self) -> bool {
        self.is_open || self.wanted.is_some()
    }

    /// Whether the user has requested a map reset; true once per request.
    pub fn take_reset_request(&self) -> bool {
        self.forget_room.swap(false, Ordering::Relaxed)
    }

    /// The work of a frame.
    ///
    /// # Errors
    /// The device fails or is lost.
    pub fn update(&mut self, now_ns: i64, graphics: Option<&Graphics>, facts: &Facts) -> Result<(), RenderError> {
        self.take_events();
        self.check_visibility(now_ns);
        self.update_notice(now_ns, facts);
        if self.is_open
            && let Ok(mut held) = self.facts.try_lock()
        {
            *held = facts.clone();
        }
        let Some(graphics) = graphics else { return Ok(()) };
        if !self.has_device {
            let (device, queue) = (graphics.device.device.clone(), graphics.device.queue.clone());
            self.has_device = self.to_worker.try_send(WorkerInput::Device(self.device, device, queue)).is_ok();
        }
        self.submit(graphics);
        self.show_finished(graphics);
        if self.under_way.is_some() { graphics.renderer.check() } else { Ok(()) }
    }

    fn take_events(&mut self) {
        let Some(tab) = &self.tab else { return };
        for _ in 0..MAX_EVENTS {
            match tab.next_event() {
                None => break,
                Some(TabEvent::Visibility) => self.checked_ns = i64::MIN,
                Some(TabEvent::Other) => {}
                Some(event) => drop(self.to_worker.try_send(WorkerInput::Pointer(event))),
            }
        }
    }

    fn check_visibility(&mut self, now_ns: i64) {
        let Some(tab) = self.tab.as_ref().filter(|_| now_ns.saturating_sub(self.checked_ns) >= CHECK_INTERVAL_NS)
        else {
            return;
        };
        self.checked_ns = now_ns;
        let is_open = tab.is_visible();
        if is_open != self.is_open && self.to_worker.try_send(WorkerInput::Open(is_open)).is_ok() {
            self.is_open = is_open;
        }
    }

    /// Shows the current notice once its picture is ready.
    fn update_notice(&mut self, now_ns: i64, facts: &Facts) {
        let trouble = self.faults.update(now_ns, facts.sensor, facts.is_alive);
        self.wanted = trouble.filter(|_| facts.may_notify && !self.is_open);
        let Some(notice_overlay) = &mut self.notice_overlay else { return };
        if let Some(notice) = self.wanted.filter(|_| self.wanted != self.logged) {
            log::warn!("notice in the headset: {}", notice.headline());
            self.logged = self.wanted;
        }
        let has_faded = notice_overlay.update(now_ns, self.wanted);
        if let Some(notice) = self.wanted.filter(|_| self.wanted != self.requested && matches!(has_faded, Ok(true)))
            && self.to_worker.try_send(WorkerInput::Notice(notice)).is_ok()
        {
            self.requested = Some(notice);
        }
        self.log_refusal_once("the notice", has_faded.map(drop));
    }

    /// Logs the first refusal of the runtime.
    fn log_refusal_once(&mut self, what: &str, done: Result<(), OpenVrError>) {
        if let Err(error) = done
            && !self.refusal_logged
        {
            log::warn!("{what}: {error}");
            self.refusal_logged = true;
        }
    }

    /// Submits a prepared picture when none is in flight.
    fn submit(&mut self, graphics: &Graphics) {
        if self.under_way.is_some() {
            return;
        }
        let Ok(mut drawing) = self.drawings.try_recv() else { return };
        if drawing.device != self.device {
            return drop(self.to_worker.try_send(WorkerInput::PictureDone));
        }
        let queue = &graphics.device.queue;
        queue.submit(drawing.commands.drain(..));
        let is_done = Arc::new(AtomicBool::new(false));
        let signal = Arc::clone(&is_done);
        queue.on_submitted_work_done(move || signal.store(true, Ordering::Release));
        self.under_way = Some((drawing, is_done));
    }

    /// Passes finished pictures to the runtime.
    fn show_finished(&mut self, graphics: &Graphics) {
        let Some((drawing, _)) = self.under_way.take_if(|(_, is_done)| is_done.load(Ordering::Acquire)) else { return };
        if let Some(texture) = graphics.device.texture_handles(&drawing.texture) {
            let handed = match (drawing.picture, &self.tab, &mut self.notice_overlay) {
                (Picture::Panel, Some(tab), _) => tab.set_picture(&texture),
                (Picture::Thumbnail, Some(tab), _) => tab.set_thumbnail(&texture),
                (Picture::Notice(notice), _, Some(notice_overlay)) => notice_overlay.set_picture(notice, &texture),
                _ => Ok(()),
            };
            self.log_refusal_once("the panel in the dashboard", handed);
        }
        self.shown.push_back(drawing.texture);
        if self.shown.len() > RETAINED_PICTURES {
            self.shown.pop_front();
        }
        // The worker waits for this before its next picture, and empties its queue faster than it
        // fills.
        let _ = self.to_worker.try_send(WorkerInput::PictureDone);
    }

    /// Drops all pictures after the device was lost.
    pub fn drop_pictures(&mut self) {
        self.device += 1;
        self.has_device = false;
        self.under_way = None;
        self.requested = None;
        if let Some(notice_overlay) = &mut self.notice_overlay {
            notice_overlay.drop_picture();
        }
        self.shown.clear();
    }

    /// Destroys tab and notice and ends the worker. Returns the pictures, because the runtime may
    /// still copy them until the session is over.
    pub fn end(self) -> Vec<Arc<wgpu::Texture>> {
        self.shown.into_iter().chain(self.under_way.map(|(drawing, _)| drawing.texture)).collect()
    }
}

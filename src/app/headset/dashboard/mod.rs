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
mod notices;
mod pictures;
mod tab;
mod welcome;
mod worker;

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex};

pub(super) use facts::Facts;
pub(super) use worker::{PanelSources, PanelWorker};

use self::notices::Notices;
use self::pictures::{Picture, Pictures, PreparedPicture};
use self::tab::Tab;
use super::graphics::Graphics;
use crate::openvr::{OpenVrError, Runtime, TabEvent};
use crate::panel::Notice;
use crate::render::RenderError;

/// Bound of messages to the worker. Choice: several frames of the most events; the worker empties
/// it every 15 ms.
const MAX_INPUTS: usize = 256;

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

/// The loop's side.
pub(super) struct Dashboard {
    tab: Tab,
    notices: Notices,
    pictures: Pictures,
    to_worker: SyncSender<WorkerInput>,
    /// What the worker shows, and its request to reset the map.
    facts: Arc<Mutex<Facts>>,
    forget_room: Arc<AtomicBool>,
    refusal_logged: bool,
}

impl Dashboard {
    /// Creates the tab and its worker. `welcome`: the notice of the first session is due.
    pub fn new(runtime: &Arc<Runtime>, welcome: bool) -> (Self, PanelWorker) {
        let (to_worker, inputs) = sync_channel(MAX_INPUTS);
        let (to_loop, drawings) = sync_channel(1);
        let facts = Arc::new(Mutex::default());
        let forget_room = Arc::<AtomicBool>::default();
        let work = PanelWorker::new(inputs, to_loop, Arc::clone(&facts), Arc::clone(&forget_room));
        let dashboard = Self {
            tab: Tab::new(runtime),
            notices: Notices::new(runtime, welcome),
            pictures: Pictures::new(drawings),
            to_worker,
            facts,
            forget_room,
            refusal_logged: false,
        };
        (dashboard, work)
    }

    /// Whether there is something to draw: the tab is open or there is a notice.
    pub fn needs_graphics(&self) -> bool {
        self.tab.is_open() || self.notices.is_wanted()
    }

    /// Whether the user has requested a map reset; true once per request.
    pub fn take_reset_request(&self) -> bool {
        self.forget_room.swap(false, Ordering::Relaxed)
    }

    /// Whether the notice of the first session has been shown.
    pub fn has_welcomed(&self) -> bool {
        self.notices.has_welcomed()
    }

    /// The work of a frame.
    ///
    /// # Errors
    /// The device fails or is lost.
    pub fn update(&mut self, now_ns: i64, graphics: Option<&Graphics>, facts: &Facts) -> Result<(), RenderError> {
        self.tab.update(now_ns, &self.to_worker);
        let noticed = self.notices.update(now_ns, facts, self.tab.is_open(), &self.to_worker);
        self.log_refusal_once("the notice", noticed);
        if self.tab.is_open()
            && let Ok(mut held) = self.facts.try_lock()
        {
            *held = facts.clone();
        }
        let Some(graphics) = graphics else { return Ok(()) };
        self.pictures.submit(graphics, &self.to_worker);
        self.show_finished(graphics);
        if self.pictures.is_under_way() { graphics.renderer.check() } else { Ok(()) }
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

    /// Passes finished pictures to the runtime.
    fn show_finished(&mut self, graphics: &Graphics) {
        let Some((picture, texture)) = self.pictures.take_finished() else { return };
        if let Some(texture) = graphics.device.texture_handles(&texture) {
            let handed = match picture {
                Picture::Panel => self.tab.set_picture(&texture),
                Picture::Thumbnail => self.tab.set_thumbnail(&texture),
                Picture::Notice(notice) => self.notices.set_picture(notice, &texture),
            };
            self.log_refusal_once("the panel in the dashboard", handed);
        }
        self.pictures.retain(texture);
        // The worker waits for this before its next picture, and empties its queue faster than it
        // fills.
        let _ = self.to_worker.try_send(WorkerInput::PictureDone);
    }

    /// Drops all pictures after the device was lost.
    pub fn drop_pictures(&mut self) {
        self.notices.drop_picture();
        self.pictures.drop_all();
    }

    /// Destroys tab and notice and ends the worker. Returns the pictures, because the runtime may
    /// still copy them until the session is over.
    pub fn end(self) -> Vec<Arc<wgpu::Texture>> {
        self.pictures.end()
    }
}

//! The panel in SteamVR's dashboard, on the side of the frame loop: the tab, the pointer on it, and pictures handed over. And the notice that is
//! shown while no dashboard is open, when the radar sees nothing.
//!
//! A thread of its own lays the panel out and prepares its pictures; see `work.rs`. The loop hands on what the user does,
//! submits a prepared picture and gives it to the runtime when the graphics card is done with it: one is under way at a time, and the
//! loop waits for none. While the tab is not shown and there is
//! no notice nothing is drawn.

mod facts;
mod placard;
mod troubles;
mod work;

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};

pub(super) use facts::Facts;
pub use facts::SensorCount;
pub(super) use work::{PanelSources, PanelWork};

use self::placard::Placard;
use self::troubles::Troubles;
use super::graphics::Graphics;
use crate::openvr::{DashboardTab, OpenVrError, Runtime, TabEvent};
use crate::panel;
use crate::panel::Notice;
use crate::render::RenderError;

/// Between two looks whether the tab is shown, nanoseconds; events bring one forward.
const LOOK_NS: i64 = 250_000_000;
/// Events taken a frame.
const MOST_EVENTS: usize = 64;
/// What may wait for the thread.
const MOST_INPUTS: usize = 256;
/// Pictures kept alive after they were replaced: the runtime copies them on our queue.
const KEPT: usize = 3;

/// What the thread is told.
enum Input {
    Open(bool),
    Pointer(TabEvent),
    /// To be drawn.
    Notice(Notice),
    /// A device to draw on, by number; the one before is gone.
    Device(u64, wgpu::Device, wgpu::Queue),
    /// The picture that was under way was handed over, or dropped.
    Handed,
}

/// What a picture is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Picture {
    Panel,
    Thumbnail,
    Notice(Notice),
}

/// A picture that waits to be submitted.
struct Drawing {
    device: u64,
    commands: Vec<wgpu::CommandBuffer>,
    picture: Picture,
    texture: Arc<wgpu::Texture>,
}

/// The loop's side.
pub(super) struct Dashboard {
    /// `None`: the runtime gives none.
    tab: Option<DashboardTab>,
    /// `None`: the runtime gives none.
    placard: Option<Placard>,
    troubles: Troubles,
    /// What is to be said, and what the thread was asked to draw last.
    wanted: Option<Notice>,
    asked: Option<Notice>,
    /// What the log was told last: what is said once a minute is not logged each time.
    logged: Option<Notice>,
    to_work: SyncSender<Input>,
    drawings: Receiver<Drawing>,
    facts: Arc<Mutex<Facts>>,
    forget_room: Arc<AtomicBool>,
    is_open: bool,
    looked_ns: i64,
    /// The device's number, and whether the thread has it.
    device: u64,
    has_device: bool,
    under_way: Option<(Drawing, Arc<AtomicBool>)>,
    shown: VecDeque<Arc<wgpu::Texture>>,
    is_refused: bool,
}

impl Dashboard {
    /// The tab, and what its thread works with.
    pub fn new(runtime: &Arc<Runtime>) -> (Self, PanelWork) {
        let tab = DashboardTab::new(runtime, "radar-chaperone.dashboard", "Radar chaperone", panel::SIZE);
        let tab = tab.inspect_err(|error| log::warn!("no panel in the dashboard: {error}")).ok();
        let placard = Placard::new(runtime).inspect_err(|error| log::warn!("no notices in the headset: {error}")).ok();
        let (to_work, inputs) = sync_channel(MOST_INPUTS);
        let (to_loop, drawings) = sync_channel(1);
        let facts = Arc::new(Mutex::default());
        let forget_room = Arc::<AtomicBool>::default();
        let work = PanelWork::new(inputs, to_loop, Arc::clone(&facts), Arc::clone(&forget_room));
        let dashboard = Self {
            tab,
            placard,
            troubles: Troubles::default(),
            wanted: None,
            asked: None,
            logged: None,
            to_work,
            drawings,
            facts,
            forget_room,
            is_open: false,
            looked_ns: i64::MIN,
            device: 0,
            has_device: false,
            under_way: None,
            shown: VecDeque::new(),
            is_refused: false,
        };
        (dashboard, work)
    }

    /// Whether there is something to be drawn: it is looked at, or there is something to be said.
    pub fn needs_graphics(&self) -> bool {
        self.is_open || self.wanted.is_some()
    }

    /// Whether the user wants the room's map to begin anew; told once.
    pub fn takes_forgetting(&self) -> bool {
        self.forget_room.swap(false, Ordering::Relaxed)
    }

    /// A frame's work.
    ///
    /// # Errors
    /// The device fails, or is lost.
    pub fn turn(&mut self, now_ns: i64, graphics: Option<&Graphics>, facts: &Facts) -> Result<(), RenderError> {
        self.take_events();
        self.look(now_ns);
        self.turn_placard(now_ns, facts);
        if self.is_open
            && let Ok(mut held) = self.facts.try_lock()
        {
            *held = facts.clone();
        }
        let Some(graphics) = graphics else { return Ok(()) };
        if !self.has_device {
            let (device, queue) = (graphics.device.device.clone(), graphics.device.queue.clone());
            self.has_device = self.to_work.try_send(Input::Device(self.device, device, queue)).is_ok();
        }
        self.submit(graphics);
        self.hand_over(graphics);
        if self.under_way.is_some() { graphics.renderer.check() } else { Ok(()) }
    }

    fn take_events(&mut self) {
        let Some(tab) = &self.tab else { return };
        for _ in 0..MOST_EVENTS {
            match tab.next_event() {
                None => break,
                Some(TabEvent::Visibility) => self.looked_ns = i64::MIN,
                Some(TabEvent::Other) => {}
                Some(event) => drop(self.to_work.try_send(Input::Pointer(event))),
            }
        }
    }

    fn look(&mut self, now_ns: i64) {
        let Some(tab) = self.tab.as_ref().filter(|_| now_ns.saturating_sub(self.looked_ns) >= LOOK_NS) else { return };
        self.looked_ns = now_ns;
        let is_open = tab.is_visible();
        if is_open != self.is_open && self.to_work.try_send(Input::Open(is_open)).is_ok() {
            self.is_open = is_open;
        }
    }

    /// Says what there is to say, as soon as there is a picture of it.
    fn turn_placard(&mut self, now_ns: i64, facts: &Facts) {
        let trouble = self.troubles.look(now_ns, facts.sensor, facts.is_alive);
        self.wanted = trouble.filter(|_| facts.may_notify && !self.is_open);
        let Some(placard) = &mut self.placard else { return };
        if let Some(notice) = self.wanted.filter(|_| self.wanted != self.logged) {
            log::warn!("the headset says: {}", notice.headline());
            self.logged = self.wanted;
        }
        let has_faded = placard.turn(now_ns, self.wanted);
        if let Some(notice) = self.wanted.filter(|_| self.wanted != self.asked && matches!(has_faded, Ok(true)))
            && self.to_work.try_send(Input::Notice(notice)).is_ok()
        {
            self.asked = Some(notice);
        }
        self.told("the notice", has_faded.map(drop));
    }

    /// What the runtime refuses is logged once.
    fn told(&mut self, what: &str, done: Result<(), OpenVrError>) {
        if let Err(error) = done
            && !self.is_refused
        {
            log::warn!("{what}: {error}");
            self.is_refused = true;
        }
    }

    /// Submits a picture that has been prepared, when none is under way.
    fn submit(&mut self, graphics: &Graphics) {
        if self.under_way.is_some() {
            return;
        }
        let Ok(mut drawing) = self.drawings.try_recv() else { return };
        if drawing.device != self.device {
            return drop(self.to_work.try_send(Input::Handed));
        }
        let queue = &graphics.device.queue;
        queue.submit(drawing.commands.drain(..));
        let is_done = Arc::new(AtomicBool::new(false));
        let tell = Arc::clone(&is_done);
        queue.on_submitted_work_done(move || tell.store(true, Ordering::Release));
        self.under_way = Some((drawing, is_done));
    }

    /// Gives the runtime what is drawn.
    fn hand_over(&mut self, graphics: &Graphics) {
        let Some((drawing, _)) = self.under_way.take_if(|(_, is_done)| is_done.load(Ordering::Acquire)) else { return };
        if let Some(texture) = graphics.device.texture_handles(&drawing.texture) {
            let handed = match (drawing.picture, &self.tab, &mut self.placard) {
                (Picture::Panel, Some(tab), _) => tab.set_picture(&texture),
                (Picture::Thumbnail, Some(tab), _) => tab.set_thumbnail(&texture),
                (Picture::Notice(notice), _, Some(placard)) => placard.set_picture(notice, &texture),
                _ => Ok(()),
            };
            self.told("the panel in the dashboard", handed);
        }
        self.shown.push_back(drawing.texture);
        if self.shown.len() > KEPT {
            self.shown.pop_front();
        }
        // The thread asks for this before its next picture, and empties its queue more often than it fills.
        let _ = self.to_work.try_send(Input::Handed);
    }

    /// The device that drew is gone.
    pub fn forget_pictures(&mut self) {
        self.device += 1;
        self.has_device = false;
        self.under_way = None;
        self.asked = None;
        if let Some(placard) = &mut self.placard {
            placard.forget_picture();
        }
        self.shown.clear();
    }

    /// Destroys tab and notice and ends the thread. Pictures come back: the runtime may still copy them until the session is over.
    pub fn end(self) -> Vec<Arc<wgpu::Texture>> {
        self.shown.into_iter().chain(self.under_way.map(|(drawing, _)| drawing.texture)).collect()
    }
}

//! The panel in SteamVR's dashboard, on the side of the frame loop: the tab, the pointer on it, and pictures handed over.
//!
//! A thread of its own lays the panel out and prepares its pictures; see `work.rs`. The loop hands on what the user does,
//! submits a prepared picture and gives it to the runtime when the graphics card is done with it: one is under way at a time, and the
//! loop waits for none. While the tab is not shown nothing is drawn.

mod facts;
mod work;

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};

pub(super) use facts::Facts;
pub use facts::SensorCount;
pub(super) use work::{PanelSources, PanelWork};

use super::graphics::Graphics;
use crate::panel;
use crate::render::RenderError;
use crate::steamvr::{DashboardTab, Runtime, TabEvent};

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
    /// A device to draw on, by number; the one before is gone.
    Device(u64, wgpu::Device, wgpu::Queue),
    /// The picture that was under way was handed over, or dropped.
    Handed,
}

/// A picture that waits to be submitted.
struct Drawing {
    device: u64,
    commands: Vec<wgpu::CommandBuffer>,
    is_thumbnail: bool,
    texture: Arc<wgpu::Texture>,
}

/// The loop's side.
pub(super) struct Dashboard {
    /// `None`: the runtime gives none.
    tab: Option<DashboardTab>,
    to_work: SyncSender<Input>,
    drawings: Receiver<Drawing>,
    facts: Arc<Mutex<Facts>>,
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
        let (to_work, inputs) = sync_channel(MOST_INPUTS);
        let (to_loop, drawings) = sync_channel(1);
        let facts = Arc::new(Mutex::default());
        let work = PanelWork::new(inputs, to_loop, Arc::clone(&facts));
        let dashboard = Self {
            tab,
            to_work,
            drawings,
            facts,
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

    /// Whether it is looked at.
    pub fn is_open(&self) -> bool {
        self.is_open
    }

    /// A frame's work.
    ///
    /// # Errors
    /// The device fails, or is lost.
    pub fn turn(&mut self, now_ns: i64, graphics: Option<&Graphics>, facts: &Facts) -> Result<(), RenderError> {
        if self.tab.is_none() {
            return Ok(());
        }
        self.take_events();
        self.look(now_ns);
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
        if let (Some(tab), Some(texture)) = (&self.tab, graphics.device.handover(&drawing.texture)) {
            let handed = if drawing.is_thumbnail { tab.set_thumbnail(&texture) } else { tab.set_picture(&texture) };
            if let Err(error) = handed
                && !self.is_refused
            {
                log::warn!("the panel in the dashboard: {error}");
                self.is_refused = true;
            }
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
        self.shown.clear();
    }

    /// Destroys the tab and ends the thread. Pictures come back: the runtime may still copy them until the session is over.
    pub fn end(self) -> Vec<Arc<wgpu::Texture>> {
        self.shown.into_iter().chain(self.under_way.map(|(drawing, _)| drawing.texture)).collect()
    }
}

//! Pictures on their way from the worker to the runtime: one is in flight at a time, and those that
//! were shown live on while the runtime may copy them.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender};

use super::WorkerInput;
use crate::app::headset::graphics::Graphics;
use crate::panel::Notice;

/// Pictures kept alive after they were replaced, because the runtime copies them on our queue.
/// Choice: as many as the worker rotates, so none is overwritten while it may be copied.
const RETAINED_PICTURES: usize = 3;

/// Content of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Picture {
    Panel,
    Thumbnail,
    Notice(Notice),
}

/// A picture that is ready to be submitted.
pub(super) struct PreparedPicture {
    pub device: u64,
    pub commands: Vec<wgpu::CommandBuffer>,
    pub picture: Picture,
    pub texture: Arc<wgpu::Texture>,
}

/// The pictures of one device.
pub(super) struct Pictures {
    drawings: Receiver<PreparedPicture>,
    /// The device's number, and whether the worker has it.
    device: u64,
    has_device: bool,
    under_way: Option<(PreparedPicture, Arc<AtomicBool>)>,
    shown: VecDeque<Arc<wgpu::Texture>>,
}

impl Pictures {
    /// `drawings`: the worker's.
    pub fn new(drawings: Receiver<PreparedPicture>) -> Self {
        Self { drawings, device: 0, has_device: false, under_way: None, shown: VecDeque::new() }
    }

    /// Whether a picture is in flight.
    pub fn is_under_way(&self) -> bool {
        self.under_way.is_some()
    }

    /// Gives the worker the device if it has none, and submits a prepared picture when none is in
    /// flight.
    pub fn submit(&mut self, graphics: &Graphics, to_worker: &SyncSender<WorkerInput>) {
        if !self.has_device {
            let (device, queue) = (graphics.device.device.clone(), graphics.device.queue.clone());
            self.has_device = to_worker.try_send(WorkerInput::Device(self.device, device, queue)).is_ok();
        }
        if self.under_way.is_some() {
            return;
        }
        let Ok(mut drawing) = self.drawings.try_recv() else { return };
        if drawing.device != self.device {
            return drop(to_worker.try_send(WorkerInput::PictureDone));
        }
        let queue = &graphics.device.queue;
        queue.submit(drawing.commands.drain(..));
        let is_done = Arc::new(AtomicBool::new(false));
        let tell = Arc::clone(&is_done);
        queue.on_submitted_work_done(move || tell.store(true, Ordering::Release));
        self.under_way = Some((drawing, is_done));
    }

    /// The picture in flight, once the graphics card has finished it.
    pub fn take_finished(&mut self) -> Option<(Picture, Arc<wgpu::Texture>)> {
        let (drawing, _) = self.under_way.take_if(|(_, is_done)| is_done.load(Ordering::Acquire))?;
        Some((drawing.picture, drawing.texture))
    }

    /// Keeps a shown picture alive.
    pub fn retain(&mut self, texture: Arc<wgpu::Texture>) {
        self.shown.push_back(texture);
        if self.shown.len() > RETAINED_PICTURES {
            self.shown.pop_front();
        }
    }

    /// Drops all pictures after the device was lost; another device has the next number.
    pub fn drop_all(&mut self) {
        self.device += 1;
        self.has_device = false;
        self.under_way = None;
        self.shown.clear();
    }

    /// All pictures that the runtime may still copy.
    pub fn end(self) -> Vec<Arc<wgpu::Texture>> {
        self.shown.into_iter().chain(self.under_way.map(|(drawing, _)| drawing.texture)).collect()
    }
}

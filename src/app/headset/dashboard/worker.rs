//! The panel's worker thread: lays the panel out, handles the pointer, and prepares pictures up to
//! the submission. The submission belongs to the frame loop: runtime and program share the queue,
//! and only one thread may use it.
//!
//! A picture is prepared when the pointer did something or the content has changed, at most 30
//! times a second, and not before the one in flight was shown. While the tab is hidden the thread
//! sleeps, except for notices, which it draws as well.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use egui::{Event, Modifiers, PointerButton, RawInput, Rect, pos2, vec2};

use super::facts::{Facts, Rates, view};
use super::{Picture, PreparedPicture, WorkerInput};
use crate::app::{SensorSupervisor, SettingChange, SettingsStore, now_ns};
use crate::openvr::TabEvent;
use crate::panel;
use crate::panel::{Notice, PanelActions, PanelView};
use crate::settings::Settings;

/// Least interval of pictures, nanoseconds: 30 a second. Choice: a slider follows the hand; more
/// would take graphics time from the game.
const MIN_PICTURE_INTERVAL_NS: i64 = 33_000_000;
/// Least interval of pictures without user input, nanoseconds. Choice: numbers that change ten
/// times a second are already faster than one reads.
const IDLE_PICTURE_INTERVAL_NS: i64 = 100_000_000;
/// Polling interval while the tab is shown, and while it is hidden. Choice: half a picture's
/// interval; hidden, nothing is due and a message ends the wait at once.
const POLL_INTERVAL: Duration = Duration::from_millis(15);
const IDLE_POLL_INTERVAL: Duration = Duration::from_secs(60);
/// Bound of pointer events that wait for the next picture. Choice: about a second of a pointer at
/// full rate; later ones are dropped while no picture can be drawn.
const MAX_EVENTS: usize = 256;
/// Size of the dashboard button's picture, pixels. Choice: more than a dashboard button covers in a
/// headset, so it is never scaled up.
const THUMBNAIL_PX: u32 = 256;
/// Textures in rotation: the runtime may still copy the last one, on the same queue. Choice: one
/// shown, one being copied, one being drawn.
const TARGETS: usize = 3;
/// The format that the runtime accepts, with egui's own blending.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// Sources of the panel's content and target of its changes.
pub(in super::super) struct PanelSources<'a> {
    pub store: &'a SettingsStore,
    pub supervisor: &'a SensorSupervisor,
}

/// State of the worker.
pub(in super::super) struct PanelWorker {
    inputs: Receiver<WorkerInput>,
    to_loop: SyncSender<PreparedPicture>,
    facts: Arc<Mutex<Facts>>,
    /// Tells the loop that the user requested a map reset.
    forget_room: Arc<AtomicBool>,
    context: egui::Context,
    painter: Option<Painter>,
    is_open: bool,
    /// A picture is in flight.
    is_busy: bool,
    has_thumbnail: bool,
    /// A notice to draw.
    notice: Option<Notice>,
    events: Vec<Event>,
    drawn: Option<(i64, PanelView)>,
    repaint_requested: bool,
    rates: Rates,
    settings: Option<(Arc<Settings>, toml::Table)>,
}

impl PanelWorker {
    pub(super) fn new(
        inputs: Receiver<WorkerInput>,
        to_loop: SyncSender<PreparedPicture>,
        facts: Arc<Mutex<Facts>>,
        forget_room: Arc<AtomicBool>,
    ) -> Self {
        Self {
            inputs,
            to_loop,
            facts,
            forget_room,
            context: egui::Context::default(),
            painter: None,
            is_open: false,
            is_busy: false,
            has_thumbnail: false,
            notice: None,
            events: Vec::new(),
            drawn: None,
            repaint_requested: false,
            rates: Rates::default(),
            settings: None,
        }
    }

    /// Runs until the loop has ended.
    pub fn run(mut self, sources: &PanelSources) {
        loop {
            match self.inputs.recv_timeout(if self.is_open { POLL_INTERVAL } else { IDLE_POLL_INTERVAL }) {
                Ok(input) => self.take(input),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            while let Ok(input) = self.inputs.try_recv() {
                self.take(input);
            }
            if self.is_busy || self.painter.is_none() {
                continue;
            }
            // Preparing a picture on a device that was just lost may panic; another device follows.
            let worked = catch_unwind(AssertUnwindSafe(|| self.draw_due(sources)));
            if worked.is_err() {
                self.painter = None;
            }
        }
    }

    fn take(&mut self, input: WorkerInput) {
        match input {
            WorkerInput::Open(is_open) => {
                self.is_open = is_open;
                self.drawn = None;
                self.events.clear();
                self.events.push(Event::PointerGone);
            }
            WorkerInput::Pointer(event) if self.is_open && self.events.len() < MAX_EVENTS => {
                self.push_pointer_event(event)
            }
            WorkerInput::Pointer(_) => {}
            WorkerInput::Device(number, device, queue) => {
                // Glyphs and shapes were on the previous device.
                self.context = egui::Context::default();
                let painter = catch_unwind(AssertUnwindSafe(|| Painter::new(number, device, queue)));
                self.painter = painter.ok();
                (self.is_busy, self.has_thumbnail, self.drawn) = (false, false, None);
            }
            WorkerInput::Notice(notice) => self.notice = Some(notice),
            WorkerInput::PictureDone => self.is_busy = false,
        }
    }

    fn push_pointer_event(&mut self, event: TabEvent) {
        let mut button = |[x, y]: [f32; 2], pressed| {
            let pos = pos2(x, y);
            self.events.push(Event::PointerMoved(pos));
            let button = PointerButton::Primary;
            self.events.push(Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE });
        };
        match event {
            TabEvent::Moved([x, y]) => self.events.push(Event::PointerMoved(pos2(x, y))),
            TabEvent::Pressed(at) => button(at, true),
            TabEvent::Released(at) => button(at, false),
            TabEvent::Left => self.events.push(Event::PointerGone),
            TabEvent::Visibility | TabEvent::Other => {}
        }
    }

    /// Draws what is due: a notice, the button once, the panel when something has changed.
    fn draw_due(&mut self, sources: &PanelSources) {
        if let Some(notice) = self.notice {
            self.draw_notice(notice);
            self.notice = self.notice.filter(|_| !self.is_busy);
            return;
        }
        if !self.has_thumbnail {
            self.draw_thumbnail();
            self.has_thumbnail = self.is_busy;
            return;
        }
        let now_ns = now_ns();
        let age_ns = self.drawn.as_ref().map_or(i64::MAX, |(time_ns, _)| now_ns.saturating_sub(*time_ns));
        if !self.is_open || age_ns < MIN_PICTURE_INTERVAL_NS {
            return;
        }
        let is_touched = !self.events.is_empty() || self.repaint_requested;
        if !is_touched && age_ns < IDLE_PICTURE_INTERVAL_NS {
            return;
        }
        let view = self.view(now_ns, sources);
        if is_touched || self.drawn.as_ref().is_none_or(|(_, before)| *before != view) {
            self.draw_panel(now_ns, view, sources);
        }
    }

    fn view(&mut self, now_ns: i64, sources: &PanelSources) -> PanelView {
        let newest = sources.store.newest();
        let settings = match self.settings.take().filter(|(known, _)| Arc::ptr_eq(known, &newest)) {
            Some(settings) => settings,
            // Every field is a number, a string, a list or a table of these, so the conversion to
            // TOML cannot fail.
            None => (Arc::clone(&newest), toml::Table::try_from(&*newest).unwrap_or_default()),
        };
        let facts = self.facts.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let reconstruction = sources.supervisor.reconstruction();
        let troubles = [sources.store.trouble(), sources.supervisor.sensor_trouble()];
        let view = view(now_ns, &facts, &settings, troubles, reconstruction, &mut self.rates);
        self.settings = Some(settings);
        view
    }

    fn draw_panel(&mut self, now_ns: i64, view: PanelView, sources: &PanelSources) {
        // One press per pass: the next one sees what this one changed.
        let is_release = |event: &Event| matches!(event, Event::PointerButton { pressed: false, .. });
        let until = self.events.iter().position(is_release).map_or(self.events.len(), |at| at + 1);
        let events = self.events.drain(..until).collect();
        let mut wishes = PanelActions::default();
        let output = self.context.run_ui(input(panel::SIZE, now_ns, events), |ui| {
            let PanelActions { changes, forget_room, forget_calibration } = panel::panel(ui, &view);
            wishes.changes.extend(changes);
            wishes.forget_room |= forget_room;
            wishes.forget_calibration |= forget_calibration;
        });
        if wishes.forget_room {
            self.forget_room.store(true, Ordering::Relaxed);
        }
        if let Some(reconstruction) = sources.supervisor.reconstruction().filter(|_| wishes.forget_calibration) {
            reconstruction.forget_calibration();
        }
        for panel::SettingChange { name, value } in wishes.changes {
            log::debug!("the panel: {name} = {value}");
            self.show_pending_change(name, &value);
            sources.store.change(SettingChange { name: name.to_owned(), value });
        }
        self.repaint_requested =
            output.viewport_output.values().any(|viewport| viewport.repaint_delay < Duration::from_millis(100));
        self.drawn = Some((now_ns, view));
        self.send(output, panel::SIZE, Picture::Panel);
    }

    /// Shows a change before it applies; then the value in use replaces it.
    fn show_pending_change(&mut self, name: &str, value: &toml::Value) {
        let table = self
            .settings
            .as_mut()
            .zip(name.split_once('.'))
            .and_then(|((_, settings), (table, key))| Some((settings.get_mut(table)?.as_table_mut()?, key)));
        if let Some((table, key)) = table {
            table.insert(key.to_owned(), value.clone());
        }
    }

    fn draw_thumbnail(&mut self) {
        let size = [THUMBNAIL_PX; 2];
        let input = input(size, now_ns(), Vec::new());
        let output = self.context.run_ui(input, |ui| panel::icon(ui, THUMBNAIL_PX as f32));
        self.send(output, size, Picture::Thumbnail);
    }

    fn draw_notice(&mut self, notice: Notice) {
        let input = input(panel::NOTICE_SIZE, now_ns(), Vec::new());
        let output = self.context.run_ui(input, |ui| panel::notice(ui, notice));
        self.send(output, panel::NOTICE_SIZE, Picture::Notice(notice));
    }

    fn send(&mut self, output: egui::FullOutput, size: [u32; 2], picture: Picture) {
        let Some(painter) = &mut self.painter else { return output.drop_without_applying_deltas() };
        let drawing = painter.prepare(&self.context, output, size, picture);
        self.is_busy = self.to_loop.try_send(drawing).is_ok();
    }
}

fn input(size: [u32; 2], now_ns: i64, events: Vec<Event>) -> RawInput {
    let [width, height] = size.map(|px| px as f32);
    RawInput {
        screen_rect: Some(Rect::from_min_size(pos2(0.0, 0.0), vec2(width, height))),
        time: Some(now_ns as f64 * 1e-9),
        events,
        ..RawInput::default()
    }
}

/// Draws egui's shapes with a device.
struct Painter {
    number: u64,
    device: wgpu::Device,
    queue: wgpu::Queue,
    renderer: egui_wgpu::Renderer,
    targets: Vec<Arc<wgpu::Texture>>,
    next: usize,
}

impl Painter {
    fn new(number: u64, device: wgpu::Device, queue: wgpu::Queue) -> Self {
        let options = egui_wgpu::RendererOptions { dithering: false, ..Default::default() };
        let renderer = egui_wgpu::Renderer::new(&device, FORMAT, options);
        Self { number, device, queue, renderer, targets: Vec::new(), next: 0 }
    }

    fn target(&self, [width, height]: [u32; 2]) -> Arc<wgpu::Texture> {
        Arc::new(self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("panel"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        }))
    }

    fn next_target(&mut self, size: [u32; 2], picture: Picture) -> Arc<wgpu::Texture> {
        if picture != Picture::Panel {
            return self.target(size);
        }
        self.next = (self.next + 1) % TARGETS;
        while self.targets.len() <= self.next {
            self.targets.push(self.target(size));
        }
        Arc::clone(&self.targets[self.next])
    }

    /// Everything but the submission.
    fn prepare(
        &mut self,
        context: &egui::Context,
        mut output: egui::FullOutput,
        size: [u32; 2],
        picture: Picture,
    ) -> PreparedPicture {
        let texture = self.next_target(size, picture);
        let screen = egui_wgpu::ScreenDescriptor { size_in_pixels: size, pixels_per_point: output.pixels_per_point };
        let shapes = context.tessellate(std::mem::take(&mut output.shapes), output.pixels_per_point);
        for (id, deltas) in &output.textures_delta.set {
            for delta in deltas {
                self.renderer.update_texture(&self.device, &self.queue, *id, delta);
            }
        }
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let mut commands = self.renderer.update_buffers(&self.device, &self.queue, &mut encoder, &shapes, &screen);
        let view = texture.create_view(&Default::default());
        let attachment = wgpu::RenderPassColorAttachment {
            view: &view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT), store: wgpu::StoreOp::Store },
        };
        let described = wgpu::RenderPassDescriptor {
            label: Some("panel"),
            color_attachments: &[Some(attachment)],
            ..Default::default()
        };
        let mut pass = encoder.begin_render_pass(&described).forget_lifetime();
        self.renderer.render(&mut pass, &shapes, &screen);
        drop(pass);
        let ready = wgpu::wgt::TextureTransition {
            texture: &*texture,
            selector: None,
            state: wgpu::wgt::TextureUses::COPY_SRC,
        };
        encoder.transition_resources(std::iter::empty(), std::iter::once(ready));
        commands.push(encoder.finish());
        for id in &output.textures_delta.free {
            self.renderer.free_texture(id);
        }
        output.drop_without_applying_deltas();
        PreparedPicture { device: self.number, commands, picture, texture }
    }
}

#[cfg(test)]
mod tests {
    use image::RgbaImage;

    use super::*;
    use crate::render::Renderer;

    const ICON: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/overlay_assets/icon.png");
    /// Drivers round differently, and the file has straight alpha.
    const TOLERANCE: u8 = 4;

    /// When set, the test writes the file instead of comparing it.
    const UPDATE: &str = "ICON_UPDATE";

    /// The button's picture as the worker draws it.
    fn drawn_icon() -> RgbaImage {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = wgpu::Backends::VULKAN;
        let instance = wgpu::Instance::new(descriptor);
        let adapter = pollster::block_on(instance.request_adapter(&Default::default()))
            .expect("a graphics adapter; ./setup.sh installs a software renderer");
        let required_limits = crate::render::needed_limits(&adapter.limits());
        let described = wgpu::DeviceDescriptor { required_limits, ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&described)).unwrap();
        let reader = Renderer::from_device(device.clone(), queue.clone(), "icon").unwrap();
        let (_to_worker, inputs) = std::sync::mpsc::sync_channel(1);
        let (to_loop, drawings) = std::sync::mpsc::sync_channel(1);
        let mut worker = PanelWorker::new(inputs, to_loop, Arc::default(), Arc::default());
        worker.take(WorkerInput::Device(1, device, queue.clone()));
        worker.draw_thumbnail();
        let picture = drawings.try_recv().unwrap();
        queue.submit(picture.commands);
        reader.picture_of_texture(&picture.texture).unwrap()
    }

    fn premultiplied([r, g, b, a]: [u8; 4]) -> [u8; 4] {
        let times = |v: u8| ((u16::from(v) * u16::from(a) + 127) / 255) as u8;
        [times(r), times(g), times(b), a]
    }

    fn straight([r, g, b, a]: [u8; 4]) -> [u8; 4] {
        let over = |v: u8| ((u16::from(v) * 255 + u16::from(a) / 2) / u16::from(a.max(1))).min(255) as u8;
        [over(r), over(g), over(b), a]
    }

    #[test]
    fn icon_file_shows_what_the_button_shows() {
        let drawn = drawn_icon();
        if std::env::var_os(UPDATE).is_some() {
            let mut file = drawn.clone();
            file.pixels_mut().for_each(|pixel| pixel.0 = straight(pixel.0));
            file.save(ICON).unwrap();
        }
        let file = image::open(ICON).unwrap().to_rgba8();
        assert_eq!(file.dimensions(), drawn.dimensions());
        for ((x, y, filed), drawn) in file.enumerate_pixels().zip(drawn.pixels()) {
            let filed = premultiplied(filed.0);
            let is_near = filed.iter().zip(drawn.0).all(|(a, b)| a.abs_diff(b) <= TOLERANCE);
            assert!(is_near, "({x}, {y}): {filed:?} in the file, {drawn:?} drawn");
        }
    }
}

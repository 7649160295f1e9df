//! The desktop window: redraws whenever something changed, and only then.

use std::sync::Arc;
use std::time::{Duration, Instant};

use winit::application::ApplicationHandler;
use winit::dpi::LogicalSize;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::window::{Window, WindowId};

use super::app::App;
use super::error::ViewError;
use super::screen::{Screen, adapter};
use crate::render::RenderError;

/// Shows the app in a window until it is closed.
///
/// # Errors
/// There is no desktop, no window or no surface, or the device failed.
pub fn show(app: &mut App, title: &str) -> Result<(), ViewError> {
    let event_loop = EventLoop::new().map_err(|error| ViewError::NoDesktop(strip_source_location(&error)))?;
    let mut desktop = Desktop { app, title: title.to_owned(), open: None, failure: None, next: None };
    event_loop.run_app(&mut desktop).map_err(|error| ViewError::NoDesktop(strip_source_location(&error)))?;
    desktop.failure.map_or(Ok(()), Err)
}

/// Text of an error of the desktop, without the source location with which it begins.
fn strip_source_location(error: &winit::error::EventLoopError) -> String {
    let text = error.to_string();
    let message = text
        .rsplit_once(".rs:")
        .and_then(|(_, message)| message.split_once(": "))
        .map(|(_, message)| message.to_owned());
    message.unwrap_or(text).trim_end_matches('.').to_owned()
}

struct Desktop<'a> {
    app: &'a mut App,
    title: String,
    open: Option<OpenWindow>,
    failure: Option<ViewError>,
    /// Next redraw if nothing else happens.
    next: Option<Instant>,
}

/// The open window. Declared in drop order: the surface before its window.
struct OpenWindow {
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    screen: Screen,
    input: egui_winit::State,
    window: Arc<Window>,
}

impl OpenWindow {
    fn new(event_loop: &ActiveEventLoop, title: &str) -> Result<Self, ViewError> {
        let attributes =
            Window::default_attributes().with_title(title).with_inner_size(LogicalSize::new(1600.0, 1000.0));
        let window = event_loop.create_window(attributes).map_err(|error| ViewError::NoWindow(error.to_string()))?;
        let window = Arc::new(window);
        let display = Box::new(event_loop.owned_display_handle());
        let mut described = wgpu::InstanceDescriptor::new_with_display_handle(display);
        described.backends = wgpu::Backends::VULKAN;
        let instance = wgpu::Instance::new(described);
        let no_surface = |cause: String| ViewError::NoSurface(cause);
        let surface = instance.create_surface(Arc::clone(&window)).map_err(|error| no_surface(error.to_string()))?;
        let adapter = adapter(&instance, Some(&surface)).map_err(|_| {
            no_surface(
                "no graphics adapter offers Vulkan to this display: install a GPU driver, or mesa-vulkan-drivers"
                    .into(),
            )
        })?;
        let size = window.inner_size();
        let mut config = surface
            .get_default_config(&adapter, size.width.max(1), size.height.max(1))
            .ok_or_else(|| no_surface(format!("{} cannot show pictures on this display", adapter.get_info().name)))?;
        // egui's colours are already sRGB: use a format without conversion.
        let plain = [wgpu::TextureFormat::Bgra8Unorm, wgpu::TextureFormat::Rgba8Unorm];
        let offered = surface.get_capabilities(&adapter).formats;
        config.format = plain.into_iter().find(|format| offered.contains(format)).unwrap_or(config.format);
        config.present_mode = wgpu::PresentMode::Fifo;
        let screen = Screen::new(&adapter, config.format)?;
        surface.configure(&screen.device, &config);
        screen.check()?;
        let side = screen.device.limits().max_texture_dimension_2d as usize;
        let scale = Some(window.scale_factor() as f32);
        let context = screen.context.clone();
        let input = egui_winit::State::new(context, egui::ViewportId::ROOT, &window, scale, None, Some(side));
        Ok(Self { surface, config, screen, input, window })
    }

    fn resize(&mut self, width: u32, height: u32) {
        let greatest = self.screen.device.limits().max_texture_dimension_2d;
        (self.config.width, self.config.height) = (width.clamp(1, greatest), height.clamp(1, greatest));
        self.surface.configure(&self.screen.device, &self.config);
    }

    /// Draws. Returns the time until the next redraw. `None`: at once, because the surface was
    /// recreated or was not ready.
    fn draw(&mut self, app: &mut App) -> Result<Option<Duration>, ViewError> {
        use wgpu::CurrentSurfaceTexture as Current;
        let frame = match self.surface.get_current_texture() {
            Current::Success(frame) | Current::Suboptimal(frame) => frame,
            Current::Occluded => return Ok(Some(Duration::from_millis(200))),
            Current::Timeout => return Ok(None),
            Current::Outdated | Current::Lost => {
                self.surface.configure(&self.screen.device, &self.config);
                self.screen.check()?;
                return Ok(None);
            }
            Current::Validation => {
                self.screen.check()?;
                return Err(ViewError::Render(RenderError::Device("the window has no drawable image".into())));
            }
        };
        let target = frame.texture.create_view(&Default::default());
        let input = self.input.take_egui_input(&self.window);
        let passed = self.screen.pass(app, input, &target, [self.config.width, self.config.height])?;
        self.input.handle_platform_output(&self.window, passed.platform);
        self.window.pre_present_notify();
        self.screen.queue.present(frame);
        Ok(Some(passed.again_after))
    }
}

impl Desktop<'_> {
    fn fail(&mut self, event_loop: &ActiveEventLoop, error: ViewError) {
        self.failure = Some(error);
        event_loop.exit();
    }

    fn draw(&mut self, event_loop: &ActiveEventLoop) {
        if self.app.is_over() {
            return event_loop.exit();
        }
        let Some(open) = &mut self.open else { return };
        match open.draw(self.app) {
            Ok(None) => self.next = Some(Instant::now() + Duration::from_millis(10)),
            Ok(Some(Duration::ZERO)) => {
                self.next = None;
                open.window.request_redraw();
            }
            Ok(Some(after)) => self.next = Instant::now().checked_add(after),
            Err(error) => self.fail(event_loop, error),
        }
    }
}

impl ApplicationHandler for Desktop<'_> {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.open.is_some() {
            return;
        }
        match OpenWindow::new(event_loop, &self.title) {
            Ok(open) => {
                self.app.set_texture(open.screen.texture());
                open.window.request_redraw();
                self.open = Some(open);
            }
            Err(error) => self.fail(event_loop, error),
        }
    }

    fn new_events(&mut self, _: &ActiveEventLoop, cause: StartCause) {
        if matches!(cause, StartCause::ResumeTimeReached { .. })
            && let Some(open) = &self.open
        {
            self.next = None;
            open.window.request_redraw();
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(open) = &mut self.open else { return };
        match &event {
            WindowEvent::RedrawRequested => return self.draw(event_loop),
            WindowEvent::CloseRequested => return event_loop.exit(),
            WindowEvent::Resized(size) => open.resize(size.width, size.height),
            _ => {}
        }
        if open.input.on_window_event(&open.window, &event).repaint {
            open.window.request_redraw();
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        event_loop.set_control_flow(self.next.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
    }
}

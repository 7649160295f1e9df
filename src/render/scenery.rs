//! Warnings in space: panels, footprints and the obstacles' shapes as an eye sees them, on a transparent ground. For displays that
//! show each eye a picture of its own.
//!
//! Two ways. A *window* is a quad standing at an obstacle: its texture holds side by side what the left and the right eye see
//! through it of that obstacle (perspective through the quad's corners). What lies in the window's plane stays
//! where it is when the head moves after the picture was drawn, and what lies behind moves by as much less. A *picture of an
//! eye* is all that it sees within its tangents, for a projection overlay.
//!
//! Colour is multiplied by alpha, and brightness by distance is already in it: an overlay shows it with alpha 1. Each window
//! and eye has three textures that take turns, so that a runtime may still copy the last ones.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::error::RenderError;
use super::eye::EyeView;
use super::gpu::{FORMAT, Gpu};
use super::painter::{linear, ready_to_copy};
use super::quads::{Quad, QuadKind};
use super::viewer::{Ball, Sight, Viewer, begin};
use crate::geometry::Pose;
use crate::warning::Shape;

/// Textures that take turns.
const TURNS: usize = 3;
/// A window's textures are dropped after so many drawings of others: some seconds.
const KEPT_FOR: u64 = 2000;
/// An eye nearer to a window's plane than this does not see through it, metres.
const NEAREST_EYE_M: f64 = 0.05;
/// Room around what a window shows, metres.
const MARGIN_M: f64 = 0.1;
/// How much of the light behind it a ball takes away, at full brightness.
const BALL_ALPHA: f32 = 0.55;
/// Balls this much farther than the nearest have half their brightness, metres.
const HALF_LIGHT_M: f64 = 1.0;

/// What is to be seen in space.
#[derive(Debug, Clone, Copy)]
pub struct Scenery<'a> {
    /// Panels and footprints, as [`super::Renderer::quads`] gives them.
    pub quads: &'a [Quad],
    /// Shapes of the obstacles, as [`crate::warning::Watch::shapes`] gives them.
    pub shapes: &'a [Shape],
    /// Colour of the shapes: sRGB red, green, blue.
    pub color: [u8; 3],
}

/// A quad in the room that shows what is behind it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// Kind and id of the panel that it belongs to: see [`Quad::key`].
    pub key: (QuadKind, u64),
    /// Middle; +x to the right, +y up, +z towards who looks through it.
    pub tracking_from_window: Pose,
    /// Width and height, metres.
    pub size_m: DVec2,
}

impl Window {
    /// The window for each panel: in the panel's plane, with room around it.
    pub fn of_panels(quads: &[Quad]) -> Vec<Self> {
        let panels = quads.iter().filter(|quad| !quad.on_floor && quad.alpha > 0.0);
        panels
            .map(|quad| Self {
                key: quad.key(),
                tracking_from_window: quad.tracking_from_quad,
                size_m: quad.size_m + 2.0 * MARGIN_M,
            })
            .collect()
    }

    /// What an eye sees through it, as a view whose picture is the window; `None` for an eye behind it or in its plane.
    pub fn view(&self, eye_m: DVec3, size_px: [u32; 2]) -> Option<EyeView> {
        let eye = self.tracking_from_window.inverse().transform_point(eye_m);
        let half = self.size_m / 2.0;
        let tangents = [-half.x - eye.x, half.x - eye.x, -half.y - eye.y, half.y - eye.y].map(|edge| edge / eye.z);
        let tracking_from_eye = Pose::new(eye_m, self.tracking_from_window.rotation);
        (eye.z > NEAREST_EYE_M).then_some(EyeView { tracking_from_eye, tangents, size_px })
    }

    /// The parts that belong to it: its panel and, of an object, its footprint and shape.
    fn shows(&self, quad: &Quad) -> bool {
        let (kind, id) = self.key;
        quad.key() == self.key || (kind == QuadKind::Object && quad.key() == (QuadKind::Footprint, id))
    }

    fn shows_shape(&self, shape: &Shape) -> bool {
        self.key == (QuadKind::Object, shape.id)
    }
}

/// Which textures take turns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Screen {
    Window(QuadKind, u64),
    Eye(usize),
}

#[derive(Default)]
struct Turns {
    textures: [Option<Arc<wgpu::Texture>>; TURNS],
    next: usize,
    last_used: u64,
}

/// The textures of all windows and eyes.
#[derive(Default)]
pub(super) struct Screens {
    screens: BTreeMap<Screen, Turns>,
    uses: u64,
}

impl Screens {
    /// Both eyes' halves of a window, each of `half_px`.
    pub fn window(
        &mut self,
        gpu: &Gpu,
        viewer: &Viewer,
        scenery: &Scenery,
        window: &Window,
        eyes_m: [DVec3; 2],
        half_px: [u32; 2],
    ) -> Result<Arc<wgpu::Texture>, RenderError> {
        let size_px = [half_px[0].saturating_mul(2), half_px[1]];
        gpu.check_size(half_px)?;
        gpu.check_size(size_px)?;
        let quads: Vec<&Quad> = scenery.quads.iter().filter(|quad| window.shows(quad)).collect();
        let shapes = scenery.shapes.iter().filter(|shape| window.shows_shape(shape));
        let balls = balls(shapes, (eyes_m[0] + eyes_m[1]) / 2.0, scenery.color);
        let mut sights = Vec::new();
        for (view, left_px) in eyes_m.map(|eye_m| window.view(eye_m, half_px)).into_iter().zip([0, half_px[0]]) {
            if let Some(view) = view.filter(|view| view.check().is_ok()) {
                sights.push((viewer.sight(gpu, &view, &[], &balls, &quads), left_px));
            }
        }
        let (kind, id) = window.key;
        let texture = self.turn(gpu, Screen::Window(kind, id), size_px);
        draw(gpu, viewer, &texture, &sights, half_px);
        Ok(texture)
    }

    /// What one eye sees; `side`: 0 left, 1 right.
    pub fn eye(
        &mut self,
        gpu: &Gpu,
        viewer: &Viewer,
        scenery: &Scenery,
        side: usize,
        view: &EyeView,
    ) -> Result<Arc<wgpu::Texture>, RenderError> {
        view.check()?;
        gpu.check_size(view.size_px)?;
        let balls = balls(scenery.shapes.iter(), view.tracking_from_eye.translation, scenery.color);
        let quads: Vec<&Quad> = scenery.quads.iter().collect();
        let sight = viewer.sight(gpu, view, &[], &balls, &quads);
        let texture = self.turn(gpu, Screen::Eye(side.min(1)), view.size_px);
        draw(gpu, viewer, &texture, &[(sight, 0)], view.size_px);
        Ok(texture)
    }

    /// The texture whose turn it is; a new one when its size is another. It was handed out three drawings ago.
    fn turn(&mut self, gpu: &Gpu, screen: Screen, size_px: [u32; 2]) -> Arc<wgpu::Texture> {
        self.uses += 1;
        let uses = self.uses;
        self.screens.retain(|_, turns| turns.last_used + KEPT_FOR >= uses);
        let turns = self.screens.entry(screen).or_default();
        turns.last_used = uses;
        turns.next = (turns.next + 1) % TURNS;
        let slot = &mut turns.textures[turns.next];
        match slot {
            Some(texture) if [texture.width(), texture.height()] == size_px => Arc::clone(texture),
            _ => Arc::clone(slot.insert(Arc::new(gpu.target(size_px, FORMAT, 1)))),
        }
    }
}

/// Draws what each eye sees into its part of a texture, `(sight, left edge)`, and leaves it ready to be copied.
fn draw(gpu: &Gpu, viewer: &Viewer, texture: &wgpu::Texture, sights: &[(Sight, u32)], part_px: [u32; 2]) {
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    {
        let mut pass = begin(gpu, &mut encoder, texture);
        for (sight, left_px) in sights {
            let [x, width, height] = [*left_px, part_px[0], part_px[1]].map(|v| v as f32);
            pass.set_viewport(x, 0.0, width, height, 0.0, 1.0);
            pass.set_scissor_rect(*left_px, 0, part_px[0], part_px[1]);
            viewer.draw_things(&mut pass, sight);
        }
    }
    ready_to_copy(&mut encoder, [texture].into_iter());
    gpu.queue.submit([encoder.finish()]);
}

/// The balls of shapes, in falling light from the nearest to the farthest.
fn balls<'s>(shapes: impl Iterator<Item = &'s Shape>, eye_m: DVec3, color: [u8; 3]) -> Vec<Ball> {
    let [red, green, blue, _] = linear(color);
    let mut balls = Vec::new();
    for shape in shapes.filter(|shape| shape.alpha > 0.0) {
        let nearest = shape.points_m.iter().map(|p| p.distance(eye_m)).fold(f64::INFINITY, f64::min);
        balls.extend(shape.points_m.iter().map(|&place_m| {
            let farther = place_m.distance(eye_m) - nearest;
            let light = shape.alpha * (-farther * std::f64::consts::LN_2 / HALF_LIGHT_M).exp() as f32;
            let alpha = BALL_ALPHA * light;
            Ball { place_m, radius_m: shape.radius_m, color: [red * alpha, green * alpha, blue * alpha, alpha] }
        }));
    }
    balls
}

//! Warnings in 3D: panels, footprints and obstacle shapes as one eye sees them, on a transparent
//! background. For displays with a separate image per eye.
//!
//! Two modes. A *window* is a quad at an obstacle. Its texture holds, side by side, what the left
//! and the right eye see of that obstacle through the quad (perspective through its corners).
//! Points in the window's plane stay in place when the head moves after drawing; points behind it
//! lag in proportion to their distance from the plane. An *eye image* covers the full field of view
//! of one eye, for a projection overlay.
//!
//! Alpha is premultiplied, and brightness by distance is already applied: show the overlay with
//! alpha 1. Each window and eye rotates through three textures, so that a VR runtime may still be
//! copying the previous ones.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::error::RenderError;
use super::eye::EyeView;
use super::eye_renderer::{Ball, Canvas, DrawList, EyeRenderer};
use super::gpu::{FORMAT, Gpu};
use super::painter::{linear, texture_size, transition_to_copy_source};
use super::quads::{Quad, QuadKind};
use crate::warning::Shape;
use radar_sar::geometry::Pose;

/// Textures per window or eye, used in turn. Choice: one shown, one being copied, one being drawn.
const TEXTURES_PER_TARGET: usize = 3;
/// Number of canvas sizes that are kept. Choice: the sizes of windows that are visible at once;
/// each is held for both eyes with depth and four samples.
const MAX_CANVASES: usize = 3;
/// Textures of a window are dropped after this many draws of other windows: some seconds. Choice:
/// some seconds, so that a wearer who turns back finds it.
const MAX_UNUSED_CALLS: u64 = 2000;
/// An eye closer to a window's plane than this does not see through it, metres. Choice: nearer, the
/// view's angles approach 90° and its projection fails.
const MIN_EYE_DISTANCE_M: f64 = 0.05;
/// Margin around the content of a window, metres. Choice: outlines and glow at the content's edge
/// are drawn completely.
const MARGIN_M: f64 = 0.05;
/// Window sides are multiples of this, metres, so that the texture size rarely changes. Choice: the
/// texture size changes rarely, which would cost the runtime a new swapchain.
const SIDE_STEP_M: f64 = 0.25;
/// Largest distance of a window's edge from the centre of its panel, metres. Choice: a room's
/// height and a large panel fit; more would lower the resolution.
const MAX_EDGE_DISTANCE_M: f64 = 2.5;
/// Share of the background light that a ball hides at full brightness. Choice: the shape is plain,
/// and the game stays visible through it.
const BALL_ALPHA: f32 = 0.55;
/// Balls this much farther away than the nearest one have half its brightness, metres. Choice:
/// depth is visible within one obstacle, and a whole room is not lit up.
const HALF_BRIGHTNESS_M: f64 = 1.0;

/// Content of a stereo image.
#[derive(Debug, Clone, Copy)]
pub struct StereoScene<'a> {
    /// Panels and footprints, from [`super::Renderer::quads`].
    pub quads: &'a [Quad],
    /// Obstacle shapes, from [`crate::warning::WarningTracker::shapes`].
    pub shapes: &'a [Shape],
    /// Colour of the shapes: sRGB red, green, blue.
    pub color: [u8; 3],
}

/// A quad in the room through which its obstacle is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// Kind and id of its panel: see [`Quad::key`].
    pub key: (QuadKind, u64),
    /// Pose of its centre: +x to the right, +y up, +z towards the viewer.
    pub tracking_from_window: Pose,
    /// Width and height, metres.
    pub size_m: DVec2,
}

impl Window {
    /// One window per panel: in the plane of the panel, and large enough to show the panel and the
    /// obstacle's shape from the midpoint of the eyes.
    pub fn of_panels(scenery: &StereoScene, eyes_m: [DVec3; 2]) -> Vec<Self> {
        let eye_m = (eyes_m[0] + eyes_m[1]) / 2.0;
        let panels = scenery.quads.iter().filter(|quad| !quad.on_floor && quad.alpha > 0.0);
        panels.map(|quad| Self::around(quad, scenery.shapes, eye_m)).collect()
    }

    fn around(panel: &Quad, shapes: &[Shape], eye_m: DVec3) -> Self {
        let panel_from_tracking = panel.tracking_from_quad.inverse();
        let eye = panel_from_tracking.transform_point(eye_m);
        let mut greatest = panel.size_m / 2.0;
        let mut least = -greatest;
        let own = shapes.iter().filter(|shape| panel.key() == (QuadKind::Object, shape.id));
        for (point_m, radius_m) in own.flat_map(|shape| shape.points_m.iter().map(|p| (*p, shape.radius_m))) {
            let to = panel_from_tracking.transform_point(point_m) - eye;
            // Intersection of the line of sight with the plane. Points beside or behind the eye are
            // not visible through it.
            let share = eye.z / -to.z;
            if eye.z > MIN_EYE_DISTANCE_M && to.z < -MIN_EYE_DISTANCE_M && share.is_finite() {
                let crossing = (eye + to * share).truncate();
                least = least.min(crossing - radius_m * share.max(1.0));
                greatest = greatest.max(crossing + radius_m * share.max(1.0));
            }
        }
        let outward = |edge: DVec2| {
            ((edge + MARGIN_M) / SIDE_STEP_M).ceil().min(DVec2::splat(MAX_EDGE_DISTANCE_M / SIDE_STEP_M)) * SIDE_STEP_M
        };
        let (greatest, least) = (outward(greatest), -outward(-least));
        let middle = ((greatest + least) / 2.0).extend(0.0);
        Self {
            key: panel.key(),
            tracking_from_window: panel.tracking_from_quad * Pose::from_translation(middle),
            size_m: greatest - least,
        }
    }

    /// Width and height of each half of its texture at the resolution of panels.
    pub fn half_px(&self) -> [u32; 2] {
        texture_size(self.size_m, None)
    }

    /// View whose image is exactly the window; `None` for an eye behind the window or in its plane.
    pub fn view(&self, eye_m: DVec3, size_px: [u32; 2]) -> Option<EyeView> {
        let eye = self.tracking_from_window.inverse().transform_point(eye_m);
        let half = self.size_m / 2.0;
        let tangents = [-half.x - eye.x, half.x - eye.x, -half.y - eye.y, half.y - eye.y].map(|edge| edge / eye.z);
        let tracking_from_eye = Pose::new(eye_m, self.tracking_from_window.rotation);
        (eye.z > MIN_EYE_DISTANCE_M).then_some(EyeView { tracking_from_eye, tangents, size_px })
    }

    /// Whether the quad belongs to this window: its panel and, for an object, its footprint.
    fn includes(&self, quad: &Quad) -> bool {
        let (kind, id) = self.key;
        quad.key() == self.key || (kind == QuadKind::Object && quad.key() == (QuadKind::Footprint, id))
    }

    fn includes_shape(&self, shape: &Shape) -> bool {
        self.key == (QuadKind::Object, shape.id)
    }
}

/// Identifies a set of textures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum TargetKey {
    Window(QuadKind, u64),
    Eye(usize),
}

#[derive(Default)]
struct TextureRing {
    textures: [Option<Arc<wgpu::Texture>>; TEXTURES_PER_TARGET],
    next: usize,
    last_used: u64,
}

/// Textures of all windows and eyes.
#[derive(Default)]
pub(super) struct RenderTargets {
    targets: BTreeMap<TargetKey, TextureRing>,
    draws: u64,
    /// Canvases by size; the most recently used is last.
    canvases: Vec<([u32; 2], Canvas)>,
}

impl RenderTargets {
    /// Textures with both eyes' halves of each window, and the size of one half in pixels. One
    /// submission.
    pub fn windows(
        &mut self,
        gpu: &Gpu,
        viewer: &EyeRenderer,
        scenery: &StereoScene,
        windows: &[(Window, [u32; 2])],
        eyes_m: [DVec3; 2],
    ) -> Result<Vec<Arc<wgpu::Texture>>, RenderError> {
        for (_, half_px) in windows {
            gpu.check_size(*half_px)?;
            gpu.check_size(side_by_side_size(*half_px))?;
        }
        if windows.is_empty() {
            return Ok(Vec::new());
        }
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut textures = Vec::new();
        for (window, half_px) in windows {
            let sights = eye_draw_lists(gpu, viewer, scenery, window, eyes_m, *half_px);
            let (kind, id) = window.key;
            let texture = self.next_texture(gpu, TargetKey::Window(kind, id), side_by_side_size(*half_px));
            draw(&mut encoder, viewer, self.canvas(gpu, side_by_side_size(*half_px)), &texture, &sights, *half_px);
            textures.push(texture);
        }
        transition_to_copy_source(&mut encoder, textures.iter().map(Arc::as_ref));
        gpu.queue.submit([encoder.finish()]);
        Ok(textures)
    }

    /// Image of one eye. `side`: 0 left, 1 right.
    pub fn eye(
        &mut self,
        gpu: &Gpu,
        viewer: &EyeRenderer,
        scenery: &StereoScene,
        side: usize,
        view: &EyeView,
    ) -> Result<Arc<wgpu::Texture>, RenderError> {
        view.check()?;
        gpu.check_size(view.size_px)?;
        let balls = balls(scenery.shapes.iter(), view.tracking_from_eye.translation, scenery.color);
        let quads: Vec<&Quad> = scenery.quads.iter().collect();
        let sight = viewer.draw_list(gpu, view, &[], &balls, &quads);
        let texture = self.next_texture(gpu, TargetKey::Eye(side.min(1)), view.size_px);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        draw(&mut encoder, viewer, self.canvas(gpu, view.size_px), &texture, &[(sight, 0)], view.size_px);
        transition_to_copy_source(&mut encoder, [texture.as_ref()].into_iter());
        gpu.queue.submit([encoder.finish()]);
        Ok(texture)
    }

    /// The canvas of this size. All images share it, because they are drawn one after the other.
    fn canvas(&mut self, gpu: &Gpu, size_px: [u32; 2]) -> &Canvas {
        match self.canvases.iter().position(|(size, _)| *size == size_px) {
            Some(at) => self.canvases[at..].rotate_left(1),
            None => {
                if self.canvases.len() >= MAX_CANVASES {
                    self.canvases.remove(0);
                }
                self.canvases.push((size_px, Canvas::new(gpu, size_px)));
            }
        }
        let last = self.canvases.len() - 1;
        &self.canvases[last].1
    }

    /// The next texture in turn; a new one if the size changed. It was last handed out three draws
    /// ago.
    fn next_texture(&mut self, gpu: &Gpu, screen: TargetKey, size_px: [u32; 2]) -> Arc<wgpu::Texture> {
        self.draws += 1;
        let uses = self.draws;
        self.targets.retain(|_, turns| turns.last_used + MAX_UNUSED_CALLS >= uses);
        let turns = self.targets.entry(screen).or_default();
        turns.last_used = uses;
        turns.next = (turns.next + 1) % TEXTURES_PER_TARGET;
        let slot = &mut turns.textures[turns.next];
        match slot {
            Some(texture) if [texture.width(), texture.height()] == size_px => Arc::clone(texture),
            _ => Arc::clone(slot.insert(Arc::new(gpu.target(size_px, FORMAT, 1)))),
        }
    }
}

/// Size of two halves side by side.
fn side_by_side_size([width, height]: [u32; 2]) -> [u32; 2] {
    [width.saturating_mul(2), height]
}

/// What each eye sees through a window, with the left edge of its half. Empty for an eye behind it.
fn eye_draw_lists(
    gpu: &Gpu,
    viewer: &EyeRenderer,
    scenery: &StereoScene,
    window: &Window,
    eyes_m: [DVec3; 2],
    half_px: [u32; 2],
) -> Vec<(DrawList, u32)> {
    let quads: Vec<&Quad> = scenery.quads.iter().filter(|quad| window.includes(quad)).collect();
    let shapes = scenery.shapes.iter().filter(|shape| window.includes_shape(shape));
    let balls = balls(shapes, (eyes_m[0] + eyes_m[1]) / 2.0, scenery.color);
    let views = eyes_m.map(|eye_m| window.view(eye_m, half_px).filter(|view| view.check().is_ok()));
    let halves = views.into_iter().zip([0, half_px[0]]).filter_map(|(view, left_px)| Some((view?, left_px)));
    halves.map(|(view, left_px)| (viewer.draw_list(gpu, &view, &[], &balls, &quads), left_px)).collect()
}

/// Draws each eye's part of a texture: `(draw list, left edge)`.
fn draw(
    encoder: &mut wgpu::CommandEncoder,
    viewer: &EyeRenderer,
    canvas: &Canvas,
    texture: &wgpu::Texture,
    sights: &[(DrawList, u32)],
    part_px: [u32; 2],
) {
    let mut pass = canvas.begin(encoder, texture);
    for (sight, left_px) in sights {
        let [x, width, height] = [*left_px, part_px[0], part_px[1]].map(|v| v as f32);
        pass.set_viewport(x, 0.0, width, height, 0.0, 1.0);
        pass.set_scissor_rect(*left_px, 0, part_px[0], part_px[1]);
        viewer.draw_objects(&mut pass, sight);
    }
}

/// Balls of the shapes. Brightness falls with distance beyond the nearest.
fn balls<'s>(shapes: impl Iterator<Item = &'s Shape>, eye_m: DVec3, color: [u8; 3]) -> Vec<Ball> {
    let [red, green, blue, _] = linear(color);
    let mut balls = Vec::new();
    for shape in shapes.filter(|shape| shape.alpha > 0.0) {
        let nearest = shape.points_m.iter().map(|p| p.distance(eye_m)).fold(f64::INFINITY, f64::min);
        balls.extend(shape.points_m.iter().map(|&position_m| {
            let farther = position_m.distance(eye_m) - nearest;
            let light = shape.alpha * (-farther * std::f64::consts::LN_2 / HALF_BRIGHTNESS_M).exp() as f32;
            let alpha = BALL_ALPHA * light;
            Ball { position_m, radius_m: shape.radius_m, color: [red * alpha, green * alpha, blue * alpha, alpha] }
        }));
    }
    balls
}

#[cfg(test)]
mod tests {
    use image::RgbaImage;

    use super::*;
    use crate::render::Renderer;
    use crate::render::renderer::tests::with_renderer;
    use crate::warning::{BodyPart, Panel, PanelKind, WarningSettings, Warnings};

    const HALF_PX: [u32; 2] = [400, 500];
    const EYES: [DVec3; 2] = [DVec3::new(-0.032, 1.6, 0.0), DVec3::new(0.032, 1.6, 0.0)];

    /// One metre wide, on the floor one metre ahead, slightly rotated.
    fn window() -> Window {
        let pose = Pose::new(DVec3::new(0.1, 0.7, -1.0), glam::DQuat::from_rotation_y(0.2));
        Window { key: (QuadKind::Object, 1), tracking_from_window: pose, size_m: DVec2::new(1.2, 1.5) }
    }

    fn ball(position_m: DVec3, alpha: f32) -> Shape {
        Shape { id: 1, points_m: [position_m].into(), radius_m: 0.03, alpha }
    }

    fn drawn(renderer: &mut Renderer, shapes: &[Shape], eyes: [DVec3; 2]) -> RgbaImage {
        let scenery = StereoScene { quads: &[], shapes, color: [64, 224, 255] };
        let texture = renderer.window(&scenery, &window(), eyes, HALF_PX).unwrap();
        renderer.picture_of_texture(&texture).unwrap()
    }

    /// Alpha-weighted centre of the lit pixels between two columns, pixels from the left of the
    /// texture.
    fn middle_of(picture: &RgbaImage, columns: std::ops::Range<u32>) -> Option<DVec2> {
        let (mut sum, mut weight) = (DVec2::ZERO, 0.0);
        for (x, y, pixel) in picture.enumerate_pixels().filter(|(x, ..)| columns.contains(x)) {
            let alpha = f64::from(pixel[3]);
            sum += DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) * alpha;
            weight += alpha;
        }
        (weight > 0.0).then(|| sum / weight)
    }

    /// Where the ray from an eye to a point crosses the window, in pixels of that eye's half.
    /// Computed by intersection, without matrices.
    fn crossing_px(eye: DVec3, point: DVec3) -> DVec2 {
        let window = window();
        let normal = window.tracking_from_window.rotation * DVec3::Z;
        let middle = window.tracking_from_window.translation;
        let along = (middle - eye).dot(normal) / (point - eye).dot(normal);
        let on_plane = eye + (point - eye) * along - middle;
        let right = window.tracking_from_window.rotation * DVec3::X;
        let share = DVec2::new(on_plane.dot(right) / window.size_m.x, -on_plane.y / window.size_m.y) + 0.5;
        share * DVec2::new(HALF_PX[0].into(), HALF_PX[1].into())
    }

    #[test]
    fn window_pixels_match_ray_intersections() {
        with_renderer(|renderer| {
            for point in [DVec3::new(0.0, 0.9, -1.3), DVec3::new(0.25, 0.5, -1.6), DVec3::new(0.2, 1.1, -1.1)] {
                let picture = drawn(renderer, &[ball(point, 1.0)], EYES);
                for (eye, left) in EYES.into_iter().zip([0, HALF_PX[0]]) {
                    let seen = middle_of(&picture, left..left + HALF_PX[0]).unwrap() - DVec2::new(left.into(), 0.0);
                    let wanted = crossing_px(eye, point);
                    assert!((seen - wanted).length() < 0.6, "{point}: {seen} for {wanted}");
                }
            }
        });
    }

    #[test]
    fn points_in_the_window_plane_do_not_shift_with_late_head_motion() {
        with_renderer(|renderer| {
            let at = |depth_m: f64| window().tracking_from_window.transform_point(DVec3::new(0.1, 0.2, -depth_m));
            let moved = EYES.map(|eye| eye + DVec3::new(0.05, 0.02, -0.05));
            let shift = |renderer: &mut Renderer, depth_m| {
                let [then, now] = [EYES, moved]
                    .map(|eyes| middle_of(&drawn(renderer, &[ball(at(depth_m), 1.0)], eyes), 0..400).unwrap());
                (then - now).length()
            };
            assert!(shift(renderer, 0.0) < 0.5, "no shift in its plane");
            let (near, far) = (shift(renderer, 0.1), shift(renderer, 0.5));
            assert!(near > 1.0 && far > 2.0 * near, "{near} px a little behind, {far} px far behind");
        });
    }

    #[test]
    fn nearer_ball_occludes_farther_in_any_order() {
        with_renderer(|renderer| {
            let eye = EYES[0];
            let near_m = DVec3::new(0.0, 0.9, -1.2);
            let far_m = eye + (near_m - eye) * 1.5;
            let (near, far) = (ball(near_m, 1.0), ball(far_m, 0.3));
            let both = drawn(renderer, &[near.clone(), far.clone()], [eye; 2]);
            assert_eq!(both, drawn(renderer, &[far.clone(), near], [eye; 2]));
            let at = crossing_px(eye, near_m).as_uvec2();
            let alone = drawn(renderer, &[far], [eye; 2]);
            assert!(alone.get_pixel(at.x, at.y)[3] > 20, "the far one is there");
            assert!(both.get_pixel(at.x, at.y)[3] > 2 * alone.get_pixel(at.x, at.y)[3]);
        });
    }

    #[test]
    fn empty_scene_is_transparent_and_color_is_premultiplied() {
        with_renderer(|renderer| {
            assert!(drawn(renderer, &[], EYES).pixels().all(|p| p.0 == [0; 4]));
            let dark = ball(DVec3::new(0.0, 0.9, -1.3), 0.0);
            assert!(drawn(renderer, &[dark], EYES).pixels().all(|p| p.0 == [0; 4]));
            let behind = EYES.map(|eye| eye - DVec3::Z * 2.0);
            let lit = ball(DVec3::new(0.0, 0.9, -1.3), 1.0);
            assert!(
                drawn(renderer, std::slice::from_ref(&lit), behind).pixels().all(|p| p.0 == [0; 4]),
                "eyes behind the window"
            );
            let linear = |v: u8| (f64::from(v) / 255.0).powf(2.2);
            let picture = drawn(renderer, &[lit], EYES);
            assert!(picture.pixels().any(|p| p[2] > 50));
            assert!(picture.pixels().all(|p| linear(p[2]) <= f64::from(p[3]) / 255.0 + 0.02));
        });
    }

    #[test]
    fn batched_windows_match_single_windows() {
        with_renderer(|renderer| {
            let shapes =
                [ball(DVec3::new(0.0, 0.9, -1.3), 1.0), Shape { id: 2, ..ball(DVec3::new(0.2, 0.5, -1.4), 0.5) }];
            let scenery = StereoScene { quads: &[], shapes: &shapes, color: [64, 224, 255] };
            let other = Window { key: (QuadKind::Object, 2), size_m: DVec2::new(0.9, 1.1), ..window() };
            let textures = renderer.windows(&scenery, &[window(), other], EYES).unwrap();
            for (window, texture) in [window(), other].into_iter().zip(textures) {
                let alone = renderer.window(&scenery, &window, EYES, window.half_px()).unwrap();
                let alone = renderer.picture_of_texture(&alone).unwrap();
                assert!(alone.pixels().any(|p| p[3] > 50));
                assert_eq!(renderer.picture_of_texture(&texture).unwrap(), alone);
            }
        });
    }

    #[test]
    fn window_shows_only_its_own_obstacle() {
        with_renderer(|renderer| {
            let other = Shape { id: 2, ..ball(DVec3::new(0.0, 0.9, -1.3), 1.0) };
            assert!(drawn(renderer, &[other], EYES).pixels().all(|p| p.0 == [0; 4]));
        });
    }

    fn a_panel() -> Warnings {
        let panel = Panel {
            id: 1,
            kind: PanelKind::Object,
            tracking_from_panel: Pose::from_translation(DVec3::new(0.1, 0.6, -0.9)),
            size_m: DVec2::new(0.6, 1.2),
            silhouette: [(DVec2::ZERO, 0.1)].into(),
            alpha: 1.0,
            distance_m: 0.6,
            time_to_contact_s: None,
            nearest_part: BodyPart::Torso,
            nearest_m: DVec3::ZERO,
            label_m: None,
        };
        Warnings { panels: vec![panel], footprints: vec![] }
    }

    #[test]
    fn panel_in_its_window_matches_its_texture() {
        with_renderer(|renderer| {
            let style = WarningSettings::default();
            let quads = renderer.quads(&a_panel(), &style).unwrap();
            let scenery = StereoScene { quads: &quads, shapes: &[], color: style.color };
            let windows = Window::of_panels(&scenery, EYES);
            assert_eq!((windows.len(), windows[0].key), (1, quads[0].key()));
            // Same resolution as the panel's texture, and a margin of whole pixels.
            let scale = f64::from(quads[0].texture.width()) / quads[0].size_m.x;
            let half_px = (windows[0].size_m * scale).round().as_uvec2().to_array();
            let texture = renderer.window(&scenery, &windows[0], EYES, half_px).unwrap();
            let (drawn, original) =
                (renderer.picture_of_texture(&texture).unwrap(), renderer.picture_of(&quads[0]).unwrap());
            let mean = |picture: &RgbaImage, columns: std::ops::Range<u32>| {
                let lit: u64 = picture
                    .enumerate_pixels()
                    .filter(|(x, ..)| columns.contains(x))
                    .map(|(.., p)| u64::from(p[3]))
                    .sum();
                lit as f64
            };
            let whole = mean(&original, 0..original.width());
            for left in [0, half_px[0]] {
                let half = mean(&drawn, left..left + half_px[0]);
                assert!((half / whole - 1.0).abs() < 0.03, "{half} of {whole}");
            }
        });
    }

    #[test]
    fn window_covers_visible_shape_and_keeps_its_size_during_head_sway() {
        with_renderer(|renderer| {
            let quads = renderer.quads(&a_panel(), &WarningSettings::default()).unwrap();
            let high = ball(DVec3::new(0.2, 1.3, -1.4), 1.0);
            let scenery = StereoScene { quads: &quads, shapes: std::slice::from_ref(&high), color: [255; 3] };
            let at = |x: f64| Window::of_panels(&scenery, EYES.map(|eye| eye + DVec3::X * x))[0];
            for eye in EYES {
                let pixel = at(0.0).view(eye, HALF_PX).unwrap().project(high.points_m[0]).unwrap();
                assert!(pixel.cmpgt(DVec2::splat(4.0)).all() && pixel.cmplt(DVec2::new(396.0, 496.0)).all(), "{pixel}");
            }
            let sizes: Vec<_> = (0..100).map(|k| at((f64::from(k) * 0.3).sin() * 0.01).size_m).collect();
            assert!(sizes.iter().all(|size| *size == sizes[0]), "{sizes:?}");
            let beside = ball(DVec3::new(0.2, 1.3, 0.0), 1.0);
            let scenery = StereoScene { shapes: &[beside], ..scenery };
            assert!(Window::of_panels(&scenery, EYES)[0].size_m.max_element() <= 2.0 * MAX_EDGE_DISTANCE_M);
        });
    }

    #[test]
    fn eye_image_matches_projection() {
        with_renderer(|renderer| {
            let head = Pose::from_translation(DVec3::new(0.2, 1.5, 0.1));
            let point = DVec3::new(0.3, 1.3, -0.7);
            for (side, view) in EyeView::pair(&head, 0.064, 1.6, [320, 280]).iter().enumerate() {
                let scenery = StereoScene { quads: &[], shapes: &[ball(point, 1.0)], color: [255; 3] };
                let texture = renderer.eye(&scenery, side, view).unwrap();
                let seen = middle_of(&renderer.picture_of_texture(&texture).unwrap(), 0..320).unwrap();
                assert!((seen - view.project(point).unwrap()).length() < 0.6, "{seen}");
            }
        });
    }

    #[test]
    fn window_textures_rotate_through_three_buffers() {
        with_renderer(|renderer| {
            let scenery = StereoScene { quads: &[], shapes: &[], color: [255; 3] };
            let textures: Vec<_> =
                (0..6).map(|_| renderer.window(&scenery, &window(), EYES, HALF_PX).unwrap()).collect();
            for (k, texture) in textures.iter().enumerate() {
                let same = textures.iter().position(|other| Arc::ptr_eq(other, texture)).unwrap();
                assert_eq!(same, k % 3);
            }
        });
    }
}

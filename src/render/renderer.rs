//! The renderer: a device, the texture cache, the preview and the stereo images.

use std::sync::Arc;

use glam::DVec3;
use image::RgbaImage;

use super::error::RenderError;
use super::eye::EyeView;
use super::eye_renderer::EyeRenderer;
use super::gpu::Gpu;
use super::painter::Painter;
use super::preview::preview;
use super::quads::{Quad, QuadCache};
use super::stereo::{RenderTargets, StereoScene, Window};
use crate::warning::{WarningSettings, Warnings};

/// Draws warnings, without a window.
pub struct Renderer {
    gpu: Gpu,
    painter: Painter,
    viewer: EyeRenderer,
    cache: QuadCache,
    targets: RenderTargets,
}

impl Renderer {
    /// Opens a graphics card, or a software renderer if there is none.
    ///
    /// # Errors
    /// [`RenderError::NoAdapter`] if the machine has neither; [`RenderError::NoDevice`] if the
    /// adapter cannot be used.
    pub fn new() -> Result<Self, RenderError> {
        Self::on(Gpu::headless()?)
    }

    /// Uses a device that the caller opened with [`super::needed_limits`] and the extensions that
    /// SteamVR needs. The renderer takes the device's callbacks for errors and for its loss. `name`
    /// is for messages.
    ///
    /// # Errors
    /// [`RenderError::Device`] if the device cannot create the pipelines;
    /// [`RenderError::DeviceLost`] if it is lost.
    pub fn from_device(device: wgpu::Device, queue: wgpu::Queue, name: &str) -> Result<Self, RenderError> {
        Self::on(Gpu::of(device, queue, name.to_owned()))
    }

    fn on(gpu: Gpu) -> Result<Self, RenderError> {
        let (painter, viewer) = (Painter::new(&gpu), EyeRenderer::new(&gpu));
        gpu.check()?;
        Ok(Self { gpu, painter, viewer, cache: QuadCache::default(), targets: RenderTargets::default() })
    }

    /// Name of the graphics adapter.
    pub fn adapter_name(&self) -> &str {
        &self.gpu.name
    }

    /// Poses and textures of all warnings. Only textures whose content changed are drawn.
    /// Footprints first, then panels in the given order. New textures can be handed to a VR
    /// runtime.
    ///
    /// # Errors
    /// [`RenderError::Device`] if the device failed since the last call;
    /// [`RenderError::DeviceLost`] if it is lost.
    pub fn quads(&mut self, warnings: &Warnings, style: &WarningSettings) -> Result<Vec<Quad>, RenderError> {
        let quads = self.cache.quads(&self.gpu, &self.painter, warnings, style);
        self.gpu.check()?;
        Ok(quads)
    }

    /// As [`Self::quads`], for callers that must not wait for a slow GPU: one texture is drawn at a
    /// time. A quad whose texture is not ready keeps its previous state, or is left out.
    ///
    /// # Errors
    /// As [`Self::quads`].
    pub fn quads_incremental(
        &mut self,
        warnings: &Warnings,
        style: &WarningSettings,
    ) -> Result<Vec<Quad>, RenderError> {
        self.gpu.check()?;
        let quads = self.cache.quads_incremental(&self.gpu, &self.painter, warnings, style);
        self.gpu.check()?;
        Ok(quads)
    }

    /// Whether the device still works. For callers that draw on it too: their errors are also
    /// reported here.
    ///
    /// # Errors
    /// As [`Self::quads`].
    pub fn check(&self) -> Result<(), RenderError> {
        self.gpu.check()
    }

    /// Number of textures drawn since the start.
    pub fn textures_drawn(&self) -> u64 {
        self.cache.drawn
    }

    /// Memory used by the textures of quads, bytes.
    pub fn texture_bytes(&self) -> u64 {
        self.cache.bytes()
    }

    /// A quad's texture as an image: premultiplied alpha, row 0 at the top.
    ///
    /// # Errors
    /// [`RenderError::Device`] if the device failed.
    pub fn picture_of(&self, quad: &Quad) -> Result<RgbaImage, RenderError> {
        self.gpu.read(&quad.texture)
    }

    /// The warnings as one eye sees them, in a dark room with a 1 m floor grid. `truth`: points and
    /// radii of the true objects, drawn as dim dots, metres.
    ///
    /// # Errors
    /// [`RenderError::View`] and [`RenderError::ImageSize`] for an invalid eye;
    /// [`RenderError::Device`] if the device failed.
    pub fn preview(
        &mut self,
        warnings: &Warnings,
        style: &WarningSettings,
        view: &EyeView,
        truth: &[(DVec3, f64)],
    ) -> Result<RgbaImage, RenderError> {
        let quads = self.quads(warnings, style)?;
        self.cache.prepare_for_sampling(&self.gpu, &self.painter, &quads);
        preview(&self.gpu, &self.viewer, &quads, view, truth)
    }

    /// Prepares the textures of these quads for a VR runtime, which copies them on our queue.
    /// Needed after a preview or [`Self::window`] sampled them; otherwise nothing is submitted.
    /// Textures stay alive for some frames after their last use. Before dropping the renderer, the
    /// caller must wait until the runtime has finished.
    ///
    /// # Errors
    /// As [`Self::quads`].
    pub fn prepare_for_copy(&mut self, quads: &[Quad]) -> Result<(), RenderError> {
        self.cache.prepare_for_copy(&self.gpu, quads);
        self.gpu.check()
    }

    /// What both eyes (left, right; tracking frame, metres) see of an obstacle through its window:
    /// the left and right half of one texture, each of `half_px`. Transparent background,
    /// premultiplied alpha, ready to be handed to a VR runtime. The texture is overwritten after
    /// two more calls for this window.
    ///
    /// # Errors
    /// [`RenderError::ImageSize`], and as [`Self::quads`].
    pub fn window(
        &mut self,
        scenery: &StereoScene,
        window: &Window,
        eyes_m: [DVec3; 2],
        half_px: [u32; 2],
    ) -> Result<Arc<wgpu::Texture>, RenderError> {
        let mut textures = self.sized_windows(scenery, &[(*window, half_px)], eyes_m)?;
        textures.pop().ok_or_else(|| RenderError::Device("a window was not drawn".into()))
    }

    /// [`Self::window`] for several windows in one submission, which is cheaper. Each has the size
    /// [`Window::half_px`].
    ///
    /// # Errors
    /// As [`Self::window`].
    pub fn windows(
        &mut self,
        scenery: &StereoScene,
        windows: &[Window],
        eyes_m: [DVec3; 2],
    ) -> Result<Vec<Arc<wgpu::Texture>>, RenderError> {
        let sized: Vec<_> = windows.iter().map(|window| (*window, window.half_px())).collect();
        self.sized_windows(scenery, &sized, eyes_m)
    }

    fn sized_windows(
        &mut self,
        scenery: &StereoScene,
        windows: &[(Window, [u32; 2])],
        eyes_m: [DVec3; 2],
    ) -> Result<Vec<Arc<wgpu::Texture>>, RenderError> {
        self.cache.prepare_for_sampling(&self.gpu, &self.painter, scenery.quads);
        let textures = self.targets.windows(&self.gpu, &self.viewer, scenery, windows, eyes_m)?;
        self.gpu.check()?;
        Ok(textures)
    }

    /// The full image of one eye (`side`: 0 left, 1 right). Otherwise as [`Self::window`].
    ///
    /// # Errors
    /// [`RenderError::View`] and [`RenderError::ImageSize`] for an invalid eye, and as
    /// [`Self::quads`].
    pub fn eye(
        &mut self,
        scenery: &StereoScene,
        side: usize,
        view: &EyeView,
    ) -> Result<Arc<wgpu::Texture>, RenderError> {
        self.cache.prepare_for_sampling(&self.gpu, &self.painter, scenery.quads);
        let texture = self.targets.eye(&self.gpu, &self.viewer, scenery, side, view)?;
        self.gpu.check()?;
        Ok(texture)
    }

    /// A texture of [`Self::window`] or [`Self::eye`] as an image: premultiplied alpha, row 0 at
    /// the top.
    ///
    /// # Errors
    /// As [`Self::picture_of`].
    pub fn picture_of_texture(&self, texture: &wgpu::Texture) -> Result<RgbaImage, RenderError> {
        self.gpu.read(texture)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::sync::{Mutex, OnceLock};

    use glam::DVec2;

    use super::*;
    use crate::warning::{BodyPart, Footprint, Panel, PanelKind, Style};
    use radar_sar::geometry::Pose;

    /// Runs a test on the renderer shared by all tests.
    ///
    /// # Panics
    /// The machine has no adapter; a software renderer will do.
    pub fn with_renderer(test: impl FnOnce(&mut Renderer)) {
        static SHARED: OnceLock<Mutex<Renderer>> = OnceLock::new();
        let shared = SHARED.get_or_init(|| Mutex::new(Renderer::new().unwrap_or_else(|error| panic!("{error}"))));
        test(&mut shared.lock().unwrap_or_else(|poisoned| poisoned.into_inner()));
    }

    fn panel(position: DVec3) -> Panel {
        Panel {
            id: 1,
            kind: PanelKind::Object,
            tracking_from_panel: Pose::from_translation(position),
            size_m: DVec2::new(0.6, 0.8),
            silhouette: [(DVec2::new(0.0, -0.1), 0.1), (DVec2::new(0.0, -0.25), 0.1)].into(),
            alpha: 1.0,
            distance_m: 0.5,
            time_to_contact_s: None,
            nearest_part: BodyPart::Torso,
            nearest_m: DVec3::ZERO,
            label_m: None,
        }
    }

    fn only(panel: Panel) -> Warnings {
        Warnings { panels: vec![panel], footprints: vec![] }
    }

    fn head() -> Pose {
        Pose::from_translation(DVec3::new(0.2, 1.5, 0.1))
    }

    fn eyes() -> [EyeView; 2] {
        EyeView::pair(&head(), 0.064, 1.6, [320, 320])
    }

    fn draw(renderer: &mut Renderer, warnings: &Warnings, view: &EyeView) -> RgbaImage {
        renderer.preview(warnings, &WarningSettings::default(), view, &[]).unwrap()
    }

    /// Smallest and largest x and y of the pixels that differ; `None` if there are none.
    fn changed(a: &RgbaImage, b: &RgbaImage) -> Option<[f64; 4]> {
        let differs = a.enumerate_pixels().filter(|(x, y, pixel)| {
            let other = b.get_pixel(*x, *y);
            (0..3).any(|c| pixel[c].abs_diff(other[c]) > 3)
        });
        differs
            .map(|(x, y, _)| [x.into(), y.into(), f64::from(x) + 1.0, f64::from(y) + 1.0])
            .reduce(|a: [f64; 4], b| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])])
    }

    #[test]
    fn panel_projects_to_expected_pixels_in_both_eyes() {
        with_renderer(|renderer| {
            let panel = panel(DVec3::new(0.3, 1.3, -0.7));
            let corner = |x: f64, y: f64| panel.tracking_from_panel.transform_point(DVec3::new(x * 0.3, y * 0.4, 0.0));
            let mut middles = Vec::new();
            for view in eyes() {
                let lit = draw(renderer, &only(panel.clone()), &view);
                let seen = changed(&lit, &draw(renderer, &Warnings::default(), &view)).unwrap();
                let left_low = view.project(corner(-1.0, -1.0)).unwrap();
                let right_high = view.project(corner(1.0, 1.0)).unwrap();
                assert!(
                    (seen[0] - left_low.x).abs() < 1.5 && (seen[3] - left_low.y).abs() < 1.5,
                    "{seen:?} {left_low}"
                );
                assert!((seen[2] - right_high.x).abs() < 1.5, "{seen:?} {right_high}");
                let middle = view.project(panel.tracking_from_panel.translation).unwrap();
                assert!(((seen[0] + seen[2]) / 2.0 - middle.x).abs() < 1.5);
                middles.push((seen[0] + seen[2]) / 2.0);
            }
            let tangent = 0.064 / 0.8;
            let expected = tangent * 160.0 / 0.8f64.tan();
            assert!((middles[0] - middles[1] - expected).abs() < 2.0, "{middles:?}, expected {expected} px apart");
        });
    }

    #[test]
    fn transparent_panels_and_panels_behind_are_not_drawn() {
        with_renderer(|renderer| {
            let [view, _] = eyes();
            let empty = draw(renderer, &Warnings::default(), &view);
            let dark = Panel { alpha: 0.0, ..panel(DVec3::new(0.3, 1.3, -0.7)) };
            assert_eq!(changed(&draw(renderer, &only(dark), &view), &empty), None);
            let behind = panel(DVec3::new(0.2, 1.3, 1.0));
            assert_eq!(changed(&draw(renderer, &only(behind), &view), &empty), None);
        });
    }

    #[test]
    fn panel_texture_is_premultiplied() {
        with_renderer(|renderer| {
            let quads = renderer.quads(&only(panel(DVec3::ZERO)), &WarningSettings::default()).unwrap();
            let picture = renderer.picture_of(&quads[0]).unwrap();
            assert!(picture.pixels().any(|p| p[3] < 8), "clear at the upper edge");
            let on_silhouette = picture.get_pixel(picture.width() / 2 + 20, picture.height() * 5 / 8);
            assert!(on_silhouette[3] > 50 && on_silhouette[2] > on_silhouette[0], "{on_silhouette:?}");
            let linear = |v: u8| (f64::from(v) / 255.0).powf(2.2);
            assert!(picture.pixels().all(|p| linear(p[2]) <= f64::from(p[3]) / 255.0 + 0.02));
        });
    }

    /// Linear luminance of a texture's pixel over a background, as defined by WCAG.
    fn luminance(pixel: &image::Rgba<u8>, behind: f64) -> f64 {
        let linear = |v: u8| {
            let v = f64::from(v) / 255.0;
            if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        };
        let [red, green, blue, alpha] = pixel.0;
        let own = 0.2126 * linear(red) + 0.7152 * linear(green) + 0.0722 * linear(blue);
        own + behind * (1.0 - f64::from(alpha) / 255.0)
    }

    /// Largest contrast across a line along a row of pixels, over white, black and a busy grey
    /// background with little contrast of its own.
    fn contrasts(picture: &RgbaImage, row: u32, columns: std::ops::Range<u32>) -> [f64; 3] {
        let behinds: [fn(u32) -> f64; 3] = [|_| 1.0, |_| 0.0, |x| if (x / 3).is_multiple_of(2) { 0.17 } else { 0.27 }];
        behinds.map(|behind| {
            let lights = columns.clone().map(|x| luminance(picture.get_pixel(x, row), behind(x)));
            let (least, most) = lights.fold((f64::INFINITY, 0.0f64), |(least, most), v| (least.min(v), most.max(v)));
            (most + 0.05) / (least + 0.05)
        })
    }

    #[test]
    fn lines_have_contrast_over_bright_dark_and_busy_backgrounds() {
        with_renderer(|renderer| {
            for style in Style::ALL {
                let settings = WarningSettings { style, ..Default::default() };
                let panel = Panel { silhouette: [(DVec2::new(0.0, -0.1), 0.13)].into(), ..panel(DVec3::ZERO) };
                let size_m = panel.size_m;
                let quads = renderer.quads(&only(panel), &settings).unwrap();
                let picture = renderer.picture_of(&quads[0]).unwrap();
                let px = |m: f64| (m / size_m.x * f64::from(picture.width())) as u32;
                let py = |m: f64| (m / size_m.y * f64::from(picture.height())) as u32;
                let row = |m_from_middle: f64| py(0.4 - m_from_middle);
                // An isolated disc is drawn at 0.55 of its radius, because voxels normally overlap.
                // Positions at which lines cross a row of pixels: metres from the left, and height
                // of the row from the centre.
                let crossed: &[(f64, f64)] = match style {
                    Style::Grid => &[(0.1, -0.3), (0.5, -0.3), (0.229, -0.1), (0.371, -0.1), (0.015, -0.3)],
                    Style::Outline | Style::Solid => &[(0.229, -0.1), (0.371, -0.1)],
                    Style::Minimal => &[(0.015, -0.1), (0.585, -0.1)],
                };
                for (line_m, height_m) in crossed {
                    let columns = px((line_m - 0.025f64).max(0.0))..px((line_m + 0.025f64).min(size_m.x));
                    let contrasts = contrasts(&picture, row(*height_m), columns);
                    assert!(contrasts.iter().all(|c| *c >= 3.0), "{style:?} at {line_m} m: {contrasts:.1?}");
                }
                // The foot line is horizontal: check it along a column.
                let turned = image::imageops::rotate90(&picture);
                let foot = contrasts(&turned, px(0.07), 0..py(0.03));
                assert!(foot.iter().all(|c| *c >= 3.0), "{style:?}, foot: {foot:.1?}");
            }
            let corners_xz_m = [(-0.3, 0.3), (0.3, 0.3), (0.3, -0.3), (-0.3, -0.3)].map(DVec2::from).into();
            let footprint = Footprint { id: 1, corners_xz_m, alpha: 1.0 };
            let warnings = Warnings { panels: vec![], footprints: vec![footprint] };
            let quads = renderer.quads(&warnings, &WarningSettings::default()).unwrap();
            let picture = renderer.picture_of(&quads[0]).unwrap();
            let contrasts = contrasts(&picture, picture.height() / 2, 0..picture.width() / 4);
            assert!(contrasts.iter().all(|c| *c >= 3.0), "footprint: {contrasts:.1?}");
        });
    }

    #[test]
    fn texture_cache_key_includes_label_and_style() {
        with_renderer(|renderer| {
            let style = WarningSettings { color: [3, 128, 255], ..Default::default() };
            let with = |label_m| only(Panel { label_m, ..panel(DVec3::ZERO) });
            let drawn = renderer.textures_drawn();
            let plain = renderer.quads(&with(None), &style).unwrap();
            let labelled = renderer.quads(&with(Some(0.8)), &style).unwrap();
            renderer.quads(&with(Some(0.8000001)), &style).unwrap();
            assert_eq!(renderer.textures_drawn(), drawn + 2);
            let [plain, labelled] = [plain, labelled].map(|quads| renderer.picture_of(&quads[0]).unwrap());
            let [left, top, right, bottom] = changed(&plain, &labelled).unwrap();
            assert!(right - left > 60.0 && bottom - top > 20.0, "{left} {top} {right} {bottom}");
            assert!(bottom < f64::from(plain.height()) / 2.0, "above the silhouette");
            let solid = WarningSettings { style: Style::Solid, ..style };
            renderer.quads(&with(None), &solid).unwrap();
            assert_eq!(renderer.textures_drawn(), drawn + 3);
            for label_m in [f64::NAN, -1.0, 1e300] {
                renderer.quads(&with(Some(label_m)), &style).unwrap();
            }
            assert_eq!(renderer.textures_drawn(), drawn + 3, "what is no distance is not written");
        });
    }

    #[test]
    fn texture_is_redrawn_only_when_the_shape_changes() {
        with_renderer(|renderer| {
            let style = WarningSettings { color: [255, 128, 1], ..Default::default() };
            let first = panel(DVec3::ZERO);
            let before = renderer.textures_drawn();
            let a = renderer.quads(&only(first.clone()), &style).unwrap();
            let moved = Panel { alpha: 0.3, tracking_from_panel: head(), ..first.clone() };
            let b = renderer.quads(&only(moved), &style).unwrap();
            assert!(std::sync::Arc::ptr_eq(&a[0].texture, &b[0].texture));
            assert_eq!(renderer.textures_drawn(), before + 1);
            let other = Panel { silhouette: [(DVec2::ZERO, 0.2)].into(), ..first };
            renderer.quads(&only(other), &style).unwrap();
            assert_eq!(renderer.textures_drawn(), before + 2);
        });
    }

    #[test]
    fn quads_incremental_draws_one_texture_at_a_time() {
        with_renderer(|renderer| {
            let style = WarningSettings { color: [1, 128, 255], ..Default::default() };
            let of = |id, width_m| Panel { id, size_m: DVec2::new(width_m, 0.83), ..panel(DVec3::Z * -0.9) };
            let both = |width_m| Warnings { panels: vec![of(1, width_m), of(2, 0.62)], footprints: vec![] };
            let drawn = renderer.textures_drawn();
            assert!(renderer.quads_incremental(&both(0.61), &style).unwrap().is_empty(), "nothing is drawn yet");
            assert_eq!(renderer.textures_drawn(), drawn + 1);
            let wait = |renderer: &mut Renderer| renderer.gpu.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
            wait(renderer);
            assert_eq!(renderer.quads_incremental(&both(0.61), &style).unwrap().len(), 1);
            wait(renderer);
            let quads = renderer.quads_incremental(&both(0.61), &style).unwrap();
            assert_eq!((quads.len(), renderer.textures_drawn()), (2, drawn + 2));
            // The first panel changes: its previous texture stays in place until the new one is
            // drawn.
            let moved = Warnings { panels: vec![Panel { alpha: 0.3, ..of(1, 0.9) }, of(2, 0.62)], footprints: vec![] };
            let during = renderer.quads_incremental(&moved, &style).unwrap();
            assert!(Arc::ptr_eq(&during[0].texture, &quads[0].texture) && during[0].size_m == quads[0].size_m);
            assert_eq!(during[0].alpha, 0.3, "brightness follows at once");
            wait(renderer);
            // A further change was requested in the meantime: the finished texture is shown
            // nevertheless.
            let after = renderer.quads_incremental(&both(1.2), &style).unwrap();
            assert_eq!(after[0].size_m.x, 0.9);
            assert!(
                renderer.quads_incremental(&only(of(2, 0.62)), &style).unwrap().len() == 1,
                "a removed warning is not drawn"
            );
        });
    }

    #[test]
    fn rendering_is_deterministic_across_renderers() {
        with_renderer(|renderer| {
            let [view, _] = eyes();
            let corners_xz_m = [(0.0, -0.6), (0.4, -0.6), (0.4, -1.0), (0.0, -1.0)].map(DVec2::from).into();
            let warnings = Warnings {
                footprints: vec![Footprint { id: 1, corners_xz_m, alpha: 0.7 }],
                ..only(panel(DVec3::new(0.3, 1.3, -0.7)))
            };
            let once = draw(renderer, &warnings, &view);
            assert_eq!(once, draw(renderer, &warnings, &view));
            assert_eq!(once, draw(&mut Renderer::new().unwrap(), &warnings, &view));
        });
    }

    #[test]
    fn panels_are_depth_tested_against_truth_dots() {
        with_renderer(|renderer| {
            let [view, _] = eyes();
            let position = DVec3::new(0.2, 1.3, -0.7);
            let warnings = only(panel(position));
            let at = |picture: &RgbaImage, point| {
                let pixel = view.project(point).unwrap();
                picture.get_pixel(pixel.x as u32, pixel.y as u32).0
            };
            let on_silhouette = position - DVec3::new(0.05, 0.15, 0.0);
            let eye = view.tracking_from_eye.translation;
            let style = WarningSettings::default();
            let mut with_dot = |share: f64| {
                let dot = eye + (on_silhouette - eye) * share;
                at(&renderer.preview(&warnings, &style, &view, &[(dot, 0.05)]).unwrap(), on_silhouette)
            };
            let (before, behind) = (with_dot(0.6), with_dot(1.5));
            assert!(before[2] < before[0] + 10, "grey: {before:?}");
            assert!(behind[2] > behind[0] + 40, "cyan: {behind:?}");
        });
    }

    #[test]
    fn precision_is_independent_of_distance_to_origin() {
        with_renderer(|renderer| {
            let far = DVec3::new(4096.0, 0.0, -2048.0);
            let [near_eye, _] = eyes();
            let mut far_eye = near_eye;
            far_eye.tracking_from_eye.translation += far;
            let position = DVec3::new(0.3, 1.3, -0.7);
            let a = draw(renderer, &only(panel(position)), &near_eye);
            let b = draw(renderer, &only(panel(position + far)), &far_eye);
            assert_eq!(changed(&a, &b), None);
        });
    }

    #[test]
    fn invalid_image_sizes_are_rejected() {
        with_renderer(|renderer| {
            let [view, _] = eyes();
            let none = Warnings::default();
            let style = WarningSettings::default();
            let empty = EyeView { size_px: [0, 10], ..view };
            assert!(matches!(
                renderer.preview(&none, &style, &empty, &[]),
                Err(RenderError::ImageSize { width: 0, .. })
            ));
            let blind = EyeView { tangents: [0.0; 4], ..view };
            assert!(matches!(renderer.preview(&none, &style, &blind, &[]), Err(RenderError::View { .. })));
        });
    }

    #[test]
    fn missing_adapter_error_names_the_remedy() {
        let message = RenderError::NoAdapter.to_string();
        assert!(message.contains("apt install mesa-vulkan-drivers libvulkan1"), "{message}");
    }

    #[test]
    fn only_sampled_textures_are_prepared_for_copy_again() {
        with_renderer(|renderer| {
            let mut tick = 0.0;
            let mut fresh = || {
                tick += 0.01;
                only(Panel { size_m: DVec2::new(0.61 + tick, 0.83), ..panel(DVec3::new(0.3, 1.3, -0.7)) })
            };
            let style = WarningSettings::default();
            let warnings = fresh();
            let quads = renderer.quads(&warnings, &style).unwrap();
            assert!(renderer.cache.all_copy_sources(&quads), "a new texture is ready");
            renderer.preview(&warnings, &style, &eyes()[0], &[]).unwrap();
            assert!(!renderer.cache.all_copy_sources(&quads));
            renderer.prepare_for_copy(&quads).unwrap();
            assert!(renderer.cache.all_copy_sources(&quads));
            let picture = renderer.picture_of(&quads[0]).unwrap();
            let others = renderer.quads(&fresh(), &style).unwrap();
            renderer.prepare_for_copy(&[quads, others].concat()).unwrap();
            assert!(picture.pixels().any(|p| p[3] > 50), "and it still shows the panel");
        });
    }

    #[test]
    fn texture_cache_is_bounded_and_keeps_textures_in_flight() {
        with_renderer(|renderer| {
            let style = WarningSettings::default();
            let (mut shown, mut most) = (std::collections::VecDeque::new(), 0);
            for k in 0..200 {
                let of_its_own = Panel { size_m: DVec2::new(1.0 + 0.001 * f64::from(k), 1.0), ..panel(DVec3::ZERO) };
                let quads = renderer.quads(&only(of_its_own), &style).unwrap();
                shown.push_back(std::sync::Arc::downgrade(&quads[0].texture));
                drop(quads);
                if shown.len() > 4 {
                    shown.pop_front();
                }
                assert!(shown.iter().all(|texture| texture.strong_count() > 0), "frame {k}");
                most = most.max(renderer.texture_bytes());
            }
            // Each texture takes 1.4 to 1.7 MB.
            assert!((40 << 20..56 << 20).contains(&most), "{most} bytes");
        });
    }

    #[test]
    fn lost_device_is_reported_and_a_new_renderer_works() {
        with_renderer(|_| {
            let gpu = Gpu::headless().unwrap();
            let device = gpu.device.clone();
            let mut renderer = Renderer::on(gpu).unwrap();
            let (warnings, style) = (only(panel(DVec3::ZERO)), WarningSettings::default());
            let quads = renderer.quads(&warnings, &style).unwrap();
            // The loss is reported only after the device has finished its work.
            device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
            device.destroy();
            for _ in 0..2 {
                assert!(matches!(renderer.quads(&warnings, &style), Err(RenderError::DeviceLost { .. })));
                assert!(matches!(renderer.prepare_for_copy(&quads), Err(RenderError::DeviceLost { .. })));
                let other = only(Panel { size_m: DVec2::ONE, ..panel(DVec3::ZERO) });
                assert!(matches!(renderer.quads(&other, &style), Err(RenderError::DeviceLost { .. })));
                assert!(matches!(
                    renderer.preview(&other, &style, &eyes()[0], &[]),
                    Err(RenderError::DeviceLost { .. })
                ));
            }
            assert!(Renderer::new().unwrap().quads(&warnings, &style).is_ok());
        });
    }
}

//! The three display modes of warnings. `panels`: quads in the room. `stereo`: windows at the
//! obstacles with a picture of the space behind for each eye. `projection`: a picture for each eye
//! over its whole view.

use std::sync::Arc;

use glam::DVec3;

use super::graphics::{Graphics, GraphicsError};
use super::overlay_pool::{MAX_SHOWN, OverlayPool};
use super::status::HeadsetError;
use crate::openvr::{EyeSide, HeadsetEye, OpenVrError, Overlay, Runtime, Universe};
use crate::render::{EyeView, Quad, RenderError, StereoScene, Window};
use crate::settings::{Display, ProjectionMatrix, Settings};
use crate::warning::{Shape, WarningTracker, Warnings};
use radar_sar::geometry::Pose;

/// Largest width of an eye's picture, pixels. Choice: lines and discs need no more.
const MAX_EYE_PX: u32 = 1024;
/// Pictures per eye kept alive after they were replaced. Choice: the copy of one may be pending
/// when the next is passed; one more in reserve.
const RETAINED_PICTURES: usize = 3;

/// Viewpoint in the standing universe, and the transform from there into the runtime's universe.
pub(super) struct Viewpoint {
    pub standing_from_head: Pose,
    pub raw_from_standing: Pose,
}

/// Why a frame shows nothing new.
#[derive(Debug, thiserror::Error)]
pub(super) enum ShowError {
    #[error(transparent)]
    SteamVr(#[from] OpenVrError),
    #[error(transparent)]
    Render(#[from] RenderError),
}

/// The overlays of one display mode.
pub(super) struct WarningDisplay {
    kind: Kind,
    eyes: Option<[HeadsetEye; 2]>,
    /// Pictures of the previous display mode: the runtime may still copy from them.
    released: Vec<Arc<wgpu::Texture>>,
}

enum Kind {
    Panels(OverlayPool),
    Stereo(OverlayPool),
    /// Left and right.
    Projection {
        overlays: Vec<Overlay>,
        matrix: ProjectionMatrix,
        pictures: Vec<Arc<wgpu::Texture>>,
    },
}

impl WarningDisplay {
    /// The display mode of the settings, or panels where the runtime refuses it.
    ///
    /// # Errors
    /// The runtime refuses panels too.
    pub fn new(runtime: &Arc<Runtime>, settings: &Settings) -> Result<Self, HeadsetError> {
        let mode = settings.headset.display;
        Self::with_mode(runtime, settings, mode).or_else(|error| {
            if mode == Display::Panels {
                return Err(error);
            }
            log::warn!("{error}. Panels are shown instead of the display mode of the settings");
            Self::with_mode(runtime, settings, Display::Panels)
        })
    }

    fn with_mode(runtime: &Arc<Runtime>, settings: &Settings, mode: Display) -> Result<Self, HeadsetError> {
        let eyes = runtime.eyes();
        let no_eyes = || OpenVrError::Call { call: "the eyes", name: "they make no picture".to_owned() };
        let kind = match mode {
            Display::Panels => Kind::Panels(OverlayPool::new(runtime, false)?),
            Display::Stereo => {
                eyes.ok_or_else(no_eyes)?;
                Kind::Stereo(OverlayPool::new(runtime, true)?)
            }
            Display::Projection => {
                eyes.ok_or_else(no_eyes)?;
                let overlay = |side| {
                    Overlay::new(runtime, &format!("radar-chaperone.{side}"), &format!("Radar chaperone, {side} eye"))
                };
                let overlays = vec![overlay("left")?, overlay("right")?];
                Kind::Projection { overlays, matrix: settings.headset.projection_matrix, pictures: Vec::new() }
            }
        };
        Ok(Self { kind, eyes, released: Vec::new() })
    }

    /// The display mode in use.
    pub fn mode(&self) -> Display {
        match self.kind {
            Kind::Panels(_) => Display::Panels,
            Kind::Stereo(_) => Display::Stereo,
            Kind::Projection { .. } => Display::Projection,
        }
    }

    /// Switches to the display mode of the settings, or to panels where the runtime refuses it.
    pub fn switch(&mut self, runtime: &Arc<Runtime>, settings: &Settings) {
        self.replace(|| Self::new(runtime, settings));
    }

    /// Switches to panels.
    pub fn switch_to_panels(&mut self, runtime: &Arc<Runtime>, settings: &Settings) {
        self.replace(|| Self::with_mode(runtime, settings, Display::Panels));
    }

    fn replace(&mut self, make: impl FnOnce() -> Result<Self, HeadsetError>) {
        // The overlays have the same names, so the existing ones must go first.
        let nothing = Self { kind: Kind::Panels(OverlayPool::none()), eyes: None, released: Vec::new() };
        let pictures = std::mem::replace(self, nothing).kind.end();
        match make() {
            Ok(made) => *self = made,
            Err(error) => log::error!("no warnings can be shown: {error}"),
        }
        // Those of the switch before are done.
        self.released = pictures;
    }

    /// Whether the overlays still exist in the runtime.
    pub fn exist(&self) -> bool {
        match &self.kind {
            Kind::Panels(slots) | Kind::Stereo(slots) => slots.exist(),
            Kind::Projection { overlays, .. } => overlays.iter().any(Overlay::exists),
        }
    }

    /// Shows warnings; returns the number of new pictures passed to the runtime.
    ///
    /// # Errors
    /// The runtime refuses something, or the device fails.
    pub fn show(
        &mut self,
        graphics: &mut Graphics,
        tracker: &WarningTracker,
        warnings: &Warnings,
        settings: &Settings,
        from: &Viewpoint,
    ) -> Result<u64, ShowError> {
        let quads = match self.kind {
            Kind::Panels(_) => graphics.renderer.quads_incremental(warnings, &settings.warning)?,
            // These modes draw the shapes themselves.
            _ => graphics.renderer.quads(&warnings.clone().without_silhouettes(), &settings.warning)?,
        };
        let scene = Scene3d { quads: &quads, tracker, warnings, settings };
        match (&mut self.kind, &self.eyes) {
            (Kind::Panels(slots), _) => Ok(slots.show(&graphics.device, &quads, &from.raw_from_standing)?),
            (Kind::Stereo(slots), Some(eyes)) => {
                let windows = windows(graphics, &scene, eyes, from)?;
                Ok(slots.show(&graphics.device, &windows, &from.raw_from_standing)?)
            }
            (Kind::Projection { overlays, matrix, pictures }, Some(eyes)) => {
                for (side, (overlay, eye)) in overlays.iter().zip(eyes).enumerate() {
                    let picture = project(graphics, &scene, overlay, side, eye, from, *matrix)?;
                    pictures.push(picture);
                }
                let outdated = pictures.len().saturating_sub(2 * RETAINED_PICTURES);
                pictures.drain(..outdated);
                Ok(2)
            }
            (_, None) => Ok(0),
        }
    }

    /// Hides all overlays.
    ///
    /// # Errors
    /// The runtime refuses.
    pub fn hide(&mut self) -> Result<(), OpenVrError> {
        match &mut self.kind {
            Kind::Panels(slots) | Kind::Stereo(slots) => slots.hide(),
            Kind::Projection { overlays, .. } => overlays.iter().map(Overlay::hide).fold(Ok(()), Result::and),
        }
    }

    /// Drops all pictures after the device was lost.
    pub fn drop_pictures(&mut self) {
        match &mut self.kind {
            Kind::Panels(slots) | Kind::Stereo(slots) => slots.drop_pictures(),
            Kind::Projection { pictures, .. } => pictures.clear(),
        }
    }

    /// Number of overlays shown.
    pub fn count(&self) -> usize {
        match &self.kind {
            Kind::Panels(slots) | Kind::Stereo(slots) => slots.shown(),
            Kind::Projection { overlays, .. } => overlays.iter().filter(|overlay| overlay.is_shown()).count(),
        }
    }

    /// Destroys the overlays. Returns their pictures, because the runtime may still copy them until
    /// the session is over.
    pub fn end(self) -> Vec<Arc<wgpu::Texture>> {
        [self.released, self.kind.end()].concat()
    }
}

impl Kind {
    /// Destroys the overlays and returns their pictures.
    fn end(self) -> Vec<Arc<wgpu::Texture>> {
        match self {
            Kind::Panels(slots) | Kind::Stereo(slots) => slots.end(),
            Kind::Projection { pictures, .. } => pictures,
        }
    }
}

/// What is drawn in space.
struct Scene3d<'a> {
    quads: &'a [Quad],
    tracker: &'a WarningTracker,
    warnings: &'a Warnings,
    settings: &'a Settings,
}

impl Scene3d<'_> {
    fn scenery<'s>(&'s self, shapes: &'s [Shape]) -> StereoScene<'s> {
        StereoScene { quads: self.quads, shapes, color: self.settings.warning.color }
    }
}

/// A window for each panel with what both eyes see through it, as quads. The brightness is in the
/// pictures already.
fn windows(
    graphics: &mut Graphics,
    scene: &Scene3d,
    eyes: &[HeadsetEye; 2],
    from: &Viewpoint,
) -> Result<Vec<Quad>, RenderError> {
    let eyes_m: [DVec3; 2] = eyes.map(|eye| (from.standing_from_head * eye.head_from_eye).translation);
    let shapes = scene.tracker.shapes(scene.warnings);
    let scenery = scene.scenery(&shapes);
    let windows: Vec<Window> = Window::of_panels(&scenery, eyes_m).into_iter().take(MAX_SHOWN).collect();
    let pictures = graphics.renderer.windows(&scenery, &windows, eyes_m)?;
    let quad = |(window, texture): (Window, Arc<wgpu::Texture>)| {
        let (tracking_from_quad, size_m, (kind, id)) = (window.tracking_from_window, window.size_m, window.key);
        Quad { kind, id, on_floor: false, tracking_from_quad, size_m, alpha: 1.0, texture }
    };
    Ok(windows.into_iter().zip(pictures).map(quad).collect())
}

/// Shows the whole view of an eye; returns the picture, which must be kept alive.
fn project(
    graphics: &mut Graphics,
    scene: &Scene3d,
    overlay: &Overlay,
    side: usize,
    eye: &HeadsetEye,
    from: &Viewpoint,
    matrix: ProjectionMatrix,
) -> Result<Arc<wgpu::Texture>, ShowError> {
    let tracking_from_eye = from.standing_from_head * eye.head_from_eye;
    let [left, right, lower, upper] = eye.tangents;
    let height_px = f64::from(MAX_EYE_PX) * (upper - lower) / (right - left);
    let size_px = [MAX_EYE_PX, height_px.round().clamp(16.0, 2.0 * f64::from(MAX_EYE_PX)) as u32];
    let view = EyeView { tracking_from_eye, tangents: eye.tangents, size_px };
    let shapes = scene.tracker.shapes(scene.warnings);
    let picture = graphics.renderer.eye(&scene.scenery(&shapes), side, &view)?;
    if let Some(texture) = graphics.device.texture_handles(&picture) {
        overlay.set_texture(&texture)?;
    }
    let raw_from_eye = from.raw_from_standing * tracking_from_eye;
    let matrix_for_runtime = match matrix {
        ProjectionMatrix::EyeFromTracking => raw_from_eye.inverse(),
        ProjectionMatrix::TrackingFromEye => raw_from_eye,
    };
    let side = if side == 0 { EyeSide::Left } else { EyeSide::Right };
    overlay.set_projection(Universe::Raw, &matrix_for_runtime, eye.tangents, side)?;
    overlay.set_alpha(1.0)?;
    overlay.show()?;
    Ok(picture)
}

impl From<RenderError> for HeadsetError {
    fn from(error: RenderError) -> Self {
        GraphicsError::from(error).into()
    }
}

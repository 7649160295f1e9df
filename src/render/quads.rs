//! Warnings as textured quads in the room. A texture is redrawn only when its content changes.
//!
//! The cache key of a texture is its content, rounded to half a millimetre. Brightness and pose are
//! not part of it. Textures that were not used for a while are dropped, the least recently used
//! first when the cache is full. Textures used within the last few frames are never dropped,
//! because a VR runtime may still be copying them and does not report when it has finished.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DQuat, DVec2, DVec3};

use super::gpu::Gpu;
use super::painter::{Painter, PanelContent, style_number, texture_size, transition_to_copy_source};
use crate::warning::{Footprint, Panel, PanelKind, WarningSettings, Warnings};
use radar_sar::geometry::Pose;

/// Unused textures are dropped after this many calls: ten seconds of frames. Choice: someone who
/// walks past an obstacle again finds its texture.
const MAX_UNUSED_CALLS: u64 = 900;
/// Limit of the texture cache, not counting textures in flight, bytes. Choice: eight panels, and as
/// much again of recent ones.
const MAX_CACHE_BYTES: u64 = 48 << 20;
/// A texture used within this many calls may still be in flight. Choice: more than the frames that
/// a compositor works on at once.
const IN_FLIGHT_CALLS: u64 = 4;
/// Margin around a footprint for its glow, metres. Choice: the shader's glow has faded to nothing
/// there.
const GLOW_MARGIN_M: f64 = 0.08;
/// Height of footprints above the floor, metres. Choice: above the depth buffer's rounding,
/// invisible as a step.
const HEIGHT_ABOVE_FLOOR_M: f64 = 0.003;
/// Footprint corners are rounded to this, metres. Choice: below the position error, so that noise
/// in the positions does not redraw the texture.
const CORNER_STEP_M: f64 = 0.005;

/// What a quad shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum QuadKind {
    /// An object's panel.
    Object,
    /// A wall's panel.
    Wall,
    /// The area on the floor under an object.
    Footprint,
}

/// A textured rectangle in the room.
#[derive(Debug, Clone)]
pub struct Quad {
    /// What it shows.
    pub kind: QuadKind,
    /// Id of the obstacle or wall that it warns of.
    pub id: u64,
    /// Whether it lies on the floor.
    pub on_floor: bool,
    /// Pose of its centre: +x to the right and +y up in the image, +z towards the viewer.
    pub tracking_from_quad: Pose,
    /// Width and height, metres.
    pub size_m: DVec2,
    /// Brightness, 0 to 1.
    pub alpha: f32,
    /// Its texture. The same `Arc` as long as the content is the same.
    pub texture: Arc<wgpu::Texture>,
}

impl Quad {
    /// Identifies the quad from frame to frame. A caller with a slot per quad, for example one
    /// overlay each, keeps a quad in the slot of its key: only pose, size and brightness change
    /// often, the texture rarely. Keys within one frame are unique.
    pub fn key(&self) -> (QuadKind, u64) {
        (self.kind, self.id)
    }
}

/// Texture content as integers: the cache key.
type ContentKey = Vec<i32>;

struct CachedTexture {
    texture: Arc<wgpu::Texture>,
    is_drawn: Arc<AtomicBool>,
    last_used: u64,
    /// Whether the coarser mip levels are drawn.
    has_mip_levels: bool,
    /// Whether the texture is in the copy-source layout.
    is_copy_source: bool,
}

/// Size of the texture that a quad had last.
struct LastSize {
    px: [u32; 2],
    last_used: u64,
}

impl LastSize {
    fn of(texture: &wgpu::Texture, last_used: u64) -> Self {
        Self { px: [texture.width(), texture.height()], last_used }
    }
}

/// Textures by content.
#[derive(Default)]
pub(super) struct QuadCache {
    textures: HashMap<ContentKey, CachedTexture>,
    /// Sizes that the incremental mode keeps.
    sizes: HashMap<(QuadKind, u64), LastSize>,
    calls: u64,
    /// Number of textures drawn so far.
    pub drawn: u64,
    /// Quads shown last by the incremental mode.
    last_shown: HashMap<(QuadKind, u64), Quad>,
    /// The texture that the incremental mode is drawing.
    pending: Option<(ContentKey, Quad)>,
}

impl QuadCache {
    /// Quads of all visible warnings: footprints first, then panels in the given order.
    pub fn quads(&mut self, gpu: &Gpu, painter: &Painter, warnings: &Warnings, style: &WarningSettings) -> Vec<Quad> {
        self.calls += 1;
        let quads = quad_requests(warnings, style).map(|wanted| {
            let texture = self.texture(gpu, painter, &wanted, style, None);
            wanted.quad(texture)
        });
        let quads = quads.collect();
        self.drop_unused();
        quads
    }

    /// As [`Self::quads`], without waiting for a slow GPU: at most one texture is being drawn at
    /// any time. A quad whose texture is not ready keeps its previous state, or is left out.
    pub fn quads_incremental(
        &mut self,
        gpu: &Gpu,
        painter: &Painter,
        warnings: &Warnings,
        style: &WarningSettings,
    ) -> Vec<Quad> {
        self.calls += 1;
        self.take_finished();
        let mut quads = Vec::new();
        for wanted in quad_requests(warnings, style) {
            let kept = self.textures.get_mut(&wanted.content).filter(|kept| kept.is_drawn.load(Ordering::Acquire));
            if let Some(kept) = kept {
                kept.last_used = self.calls;
                self.sizes.insert(wanted.key(), LastSize::of(&kept.texture, self.calls));
                self.last_shown.insert(wanted.key(), wanted.quad(Arc::clone(&kept.texture)));
            } else if self.pending.is_none() {
                let last_px = self.sizes.get(&wanted.key()).map(|size| size.px);
                let texture = self.texture(gpu, painter, &wanted, style, last_px);
                self.sizes.insert(wanted.key(), LastSize::of(&texture, self.calls));
                self.pending = Some((wanted.content.clone(), wanted.quad(texture)));
            }
            quads.extend(
                self.last_shown.get(&wanted.key()).map(|before| Quad { alpha: wanted.alpha, ..before.clone() }),
            );
        }
        self.last_shown.retain(|key, _| quads.iter().any(|quad| quad.key() == *key));
        self.drop_unused();
        quads
    }

    /// Shows the pending quad once it is drawn. It is newer than the previous one even if a
    /// different quad is requested by now.
    fn take_finished(&mut self) {
        let textures = &self.textures;
        let is_drawn =
            |content: &ContentKey| textures.get(content).is_none_or(|kept| kept.is_drawn.load(Ordering::Acquire));
        if let Some((_, quad)) = self.pending.take_if(|(content, _)| is_drawn(content)) {
            self.last_shown.insert(quad.key(), quad);
        }
    }

    /// Call before these textures are sampled: draws their mip levels and marks them as no longer
    /// copy sources.
    pub fn prepare_for_sampling(&mut self, gpu: &Gpu, painter: &Painter, quads: &[Quad]) {
        let mut encoder = None;
        for kept in self.textures.values_mut().filter(|kept| is_among(&kept.texture, quads)) {
            kept.is_copy_source = false;
            if !std::mem::replace(&mut kept.has_mip_levels, true) {
                let encoder = encoder.get_or_insert_with(|| gpu.device.create_command_encoder(&Default::default()));
                painter.draw_mip_levels(gpu, encoder, &kept.texture);
            }
        }
        if let Some(encoder) = encoder {
            gpu.queue.submit([encoder.finish()]);
        }
    }

    /// Puts the textures of these quads into the copy-source layout. Submits nothing if they
    /// already are.
    pub fn prepare_for_copy(&mut self, gpu: &Gpu, quads: &[Quad]) {
        let sampled = self.textures.values_mut().filter(|kept| !kept.is_copy_source && is_among(&kept.texture, quads));
        let textures: Vec<_> = sampled
            .map(|kept| {
                kept.is_copy_source = true;
                Arc::clone(&kept.texture)
            })
            .collect();
        if !textures.is_empty() {
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            transition_to_copy_source(&mut encoder, textures.iter().map(Arc::as_ref));
            gpu.queue.submit([encoder.finish()]);
        }
    }

    /// Memory used by textures, bytes.
    pub fn bytes(&self) -> u64 {
        self.textures.values().map(|kept| bytes_of(&kept.texture)).sum()
    }

    /// Whether all of these textures are in the copy-source layout.
    #[cfg(test)]
    pub fn all_copy_sources(&self, quads: &[Quad]) -> bool {
        self.textures.values().filter(|kept| is_among(&kept.texture, quads)).all(|kept| kept.is_copy_source)
    }

    fn drop_unused(&mut self) {
        let uses = self.calls;
        self.textures.retain(|_, kept| kept.last_used + MAX_UNUSED_CALLS >= uses);
        self.sizes.retain(|_, size| size.last_used + MAX_UNUSED_CALLS >= uses);
        let mut excess = self.bytes().saturating_sub(MAX_CACHE_BYTES);
        if excess == 0 {
            return;
        }
        let mut by_use: Vec<(u64, u64)> =
            self.textures.values().map(|kept| (kept.last_used, bytes_of(&kept.texture))).collect();
        by_use.sort_unstable();
        // One call marks only a few textures, so dropping by call number is precise enough.
        let mut oldest = 0;
        for (last_used, bytes) in by_use {
            if excess == 0 || last_used + IN_FLIGHT_CALLS > uses {
                break;
            }
            oldest = last_used;
            excess = excess.saturating_sub(bytes);
        }
        self.textures.retain(|_, kept| kept.last_used > oldest);
    }

    fn texture(
        &mut self,
        gpu: &Gpu,
        painter: &Painter,
        wanted: &QuadRequest,
        style: &WarningSettings,
        last_px: Option<[u32; 2]>,
    ) -> Arc<wgpu::Texture> {
        let (uses, drawn) = (self.calls, &mut self.drawn);
        let kept = self.textures.entry(wanted.content.clone()).or_insert_with(|| {
            *drawn += 1;
            let size_px = texture_size(wanted.size_m, last_px);
            let (texture, is_drawn) =
                (Arc::new(wanted.paint(gpu, painter, style, size_px)), Arc::new(AtomicBool::new(false)));
            let signal = Arc::clone(&is_drawn);
            gpu.queue.on_submitted_work_done(move || signal.store(true, Ordering::Release));
            CachedTexture { texture, is_drawn, last_used: uses, has_mip_levels: false, is_copy_source: true }
        });
        kept.last_used = uses;
        Arc::clone(&kept.texture)
    }
}

/// A quad without its texture, and the content of that texture.
struct QuadRequest<'w> {
    kind: QuadKind,
    id: u64,
    tracking_from_quad: Pose,
    size_m: DVec2,
    alpha: f32,
    content: ContentKey,
    picture: QuadContent<'w>,
}

enum QuadContent<'w> {
    Panel(&'w Panel),
    /// Corners relative to the centre.
    Footprint(Vec<DVec2>),
}

impl QuadRequest<'_> {
    fn key(&self) -> (QuadKind, u64) {
        (self.kind, self.id)
    }

    fn quad(&self, texture: Arc<wgpu::Texture>) -> Quad {
        let Self { kind, id, tracking_from_quad, size_m, alpha, .. } = *self;
        Quad { kind, id, on_floor: kind == QuadKind::Footprint, tracking_from_quad, size_m, alpha, texture }
    }

    fn paint(&self, gpu: &Gpu, painter: &Painter, style: &WarningSettings, size_px: [u32; 2]) -> wgpu::Texture {
        match &self.picture {
            QuadContent::Panel(panel) => painter.panel(gpu, &panel_content(panel), style, size_px),
            QuadContent::Footprint(corners) => painter.footprint(gpu, self.size_m, corners, style, size_px),
        }
    }
}

/// Requests for all visible warnings: footprints first, then panels in the given order.
fn quad_requests<'w>(warnings: &'w Warnings, style: &'w WarningSettings) -> impl Iterator<Item = QuadRequest<'w>> {
    let areas = warnings.footprints.iter().filter(|f| f.alpha > 0.0 && f.corners_xz_m.len() >= 3);
    let panels =
        warnings.panels.iter().filter(|p| p.alpha > 0.0 && p.size_m.is_finite() && p.size_m.min_element() > 0.0);
    areas.map(move |area| footprint_request(area, style)).chain(panels.map(move |panel| panel_request(panel, style)))
}

fn panel_content(panel: &Panel) -> PanelContent<'_> {
    let label_dm = panel.label_m.filter(|m| (0.0..1000.0).contains(m)).map(|m| (m * 10.0).round() as i32);
    PanelContent { kind: panel.kind, size_m: panel.size_m, silhouette: &panel.silhouette, label_dm }
}

fn panel_request<'w>(panel: &'w Panel, style: &WarningSettings) -> QuadRequest<'w> {
    let discs = panel.silhouette.iter().flat_map(|(c, r)| [c.x, c.y, *r]);
    let kind = match panel.kind {
        PanelKind::Wall => 0,
        PanelKind::Object => 1,
        PanelKind::Pane => 3,
    };
    QuadRequest {
        kind: if panel.kind == PanelKind::Wall { QuadKind::Wall } else { QuadKind::Object },
        id: panel.id,
        tracking_from_quad: panel.tracking_from_panel,
        size_m: panel.size_m,
        alpha: panel.alpha,
        content: content(
            kind,
            style,
            [panel_content(panel).label_dm.map_or(-1.0, f64::from), panel.size_m.x, panel.size_m.y]
                .into_iter()
                .chain(discs),
        ),
        picture: QuadContent::Panel(panel),
    }
}

fn footprint_request<'w>(area: &Footprint, style: &WarningSettings) -> QuadRequest<'w> {
    let flat: Vec<DVec2> = area.corners_xz_m.iter().map(|c| DVec2::new(c.x, -c.y)).collect();
    let least = flat.iter().copied().fold(DVec2::INFINITY, DVec2::min);
    let greatest = flat.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
    let middle = (least + greatest) / 2.0;
    let size_m = ((greatest - least) / CORNER_STEP_M).ceil() * CORNER_STEP_M + 2.0 * GLOW_MARGIN_M;
    let corners: Vec<DVec2> = flat.iter().map(|c| ((c - middle) / CORNER_STEP_M).round() * CORNER_STEP_M).collect();
    let position = DVec3::new(middle.x, HEIGHT_ABOVE_FLOOR_M, -middle.y);
    let lengths = [size_m.x, size_m.y].into_iter().chain(corners.iter().flat_map(|c| c.to_array()));
    QuadRequest {
        kind: QuadKind::Footprint,
        id: area.id,
        tracking_from_quad: Pose::new(position, DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2)),
        size_m,
        alpha: area.alpha,
        content: content(2, style, lengths),
        picture: QuadContent::Footprint(corners),
    }
}

/// All mip levels of a texture, bytes. The coarser levels add a third.
fn bytes_of(texture: &wgpu::Texture) -> u64 {
    u64::from(texture.width()) * u64::from(texture.height()) * 16 / 3
}

fn is_among(texture: &Arc<wgpu::Texture>, quads: &[Quad]) -> bool {
    quads.iter().any(|quad| Arc::ptr_eq(&quad.texture, texture))
}

fn content(kind: i32, style: &WarningSettings, lengths_m: impl Iterator<Item = f64>) -> ContentKey {
    let color = style.color.map(i32::from);
    let lengths = [style.grid_spacing_m].into_iter().chain(lengths_m).map(|v| (v * 2000.0).round() as i32);
    [kind, style_number(style.style) as i32].into_iter().chain(color).chain(lengths).collect()
}

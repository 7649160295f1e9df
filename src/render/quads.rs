//! Warnings as textured quads standing in the room, each with a texture that is drawn again only when its content changes.
//!
//! The key of a texture is its content, rounded to half a millimetre; brightness and pose are no part of it. Textures that
//! nothing showed for a while are dropped, the longest unused first when there are many. One that was shown within the last few
//! frames never is: a VR runtime may still be copying it, and no one tells us when it is done.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DQuat, DVec2, DVec3};

use super::gpu::Gpu;
use super::painter::{Painter, PanelLook, ready_to_copy, style_number};
use crate::geometry::Pose;
use crate::warning::{Footprint, Panel, PanelKind, WarningSettings, Warnings};

/// A texture is dropped after so many uses of the cache without it: ten seconds of frames.
const KEPT_FOR: u64 = 900;
/// More memory than this is not kept in textures, but for those in flight, bytes: what eight panels show, and as much again of what
/// they showed lately.
const MOST_KEPT_BYTES: u64 = 48 << 20;
/// A texture used so few uses ago may still be in flight.
const IN_FLIGHT: u64 = 4;
/// Room around a footprint for its glow, metres.
const GLOW_M: f64 = 0.08;
/// Footprints lie this far above the floor, metres.
const ABOVE_FLOOR_M: f64 = 0.003;
/// Corners of a footprint are rounded to this, metres.
const CORNER_STEP_M: f64 = 0.005;

/// What a quad shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum QuadKind {
    /// An object's panel.
    Object,
    /// A wall's panel.
    Wall,
    /// The area where an object stands.
    Footprint,
}

/// A rectangle in the room with a picture on it.
#[derive(Debug, Clone)]
pub struct Quad {
    /// What it shows.
    pub kind: QuadKind,
    /// The obstacle or wall it warns of.
    pub id: u64,
    /// Whether it lies on the floor.
    pub on_floor: bool,
    /// Middle; +x to the right and +y up in the picture, +z towards who looks at it.
    pub tracking_from_quad: Pose,
    /// Width and height, metres.
    pub size_m: DVec2,
    /// Brightness, 0 to 1.
    pub alpha: f32,
    /// The picture; the same `Arc` as long as it is the same picture.
    pub texture: Arc<wgpu::Texture>,
}

impl Quad {
    /// What stays the same from frame to frame while the same thing is shown. Who holds a slot for each quad, an overlay for
    /// example, leaves a quad in the slot of its key: nothing but its pose, size and brightness then changes from frame to
    /// frame, and its picture seldom. Keys of one frame differ.
    pub fn key(&self) -> (QuadKind, u64) {
        (self.kind, self.id)
    }
}

/// What a picture shows, in whole numbers.
type Content = Vec<i32>;

struct Kept {
    texture: Arc<wgpu::Texture>,
    is_drawn: Arc<AtomicBool>,
    last_used: u64,
    /// Whether its smaller levels are drawn.
    has_levels: bool,
    /// Whether it was left in the layout in which a runtime takes it over.
    is_ready: bool,
}

/// Textures by content.
#[derive(Default)]
pub(super) struct QuadCache {
    textures: HashMap<Content, Kept>,
    uses: u64,
    /// Textures drawn so far.
    pub drawn: u64,
    /// What is shown at leisure.
    shown: HashMap<(QuadKind, u64), Quad>,
    /// The one that is being drawn for it.
    under_way: Option<(Content, Quad)>,
}

impl QuadCache {
    /// Quads of all that shines: footprints first, then panels in the order given.
    pub fn quads(&mut self, gpu: &Gpu, painter: &Painter, warnings: &Warnings, style: &WarningSettings) -> Vec<Quad> {
        self.uses += 1;
        let quads = wanted(warnings, style).map(|wanted| {
            let texture = self.texture(gpu, painter, &wanted, style);
            wanted.quad(texture)
        });
        let quads = quads.collect();
        self.drop_unused();
        quads
    }

    /// The same for who must not wait for a slow graphics card: at most one picture is being drawn at any time, and what has
    /// none yet is shown as it was before, or not at all.
    pub fn quads_at_leisure(
        &mut self,
        gpu: &Gpu,
        painter: &Painter,
        warnings: &Warnings,
        style: &WarningSettings,
    ) -> Vec<Quad> {
        self.uses += 1;
        self.take_drawn();
        let mut quads = Vec::new();
        for wanted in wanted(warnings, style) {
            let kept = self.textures.get_mut(&wanted.content).filter(|kept| kept.is_drawn.load(Ordering::Acquire));
            if let Some(kept) = kept {
                kept.last_used = self.uses;
                self.shown.insert(wanted.key(), wanted.quad(Arc::clone(&kept.texture)));
            } else if self.under_way.is_none() {
                let texture = self.texture(gpu, painter, &wanted, style);
                self.under_way = Some((wanted.content.clone(), wanted.quad(texture)));
            }
            quads.extend(self.shown.get(&wanted.key()).map(|before| Quad { alpha: wanted.alpha, ..before.clone() }));
        }
        self.shown.retain(|key, _| quads.iter().any(|quad| quad.key() == *key));
        self.drop_unused();
        quads
    }

    /// What was under way and is drawn may be shown, although by now something else may be wanted there: it is newer than what was.
    fn take_drawn(&mut self) {
        let textures = &self.textures;
        let is_drawn =
            |content: &Content| textures.get(content).is_none_or(|kept| kept.is_drawn.load(Ordering::Acquire));
        if let Some((_, quad)) = self.under_way.take_if(|(content, _)| is_drawn(content)) {
            self.shown.insert(quad.key(), quad);
        }
    }

    /// Before our own views sample these quads: their smaller levels are drawn, and they will not be ready to be copied.
    pub fn before_sampling(&mut self, gpu: &Gpu, painter: &Painter, quads: &[Quad]) {
        let mut encoder = None;
        for kept in self.textures.values_mut().filter(|kept| is_among(&kept.texture, quads)) {
            kept.is_ready = false;
            if !std::mem::replace(&mut kept.has_levels, true) {
                let encoder = encoder.get_or_insert_with(|| gpu.device.create_command_encoder(&Default::default()));
                painter.smaller_levels(gpu, encoder, &kept.texture);
            }
        }
        if let Some(encoder) = encoder {
            gpu.queue.submit([encoder.finish()]);
        }
    }

    /// Makes the textures of these quads ready to be copied by a runtime; submits nothing when they are.
    pub fn hand_over(&mut self, gpu: &Gpu, quads: &[Quad]) {
        let sampled = self.textures.values_mut().filter(|kept| !kept.is_ready && is_among(&kept.texture, quads));
        let textures: Vec<_> = sampled
            .map(|kept| {
                kept.is_ready = true;
                Arc::clone(&kept.texture)
            })
            .collect();
        if !textures.is_empty() {
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            ready_to_copy(&mut encoder, textures.iter().map(Arc::as_ref));
            gpu.queue.submit([encoder.finish()]);
        }
    }

    /// Memory that textures take, bytes.
    pub fn bytes(&self) -> u64 {
        self.textures.values().map(|kept| bytes_of(&kept.texture)).sum()
    }

    /// Whether all of these could be handed over as they are.
    #[cfg(test)]
    pub fn all_ready(&self, quads: &[Quad]) -> bool {
        self.textures.values().filter(|kept| is_among(&kept.texture, quads)).all(|kept| kept.is_ready)
    }

    fn drop_unused(&mut self) {
        let uses = self.uses;
        self.textures.retain(|_, kept| kept.last_used + KEPT_FOR >= uses);
        let mut excess = self.bytes().saturating_sub(MOST_KEPT_BYTES);
        if excess == 0 {
            return;
        }
        let mut by_use: Vec<(u64, u64)> =
            self.textures.values().map(|kept| (kept.last_used, bytes_of(&kept.texture))).collect();
        by_use.sort_unstable();
        // Each use stamps a handful of textures, so one stamp more or less to drop makes no difference.
        let mut oldest = 0;
        for (last_used, bytes) in by_use {
            if excess == 0 || last_used + IN_FLIGHT > uses {
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
        wanted: &Wanted,
        style: &WarningSettings,
    ) -> Arc<wgpu::Texture> {
        let (uses, drawn) = (self.uses, &mut self.drawn);
        let kept = self.textures.entry(wanted.content.clone()).or_insert_with(|| {
            *drawn += 1;
            let (texture, is_drawn) = (Arc::new(wanted.paint(gpu, painter, style)), Arc::new(AtomicBool::new(false)));
            let tell = Arc::clone(&is_drawn);
            gpu.queue.on_submitted_work_done(move || tell.store(true, Ordering::Release));
            Kept { texture, is_drawn, last_used: uses, has_levels: false, is_ready: true }
        });
        kept.last_used = uses;
        Arc::clone(&kept.texture)
    }
}

/// A quad without its picture, and what the picture shows.
struct Wanted<'w> {
    kind: QuadKind,
    id: u64,
    tracking_from_quad: Pose,
    size_m: DVec2,
    alpha: f32,
    content: Content,
    picture: Picture<'w>,
}

enum Picture<'w> {
    Panel(&'w Panel),
    /// Corners from the middle.
    Footprint(Vec<DVec2>),
}

impl Wanted<'_> {
    fn key(&self) -> (QuadKind, u64) {
        (self.kind, self.id)
    }

    fn quad(&self, texture: Arc<wgpu::Texture>) -> Quad {
        let Self { kind, id, tracking_from_quad, size_m, alpha, .. } = *self;
        Quad { kind, id, on_floor: kind == QuadKind::Footprint, tracking_from_quad, size_m, alpha, texture }
    }

    fn paint(&self, gpu: &Gpu, painter: &Painter, style: &WarningSettings) -> wgpu::Texture {
        match &self.picture {
            Picture::Panel(panel) => painter.panel(gpu, &look(panel), style),
            Picture::Footprint(corners) => painter.footprint(gpu, self.size_m, corners, style),
        }
    }
}

/// All that shines: footprints first, then panels in the order given.
fn wanted<'w>(warnings: &'w Warnings, style: &'w WarningSettings) -> impl Iterator<Item = Wanted<'w>> {
    let areas = warnings.footprints.iter().filter(|f| f.alpha > 0.0 && f.corners_xz_m.len() >= 3);
    let panels =
        warnings.panels.iter().filter(|p| p.alpha > 0.0 && p.size_m.is_finite() && p.size_m.min_element() > 0.0);
    areas.map(move |area| wanted_footprint(area, style)).chain(panels.map(move |panel| wanted_panel(panel, style)))
}

fn look(panel: &Panel) -> PanelLook<'_> {
    let label_dm = panel.label_m.filter(|m| (0.0..1000.0).contains(m)).map(|m| (m * 10.0).round() as i32);
    PanelLook { kind: panel.kind, size_m: panel.size_m, silhouette: &panel.silhouette, label_dm }
}

fn wanted_panel<'w>(panel: &'w Panel, style: &WarningSettings) -> Wanted<'w> {
    let discs = panel.silhouette.iter().flat_map(|(c, r)| [c.x, c.y, *r]);
    let kind = match panel.kind {
        PanelKind::Wall => 0,
        PanelKind::Object => 1,
        PanelKind::Pane => 3,
    };
    Wanted {
        kind: if panel.kind == PanelKind::Wall { QuadKind::Wall } else { QuadKind::Object },
        id: panel.id,
        tracking_from_quad: panel.tracking_from_panel,
        size_m: panel.size_m,
        alpha: panel.alpha,
        content: content(
            kind,
            style,
            [look(panel).label_dm.map_or(-1.0, f64::from), panel.size_m.x, panel.size_m.y].into_iter().chain(discs),
        ),
        picture: Picture::Panel(panel),
    }
}

fn wanted_footprint<'w>(area: &Footprint, style: &WarningSettings) -> Wanted<'w> {
    let flat: Vec<DVec2> = area.corners_xz_m.iter().map(|c| DVec2::new(c.x, -c.y)).collect();
    let least = flat.iter().copied().fold(DVec2::INFINITY, DVec2::min);
    let greatest = flat.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
    let middle = (least + greatest) / 2.0;
    let size_m = ((greatest - least) / CORNER_STEP_M).ceil() * CORNER_STEP_M + 2.0 * GLOW_M;
    let corners: Vec<DVec2> = flat.iter().map(|c| ((c - middle) / CORNER_STEP_M).round() * CORNER_STEP_M).collect();
    let place = DVec3::new(middle.x, ABOVE_FLOOR_M, -middle.y);
    let lengths = [size_m.x, size_m.y].into_iter().chain(corners.iter().flat_map(|c| c.to_array()));
    Wanted {
        kind: QuadKind::Footprint,
        id: area.id,
        tracking_from_quad: Pose::new(place, DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2)),
        size_m,
        alpha: area.alpha,
        content: content(2, style, lengths),
        picture: Picture::Footprint(corners),
    }
}

/// All levels of a texture, bytes: the smaller ones add a third.
fn bytes_of(texture: &wgpu::Texture) -> u64 {
    u64::from(texture.width()) * u64::from(texture.height()) * 16 / 3
}

fn is_among(texture: &Arc<wgpu::Texture>, quads: &[Quad]) -> bool {
    quads.iter().any(|quad| Arc::ptr_eq(&quad.texture, texture))
}

fn content(kind: i32, style: &WarningSettings, lengths_m: impl Iterator<Item = f64>) -> Content {
    let color = style.color.map(i32::from);
    let lengths = [style.grid_spacing_m].into_iter().chain(lengths_m).map(|v| (v * 2000.0).round() as i32);
    [kind, style_number(style.style) as i32].into_iter().chain(color).chain(lengths).collect()
}

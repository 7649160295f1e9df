//! Warnings as textured quads standing in the room, each with a texture that is drawn again only when its content changes.
//!
//! The key of a texture is its content, rounded to half a millimetre; brightness and pose are no part of it. Textures that
//! nothing showed for a while are dropped.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{DQuat, DVec2, DVec3};

use super::gpu::Gpu;
use super::painter::{Painter, PanelLook};
use crate::geometry::Pose;
use crate::warning::{Footprint, Panel, PanelKind, WarningSettings, Warnings};

/// A texture is dropped after so many uses of the cache without it.
const KEPT_FOR: u64 = 90;
/// Room around a footprint for its glow, metres.
const GLOW_M: f64 = 0.08;
/// Footprints lie this far above the floor, metres.
const ABOVE_FLOOR_M: f64 = 0.003;
/// Corners of a footprint are rounded to this, metres.
const CORNER_STEP_M: f64 = 0.005;

/// A rectangle in the room with a picture on it.
#[derive(Debug, Clone)]
pub struct Quad {
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

type Key = Vec<i32>;

struct Kept {
    texture: Arc<wgpu::Texture>,
    last_used: u64,
}

/// Textures by content.
#[derive(Default)]
pub(super) struct QuadCache {
    textures: HashMap<Key, Kept>,
    uses: u64,
    /// Textures drawn so far.
    pub drawn: u64,
}

impl QuadCache {
    /// Quads of all that shines: footprints first, then panels in the order given.
    pub fn quads(&mut self, gpu: &Gpu, painter: &Painter, warnings: &Warnings, style: &WarningSettings) -> Vec<Quad> {
        self.uses += 1;
        let areas = warnings.footprints.iter().filter(|f| f.alpha > 0.0 && f.corners_xz_m.len() >= 3);
        let mut quads: Vec<Quad> = areas.map(|f| self.footprint(gpu, painter, f, style)).collect();
        let panels =
            warnings.panels.iter().filter(|p| p.alpha > 0.0 && p.size_m.is_finite() && p.size_m.min_element() > 0.0);
        quads.extend(panels.map(|p| self.panel(gpu, painter, p, style)));
        let uses = self.uses;
        self.textures.retain(|_, kept| kept.last_used + KEPT_FOR >= uses);
        quads
    }

    fn panel(&mut self, gpu: &Gpu, painter: &Painter, panel: &Panel, style: &WarningSettings) -> Quad {
        let look = PanelLook { kind: panel.kind, size_m: panel.size_m, silhouette: &panel.silhouette };
        let discs = look.silhouette.iter().flat_map(|(c, r)| [c.x, c.y, *r]);
        let kind = if panel.kind == PanelKind::Wall { 0 } else { 1 };
        let key = key(kind, style, [panel.size_m.x, panel.size_m.y].into_iter().chain(discs));
        Quad {
            id: panel.id,
            on_floor: false,
            tracking_from_quad: panel.tracking_from_panel,
            size_m: panel.size_m,
            alpha: panel.alpha,
            texture: self.texture(key, || painter.panel(gpu, &look, style)),
        }
    }

    fn footprint(&mut self, gpu: &Gpu, painter: &Painter, area: &Footprint, style: &WarningSettings) -> Quad {
        let flat: Vec<DVec2> = area.corners_xz_m.iter().map(|c| DVec2::new(c.x, -c.y)).collect();
        let least = flat.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        let greatest = flat.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
        let middle = (least + greatest) / 2.0;
        let size_m = ((greatest - least) / CORNER_STEP_M).ceil() * CORNER_STEP_M + 2.0 * GLOW_M;
        let corners: Vec<DVec2> = flat.iter().map(|c| ((c - middle) / CORNER_STEP_M).round() * CORNER_STEP_M).collect();
        let key = key(2, style, [size_m.x, size_m.y].into_iter().chain(corners.iter().flat_map(|c| c.to_array())));
        let place = DVec3::new(middle.x, ABOVE_FLOOR_M, -middle.y);
        Quad {
            id: area.id,
            on_floor: true,
            tracking_from_quad: Pose::new(place, DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2)),
            size_m,
            alpha: area.alpha,
            texture: self.texture(key, || painter.footprint(gpu, size_m, &corners, style)),
        }
    }

    fn texture(&mut self, key: Key, draw: impl FnOnce() -> wgpu::Texture) -> Arc<wgpu::Texture> {
        let (uses, drawn) = (self.uses, &mut self.drawn);
        let kept = self.textures.entry(key).or_insert_with(|| {
            *drawn += 1;
            Kept { texture: Arc::new(draw()), last_used: uses }
        });
        kept.last_used = uses;
        Arc::clone(&kept.texture)
    }
}

fn key(kind: i32, style: &WarningSettings, lengths_m: impl Iterator<Item = f64>) -> Key {
    let color = style.color.map(i32::from);
    let lengths = [style.grid_spacing_m].into_iter().chain(lengths_m).map(|v| (v * 2000.0).round() as i32);
    [kind].into_iter().chain(color).chain(lengths).collect()
}

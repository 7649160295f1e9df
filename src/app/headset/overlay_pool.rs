//! Shows quads on overlays, for the displays `panels` and `stereo`: a pool of overlays that live as
//! long as the session, each assigned to an obstacle while it has a warning.
//!
//! An obstacle keeps its overlay, so that nothing jumps between overlays. An overlay without an
//! obstacle is hidden, not destroyed. A picture is passed to the runtime only when it has changed.
//! The runtime copies it on our queue later, so the last few stay alive.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::openvr::{OpenVrError, Overlay, Runtime, Universe, VulkanDevice};
use crate::render::{Quad, QuadKind};
use radar_sar::geometry::Pose;

/// Number of overlays. Choice: the runtime's compositor draws each of them for each eye.
pub(super) const MAX_OVERLAYS: usize = 8;
/// Pictures per overlay kept alive after they were replaced. Choice: the copy of one may be pending
/// when the next is passed; one more in reserve.
const RETAINED_PICTURES: usize = 2;
/// Steps of brightness, to save calls of the runtime. Choice: those of an 8-bit display; finer ones
/// cannot be seen.
const ALPHA_STEPS: f32 = 255.0;
/// Sort orders. Choice: what lies on the floor is drawn before what stands on it.
const FLOOR_ORDER: u32 = 0;
const PANEL_ORDER: u32 = 1;

/// Identifies a quad.
type QuadKey = (QuadKind, u64);

struct PooledOverlay {
    overlay: Overlay,
    assigned_to: Option<QuadKey>,
    texture: Option<Arc<wgpu::Texture>>,
    replaced: VecDeque<Arc<wgpu::Texture>>,
}

/// A pool of overlays.
pub(super) struct OverlayPool {
    slots: Vec<PooledOverlay>,
    /// Pictures have two halves, one for each eye.
    is_stereo: bool,
}

impl OverlayPool {
    /// # Errors
    /// The runtime refuses an overlay.
    pub fn new(runtime: &Arc<Runtime>, is_stereo: bool) -> Result<Self, OpenVrError> {
        let slot = |index| {
            let overlay =
                Overlay::new(runtime, &format!("radar-chaperone.{index}"), &format!("Radar chaperone {index}"))?;
            if is_stereo {
                overlay.set_side_by_side()?;
            }
            Ok(PooledOverlay { overlay, assigned_to: None, texture: None, replaced: VecDeque::new() })
        };
        Ok(Self { slots: (1..=MAX_OVERLAYS).map(slot).collect::<Result<_, _>>()?, is_stereo })
    }

    /// An empty pool.
    pub fn none() -> Self {
        Self { slots: Vec::new(), is_stereo: false }
    }

    /// Whether the overlays still exist in the runtime.
    pub fn exist(&self) -> bool {
        self.slots.iter().any(|slot| slot.overlay.exists())
    }

    /// Shows these quads, whose positions are in the standing universe, and hides all others;
    /// returns the number of new pictures passed to the runtime.
    ///
    /// # Errors
    /// The runtime refuses something; the rest is shown.
    pub fn show(
        &mut self,
        device: &VulkanDevice,
        quads: &[Quad],
        raw_from_standing: &Pose,
    ) -> Result<u64, OpenVrError> {
        let wanted: Vec<_> = quads.iter().map(|quad| (quad.key(), size_of(&quad.texture))).take(MAX_OVERLAYS).collect();
        let held: Vec<_> =
            self.slots.iter().map(|slot| (slot.assigned_to, slot.texture.as_deref().map(size_of))).collect();
        let (mut handed, mut refused) = (0, None);
        let lent = assign(&held, &wanted);
        for (slot, _) in self.slots.iter_mut().zip(&lent).filter(|(_, quad)| quad.is_none()) {
            refused = slot.release().err().or(refused);
        }
        for (slot, quad) in self.slots.iter_mut().zip(&lent) {
            let Some(quad) = quad.and_then(|index| quads.get(index)) else { continue };
            match slot.show_quad(device, quad, raw_from_standing, self.is_stereo) {
                Ok(is_new) => handed += u64::from(is_new),
                Err(error) => refused = Some(error),
            }
        }
        refused.map_or(Ok(handed), Err)
    }

    /// Hides all overlays.
    ///
    /// # Errors
    /// The runtime refuses.
    pub fn hide(&mut self) -> Result<(), OpenVrError> {
        self.slots.iter_mut().map(PooledOverlay::release).fold(Ok(()), Result::and)
    }

    /// Drops all pictures after the device was lost.
    pub fn drop_pictures(&mut self) {
        for slot in &mut self.slots {
            slot.texture = None;
            slot.replaced.clear();
        }
    }

    /// Destroys the overlays. Returns their pictures, because the runtime may still copy them until
    /// the session is over.
    pub fn end(self) -> Vec<Arc<wgpu::Texture>> {
        self.slots.into_iter().flat_map(|slot| slot.texture.into_iter().chain(slot.replaced)).collect()
    }

    /// Number of overlays shown.
    pub fn shown(&self) -> usize {
        self.slots.iter().filter(|slot| slot.overlay.is_shown()).count()
    }
}

impl PooledOverlay {
    fn release(&mut self) -> Result<(), OpenVrError> {
        self.assigned_to = None;
        self.overlay.hide()
    }

    /// Shows a quad; returns whether its picture was passed to the runtime.
    fn show_quad(
        &mut self,
        device: &VulkanDevice,
        quad: &Quad,
        raw_from_standing: &Pose,
        is_stereo: bool,
    ) -> Result<bool, OpenVrError> {
        self.assigned_to = Some(quad.key());
        let is_new = !self.texture.as_ref().is_some_and(|texture| Arc::ptr_eq(texture, &quad.texture));
        if is_new && let Some(texture) = device.texture_handles(&quad.texture) {
            self.overlay.set_texture(&texture)?;
            self.replaced.extend(self.texture.replace(Arc::clone(&quad.texture)));
            while self.replaced.len() > RETAINED_PICTURES {
                self.replaced.pop_front();
            }
        }
        // For a picture of two halves, the runtime uses the aspect of one.
        let width_px = f64::from(quad.texture.width()) / if is_stereo { 2.0 } else { 1.0 };
        let height_px = f64::from(quad.texture.height());
        self.overlay.set_texel_aspect((quad.size_m.x / width_px) / (quad.size_m.y / height_px))?;
        self.overlay.set_width_m(quad.size_m.x)?;
        self.overlay.set_pose(Universe::Raw, &(*raw_from_standing * quad.tracking_from_quad))?;
        self.overlay.set_alpha((quad.alpha * ALPHA_STEPS).round() / ALPHA_STEPS)?;
        self.overlay.set_sort_order(if quad.on_floor { FLOOR_ORDER } else { PANEL_ORDER })?;
        self.overlay.show()?;
        Ok(is_new)
    }
}

/// Width and height, pixels.
type Size = [u32; 2];

fn size_of(texture: &wgpu::Texture) -> Size {
    [texture.width(), texture.height()]
}

/// The quad for each overlay: its own when still wanted. Of the others each, in order, gets a free overlay whose last picture had
/// its size, for which the runtime keeps its copy; else one without picture; else any.
fn assign(held: &[(Option<QuadKey>, Option<Size>)], wanted: &[(QuadKey, Size)]) -> Vec<Option<usize>> {
    let own = |key: Option<QuadKey>| key.and_then(|key| wanted.iter().position(|(wanted, _)| *wanted == key));
    let mut lent: Vec<Option<usize>> = held.iter().map(|(key, _)| own(*key)).collect();
    let misfit = |last: Option<Size>, size: Size| match last {
        Some(last) if last == size => 0,
        None => 1,
        Some(_) => 2,
    };
    for (quad, (_, size)) in wanted.iter().enumerate() {
        if lent.contains(&Some(quad)) {
            continue;
        }
        let free = (0..held.len()).filter(|slot| lent[*slot].is_none());
        if let Some(slot) = free.min_by_key(|slot| misfit(held[*slot].1, *size)) {
            lent[slot] = Some(quad);
        }
    }
    lent
}

#[cfg(test)]
mod tests {
    use super::*;

    const LARGE: Size = [512, 1024];
    const SMALL: Size = [256, 256];

    /// The assignment where all pictures have one size.
    fn assigned(held: &[Option<QuadKey>], wanted: &[QuadKey]) -> Vec<Option<usize>> {
        let held: Vec<_> = held.iter().map(|key| (*key, key.map(|_| SMALL))).collect();
        assign(&held, &wanted.iter().map(|key| (*key, SMALL)).collect::<Vec<_>>())
    }

    #[test]
    fn obstacle_keeps_its_overlay() {
        let [chair, table] = [1, 2].map(|id| (QuadKind::Object, id));
        let wall = (QuadKind::Wall, 3);
        assert_eq!(assigned(&[None; 3], &[chair, table]), [Some(0), Some(1), None]);
        // The table is nearer now and comes first; a wall takes the free overlay.
        assert_eq!(assigned(&[Some(chair), Some(table), None], &[table, chair, wall]), [Some(1), Some(0), Some(2)]);
        assert_eq!(assigned(&[Some(chair), Some(table), None], &[wall]), [Some(0), None, None]);
        // A footprint has another key than its panel.
        assert_eq!(assigned(&[Some(chair), None], &[(QuadKind::Footprint, 1)]), [Some(0), None]);
        assert_eq!(assigned(&[Some(chair)], &[table, wall]), [Some(0)], "what does not fit is left out");
        assert_eq!(assigned(&[Some(table), Some(chair)], &[]), [None, None]);
    }

    #[test]
    fn overlay_with_a_picture_of_the_same_size_is_preferred() {
        let [chair, table, shelf] = [1, 2, 3].map(|id| (QuadKind::Object, id));
        let held = [(None, Some(LARGE)), (None, None), (None, Some(SMALL)), (Some(shelf), Some(SMALL))];
        let wanted = [(chair, SMALL), (shelf, SMALL), (table, SMALL)];
        assert_eq!(assign(&held, &wanted), [None, Some(2), Some(0), Some(1)]);
    }
}

//! Shows quads on overlays, for the displays `panels` and `stereo`: a pool of overlays that live as
//! long as the session, each assigned to an obstacle while it has a warning.
//!
//! An obstacle keeps its overlay, so that nothing jumps between overlays. An overlay without an
//! obstacle is hidden, not destroyed, and the runtime keeps its copy of the picture: there are more
//! overlays than are shown at once, so an obstacle that is near again mostly finds its own. A picture
//! is passed to the runtime only when it has changed. The runtime copies it on our queue later, so
//! the last few stay alive, until the overlay has been hidden for a while.

use std::collections::VecDeque;
use std::sync::{Arc, Weak};

use crate::openvr::{OpenVrError, Overlay, Runtime, Universe, VulkanDevice};
use crate::render::{Quad, QuadKind};
use radar_sar::geometry::Pose;

/// Number of overlays shown at once. Choice: the runtime's compositor draws each of them for each eye.
pub(super) const MAX_SHOWN: usize = 8;
/// Number of overlays, made as they are needed. Choice: twice what is shown at once; the runtime keeps a picture for each.
const MAX_OVERLAYS: usize = 2 * MAX_SHOWN;
/// Pictures per overlay kept alive. Choice: the copy of one may be pending when the next is passed;
/// one more in reserve.
const RETAINED_PICTURES: usize = 3;
/// Calls after which the pictures of a hidden overlay are no longer kept alive. Choice: a second of frames, far more than a copy takes.
const RELEASED_AFTER_CALLS: u64 = 90;
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
    /// The quad shown, or shown last.
    assigned_to: Option<QuadKey>,
    /// Number of the call in which it was shown last.
    shown_at: u64,
    /// The picture of which the runtime has a copy.
    picture: Option<CopiedPicture>,
    /// Pictures that the runtime may still be copying; the newest is last.
    retained: VecDeque<Arc<wgpu::Texture>>,
}

/// The picture that an overlay was given last. It may have been dropped since.
struct CopiedPicture {
    texture: Weak<wgpu::Texture>,
    size: Size,
}

/// A pool of overlays.
pub(super) struct OverlayPool {
    runtime: Option<Arc<Runtime>>,
    slots: Vec<PooledOverlay>,
    /// The runtime has refused a further one.
    is_full: bool,
    calls: u64,
    /// Pictures have two halves, one for each eye.
    is_stereo: bool,
}

impl OverlayPool {
    /// # Errors
    /// The runtime refuses an overlay.
    pub fn new(runtime: &Arc<Runtime>, is_stereo: bool) -> Result<Self, OpenVrError> {
        let mut pool =
            Self { runtime: Some(Arc::clone(runtime)), slots: Vec::new(), is_full: false, calls: 0, is_stereo };
        (0..MAX_SHOWN).try_for_each(|_| pool.add())?;
        Ok(pool)
    }

    /// An empty pool.
    pub fn none() -> Self {
        Self { runtime: None, slots: Vec::new(), is_full: false, calls: 0, is_stereo: false }
    }

    /// One more overlay.
    fn add(&mut self) -> Result<(), OpenVrError> {
        let Some(runtime) = &self.runtime else { return Ok(()) };
        let number = self.slots.len() + 1;
        let overlay =
            Overlay::new(runtime, &format!("radar-chaperone.{number}"), &format!("Radar chaperone {number}"))?;
        if self.is_stereo {
            overlay.set_side_by_side()?;
        }
        self.slots.push(PooledOverlay {
            overlay,
            assigned_to: None,
            shown_at: 0,
            picture: None,
            retained: VecDeque::new(),
        });
        Ok(())
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
        self.calls += 1;
        let wanted: Vec<_> = quads.iter().map(|quad| (quad.key(), size_of(&quad.texture))).take(MAX_SHOWN).collect();
        let (mut handed, mut refused) = (0, None);
        let mut lent = self.assign(&wanted);
        // One more overlay for those that would take another's; a runtime that refuses it has shown how many it has room for.
        let is_foreign = |slot: &Held, quad: Option<usize>| {
            quad.is_some_and(|quad| slot.last.is_some_and(|(key, _)| key != wanted[quad].0))
        };
        while !self.is_full
            && self.slots.len() < MAX_OVERLAYS
            && self.held().iter().zip(&lent).any(|(slot, quad)| is_foreign(slot, *quad))
        {
            if let Err(error) = self.add() {
                log::info!("no further overlay: {error}");
                self.is_full = true;
            }
            lent = self.assign(&wanted);
        }
        for (slot, _) in self.slots.iter_mut().zip(&lent).filter(|(_, quad)| quad.is_none()) {
            refused = slot.overlay.hide().err().or(refused);
            if slot.shown_at + RELEASED_AFTER_CALLS < self.calls {
                slot.retained.clear();
            }
        }
        for (slot, quad) in self.slots.iter_mut().zip(&lent) {
            let Some(quad) = quad.and_then(|index| quads.get(index)) else { continue };
            slot.shown_at = self.calls;
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
        self.slots.iter_mut().map(|slot| slot.overlay.hide()).fold(Ok(()), Result::and)
    }

    /// Drops all pictures after the device was lost.
    pub fn drop_pictures(&mut self) {
        for slot in &mut self.slots {
            slot.picture = None;
            slot.retained.clear();
        }
    }

    /// Destroys the overlays. Returns their pictures, because the runtime may still copy them until
    /// the session is over.
    pub fn end(self) -> Vec<Arc<wgpu::Texture>> {
        self.slots.into_iter().flat_map(|slot| slot.retained).collect()
    }

    fn held(&self) -> Vec<Held> {
        let held = |slot: &PooledOverlay| Held {
            last: slot.assigned_to.zip(slot.picture.as_ref().map(|picture| picture.size)),
            shown_at: slot.shown_at,
        };
        self.slots.iter().map(held).collect()
    }

    fn assign(&self, wanted: &[(QuadKey, Size)]) -> Vec<Option<usize>> {
        assign(&self.held(), wanted)
    }

    /// Number of overlays shown.
    pub fn shown(&self) -> usize {
        self.slots.iter().filter(|slot| slot.overlay.is_shown()).count()
    }
}

impl PooledOverlay {
    /// Shows a quad; returns whether its picture was passed to the runtime.
    fn show_quad(
        &mut self,
        device: &VulkanDevice,
        quad: &Quad,
        raw_from_standing: &Pose,
        is_stereo: bool,
    ) -> Result<bool, OpenVrError> {
        self.assigned_to = Some(quad.key());
        let is_copied = |picture: &CopiedPicture| std::ptr::eq(picture.texture.as_ptr(), Arc::as_ptr(&quad.texture));
        let is_new = !self.picture.as_ref().is_some_and(is_copied);
        if is_new && let Some(texture) = device.texture_handles(&quad.texture) {
            self.overlay.set_texture(&texture)?;
            self.picture = Some(CopiedPicture { texture: Arc::downgrade(&quad.texture), size: size_of(&quad.texture) });
            self.retained.push_back(Arc::clone(&quad.texture));
            while self.retained.len() > RETAINED_PICTURES {
                self.retained.pop_front();
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

/// An overlay: the quad that it shows or showed last with the size of its picture, and when.
#[derive(Debug, Clone, Copy, Default)]
struct Held {
    last: Option<(QuadKey, Size)>,
    shown_at: u64,
}

/// The quad for each overlay: its own, also if it was hidden. Of the others each, in order, gets an overlay without picture; else one
/// whose picture has its size, for which the runtime keeps its copy; else the one hidden longest.
fn assign(held: &[Held], wanted: &[(QuadKey, Size)]) -> Vec<Option<usize>> {
    let own = |key: QuadKey| wanted.iter().position(|(wanted, _)| *wanted == key);
    let mut lent: Vec<Option<usize>> = held.iter().map(|slot| own(slot.last?.0)).collect();
    for (quad, (_, size)) in wanted.iter().enumerate() {
        if lent.contains(&Some(quad)) {
            continue;
        }
        let misfit = |slot: &usize| match held[*slot] {
            Held { last: None, .. } => (0, 0),
            Held { last: Some((_, last)), shown_at } if last == *size => (1, shown_at),
            Held { shown_at, .. } => (2, shown_at),
        };
        let free = (0..held.len()).filter(|slot| lent[*slot].is_none());
        if let Some(slot) = free.min_by_key(misfit) {
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

    /// The assignment where all pictures have one size; the first overlay was shown last.
    fn assigned(held: &[Option<QuadKey>], wanted: &[QuadKey]) -> Vec<Option<usize>> {
        let slot = |(n, key): (usize, &Option<QuadKey>)| Held {
            last: key.map(|key| (key, SMALL)),
            shown_at: (held.len() - n) as u64,
        };
        let held: Vec<_> = held.iter().enumerate().map(slot).collect();
        assign(&held, &wanted.iter().map(|key| (*key, SMALL)).collect::<Vec<_>>())
    }

    #[test]
    fn obstacle_keeps_its_overlay() {
        let [chair, table] = [1, 2].map(|id| (QuadKind::Object, id));
        let wall = (QuadKind::Wall, 3);
        assert_eq!(assigned(&[None; 3], &[chair, table]), [Some(0), Some(1), None]);
        // The table is nearer now and comes first; a wall takes the free overlay.
        assert_eq!(assigned(&[Some(chair), Some(table), None], &[table, chair, wall]), [Some(1), Some(0), Some(2)]);
        // An overlay without picture, before one of which the obstacle may come back.
        assert_eq!(assigned(&[Some(chair), Some(table), None], &[wall]), [None, None, Some(0)]);
        assert_eq!(assigned(&[Some(chair), Some(table)], &[wall]), [None, Some(0)], "hidden longest");
        // A footprint has another key than its panel.
        assert_eq!(assigned(&[Some(chair), None], &[(QuadKind::Footprint, 1)]), [None, Some(0)]);
        assert_eq!(assigned(&[Some(chair)], &[table, wall]), [Some(0)], "what does not fit is left out");
        assert_eq!(assigned(&[Some(table), Some(chair)], &[]), [None, None]);
    }

    #[test]
    fn overlay_with_a_picture_of_the_same_size_is_preferred() {
        let [chair, table, shelf] = [1, 2, 3].map(|id| (QuadKind::Object, id));
        let [lamp, sofa] = [4, 5].map(|id| (QuadKind::Object, id));
        let held = [(lamp, LARGE), (sofa, SMALL), (shelf, SMALL)];
        let held = held.map(|quad| Held { last: Some(quad), shown_at: 1 });
        let wanted = [(chair, SMALL), (shelf, SMALL), (table, SMALL)];
        assert_eq!(assign(&held, &wanted), [Some(2), Some(0), Some(1)]);
        assert_eq!(assign(&[held[0], Held::default()], &wanted[..1]), [None, Some(0)]);
    }
}

//! The overlays of the client.

use std::collections::{BTreeMap, BTreeSet};
use std::thread::ThreadId;

use radar_sar::geometry::Pose;

use crate::events::Events;
use crate::eyes::Edges;
use crate::report::Report;
use crate::sys;
use crate::vulkan::{Copied, Copier};

/// Limit of overlays.
pub const MAX_OVERLAYS: usize = sys::k_unMaxOverlayCount as usize;
/// First handle. Choice: unlike a small number or a pointer, to detect mix-ups.
const FIRST_HANDLE: u64 = 0x5354_4e44_0000_0001;

/// Placement of an overlay.
#[derive(Debug, Clone, Copy)]
pub enum Transform {
    /// Not set.
    Unset,
    /// Fixed in a universe.
    Absolute { origin: u32, universe_from_overlay: Pose },
    /// Fixed to a device.
    Device { device: u32, device_from_overlay: Pose },
    /// Covers the view of one eye. The direction of the matrix is configurable.
    Projection { origin: u32, matrix: Pose, edges: Edges, is_left: bool },
}

/// An overlay.
#[derive(Clone)]
pub struct Overlay {
    pub key: String,
    pub name: String,
    pub shown: bool,
    /// Whether it is a dashboard tab, which SteamVR places.
    pub dashboard: bool,
    pub flags: u32,
    pub look: Look,
    pub transform: Transform,
    pub texture: Option<Texture>,
    pub input: Input,
}

/// How an overlay's texture is drawn.
#[derive(Debug, Clone, Copy)]
pub struct Look {
    pub alpha: f32,
    pub color: [f32; 3],
    pub width_m: f32,
    pub texel_aspect: f32,
    /// u and v at the upper left, u and v at the lower right.
    pub bounds: [f32; 4],
    pub sort_order: u32,
    pub color_space: u32,
    pub curvature: f32,
}

impl Default for Look {
    fn default() -> Self {
        Self {
            alpha: 1.0,
            color: [1.0; 3],
            width_m: 1.0,
            texel_aspect: 1.0,
            bounds: [0.0, 0.0, 1.0, 1.0],
            sort_order: 0,
            color_space: sys::EColorSpace_ColorSpace_Auto,
            curvature: 0.0,
        }
    }
}

/// Pointer input on an overlay.
#[derive(Clone)]
pub struct Input {
    pub method: u32,
    pub mouse_scale: [f32; 2],
    /// Events for PollNextOverlayEvent.
    pub events: Events,
}

/// The texture of an overlay.
#[derive(Clone)]
pub struct Texture {
    pub size: [u32; 2],
    pub color_space: u32,
    /// `None` if the copy failed.
    pub copied: Option<Copied>,
}

impl Overlay {
    fn new(key: &str, name: &str) -> Self {
        Self {
            key: key.to_owned(),
            name: name.to_owned(),
            shown: false,
            dashboard: false,
            flags: 0,
            look: Look::default(),
            transform: Transform::Unset,
            texture: None,
            input: Input { method: 0, mouse_scale: [1.0; 2], events: Events::default() },
        }
    }

    /// Whether a flag is set.
    pub fn has(&self, flag: sys::VROverlayFlags) -> bool {
        self.flags & flag != 0
    }
}

/// Key of a dashboard tab's thumbnail.
pub fn thumbnail_key(key: &str) -> String {
    format!("{key}.thumbnail")
}

/// All overlays, and the copier of their textures.
#[derive(Default)]
pub struct Overlays {
    by_handle: BTreeMap<u64, Overlay>,
    created: u64,
    /// Whether the dashboard is open.
    pub dashboard_open: bool,
    /// The thread that submits textures.
    pub thread: Option<ThreadId>,
    pub copier: Option<Copier>,
}

impl Overlays {
    /// Number of overlays.
    pub fn len(&self) -> usize {
        self.by_handle.len()
    }

    /// Visible overlays outside the dashboard.
    pub fn visible(&self) -> impl Iterator<Item = &Overlay> {
        self.by_handle.values().filter(|overlay| overlay.shown && !overlay.dashboard)
    }

    /// The active tab of an open dashboard: the first that was created.
    pub fn active_tab(&mut self) -> Option<(u64, &mut Overlay)> {
        // A thumbnail is created after its tab.
        let (handle, tab) = self.by_handle.iter_mut().find(|(_, overlay)| overlay.dashboard)?;
        Some((*handle, tab))
    }

    /// Whether an overlay is visible: a tab only while it is active.
    pub fn is_seen(&mut self, handle: u64) -> bool {
        let is_active = self.dashboard_open && self.active_tab().is_some_and(|(tab, _)| tab == handle);
        is_active || self.by_handle.get(&handle).is_some_and(|overlay| overlay.shown && !overlay.dashboard)
    }

    /// The handle of a key.
    pub fn handle(&self, key: &str) -> Option<u64> {
        self.by_handle.iter().find(|(_, overlay)| overlay.key == key).map(|(handle, _)| *handle)
    }

    /// Creates an overlay.
    pub fn create(&mut self, key: &str, name: &str) -> u64 {
        let handle = FIRST_HANDLE + self.created;
        self.created += 1;
        self.by_handle.insert(handle, Overlay::new(key, name));
        handle
    }

    /// The overlay of a handle.
    ///
    /// # Errors
    /// What is wrong with the handle.
    pub fn get(&mut self, handle: u64) -> Result<&mut Overlay, &'static str> {
        let was_created = (FIRST_HANDLE..FIRST_HANDLE + self.created).contains(&handle);
        let why = if was_created { "destroyed overlay handle" } else { "unknown overlay handle" };
        self.by_handle.get_mut(&handle).ok_or(why)
    }

    /// Destroys an existing overlay, a dashboard tab together with its thumbnail.
    pub fn destroy(&mut self, handle: u64) {
        if let Some(overlay) = self.by_handle.remove(&handle).filter(|overlay| overlay.dashboard) {
            self.by_handle.retain(|_, other| !(other.dashboard && other.key == thumbnail_key(&overlay.key)));
        }
    }

    /// Whether the device of the textures has reported its loss.
    pub fn is_device_lost(&mut self) -> bool {
        self.copier.as_mut().is_some_and(Copier::is_lost)
    }

    /// Drops all copies without freeing them, because their device may no longer exist.
    pub fn forget_copies(&mut self) {
        self.by_handle.values_mut().filter_map(|overlay| overlay.texture.as_mut()).for_each(|t| t.copied = None);
        std::mem::forget(self.copier.take());
    }

    /// Frees the copies.
    pub fn free(&mut self) {
        self.by_handle.clear();
        if let Some(copier) = self.copier.take() {
            copier.free();
        }
    }

    /// Checks the state at the client's wait for the next frame.
    pub fn check_frame(&self, report: &mut Report) {
        let mut eyes = BTreeSet::new();
        let mut count = 0;
        for overlay in self.visible() {
            count += 1;
            if overlay.texture.is_none() {
                report.violation("shown without a texture", &overlay.key);
            }
            match overlay.transform {
                Transform::Unset => report.violation("shown without a transform", &overlay.key),
                Transform::Projection { is_left, .. } => drop(eyes.insert(is_left)),
                _ => {}
            }
        }
        if eyes.len() == 1 {
            report.violation("projection for one eye only", format!("left: {}", eyes.contains(&true)));
        }
        report.most_visible = report.most_visible.max(count);
    }
}

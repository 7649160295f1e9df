//! Overlays as the runtime knows them.

use std::collections::{BTreeMap, BTreeSet};
use std::thread::ThreadId;

use radar_sar::geometry::Pose;

use crate::events::Events;
use crate::eyes::Edges;
use crate::report::Report;
use crate::sys;
use crate::vulkan::{Copied, Copier};

/// Overlays there may be.
pub const MAX_OVERLAYS: usize = sys::k_unMaxOverlayCount as usize;
/// A first handle that is unlike a small number or a pointer.
const FIRST_HANDLE: u64 = 0x5354_4e44_0000_0001;

/// Where an overlay is.
#[derive(Debug, Clone, Copy)]
pub enum Transform {
    /// Not said.
    Unset,
    /// In a universe.
    Absolute { origin: u32, universe_from_overlay: Pose },
    /// On a device.
    Device { device: u32, device_from_overlay: Pose },
    /// Over the whole view of one eye. Which way the matrix goes is a setting.
    Projection { origin: u32, matrix: Pose, edges: Edges, is_left: bool },
}

/// An overlay.
#[derive(Clone)]
pub struct Overlay {
    pub key: String,
    pub name: String,
    pub shown: bool,
    /// A tab of the dashboard, whose place is SteamVR's.
    pub dashboard: bool,
    pub alpha: f32,
    pub color: [f32; 3],
    pub width_m: f32,
    pub texel_aspect: f32,
    /// u and v at the upper left, u and v at the lower right.
    pub bounds: [f32; 4],
    pub sort_order: u32,
    pub flags: u32,
    pub color_space: u32,
    pub curvature: f32,
    pub transform: Transform,
    pub texture: Option<Texture>,
    pub input_method: u32,
    pub mouse_scale: [f32; 2],
    /// Of this overlay, for PollNextOverlayEvent.
    pub events: Events,
}

/// The texture that an overlay shows.
#[derive(Clone)]
pub struct Texture {
    pub size: [u32; 2],
    pub color_space: u32,
    /// Missing where the copy could not be made.
    pub copied: Option<Copied>,
}

impl Overlay {
    fn new(key: &str, name: &str) -> Self {
        Self {
            key: key.to_owned(),
            name: name.to_owned(),
            shown: false,
            dashboard: false,
            alpha: 1.0,
            color: [1.0; 3],
            width_m: 1.0,
            texel_aspect: 1.0,
            bounds: [0.0, 0.0, 1.0, 1.0],
            sort_order: 0,
            flags: 0,
            color_space: sys::EColorSpace_ColorSpace_Auto,
            curvature: 0.0,
            transform: Transform::Unset,
            texture: None,
            input_method: 0,
            mouse_scale: [1.0; 2],
            events: Events::default(),
        }
    }

    /// Whether a flag is set.
    pub fn has(&self, flag: sys::VROverlayFlags) -> bool {
        self.flags & flag != 0
    }
}

/// The key of a dashboard tab's thumbnail.
pub fn thumbnail_key(key: &str) -> String {
    format!("{key}.thumbnail")
}

/// All overlays, and how their textures are copied.
#[derive(Default)]
pub struct Overlays {
    by_handle: BTreeMap<u64, Overlay>,
    created: u64,
    /// Whether the dashboard is open.
    pub dashboard_open: bool,
    /// The thread that hands textures over.
    pub thread: Option<ThreadId>,
    pub copier: Option<Copier>,
}

impl Overlays {
    /// How many there are.
    pub fn len(&self) -> usize {
        self.by_handle.len()
    }

    /// Those that are shown and not in the dashboard.
    pub fn visible(&self) -> impl Iterator<Item = &Overlay> {
        self.by_handle.values().filter(|overlay| overlay.shown && !overlay.dashboard)
    }

    /// The tab in front when the dashboard is open: the first that was made.
    pub fn active_tab(&mut self) -> Option<(u64, &mut Overlay)> {
        // A thumbnail is made after its tab.
        let (handle, tab) = self.by_handle.iter_mut().find(|(_, overlay)| overlay.dashboard)?;
        Some((*handle, tab))
    }

    /// Whether an overlay is seen: a tab while it is in front.
    pub fn is_seen(&mut self, handle: u64) -> bool {
        let is_active = self.dashboard_open && self.active_tab().is_some_and(|(tab, _)| tab == handle);
        is_active || self.by_handle.get(&handle).is_some_and(|overlay| overlay.shown && !overlay.dashboard)
    }

    /// The handle of a key.
    pub fn handle(&self, key: &str) -> Option<u64> {
        self.by_handle.iter().find(|(_, overlay)| overlay.key == key).map(|(handle, _)| *handle)
    }

    /// Makes one.
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

    /// Destroys one that there is, a tab of the dashboard with its thumbnail.
    pub fn destroy(&mut self, handle: u64) {
        if let Some(overlay) = self.by_handle.remove(&handle).filter(|overlay| overlay.dashboard) {
            self.by_handle.retain(|_, other| !(other.dashboard && other.key == thumbnail_key(&overlay.key)));
        }
    }

    /// Whether the device that textures come from has said that it is lost.
    pub fn is_device_lost(&mut self) -> bool {
        self.copier.as_mut().is_some_and(Copier::is_lost)
    }

    /// Forgets all copies without touching them: their device may be gone.
    pub fn forget_copies(&mut self) {
        self.by_handle.values_mut().filter_map(|overlay| overlay.texture.as_mut()).for_each(|t| t.copied = None);
        std::mem::forget(self.copier.take());
    }

    /// Frees what the copies take.
    pub fn free(&mut self) {
        self.by_handle.clear();
        if let Some(copier) = self.copier.take() {
            copier.free();
        }
    }

    /// What must hold when the client waits for the next frame.
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

//! The dashboard: opened and closed by commands, with the client's first tab active; laser pointer
//! input; images of the tab as submitted.

use std::path::Path;

use crate::commands::Touch;
use crate::events::event;
use crate::overlay::{Overlay, thumbnail_key};
use crate::report::write_whole;
use crate::sys;
use crate::world::World;

/// No device.
const NOBODY: u32 = u32::MAX;
/// `VRMouseButton_Left`: the trigger.
const TRIGGER: u32 = 1;

/// Images of a tab and of its button, to be read outside the lock.
pub struct TabPicture {
    pub name: String,
    tab: Overlay,
    thumbnail: Option<Overlay>,
}

impl World {
    /// Opens or closes the dashboard.
    pub fn open_dashboard(&mut self, open: bool) {
        if open == self.overlays.dashboard_open {
            return;
        }
        self.overlays.dashboard_open = open;
        let [kind, tab_kind] = match open {
            true => [sys::EVREventType_VREvent_DashboardActivated, sys::EVREventType_VREvent_OverlayShown],
            false => [sys::EVREventType_VREvent_DashboardDeactivated, sys::EVREventType_VREvent_OverlayHidden],
        };
        self.send(event(kind, NOBODY));
        self.push_tab_event(event(tab_kind, NOBODY));
    }

    /// Pointer input on the active tab, at a position from its upper left in units of its mouse
    /// scale.
    pub fn touch(&mut self, touch: Touch, x: f32, y: f32) {
        if !self.overlays.dashboard_open {
            return eprintln!("fake runtime: the dashboard is closed: pointer input ignored");
        }
        let Some(tab) = self.overlays.active_tab().map(|(_, tab)| tab) else {
            return eprintln!("fake runtime: there is no tab for pointer input");
        };
        if tab.input.method != sys::VROverlayInputMethod_Mouse {
            return eprintln!("fake runtime: {} accepts no mouse input", tab.key);
        }
        // As in SteamVR: from the lower left.
        let at = [x, tab.input.mouse_scale[1] - y];
        let kind = match touch {
            Touch::Move => sys::EVREventType_VREvent_MouseMove,
            Touch::Down => sys::EVREventType_VREvent_MouseButtonDown,
            Touch::Up => sys::EVREventType_VREvent_MouseButtonUp,
            Touch::Leave => sys::EVREventType_VREvent_FocusLeave,
            Touch::Click => {
                let steps = [Touch::Move, Touch::Down, Touch::Up];
                return steps.into_iter().for_each(|step| self.touch(step, x, y));
            }
        };
        let mut told = event(kind, 0);
        let is_button = matches!(touch, Touch::Down | Touch::Up);
        let mouse =
            sys::VREvent_Mouse_t { x: at[0], y: at[1], button: if is_button { TRIGGER } else { 0 }, cursorIndex: 0 };
        if !matches!(touch, Touch::Leave) {
            // SAFETY: the union holds mouse data for these kinds; it need not be aligned.
            unsafe { (&raw mut told.data).cast::<sys::VREvent_Mouse_t>().write_unaligned(mouse) };
        }
        self.push_tab_event(told);
    }

    fn push_tab_event(&mut self, event: sys::VREvent_t) {
        let now_ns = crate::clock::now_ns();
        let Some((_, tab)) = self.overlays.active_tab() else { return };
        if !tab.input.events.push(now_ns, event) {
            self.report.events_dropped += 1;
        }
    }

    /// The active tab as submitted, whether the dashboard is open or not.
    ///
    /// # Errors
    /// There is no tab.
    pub fn tab_picture(&mut self, name: &str) -> Result<TabPicture, String> {
        let tab = self.overlays.active_tab().map(|(_, tab)| tab.clone()).ok_or("there is no tab")?;
        let thumbnail = self.overlays.handle(&thumbnail_key(&tab.key));
        let thumbnail = thumbnail.and_then(|handle| self.overlays.get(handle).ok().cloned());
        Ok(TabPicture { name: name.to_owned(), tab, thumbnail })
    }
}

impl TabPicture {
    /// Writes `NAME_thumbnail.png`, if it exists, and then `NAME.png`.
    ///
    /// # Errors
    /// What is missing or failed.
    pub fn write(&self, folder: &Path) -> Result<(), String> {
        std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        if let Some(thumbnail) = self.thumbnail.as_ref().filter(|thumbnail| thumbnail.texture.is_some()) {
            write(thumbnail, &folder.join(format!("{}_thumbnail.png", self.name)))?;
        }
        write(&self.tab, &folder.join(format!("{}.png", self.name)))
    }
}

fn write(overlay: &Overlay, path: &Path) -> Result<(), String> {
    let copied = overlay.texture.as_ref().and_then(|texture| texture.copied.as_ref());
    let copied = copied.ok_or_else(|| format!("{} has no picture", overlay.key))?;
    let mut pixels = copied.read()?;
    if [ash::vk::Format::B8G8R8A8_SRGB, ash::vk::Format::B8G8R8A8_UNORM].contains(&copied.image.format) {
        pixels.chunks_exact_mut(4).for_each(|pixel| pixel.swap(0, 2));
    }
    let image = image::RgbaImage::from_raw(copied.image.width, copied.image.height, pixels);
    let mut bytes = std::io::Cursor::new(Vec::new());
    let encoded = image.ok_or("an image has too few pixels")?.write_to(&mut bytes, image::ImageFormat::Png);
    encoded.map_err(|error| error.to_string())?;
    write_whole(path, &bytes.into_inner()).map_err(|error| format!("{}: {error}", path.display()))
}

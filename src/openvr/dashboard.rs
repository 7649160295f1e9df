//! A dashboard tab: its image, the image of its button, and laser pointer input.

use std::ffi::CString;
use std::marker::PhantomData;
use std::sync::Arc;

use super::error::OpenVrError;
use super::overlay::{check_call, submit_texture};
use super::runtime::{Runtime, call};
use super::sys;
use super::vulkan::VulkanTexture;

/// Width of the tab, metres. Choice: as wide as other tabs.
const TAB_WIDTH_M: f32 = 2.4;

/// Input on the tab. Positions are pixels from the upper left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TabEvent {
    /// The pointer moved to this position.
    Moved([f32; 2]),
    /// The trigger was pressed at this position.
    Pressed([f32; 2]),
    /// The trigger was released at this position.
    Released([f32; 2]),
    /// The pointer left the tab.
    Left,
    /// The tab was shown or hidden.
    Visibility,
    /// Any other event.
    Other,
}

/// A dashboard tab. Destroyed when dropped.
pub struct DashboardTab {
    /// Keeps the function table valid.
    _runtime: Arc<Runtime>,
    table: &'static sys::VR_IVROverlay_FnTable,
    main: sys::VROverlayHandle_t,
    thumbnail: sys::VROverlayHandle_t,
    height_px: f32,
    /// Makes the type neither `Send` nor `Sync`.
    thread: PhantomData<*const ()>,
}

impl DashboardTab {
    /// Creates a tab for images of this size. The key must be unique in SteamVR.
    ///
    /// # Errors
    /// The runtime rejects the call, or has no dashboard.
    pub fn new(runtime: &Arc<Runtime>, key: &str, name: &str, size_px: [u32; 2]) -> Result<Self, OpenVrError> {
        let text = |text: &str| CString::new(text).unwrap_or_default();
        let (key, name) = (text(key), text(name));
        let missing = || OpenVrError::Interface(sys::IVROverlay_Version.to_string_lossy().into_owned());
        let table = runtime.overlay.ok_or_else(missing)?;
        let (mut main, mut thumbnail) = (0, 0);
        let (key, name) = (key.as_ptr().cast_mut(), name.as_ptr().cast_mut());
        let error = call!(table, CreateDashboardOverlay(key, name, &mut main, &mut thumbnail));
        check_call(table, "to make a tab of the dashboard", error)?;
        let [width_px, height_px] = size_px.map(|px| px as f32);
        let tab = Self { _runtime: Arc::clone(runtime), table, main, thumbnail, height_px, thread: PhantomData };
        let error = call!(table, SetOverlayWidthInMeters(main, TAB_WIDTH_M));
        check_call(table, "the width of a tab", error)?;
        let error = call!(table, SetOverlayInputMethod(main, sys::VROverlayInputMethod_Mouse));
        check_call(table, "a pointer on a tab", error)?;
        let mut scale = sys::HmdVector2_t { v: [width_px, height_px] };
        check_call(table, "the scale of a tab's pointer", call!(table, SetOverlayMouseScale(main, &mut scale)))?;
        Ok(tab)
    }

    /// Next event, if any.
    pub fn next_event(&self) -> Option<TabEvent> {
        let mut event = std::mem::MaybeUninit::<sys::VREvent_t>::zeroed();
        let length = size_of::<sys::VREvent_t>() as u32;
        if !call!(self.table, PollNextOverlayEvent(self.main, event.as_mut_ptr(), length)) {
            return None;
        }
        // SAFETY: all zeros is an event of kind 0, and the kind is a plain number whatever the
        // runtime wrote.
        let kind = unsafe { (*event.as_ptr()).eventType } as sys::EVREventType;
        // SAFETY: the data is plain numbers whatever the runtime wrote. It is used only if the kind
        // states that it is mouse data.
        let mouse =
            unsafe { std::ptr::addr_of!((*event.as_ptr()).data).cast::<sys::VREvent_Mouse_t>().read_unaligned() };
        // The runtime counts from the lower edge.
        let at = [mouse.x, self.height_px - mouse.y];
        Some(match kind {
            sys::EVREventType_VREvent_MouseMove => TabEvent::Moved(at),
            sys::EVREventType_VREvent_MouseButtonDown => TabEvent::Pressed(at),
            sys::EVREventType_VREvent_MouseButtonUp => TabEvent::Released(at),
            sys::EVREventType_VREvent_FocusLeave => TabEvent::Left,
            sys::EVREventType_VREvent_OverlayShown | sys::EVREventType_VREvent_OverlayHidden => TabEvent::Visibility,
            _ => TabEvent::Other,
        })
    }

    /// Whether it is shown.
    pub fn is_visible(&self) -> bool {
        call!(self.table, IsOverlayVisible(self.main))
    }

    /// Sets its image, as [`super::Overlay::set_texture`].
    ///
    /// # Errors
    /// The runtime rejects the call.
    pub fn set_picture(&self, texture: &VulkanTexture) -> Result<(), OpenVrError> {
        submit_texture(self.table, self.main, texture)
    }

    /// Sets the image of its button.
    ///
    /// # Errors
    /// The runtime rejects the call.
    pub fn set_thumbnail(&self, texture: &VulkanTexture) -> Result<(), OpenVrError> {
        submit_texture(self.table, self.thumbnail, texture)
    }
}

impl Drop for DashboardTab {
    fn drop(&mut self) {
        // The runtime destroys the thumbnail too. If the runtime has exited, both no longer exist.
        call!(self.table, DestroyOverlay(self.main));
    }
}

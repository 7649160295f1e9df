//! Overlays: rectangles that the runtime draws over everything, each with a texture, a pose and a
//! brightness.
//!
//! An overlay belongs to the thread that created it, which must be the one that submits to the
//! graphics queue: the runtime submits its copy of a texture on the same queue, within
//! [`Overlay::set_texture`]. The last values are cached, so setting the same value again makes no
//! call to the runtime.

use std::cell::Cell;
use std::ffi::{CString, c_void};
use std::marker::PhantomData;
use std::sync::Arc;

use super::error::{OpenVrError, described};
use super::matrix::matrix;
use super::poses::Universe;
use super::runtime::{Runtime, call, string_from};
use super::sys::{self, HEADSET};
use super::vulkan::VulkanTexture;
use radar_sar::geometry::Pose;

/// The eye of a projection overlay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EyeSide {
    /// Left.
    Left,
    /// Right.
    Right,
}

/// An overlay. Destroyed when dropped.
pub struct Overlay {
    /// Keeps the function table valid.
    _runtime: Arc<Runtime>,
    table: &'static sys::VR_IVROverlay_FnTable,
    handle: sys::VROverlayHandle_t,
    is_shown: Cell<bool>,
    width_m: Cell<f64>,
    alpha: Cell<f32>,
    texel_aspect: Cell<f64>,
    sort_order: Cell<u32>,
    pose: Cell<Option<(Universe, Pose)>>,
    /// Makes the type neither `Send` nor `Sync`.
    thread: PhantomData<*const ()>,
}

impl Overlay {
    /// Creates a hidden overlay for premultiplied colours. The key must be unique in SteamVR.
    ///
    /// # Errors
    /// The key is in use (another instance of this program is running), the runtime has no room for
    /// it, or the runtime has exited.
    pub fn new(runtime: &Arc<Runtime>, key: &str, name: &str) -> Result<Self, OpenVrError> {
        let text = |text: &str| CString::new(text).unwrap_or_default();
        let (key, name) = (text(key), text(name));
        let missing = || OpenVrError::Interface(sys::IVROverlay_Version.to_string_lossy().into_owned());
        let table = runtime.overlay.ok_or_else(missing)?;
        let mut handle = 0;
        let error = call!(table, CreateOverlay(key.as_ptr().cast_mut(), name.as_ptr().cast_mut(), &mut handle));
        check_call(table, "to make an overlay", error)?;
        let overlay = Self {
            _runtime: Arc::clone(runtime),
            table,
            handle,
            is_shown: Cell::new(false),
            width_m: Cell::new(f64::NAN),
            alpha: Cell::new(f32::NAN),
            texel_aspect: Cell::new(1.0),
            sort_order: Cell::new(0),
            pose: Cell::new(None),
            thread: PhantomData,
        };
        overlay.set_flag(sys::VROverlayFlags_IsPremultiplied)?;
        // Otherwise SteamVR draws a plain backside. A runtime before SDK 2.15 refuses the flag, and draws none.
        if let Err(error) = overlay.set_flag(sys::VROverlayFlags_NoBackside) {
            log::debug!("{error}");
        }
        Ok(overlay)
    }

    /// Shows the left half of the texture to the left eye and the right half to the right eye.
    ///
    /// # Errors
    /// The runtime rejects the call.
    pub fn set_side_by_side(&self) -> Result<(), OpenVrError> {
        self.set_flag(sys::VROverlayFlags_SideBySide_Parallel)
    }

    fn set_flag(&self, flag: sys::VROverlayFlags) -> Result<(), OpenVrError> {
        let error = call!(self.table, SetOverlayFlag(self.handle, flag, true));
        check_call(self.table, "a flag of an overlay", error)
    }

    /// Sets its pose `universe_from_overlay`: origin at its centre, +x to the right and +y up on
    /// it, +z towards the viewer.
    ///
    /// # Errors
    /// The runtime rejects the call.
    pub fn set_pose(&self, universe: Universe, pose: &Pose) -> Result<(), OpenVrError> {
        if self.pose.get() == Some((universe, *pose)) {
            return Ok(());
        }
        let mut transform = matrix(pose);
        let error = call!(self.table, SetOverlayTransformAbsolute(self.handle, universe.origin(), &mut transform));
        check_call(self.table, "the pose of an overlay", error)?;
        self.pose.set(Some((universe, *pose)));
        Ok(())
    }

    /// Fixes it to the head: `head_from_overlay`.
    ///
    /// # Errors
    /// The runtime rejects the call.
    pub fn set_pose_on_head(&self, pose: &Pose) -> Result<(), OpenVrError> {
        let mut transform = matrix(pose);
        let error = call!(self.table, SetOverlayTransformTrackedDeviceRelative(self.handle, HEADSET, &mut transform));
        self.pose.set(None);
        check_call(self.table, "the pose of an overlay on the head", error)
    }

    /// Makes it fill the view of one eye. `pose` and `tangents` (left, right, top, bottom as in
    /// `GetProjectionRaw`) are those that the texture was drawn with.
    ///
    /// # Errors
    /// The runtime rejects the call, or does not support projection overlays.
    pub fn set_projection(
        &self,
        universe: Universe,
        pose: &Pose,
        tangents: [f64; 4],
        side: EyeSide,
    ) -> Result<(), OpenVrError> {
        let mut transform = matrix(pose);
        let [left, right, top, bottom] = tangents.map(|t| t as f32);
        let mut projection = sys::VROverlayProjection_t { fLeft: left, fRight: right, fTop: top, fBottom: bottom };
        let eye = match side {
            EyeSide::Left => sys::EVREye_Eye_Left,
            EyeSide::Right => sys::EVREye_Eye_Right,
        };
        let error = call!(
            self.table,
            SetOverlayTransformProjection(self.handle, universe.origin(), &mut transform, &mut projection, eye)
        );
        self.pose.set(None);
        check_call(self.table, "the projection of an overlay", error)
    }

    /// Sets its width, metres. The height follows from the aspect ratio of the texture.
    ///
    /// # Errors
    /// The runtime rejects the call.
    pub fn set_width_m(&self, width_m: f64) -> Result<(), OpenVrError> {
        if self.width_m.get() == width_m {
            return Ok(());
        }
        let error = call!(self.table, SetOverlayWidthInMeters(self.handle, width_m as f32));
        check_call(self.table, "the width of an overlay", error)?;
        self.width_m.set(width_m);
        Ok(())
    }

    /// Sets the width of a texel over its height. The overlay's height follows from this, its width
    /// and the texture.
    ///
    /// # Errors
    /// The runtime rejects the call.
    pub fn set_texel_aspect(&self, aspect: f64) -> Result<(), OpenVrError> {
        if self.texel_aspect.get() == aspect {
            return Ok(());
        }
        let error = call!(self.table, SetOverlayTexelAspect(self.handle, aspect as f32));
        check_call(self.table, "the shape of an overlay's pixels", error)?;
        self.texel_aspect.set(aspect);
        Ok(())
    }

    /// Sets its brightness, 0 to 1.
    ///
    /// # Errors
    /// The runtime rejects the call.
    pub fn set_alpha(&self, alpha: f32) -> Result<(), OpenVrError> {
        if self.alpha.get() == alpha {
            return Ok(());
        }
        let error = call!(self.table, SetOverlayAlpha(self.handle, alpha));
        check_call(self.table, "the brightness of an overlay", error)?;
        self.alpha.set(alpha);
        Ok(())
    }

    /// Sets its sort order. Overlays with greater numbers are drawn over those with smaller ones.
    ///
    /// # Errors
    /// The runtime rejects the call.
    pub fn set_sort_order(&self, order: u32) -> Result<(), OpenVrError> {
        if self.sort_order.get() == order {
            return Ok(());
        }
        let error = call!(self.table, SetOverlaySortOrder(self.handle, order));
        check_call(self.table, "the order of an overlay", error)?;
        self.sort_order.set(order);
        Ok(())
    }

    /// Sets its texture. The runtime copies it on the queue given in `texture`. The texture must be
    /// in the copy-source layout, and must stay alive until the copy is done.
    ///
    /// # Errors
    /// The runtime rejects the call.
    pub fn set_texture(&self, texture: &VulkanTexture) -> Result<(), OpenVrError> {
        submit_texture(self.table, self.handle, texture)
    }

    /// Shows it.
    ///
    /// # Errors
    /// The runtime rejects the call.
    pub fn show(&self) -> Result<(), OpenVrError> {
        if self.is_shown.get() {
            return Ok(());
        }
        check_call(self.table, "to show an overlay", call!(self.table, ShowOverlay(self.handle)))?;
        self.is_shown.set(true);
        Ok(())
    }

    /// Hides it.
    ///
    /// # Errors
    /// The runtime rejects the call.
    pub fn hide(&self) -> Result<(), OpenVrError> {
        if !self.is_shown.get() {
            return Ok(());
        }
        check_call(self.table, "to hide an overlay", call!(self.table, HideOverlay(self.handle)))?;
        self.is_shown.set(false);
        Ok(())
    }

    /// Whether it is shown.
    pub fn is_shown(&self) -> bool {
        self.is_shown.get()
    }

    /// Whether the runtime still knows this overlay. It does not if the runtime exited
    /// unexpectedly.
    pub fn exists(&self) -> bool {
        let mut alpha = 0.0;
        let error = call!(self.table, GetOverlayAlpha(self.handle, &mut alpha));
        error == sys::EVROverlayError_VROverlayError_None
    }
}

impl Drop for Overlay {
    fn drop(&mut self) {
        // If the runtime has exited, the overlay no longer exists.
        call!(self.table, DestroyOverlay(self.handle));
    }
}

/// Hands a texture to the runtime for an overlay.
pub(super) fn submit_texture(
    table: &'static sys::VR_IVROverlay_FnTable,
    overlay: sys::VROverlayHandle_t,
    texture: &VulkanTexture,
) -> Result<(), OpenVrError> {
    let pointer = |handle: u64| handle as usize as *mut c_void;
    let mut data = sys::VRVulkanTextureData_t {
        m_nImage: texture.image,
        m_pDevice: pointer(texture.device).cast(),
        m_pPhysicalDevice: pointer(texture.physical_device).cast(),
        m_pInstance: pointer(texture.instance).cast(),
        m_pQueue: pointer(texture.queue).cast(),
        m_nQueueFamilyIndex: texture.queue_family,
        m_nWidth: texture.width,
        m_nHeight: texture.height,
        m_nFormat: texture.format,
        m_nSampleCount: texture.samples,
    };
    let mut handed = sys::Texture_t {
        handle: (&raw mut data).cast(),
        eType: sys::ETextureType_TextureType_Vulkan,
        eColorSpace: sys::EColorSpace_ColorSpace_Auto,
    };
    let error = call!(table, SetOverlayTexture(overlay, &mut handed));
    check_call(table, "the picture of an overlay", error)
}

pub(super) fn check_call(
    table: &sys::VR_IVROverlay_FnTable,
    call: &'static str,
    error: sys::EVROverlayError,
) -> Result<(), OpenVrError> {
    if error == sys::EVROverlayError_VROverlayError_None {
        return Ok(());
    }
    let name = string_from(call!(table, GetOverlayErrorNameFromEnum(error)));
    Err(OpenVrError::Call { call, name: described(i64::from(error), name.as_deref(), None) })
}

//! Overlay for a notice in front of the wearer's eyes: below the centre of the view, head-locked,
//! with a fade.

use std::sync::Arc;

use glam::{DQuat, DVec3};

use crate::openvr::{OpenVrError, Overlay, Runtime, VulkanTexture};
use crate::panel::Notice;
use radar_sar::geometry::Pose;

/// Distance from the eyes, and depth below the straight view so that it hides little of the game,
/// metres. Choice: about where headsets focus, and 17° down.
const DISTANCE_M: f64 = 1.2;
const BELOW_M: f64 = 0.36;
/// Width, metres. Choice: letters of 1.5°, which any headset resolves.
const WIDTH_M: f64 = 0.82;
/// Duration of a fade, nanoseconds. Choice: sudden lights startle; slower, a notice of 3 s would
/// not reach its brightness for long.
const FADE_NS: i64 = 400_000_000;
/// Sort order: in front of all warnings. Choice: above the panels' orders of 0 and 1, with room for
/// other programs between.
const SORT_ORDER: u32 = 1000;

/// The notice's overlay.
pub(super) struct NoticeOverlay {
    overlay: Overlay,
    /// The notice that its picture shows.
    picture_of: Option<Notice>,
    alpha: f32,
    turned_ns: i64,
}

impl NoticeOverlay {
    /// # Errors
    /// The runtime refuses.
    pub fn new(runtime: &Arc<Runtime>) -> Result<Self, OpenVrError> {
        let overlay = Overlay::new(runtime, "radar-chaperone.notice", "Radar chaperone, notice")?;
        overlay.set_width_m(WIDTH_M)?;
        overlay.set_sort_order(SORT_ORDER)?;
        let middle = DVec3::new(0.0, -BELOW_M, -DISTANCE_M);
        // Facing the eyes.
        overlay.set_pose_on_head(&Pose::new(middle, DQuat::from_rotation_x(-(BELOW_M / DISTANCE_M).atan())))?;
        Ok(Self { overlay, picture_of: None, alpha: 0.0, turned_ns: i64::MIN })
    }

    /// Takes the picture of a notice.
    ///
    /// # Errors
    /// The runtime refuses.
    pub fn set_picture(&mut self, notice: Notice, texture: &VulkanTexture) -> Result<(), OpenVrError> {
        // A refused picture must not be shown as one.
        self.picture_of = None;
        self.overlay.set_texture(texture)?;
        self.picture_of = Some(notice);
        Ok(())
    }

    /// The work of a frame: shows the wanted notice once its picture is there. Returns whether the
    /// overlay has faded out, which another picture must wait for.
    ///
    /// # Errors
    /// The runtime refuses.
    pub fn update(&mut self, now_ns: i64, wanted: Option<Notice>) -> Result<bool, OpenVrError> {
        let past_ns = now_ns.saturating_sub(self.turned_ns).clamp(0, FADE_NS);
        self.turned_ns = now_ns;
        let step = past_ns as f32 / FADE_NS as f32;
        let is_wanted = wanted.is_some() && wanted == self.picture_of;
        self.alpha = if is_wanted { self.alpha + step } else { self.alpha - step }.clamp(0.0, 1.0);
        if self.alpha > 0.0 {
            self.overlay.set_alpha(self.alpha)?;
            self.overlay.show()?;
        } else {
            self.overlay.hide()?;
        }
        Ok(self.alpha == 0.0)
    }

    /// Drops the picture after the device was lost.
    pub fn drop_picture(&mut self) {
        self.picture_of = None;
    }
}

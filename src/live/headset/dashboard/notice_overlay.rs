//! Shows a notice before the player's eyes: below the middle of the view, moving with the head, coming and going softly.

use std::sync::Arc;

use glam::{DQuat, DVec3};

use crate::openvr::{OpenVrError, Overlay, Runtime, VulkanTexture};
use crate::panel::Notice;
use radar_sar::geometry::Pose;

/// So far away, and so far below the straight look that it hides little of the game, metres.
const DISTANCE_M: f64 = 1.2;
const BELOW_M: f64 = 0.36;
/// Letters of a degree and a half.
const WIDTH_M: f64 = 0.82;
/// From nothing to full brightness, nanoseconds.
const FADE_NS: i64 = 400_000_000;
/// Over all that warns.
const SORT_ORDER: u32 = 1000;

/// The notice's overlay.
pub(super) struct NoticeOverlay {
    overlay: Overlay,
    /// What its picture says.
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
        self.picture_of = Some(notice);
        self.overlay.set_texture(texture)
    }

    /// A frame's work: shows what is wanted when its picture is there. Another picture is not taken before the last one has faded:
    /// says whether it has.
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

    /// The device that drew its picture is gone.
    pub fn drop_picture(&mut self) {
        self.picture_of = None;
    }
}

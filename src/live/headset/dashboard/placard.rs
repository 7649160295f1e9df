//! Shows a notice before the player's eyes: below the middle of the view, moving with the head, coming and going softly.

use std::sync::Arc;

use glam::{DQuat, DVec3};

use crate::openvr::{OpenVrError, Overlay, Runtime, VulkanTexture};
use crate::panel::Notice;
use radar_sar::geometry::Pose;

/// So far away, and so far below the straight look that it hides little of the game, metres.
const AWAY_M: f64 = 1.2;
const BELOW_M: f64 = 0.36;
/// Letters of a degree and a half.
const WIDTH_M: f64 = 0.82;
/// From nothing to full brightness, nanoseconds.
const FADE_NS: i64 = 400_000_000;
/// Over all that warns.
const ORDER: u32 = 1000;

/// The notice's overlay.
pub(super) struct Placard {
    overlay: Overlay,
    /// What its picture says.
    says: Option<Notice>,
    alpha: f32,
    turned_ns: i64,
}

impl Placard {
    /// # Errors
    /// The runtime refuses.
    pub fn new(runtime: &Arc<Runtime>) -> Result<Self, OpenVrError> {
        let overlay = Overlay::new(runtime, "radar-chaperone.notice", "Radar chaperone, notice")?;
        overlay.set_width_m(WIDTH_M)?;
        overlay.set_sort_order(ORDER)?;
        let middle = DVec3::new(0.0, -BELOW_M, -AWAY_M);
        // Facing the eyes.
        overlay.set_pose_on_head(&Pose::new(middle, DQuat::from_rotation_x(-(BELOW_M / AWAY_M).atan())))?;
        Ok(Self { overlay, says: None, alpha: 0.0, turned_ns: i64::MIN })
    }

    /// Takes the picture of a notice.
    ///
    /// # Errors
    /// The runtime refuses.
    pub fn set_picture(&mut self, notice: Notice, texture: &VulkanTexture) -> Result<(), OpenVrError> {
        self.says = Some(notice);
        self.overlay.set_texture(texture)
    }

    /// A frame's work: shows what is wanted when its picture is there. Another picture is not taken before the last one has faded:
    /// says whether it has.
    ///
    /// # Errors
    /// The runtime refuses.
    pub fn turn(&mut self, now_ns: i64, wanted: Option<Notice>) -> Result<bool, OpenVrError> {
        let past_ns = now_ns.saturating_sub(self.turned_ns).clamp(0, FADE_NS);
        self.turned_ns = now_ns;
        let step = past_ns as f32 / FADE_NS as f32;
        let is_wanted = wanted.is_some() && wanted == self.says;
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
    pub fn forget_picture(&mut self) {
        self.says = None;
    }
}

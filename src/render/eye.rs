//! The pose and projection of one eye.
//!
//! The tangents are those of OpenVR's `GetProjectionRaw`: `[left, right, top, bottom]`, each the
//! tangent of the angle from the eye's −z axis to that edge of the image, x to the right. With y
//! up, the names of the vertical edges are swapped against their values (openvr issues 110, 254,
//! 816): `top` is the tangent of the *lower* edge, negative for any headset, and `bottom` is that
//! of the *upper* edge, positive. `ComposeProjection` in OpenVR's manual uses them in the same way.

use glam::{DMat4, DVec2, DVec3, DVec4, Mat4};

use super::error::RenderError;
use radar_sar::geometry::Pose;

/// Distance of the near plane, metres. Choice: nearer than an eye's distance to any panel, and than
/// a headset's lens.
const NEAR_M: f64 = 0.03;

/// Pose and projection of one eye.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EyeView {
    /// Pose of the eye. It looks along −z; +y is up in its image.
    pub tracking_from_eye: Pose,
    /// Left, right, "top" (the lower edge, negative) and "bottom" (the upper edge, positive), as
    /// returned by `GetProjectionRaw`.
    pub tangents: [f64; 4],
    /// Width and height of its image, pixels.
    pub size_px: [u32; 2],
}

impl EyeView {
    /// Left and right eye of a head, both looking straight ahead. `ipd_m`: distance between the
    /// pupils, 0.064 m for most people. `fov_rad`: full horizontal field of view; the vertical one
    /// follows from the aspect ratio of the image.
    pub fn pair(tracking_from_head: &Pose, ipd_m: f64, fov_rad: f64, size_px: [u32; 2]) -> [Self; 2] {
        let x = (fov_rad / 2.0).tan();
        let y = x * f64::from(size_px[1]) / f64::from(size_px[0]);
        [-0.5, 0.5].map(|side| Self {
            tracking_from_eye: *tracking_from_head * Pose::from_translation(DVec3::new(side * ipd_m, 0.0, 0.0)),
            tangents: [-x, x, -y, y],
            size_px,
        })
    }

    /// Pixel, from the upper left corner of the image, at which a point of the tracking frame
    /// appears; `None` behind the eye.
    pub fn project(&self, point_m: DVec3) -> Option<DVec2> {
        let in_eye = self.tracking_from_eye.inverse().transform_point(point_m);
        let clip = self.clip_from_eye() * in_eye.extend(1.0);
        let ndc = DVec2::new(clip.x, clip.y) / clip.w;
        let size = DVec2::new(self.size_px[0].into(), self.size_px[1].into());
        (clip.w > NEAR_M).then(|| (ndc * DVec2::new(0.5, -0.5) + 0.5) * size)
    }

    /// Left, right, lower and upper tangent, y up.
    pub(super) fn edges(&self) -> [f64; 4] {
        self.tangents
    }

    /// # Errors
    /// [`RenderError::View`] if the pose or the tangents are not finite, the rotation is not
    /// normalised, or the tangents are not in ascending order.
    pub(super) fn check(&self) -> Result<(), RenderError> {
        let [left, right, lower, upper] = self.edges();
        let finite = self.tangents.iter().all(|t| t.is_finite());
        let pose = self.tracking_from_eye.translation.is_finite() && self.tracking_from_eye.rotation.is_normalized();
        if finite && pose && left < right && lower < upper {
            return Ok(());
        }
        let position_m = self.tracking_from_eye.translation.to_array();
        Err(RenderError::View { tangents: self.tangents, position_m })
    }

    /// Perspective projection with reversed depth: 1 at the near plane and 0 at infinity. This
    /// gives the best float precision.
    fn clip_from_eye(&self) -> DMat4 {
        let [left, right, lower, upper] = self.edges();
        let (width, height) = (right - left, upper - lower);
        DMat4::from_cols(
            DVec4::new(2.0 / width, 0.0, 0.0, 0.0),
            DVec4::new(0.0, 2.0 / height, 0.0, 0.0),
            DVec4::new((right + left) / width, (upper + lower) / height, 0.0, -1.0),
            DVec4::new(0.0, 0.0, NEAR_M, 0.0),
        )
    }

    /// For points relative to the eye, in the axes of the tracking frame.
    pub(super) fn clip_from_offset(&self) -> Mat4 {
        let eye_from_offset = DMat4::from_quat(self.tracking_from_eye.rotation.conjugate());
        (self.clip_from_eye() * eye_from_offset).as_mat4()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tangents_project_to_image_edges() {
        // Left eye of a Rift: it sees further down (1.11) than up (0.89), and further left than
        // right.
        let eye =
            EyeView { tracking_from_eye: Pose::IDENTITY, tangents: [-0.96, 0.72, -1.11, 0.89], size_px: [1000, 1200] };
        let close = |point: DVec3, x: f64, y: f64| (eye.project(point).unwrap() - DVec2::new(x, y)).length() < 1e-9;
        assert!(close(DVec3::new(-0.96, 0.89, -1.0), 0.0, 0.0), "upper left");
        assert!(close(DVec3::new(0.72, -1.11, -1.0) * 3.0, 1000.0, 1200.0), "lower right");
        assert_eq!(eye.project(DVec3::Z), None);
    }

    #[test]
    fn disparity_grows_with_proximity() {
        let [left, right] = EyeView::pair(&Pose::IDENTITY, 0.064, 1.6, [960, 960]);
        let disparity = |z: f64| left.project(DVec3::Z * z).unwrap().x - right.project(DVec3::Z * z).unwrap().x;
        assert!(disparity(-0.5) > disparity(-2.0) && disparity(-2.0) > 0.0);
    }

    #[test]
    fn degenerate_eye_views_are_rejected() {
        let [eye, _] = EyeView::pair(&Pose::IDENTITY, 0.064, 1.6, [960, 960]);
        assert!(eye.check().is_ok());
        assert!(EyeView { tangents: [1.0, -1.0, -1.0, 1.0], ..eye }.check().is_err());
        assert!(EyeView { tangents: [-1.0, 1.0, f64::NAN, 1.0], ..eye }.check().is_err());
        assert!(EyeView { tracking_from_eye: Pose::from_translation(DVec3::NAN), ..eye }.check().is_err());
    }
}

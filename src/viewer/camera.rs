//! The camera: orbits around a target, or looks out of the head. Right-handed, +y up, reversed
//! depth: 1 at the near plane and 0 at infinity.

use glam::{DMat4, DQuat, DVec2, DVec3, DVec4};

use radar_sar::geometry::{Aabb, Pose};

/// Distance of the near plane, metres. Choice: nearer than the least distance from the target and
/// than a panel from the eye.
const NEAR_M: f64 = 0.03;
/// Smallest and largest distance from the target, metres. Choice: from one chair leg to several
/// rooms.
const DISTANCES_M: [f64; 2] = [0.3, 60.0];
/// Vertical fields of view around the room and out of the head, radians. Choice: a lens without
/// visible distortion (43°); a headset's (86°).
const ORBIT_FOV_RAD: f64 = 0.75;
const HEAD_FOV_RAD: f64 = 1.5;
/// Straight up and down are excluded by this angle, radians: there the direction to the right is
/// undefined. Choice: far above rounding, too small to see.
const POLE_RAD: f64 = 1e-3;
/// Distance of a fitted box's edge from the centre of the view, as a share of the view's sides.
/// Choice: a margin of 4 % on every side.
const FIT_SHARE: f64 = 0.46;
/// Rotation for a pointer movement over the full height of the view, radians. Choice: one drag
/// shows a box from all sides.
const ORBIT_RAD_PER_HEIGHT: f64 = 4.0;

/// Named views.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum View {
    /// From above and behind.
    Overview,
    /// From above; forward (−z) is up.
    Above,
    /// From the right side.
    Side,
    /// Out of the head.
    FirstPerson,
}

/// Camera position and mode.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// The target.
    pub target_m: DVec3,
    /// Rotation to the right around +y; 0 looks along −z, radians.
    pub yaw_rad: f64,
    /// Downward rotation, radians.
    pub pitch_rad: f64,
    /// Distance to the target, metres.
    pub distance_m: f64,
    /// Whether the camera looks out of the head instead.
    pub is_first_person: bool,
}

impl Default for Camera {
    fn default() -> Self {
        Self::of(View::Overview, DVec3::new(0.0, 0.9, 0.0), 3.0)
    }
}

impl Camera {
    /// A named view of everything within `radius_m` of a point.
    pub fn of(view: View, middle_m: DVec3, radius_m: f64) -> Self {
        let (yaw_rad, pitch_rad) = match view {
            View::Overview | View::FirstPerson => (-0.6, 0.65),
            View::Above => (0.0, std::f64::consts::FRAC_PI_2 - POLE_RAD),
            View::Side => (-std::f64::consts::FRAC_PI_2, 0.0),
        };
        let distance_m = (1.08 * radius_m / (ORBIT_FOV_RAD / 2.0).tan()).clamp(DISTANCES_M[0], DISTANCES_M[1]);
        Self { target_m: middle_m, yaw_rad, pitch_rad, distance_m, is_first_person: view == View::FirstPerson }
    }

    /// A named view in which a box just fits.
    pub fn fitting(view: View, bounds: &Aabb, aspect: f64) -> Self {
        let mut camera = Self::of(view, bounds.center(), 0.5 * bounds.size().length());
        let corner = |n: usize| {
            let pick = |axis: usize| if n >> axis & 1 == 1 { bounds.max[axis] } else { bounds.min[axis] };
            DVec3::new(pick(0), pick(1), pick(2))
        };
        let is_in_view = |camera: &Self| {
            let eye = Self { is_first_person: false, ..camera.clone() }.eye(None, aspect);
            (0..8)
                .filter_map(|n| eye.project(corner(n)))
                .filter(|at| (*at - 0.5).abs().max_element() <= FIT_SHARE)
                .count()
                == 8
        };
        let [mut low, mut high] = DISTANCES_M;
        for _ in 0..24 {
            camera.distance_m = 0.5 * (low + high);
            if is_in_view(&camera) { high = camera.distance_m } else { low = camera.distance_m }
        }
        camera.distance_m = high;
        camera
    }

    /// Rotates around the target. `way`: pointer movement in shares of the view's height.
    pub fn orbit(&mut self, way: DVec2) {
        let most = std::f64::consts::FRAC_PI_2 - POLE_RAD;
        self.yaw_rad = (self.yaw_rad + way.x * ORBIT_RAD_PER_HEIGHT) % std::f64::consts::TAU;
        self.pitch_rad = (self.pitch_rad + way.y * ORBIT_RAD_PER_HEIGHT).clamp(-most, most);
    }

    /// Moves the target. `way`: pointer movement in shares of the view's height.
    pub fn pan(&mut self, way: DVec2) {
        let height_m = 2.0 * (ORBIT_FOV_RAD / 2.0).tan() * self.distance_m;
        let rotation = self.rotation();
        self.target_m += (rotation * DVec3::NEG_X * way.x + rotation * DVec3::Y * way.y) * height_m;
        self.target_m = self.target_m.clamp(DVec3::splat(-1e3), DVec3::splat(1e3));
    }

    /// Zooms in for factors above 1.
    pub fn zoom(&mut self, factor: f64) {
        if factor.is_finite() && factor > 0.0 {
            self.distance_m = (self.distance_m / factor).clamp(DISTANCES_M[0], DISTANCES_M[1]);
        }
    }

    fn rotation(&self) -> DQuat {
        DQuat::from_rotation_y(-self.yaw_rad) * DQuat::from_rotation_x(-self.pitch_rad)
    }

    /// The eye, given the pose of the head and the aspect ratio (width over height) of the view.
    pub fn eye(&self, head: Option<&Pose>, aspect: f64) -> Eye {
        match head.filter(|_| self.is_first_person) {
            Some(head) => Eye { tracking_from_eye: *head, fov_rad: HEAD_FOV_RAD, aspect },
            None => {
                let rotation = self.rotation();
                let position = self.target_m + rotation * DVec3::Z * self.distance_m;
                Eye { tracking_from_eye: Pose::new(position, rotation), fov_rad: ORBIT_FOV_RAD, aspect }
            }
        }
    }
}

/// An eye and its field of view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eye {
    /// Pose of the eye: looks along −z, +y is up.
    pub tracking_from_eye: Pose,
    /// Vertical field of view, radians.
    pub fov_rad: f64,
    /// Width of the view over its height.
    pub aspect: f64,
}

impl Eye {
    /// For points relative to the eye, in the axes of the tracking frame.
    pub fn clip_from_offset(&self) -> DMat4 {
        let y = 1.0 / (self.fov_rad / 2.0).tan();
        let clip_from_eye = DMat4::from_cols(
            DVec4::new(y / self.aspect, 0.0, 0.0, 0.0),
            DVec4::new(0.0, y, 0.0, 0.0),
            DVec4::new(0.0, 0.0, 0.0, -1.0),
            DVec4::new(0.0, 0.0, NEAR_M, 0.0),
        );
        clip_from_eye * DMat4::from_quat(self.tracking_from_eye.rotation.conjugate())
    }

    /// Where a point appears, 0 to 1 from the upper left corner; `None` behind the eye.
    pub fn project(&self, position_m: DVec3) -> Option<DVec2> {
        let clip = self.clip_from_offset() * (position_m - self.tracking_from_eye.translation).extend(1.0);
        (clip.w > NEAR_M).then(|| DVec2::new(clip.x, -clip.y) / clip.w * 0.5 + 0.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: DVec2, b: DVec2) -> bool {
        (a - b).length() < 1e-6
    }

    #[test]
    fn target_projects_to_the_center() {
        for view in [View::Overview, View::Above, View::Side] {
            let middle = DVec3::new(0.4, 1.0, -0.7);
            let eye = Camera::of(view, middle, 2.0).eye(None, 1.5);
            assert!(near(eye.project(middle).unwrap(), DVec2::splat(0.5)), "{view:?}");
        }
    }

    #[test]
    fn named_views_have_expected_directions() {
        let from = |view, point| Camera::of(view, DVec3::ZERO, 2.0).eye(None, 1.0).project(point).unwrap();
        let ahead = from(View::Above, DVec3::NEG_Z);
        assert!(ahead.y < 0.4 && (ahead.x - 0.5).abs() < 1e-6, "from above ahead is up: {ahead}");
        assert!(from(View::Above, DVec3::X).x > 0.6, "and right is right");
        assert!(from(View::Side, DVec3::Y).y < 0.4, "from the side up is up");
        assert!(from(View::Side, DVec3::NEG_Z).x > 0.6, "and ahead is right");
        assert!(from(View::Overview, DVec3::Y).y < 0.5);
    }

    #[test]
    fn sphere_is_inside_the_view() {
        let camera = Camera::of(View::Overview, DVec3::ONE, 3.0);
        let eye = camera.eye(None, 1.0);
        for n in 0..200 {
            let turn = DQuat::from_euler(glam::EulerRot::XYZ, f64::from(n), f64::from(n) * 0.37, 0.0);
            let at = eye.project(DVec3::ONE + turn * DVec3::X * 2.8).unwrap();
            assert!(at.cmpge(DVec2::splat(-0.05)).all() && at.cmple(DVec2::splat(1.05)).all(), "{at}");
        }
    }

    #[test]
    fn fitted_box_fills_the_view() {
        let bounds = Aabb { min: DVec3::new(-2.0, 0.0, -2.5), max: DVec3::new(2.0, 2.5, 2.5) };
        for (view, aspect) in [(View::Overview, 1.6), (View::Above, 1.0), (View::Side, 0.6)] {
            let eye = Camera::fitting(view, &bounds, aspect).eye(None, aspect);
            let corners = (0..8).map(|n| DVec3::new([-2.0, 2.0][n & 1], [0.0, 2.5][n >> 1 & 1], [-2.5, 2.5][n >> 2]));
            let farthest = corners.map(|point| (eye.project(point).unwrap() - 0.5).abs().max_element());
            let farthest = farthest.fold(0.0, f64::max);
            assert!((farthest - FIT_SHARE).abs() < 0.01, "{view:?}: {farthest}");
        }
    }

    #[test]
    fn camera_controls_stay_within_bounds() {
        let mut camera = Camera::default();
        (0..100).for_each(|_| camera.orbit(DVec2::new(0.3, 0.3)));
        assert!(camera.pitch_rad < std::f64::consts::FRAC_PI_2 && camera.yaw_rad.abs() < 7.0);
        (0..100).for_each(|_| camera.zoom(2.0));
        assert_eq!(camera.distance_m, DISTANCES_M[0]);
        camera.zoom(f64::NAN);
        camera.zoom(-1.0);
        assert_eq!(camera.distance_m, DISTANCES_M[0]);
        let mut camera = Camera::default();
        let before = camera.target_m;
        camera.pan(DVec2::new(0.25, 0.0));
        let there = camera.eye(None, 1.0).project(before).unwrap();
        assert!(near(there, DVec2::new(0.75, 0.5)), "what one holds goes with the pointer: {there}");
    }

    #[test]
    fn first_person_uses_the_head_pose() {
        let camera = Camera::of(View::FirstPerson, DVec3::ZERO, 2.0);
        let head = Pose::looking_at(DVec3::new(0.0, 1.6, 0.0), DVec3::new(1.0, 1.0, 0.0), DVec3::Y);
        assert!(near(camera.eye(Some(&head), 1.0).project(DVec3::new(1.0, 1.0, 0.0)).unwrap(), DVec2::splat(0.5)));
        assert!(camera.eye(Some(&head), 1.0).project(DVec3::new(-1.0, 2.2, 0.0)).is_none(), "behind");
        assert!(near(camera.eye(None, 1.0).project(DVec3::ZERO).unwrap(), DVec2::splat(0.5)));
    }
}

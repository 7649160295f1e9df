//! Specular echo of one side of a flat rectangle.

use std::f64::consts::PI;

use glam::DVec3;

use crate::world::Panel;

use super::fresnel::{MAX_FRESNEL_M, fresnel_radius_m, interval_share};

/// One side of a rectangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Face {
    pub center_m: DVec3,
    /// Unit normal of this side.
    pub normal: DVec3,
    /// Unit vectors along the sides, and half their lengths, metres.
    pub u: DVec3,
    pub v: DVec3,
    pub half_m: [f64; 2],
    /// √γ of the specular share.
    pub reflection: f64,
}

/// A ray's crossing of a rectangle's plane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Crossing {
    /// Share of the rectangle in the Fresnel zone about the crossing, of the field.
    pub share: f64,
    pub point_m: DVec3,
}

impl Face {
    /// The sides of a panel that reflect.
    pub fn of(panel: &Panel) -> impl Iterator<Item = Self> {
        let normal = panel.normal();
        let sides = if panel.two_sided { 2 } else { 1 };
        let front = Self {
            center_m: panel.center_m,
            normal,
            u: panel.half_u_m.normalize_or(DVec3::X),
            v: panel.half_v_m.normalize_or(DVec3::X),
            half_m: [panel.half_u_m.length(), panel.half_v_m.length()],
            reflection: panel.material.specular().sqrt(),
        };
        [front, Self { normal: -normal, ..front }].into_iter().take(sides)
    }

    /// Distance in front of its plane, metres; negative behind it.
    pub fn distance_m(&self, point: DVec3) -> f64 {
        self.normal.dot(point - self.center_m)
    }

    /// Mirror image of a point.
    pub fn image(&self, point: DVec3) -> DVec3 {
        point - 2.0 * self.distance_m(point) * self.normal
    }

    /// Share of the rectangle in a Fresnel zone about a point of its plane.
    pub fn share(&self, point: DVec3, radius_m: f64) -> f64 {
        let off = point - self.center_m;
        let across = interval_share(off.dot(self.u), self.half_m[0], radius_m);
        if across == 0.0 { 0.0 } else { across * interval_share(off.dot(self.v), self.half_m[1], radius_m) }
    }

    /// Echo from the foot of the perpendicular: its place, distance and √σ, m. σ = π d² γ: the image of
    /// the sensor at twice the distance (Physics).
    pub fn echo(&self, sensor_m: DVec3) -> Option<(DVec3, f64, f64)> {
        let distance_m = self.distance_m(sensor_m);
        if distance_m <= 0.0 {
            return None;
        }
        let foot_m = sensor_m - self.normal * distance_m;
        let share = self.share(foot_m, fresnel_radius_m(distance_m, distance_m));
        (share > 0.0).then(|| (foot_m, distance_m, PI.sqrt() * distance_m * self.reflection * share))
    }

    /// Where the straight line between two points crosses the plane, if they lie on different sides of
    /// it.
    pub fn crossing(&self, from_m: DVec3, to_m: DVec3) -> Option<Crossing> {
        let (a, b) = (self.distance_m(from_m), self.distance_m(to_m));
        if a * b >= 0.0 {
            return None;
        }
        let at = a / (a - b);
        let point_m = from_m + (to_m - from_m) * at;
        // Most paths miss it by far.
        let off = point_m - self.center_m;
        let outside_m = (off.dot(self.u).abs() - self.half_m[0]).max(off.dot(self.v).abs() - self.half_m[1]);
        if outside_m > MAX_FRESNEL_M {
            return None;
        }
        let length_m = from_m.distance(to_m);
        let share = self.share(point_m, fresnel_radius_m(at * length_m, (1.0 - at) * length_m));
        (share > 0.0).then_some(Crossing { share, point_m })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::material::METAL;

    fn face() -> Face {
        let (half_u_m, half_v_m) = (DVec3::X * 0.5, DVec3::Y * 0.3);
        let panel = Panel { center_m: DVec3::ZERO, half_u_m, half_v_m, material: METAL, two_sided: true };
        Face::of(&panel).next().unwrap()
    }

    #[test]
    fn two_sides_of_a_board_face_opposite_ways() {
        let panel =
            Panel { center_m: DVec3::ZERO, half_u_m: DVec3::X, half_v_m: DVec3::Y, material: METAL, two_sided: true };
        let sides: Vec<Face> = Face::of(&panel).collect();
        assert_eq!((sides.len(), sides[0].normal), (2, -sides[1].normal));
        assert!(sides[1].echo(DVec3::Z).is_none() && sides[1].echo(DVec3::NEG_Z).is_some());
    }

    #[test]
    fn specular_echo_is_that_of_the_mirror_image_and_ends_smoothly() {
        for d in [0.6, 2.4] {
            let (_, distance_m, sigma) = face().echo(DVec3::new(0.1, 0.05, d)).unwrap();
            let expected = (PI * d * d * 0.99).sqrt();
            assert!((distance_m - d).abs() < 1e-12 && (sigma - expected).abs() < 1e-9 * expected);
        }
        let at = |x: f64| face().echo(DVec3::new(x, 0.0, 1.0)).map_or(0.0, |e| e.2);
        let whole = at(0.0);
        assert!((at(0.5) / whole - 0.5).abs() < 1e-9);
        assert_eq!((at(0.56), at(-0.56)), (0.0, 0.0));
        let largest_step = (0..700).map(|n| 1e-3 * f64::from(n)).map(|x| (at(x + 1e-3) - at(x)).abs());
        assert!(largest_step.fold(0.0, f64::max) < 0.025 * whole);
    }

    #[test]
    fn crossing_lies_on_the_plane_and_misses_past_the_border() {
        let (from, to) = (DVec3::new(0.1, 0.0, 1.0), DVec3::new(0.3, 0.2, -1.0));
        let crossing = face().crossing(from, to).unwrap();
        assert!(crossing.point_m.distance(DVec3::new(0.2, 0.1, 0.0)) < 1e-12 && crossing.share == 1.0);
        assert!(face().crossing(from, DVec3::new(0.3, 0.2, 0.5)).is_none());
        assert!(face().crossing(from, DVec3::new(2.3, 0.2, -1.0)).is_none());
    }
}

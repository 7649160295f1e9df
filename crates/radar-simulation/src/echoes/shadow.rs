//! Shadows: what panels and bodies take out of a straight path.

use glam::DVec3;

use radar_sar::geometry::Aabb;

use crate::world::Panel;

use super::face::Face;
use super::fresnel::{MAX_FRESNEL_M, fresnel_radius_m, interval_share};

/// A surface nearer to an end of the path than this, metres, does not shadow it: the end is on the surface,
/// or belongs to it. Choice: above rounding, below the thickness of boards.
const OWN_SURFACE_M: f64 = 4e-3;
/// Field transmission below which a path counts as blocked: −60 dB. Choice: weaker than any path that is
/// kept.
const BLOCKED: f64 = 1e-3;

/// A rectangle that shadows what is behind it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Occluder {
    face: Face,
    /// √transmission.
    transmission: f64,
    radius_m: f64,
}

impl Occluder {
    /// `None` for a panel that hides nothing worth mentioning.
    pub fn of(panel: &Panel) -> Option<Self> {
        let face = Face::of(panel).next()?;
        let transmission = panel.material.transmission.sqrt();
        let radius_m = (panel.half_u_m + panel.half_v_m).length();
        (transmission < 0.95).then_some(Self { face, transmission, radius_m })
    }

    /// Field transmission along the straight path between two points. The surface intercepts the share of the
    /// Fresnel zone that it covers; the rest passes (Babinet's principle, Physics).
    pub fn transmission(&self, from_m: DVec3, to_m: DVec3) -> f64 {
        let Some(crossing) = self.face.crossing(from_m, to_m) else { return 1.0 };
        let nearest_m = crossing.point_m.distance(from_m).min(crossing.point_m.distance(to_m));
        if nearest_m < OWN_SURFACE_M { 1.0 } else { 1.0 - (1.0 - self.transmission) * crossing.share }
    }

    /// Whether it may shadow a path from a point to anywhere in a ball.
    pub fn may_shadow(&self, from_m: DVec3, center_m: DVec3, radius_m: f64) -> bool {
        let (a, b) = (self.face.distance_m(from_m), self.face.distance_m(center_m));
        if a * b > 0.0 && b.abs() > radius_m {
            return false;
        }
        distance_to_segment_m(self.face.center_m, from_m, center_m) < self.radius_m + radius_m + MAX_FRESNEL_M
    }
}

/// A ball around neighbouring surfaces, which paths that miss it pass over together.
#[derive(Debug, Clone, PartialEq)]
struct Ball {
    center_m: DVec3,
    radius_m: f64,
    /// Of an object: its smaller balls; of those: surfaces.
    members: std::ops::Range<usize>,
}

impl Ball {
    fn around(occluders: &[Occluder], members: std::ops::Range<usize>) -> Option<Self> {
        let corners =
            occluders.iter().flat_map(|o| [-1.0, 1.0].map(|s| o.face.center_m + DVec3::splat(s * o.radius_m)));
        let center_m = Aabb::around(corners)?.center();
        let reach = |o: &Occluder| o.face.center_m.distance(center_m) + o.radius_m;
        // Beyond a border a surface still shadows within a Fresnel radius.
        let radius_m = occluders.iter().map(reach).fold(0.0, f64::max) + MAX_FRESNEL_M;
        Some(Self { center_m, radius_m, members })
    }

    fn is_near(&self, from_m: DVec3, way: DVec3, slack_m: f64) -> bool {
        let off = self.center_m - from_m;
        let at = (off.dot(way) / way.length_squared().max(1e-12)).clamp(0.0, 1.0);
        (off - way * at).length_squared() < (self.radius_m + slack_m).powi(2)
    }
}

/// Surfaces of one smaller ball. Choice: a box.
const IN_BALL: usize = 6;

/// Surfaces that shadow, by object.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Occluders {
    all: Vec<Occluder>,
    balls: Vec<Ball>,
    objects: Vec<Ball>,
}

impl Occluders {
    /// Adds the surfaces of an object.
    pub fn add(&mut self, occluders: impl Iterator<Item = Occluder>) {
        let (first, first_ball) = (self.all.len(), self.balls.len());
        self.all.extend(occluders);
        for at in (first..self.all.len()).step_by(IN_BALL) {
            let members = at..(at + IN_BALL).min(self.all.len());
            self.balls.extend(Ball::around(&self.all[members.clone()], members));
        }
        self.objects.extend(Ball::around(&self.all[first..], first_ball..self.balls.len()));
    }

    fn near(&self, from_m: DVec3, to_m: DVec3, slack_m: f64) -> impl Iterator<Item = &Occluder> {
        let way = to_m - from_m;
        let is_near = move |ball: &&Ball| ball.is_near(from_m, way, slack_m);
        let objects = self.objects.iter().filter(is_near);
        let balls = objects.flat_map(|object| &self.balls[object.members.clone()]).filter(is_near);
        balls.flat_map(|ball| &self.all[ball.members.clone()])
    }

    /// Field transmission along a path.
    pub fn transmission(&self, from_m: DVec3, to_m: DVec3) -> f64 {
        transmission_past(self.near(from_m, to_m, 0.0), from_m, to_m)
    }

    /// Those that may shadow a path from a point to anywhere in a ball.
    pub fn towards(&self, from_m: DVec3, center_m: DVec3, radius_m: f64) -> Vec<Occluder> {
        let near = self.near(from_m, center_m, radius_m);
        near.filter(|occluder| occluder.may_shadow(from_m, center_m, radius_m)).copied().collect()
    }
}

/// Field transmission of all of these surfaces along a path; 0 if blocked.
pub(super) fn transmission_past<'o>(occluders: impl Iterator<Item = &'o Occluder>, from_m: DVec3, to_m: DVec3) -> f64 {
    let mut transmission = 1.0;
    for occluder in occluders {
        transmission *= occluder.transmission(from_m, to_m);
        if transmission < BLOCKED {
            return 0.0;
        }
    }
    transmission
}

/// Field that passes a capsule (a line segment with a radius) on the way between two points: none through
/// its middle, all beyond a Fresnel radius of its border.
pub(super) fn past_capsule(from_m: DVec3, to_m: DVec3, ends_m: [DVec3; 2], radius_m: f64) -> f64 {
    let (distance_m, at) = segment_distance(from_m, to_m, ends_m);
    let length_m = from_m.distance(to_m);
    // An end within the body belongs to it.
    if at.min(1.0 - at) * length_m < radius_m + OWN_SURFACE_M {
        return 1.0;
    }
    1.0 - interval_share(distance_m, radius_m, fresnel_radius_m(at * length_m, (1.0 - at) * length_m))
}

/// Smallest distance of a point from a segment, metres.
fn distance_to_segment_m(point_m: DVec3, from_m: DVec3, to_m: DVec3) -> f64 {
    let way = to_m - from_m;
    let at = ((point_m - from_m).dot(way) / way.length_squared().max(1e-12)).clamp(0.0, 1.0);
    point_m.distance(from_m + way * at)
}

/// Smallest distance of two segments, metres, and where along the first one; by projection from the crossing of the
/// two lines (Ericson, Real-Time Collision Detection, 5.1.9).
fn segment_distance(from_m: DVec3, to_m: DVec3, ends_m: [DVec3; 2]) -> (f64, f64) {
    let (d1, d2, r) = (to_m - from_m, ends_m[1] - ends_m[0], from_m - ends_m[0]);
    let (a, e, f) = (d1.length_squared().max(1e-12), d2.length_squared().max(1e-12), d2.dot(r));
    let (b, c) = (d1.dot(d2), d1.dot(r));
    let denominator = a * e - b * b;
    let start = if denominator > 1e-12 { ((b * f - c * e) / denominator).clamp(0.0, 1.0) } else { 0.5 };
    let along = ((b * start + f) / e).clamp(0.0, 1.0);
    let at = ((b * along - c) / a).clamp(0.0, 1.0);
    let distance_m = (from_m + d1 * at).distance(ends_m[0] + d2 * along);
    (distance_m, at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::material::{TEXTILE, WOOD};

    fn screen(material: crate::world::Material) -> Occluders {
        let (half_u_m, half_v_m) = (DVec3::X * 0.5, DVec3::Y * 0.5);
        let panel = Panel { center_m: DVec3::NEG_Z, half_u_m, half_v_m, material, two_sided: true };
        let mut occluders = Occluders::default();
        occluders.add(Occluder::of(&panel).into_iter());
        occluders
    }

    #[test]
    fn wood_blocks_cloth_attenuates_and_the_shadow_ends_smoothly() {
        let behind = DVec3::NEG_Z * 2.0;
        assert_eq!(screen(WOOD).transmission(DVec3::ZERO, behind), 0.0);
        let through = screen(TEXTILE).transmission(DVec3::ZERO, behind);
        assert!((through * through - TEXTILE.transmission).abs() < 1e-12);
        let at = |x: f64| screen(WOOD).transmission(DVec3::ZERO, DVec3::new(2.0 * x, 0.0, -2.0));
        assert!((at(0.5) - 0.5).abs() < 0.01 && at(0.56) == 1.0 && at(0.44) == 0.0);
    }

    #[test]
    fn surface_does_not_shadow_what_lies_on_it_or_before_it() {
        for z in [-0.9, -0.999, -1.0, -1.001] {
            assert_eq!(screen(WOOD).transmission(DVec3::ZERO, DVec3::new(0.2, 0.1, z)), 1.0);
        }
    }

    #[test]
    fn preselection_keeps_every_surface_that_shadows() {
        let screen = screen(WOOD);
        for n in 0..400 {
            let center = DVec3::new(0.15 * f64::from(n % 20) - 1.5, 0.15 * f64::from(n / 20) - 1.5, -2.2);
            if screen.transmission(DVec3::ZERO, center) < 1.0 {
                assert_eq!(screen.towards(DVec3::ZERO, center, 0.1).len(), 1);
            }
        }
        assert!(screen.towards(DVec3::ZERO, DVec3::new(0.0, 0.0, -0.5), 0.2).is_empty());
        assert!(screen.towards(DVec3::X * 2.0, DVec3::new(2.0, 0.0, -2.0), 0.2).is_empty());
    }

    #[test]
    fn arm_shadows_what_is_behind_it() {
        let arm = [DVec3::new(-0.3, 0.0, -0.5), DVec3::new(0.3, 0.0, -0.5)];
        let through = |y: f64| past_capsule(DVec3::ZERO, DVec3::new(0.0, y, -2.0), arm, 0.05);
        assert_eq!((through(0.0), through(0.5)), (0.0, 1.0));
        assert!((0.0..=1.0).contains(&through(0.2)));
        assert_eq!(past_capsule(DVec3::ZERO, DVec3::NEG_Z * 0.4, arm, 0.05), 1.0);
        // The sensor inside the body is not shadowed by it.
        assert_eq!(past_capsule(DVec3::ZERO, DVec3::NEG_Z, [DVec3::Z * 0.05, DVec3::NEG_Y], 0.1), 1.0);
    }
}

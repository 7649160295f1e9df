//! Paths by a mirror: a wall, the floor, or a large smooth panel. An object is seen once reflected (sensor, object,
//! mirror, sensor, and the same path backwards) at half the sum of both legs, and twice reflected at its image behind
//! the mirror. Each reflection multiplies the field by √γ; the legs by the mirror are those to the image (Physics).

use glam::DVec3;

use super::bodies::{MovingBodies, MovingLimb};
use super::face::{Crossing, Face};
use super::view::View;
use super::visibility::{LineLink, PointLink};
use super::{EchoScene, REFLECTION_PHASE_RAD};

/// A point that is seen by a mirror, at three times.
struct Mirrored {
    at_m: [DVec3; 3],
    image_m: [DVec3; 3],
    root_sigma_m: f64,
    phase_rad: f64,
    /// Field of its lobe to the sensor and to the mirror.
    lobes: [f64; 2],
    /// Field transmission of the leg to the sensor and of that by the mirror, the mirror's share included.
    legs: [f64; 2],
}

impl EchoScene {
    /// The leg from the sensor by a mirror to a point in front of it: where it meets the mirror, and its field
    /// transmission without the mirror's reflection and share; `None` where there is no such path.
    pub(super) fn by_mirror(&self, mirror: &Face, sensor_m: DVec3, point_m: DVec3) -> Option<(Crossing, f64)> {
        if mirror.distance_m(point_m) <= 1e-6 {
            return None;
        }
        let crossing = mirror.crossing(sensor_m, mirror.image(point_m))?;
        let near = self.occluders.transmission(crossing.point_m, point_m);
        if near == 0.0 {
            return None;
        }
        let transmission = near * self.occluders.transmission(sensor_m, crossing.point_m);
        (transmission > 0.0).then_some((crossing, transmission))
    }
}

impl View<'_> {
    /// Both paths of a point by a mirror.
    fn add_mirrored(&mut self, mirror: &Face, source: &Mirrored) {
        let [to_point, to_image] = [source.at_m[1], source.image_m[1]].map(|at| at - self.sensor_m[1]);
        let (direct_m, by_mirror_m) = (to_point.length(), to_image.length());
        let cos_image = to_image.dot(self.forward) / by_mirror_m;
        let one_way = source.root_sigma_m * mirror.reflection * source.legs[1] / by_mirror_m;
        let sensor_m = self.sensor_m;
        let ranges = |image_share: f64| {
            [0, 1, 2].map(|n| {
                let [point_m, image_m] = [source.at_m[n], source.image_m[n]].map(|at| at.distance(sensor_m[n]));
                point_m * (1.0 - image_share) + image_m * image_share
            })
        };
        // Both directions of the path have the same length, so their fields add up.
        let by = 2.0 * one_way * (source.lobes[0] * source.lobes[1]).sqrt() * source.legs[0] / direct_m;
        if by >= self.min_amplitude {
            let beam = self.beam.between(to_point.dot(self.forward) / direct_m, cos_image);
            self.add(ranges(0.5), by * beam, source.phase_rad + REFLECTION_PHASE_RAD);
        }
        let image = one_way * source.lobes[1] * mirror.reflection * source.legs[1] / by_mirror_m;
        if image >= self.min_amplitude {
            self.add(ranges(1.0), image * self.beam.two_way(cos_image), source.phase_rad + 2.0 * REFLECTION_PHASE_RAD);
        }
    }

    pub(super) fn add_point_link(&mut self, scene: &EchoScene, link: &PointLink) {
        let (point, mirror) = (&scene.cloud.points[link.point], &scene.mirrors[link.mirror]);
        let Some(crossing) = mirror.crossing(self.sensor_m[1], link.image_m) else { return };
        let past_bodies = self.past_bodies(crossing.point_m);
        let image_of_sensor = mirror.image(self.sensor_m[1]);
        let lobes = [self.sensor_m[1], image_of_sensor]
            .map(|seen_from| point.lobe.towards((seen_from - point.position_m).normalize_or_zero()));
        let source = Mirrored {
            at_m: [point.position_m; 3],
            image_m: [link.image_m; 3],
            root_sigma_m: point.root_sigma_m,
            phase_rad: point.phase_rad,
            lobes,
            legs: [link.direct * self.past_bodies(point.position_m), link.by_mirror * crossing.share * past_bodies],
        };
        self.add_mirrored(mirror, &source);
    }

    pub(super) fn add_line_link(&mut self, scene: &EchoScene, link: &LineLink) {
        let (line, mirror) = (&scene.lines[link.line], &scene.mirrors[link.mirror]);
        let images = self.sensor_m.map(|sensor_m| mirror.image(sensor_m));
        if let Some(echo) = line.bistatic(self.sensor_m[1], images[1]).filter(|echo| echo.range_m <= self.max_range_m) {
            let image_m = mirror.image(echo.point_m);
            let beam = self.beam.between(self.cos_to(echo.point_m), self.cos_to(image_m));
            let most = 2.0 * echo.spread * mirror.reflection * beam;
            if most >= self.min_amplitude {
                let leg = self.leg_by_mirror(scene, mirror, echo.point_m);
                let direct = if leg > 0.0 { self.transmission(scene, echo.point_m) } else { 0.0 };
                let range_m =
                    [0, 2].map(|n| line.bistatic(self.sensor_m[n], images[n]).map_or(echo.range_m, |e| e.range_m));
                // Both reflections of the path: by the line and by the mirror.
                self.add([range_m[0], echo.range_m, range_m[1]], most * leg * direct, 2.0 * REFLECTION_PHASE_RAD);
            }
        }
        // The image's echo to the sensor is the line's to the sensor's image.
        if let Some(echo) = line.echo(images[1]).filter(|echo| echo.range_m <= self.max_range_m) {
            let beam = self.beam.two_way(self.cos_to(mirror.image(echo.point_m)));
            let most = echo.spread * mirror.reflection * mirror.reflection * beam;
            if most >= self.min_amplitude {
                let leg = self.leg_by_mirror(scene, mirror, echo.point_m);
                let range_m = images.map(|image_m| line.range_m(image_m));
                self.add(range_m, most * leg * leg, 3.0 * REFLECTION_PHASE_RAD);
            }
        }
    }

    /// Field transmission of the leg by a mirror, the mirror's share included.
    fn leg_by_mirror(&self, scene: &EchoScene, mirror: &Face, point_m: DVec3) -> f64 {
        // Where the line meets the mirror, as a leg of a chair the floor, the leg by the mirror is the direct one.
        if mirror.distance_m(point_m) < AT_MIRROR_M {
            let share = mirror.share(point_m, AT_MIRROR_M);
            return if share > 0.0 { share * self.transmission(scene, point_m) } else { 0.0 };
        }
        let leg = scene.by_mirror(mirror, self.sensor_m[1], point_m);
        leg.map_or(0.0, |(crossing, passes)| passes * crossing.share * self.past_bodies(crossing.point_m))
    }

    /// Bodies in the mirrors: also the wearer's own.
    pub(super) fn add_mirrored_bodies(&mut self, scene: &EchoScene, moving: &MovingBodies) {
        for limb in &moving.limbs {
            let middle_m = 0.5 * (limb.ends_m[0] + limb.ends_m[1]);
            let direct = self.transmission(scene, middle_m);
            for mirror in &scene.mirrors {
                self.add_mirrored_limb(scene, mirror, moving, limb, direct);
            }
        }
    }

    fn add_mirrored_limb(
        &mut self,
        scene: &EchoScene,
        mirror: &Face,
        moving: &MovingBodies,
        limb: &MovingLimb,
        direct: f64,
    ) {
        let middle_m = 0.5 * (limb.ends_m[0] + limb.ends_m[1]);
        if mirror.distance_m(self.sensor_m[1]) <= 0.0 || mirror.distance_m(middle_m) <= 0.0 {
            return;
        }
        let image_m = mirror.image(middle_m);
        let by_mirror_m = image_m.distance(self.sensor_m[1]).max(0.1);
        let direct_m = middle_m.distance(self.sensor_m[1]).max(0.1);
        let beam = self.beam.two_way(self.cos_to(image_m));
        let one_way = limb.max_root_sigma_m * mirror.reflection * beam.sqrt() / by_mirror_m;
        let by_most = if direct_m < MIN_DIRECT_M { 0.0 } else { 2.0 * one_way * direct / direct_m };
        if by_most.max(one_way * mirror.reflection * beam.sqrt() / by_mirror_m) < self.min_amplitude {
            return;
        }
        let Some((crossing, leg)) = scene.by_mirror(mirror, self.sensor_m[1], middle_m) else { return };
        let image_of_sensor = mirror.image(self.sensor_m[1]);
        for point in &moving.points[limb.points.clone()] {
            let lobe = |seen_from: DVec3| point.normal.dot((seen_from - point.at_m[1]).normalize_or_zero()).max(0.0);
            let source = Mirrored {
                at_m: point.at_m,
                image_m: point.at_m.map(|at| mirror.image(at)),
                root_sigma_m: point.root_sigma_m,
                phase_rad: point.phase_rad,
                lobes: [lobe(self.sensor_m[1]), lobe(image_of_sensor)],
                legs: [if direct_m < MIN_DIRECT_M { 0.0 } else { direct }, leg * crossing.share],
            };
            self.add_mirrored(mirror, &source);
        }
    }
}

/// A place nearer than this to a mirror, or behind it by as much as a line's end fades, is on it, metres. Choice: two
/// wavelengths.
const AT_MIRROR_M: f64 = 0.01;

/// A limb nearer than this to the sensor, metres, has no direct echo: it is the head that carries it. Choice: nearer
/// than an arm comes; what the headset itself reflects is the sensor's leakage.
pub(super) const MIN_DIRECT_M: f64 = 0.15;

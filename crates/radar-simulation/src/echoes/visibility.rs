//! What a sensor position sees: which sources are shadowed, and which have a path by a mirror. It changes little
//! over 50 ms and costs more than the echoes, so a caller may keep it for that long.

use glam::DVec3;

use radar_sar::Beam;
use radar_sar::geometry::Pose;

use super::EchoScene;
use super::beam_table::BeamTable;
use super::line::{Line, LineEcho};
use super::points::Cluster;
use super::shadow::transmission_past;

/// How far the sensor may have moved, metres, and turned, rad, since the visibility was computed. Choice: 50 ms at 2
/// m/s and at 230°/s.
const SLACK_M: f64 = 0.1;
const SLACK_RAD: f64 = 0.2;
/// Point sources with paths by mirrors: the strongest ones. Choice: those beyond are below −60 dB by plaster.
const MIRRORED_POINTS: usize = 200;

/// Lines with paths by mirrors: the strongest ones. Choice: all tubes of a furnished room, but not all wooden edges.
const MIRRORED_LINES: usize = 200;

/// What is seen from about a position.
#[derive(Debug, Clone)]
pub(crate) struct Visibility {
    pub(super) beam: BeamTable,
    pub(super) min_amplitude: f64,
    pub(super) max_range_m: f64,
    /// Clusters in reach with a visible point, and for each its points' field transmission.
    pub(super) clusters: Vec<VisibleCluster>,
    pub(super) point_links: Vec<PointLink>,
    pub(super) line_links: Vec<LineLink>,
}

#[derive(Debug, Clone)]
pub(super) struct VisibleCluster {
    pub index: usize,
    pub transmission: Vec<f32>,
}

/// A point source seen by a mirror.
#[derive(Debug, Clone, Copy)]
pub(super) struct PointLink {
    pub point: usize,
    pub mirror: usize,
    /// The point's mirror image, metres.
    pub image_m: DVec3,
    /// Field transmission of the direct leg, and of the leg by the mirror.
    pub direct: f64,
    pub by_mirror: f64,
}

/// A line seen by a mirror.
#[derive(Debug, Clone, Copy)]
pub(super) struct LineLink {
    pub line: usize,
    pub mirror: usize,
}

/// Bounds of the search, in one sensor position.
struct Searcher<'s> {
    scene: &'s EchoScene,
    sensor_m: DVec3,
    forward: DVec3,
    beam: BeamTable,
    min_amplitude: f64,
    max_range_m: f64,
}

impl Visibility {
    pub(super) fn new(scene: &EchoScene, sensor: &Pose, beam: &Beam, min_amplitude: f64, max_range_m: f64) -> Self {
        let (sensor_m, forward) = (sensor.translation, sensor.forward());
        let searcher = Searcher { scene, sensor_m, forward, beam: BeamTable::new(beam), min_amplitude, max_range_m };
        let clusters = searcher.clusters();
        let point_links = searcher.point_links(&clusters);
        let line_links = searcher.line_links();
        Self { beam: searcher.beam, min_amplitude, max_range_m, clusters, point_links, line_links }
    }
}

impl Visibility {
    /// Numbers of points and lines seen by mirrors.
    #[cfg(test)]
    pub fn link_counts(&self) -> [usize; 2] {
        [self.point_links.len(), self.line_links.len()]
    }
}

/// Upper bound of the beam's two-way amplitude within a ball, and the least distance to it, metres.
pub(super) fn beam_bound(
    beam: &BeamTable,
    [sensor_m, forward]: [DVec3; 2],
    center_m: DVec3,
    radius_m: f64,
    slack_rad: f64,
) -> (f64, f64) {
    let to = center_m - sensor_m;
    let distance_m = to.length();
    if distance_m <= radius_m * 1.02 {
        return (1.0, 0.0);
    }
    let (sin, cos) = (radius_m / distance_m, to.dot(forward) / distance_m);
    // The ball's half-angle and the slack, as one rotation towards the boresight.
    let cos_ball = (1.0 - sin * sin).sqrt();
    let (sin_slack, cos_slack) = radar_sar::math::sin_cos(slack_rad);
    let (cos_by, sin_by) = (cos_ball * cos_slack - sin * sin_slack, sin * cos_slack + cos_ball * sin_slack);
    let nearest = if cos >= cos_by { 1.0 } else { cos * cos_by + (1.0 - cos * cos).max(0.0).sqrt() * sin_by };
    (beam.at_most(nearest), distance_m - radius_m)
}

impl Searcher<'_> {
    /// Upper bound of the two-way amplitude about a place.
    fn beam_about(&self, place_m: DVec3, radius_m: f64) -> (f64, f64) {
        beam_bound(&self.beam, [self.sensor_m, self.forward], place_m, radius_m + SLACK_M, SLACK_RAD)
    }

    fn is_in_reach(&self, cluster: &Cluster) -> bool {
        let behind = cluster.normal.is_some_and(|n| n.dot(self.sensor_m - cluster.center_m) < -SLACK_M);
        let (beam, nearest_m) = self.beam_about(cluster.center_m, cluster.radius_m);
        let at_least_m = nearest_m.max(0.1);
        !behind
            && nearest_m <= self.max_range_m
            && cluster.max_root_sigma_m * beam >= self.min_amplitude * at_least_m * at_least_m
    }

    fn clusters(&self) -> Vec<VisibleCluster> {
        let cloud = &self.scene.cloud;
        let reach = cloud.clusters.iter().enumerate().filter(|(_, cluster)| self.is_in_reach(cluster));
        let seen = reach.map(|(index, cluster)| {
            let between = self.scene.occluders.towards(self.sensor_m, cluster.center_m, cluster.radius_m);
            let points = cloud.points[cluster.points.clone()].iter();
            let transmission =
                points.map(|point| transmission_past(between.iter(), self.sensor_m, point.position_m) as f32);
            VisibleCluster { index, transmission: transmission.collect() }
        });
        seen.filter(|cluster| cluster.transmission.iter().any(|t| *t > 0.0)).collect()
    }

    /// The strongest visible points of objects: index, transmission.
    fn strongest(&self, clusters: &[VisibleCluster]) -> Vec<(usize, f64)> {
        let cloud = &self.scene.cloud;
        let mut strongest: Vec<(f64, usize, f64)> = Vec::new();
        for visible in clusters {
            let first = cloud.clusters[visible.index].points.start;
            if first < self.scene.shell_points {
                continue;
            }
            for (n, &transmission) in visible.transmission.iter().enumerate() {
                let point = &cloud.points[first + n];
                let to = self.sensor_m - point.position_m;
                let d2 = to.length_squared().max(0.01);
                let lobe = point.lobe.towards(to / d2.sqrt());
                let strength = f64::from(transmission) * lobe * point.root_sigma_m / d2;
                if strength > self.min_amplitude {
                    strongest.push((strength, first + n, f64::from(transmission)));
                }
            }
        }
        strongest.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        strongest.truncate(MIRRORED_POINTS);
        strongest.into_iter().map(|(_, index, transmission)| (index, transmission)).collect()
    }

    fn point_links(&self, clusters: &[VisibleCluster]) -> Vec<PointLink> {
        let strongest = self.strongest(clusters);
        let mut links = Vec::new();
        for (mirror, face) in self.scene.mirrors.iter().enumerate().filter(|(_, f)| f.distance_m(self.sensor_m) > 0.0) {
            for &(index, direct) in &strongest {
                let point = &self.scene.cloud.points[index];
                let image_m = face.image(point.position_m);
                let (direct_m, by_mirror_m) =
                    (point.position_m.distance(self.sensor_m), image_m.distance(self.sensor_m));
                let (beam, _) = self.beam_about(image_m, 0.0);
                let most =
                    2.0 * point.root_sigma_m * face.reflection * beam.sqrt() / (direct_m * by_mirror_m).max(0.01);
                if most < self.min_amplitude || 0.5 * (direct_m + by_mirror_m) > self.max_range_m {
                    continue;
                }
                if let Some((_, by_mirror)) = self.scene.by_mirror(face, self.sensor_m, point.position_m) {
                    links.push(PointLink { point: index, mirror, image_m, direct, by_mirror });
                }
            }
        }
        links
    }

    fn line_links(&self) -> Vec<LineLink> {
        // Lines within reach of the beam, wide enough for where the sensor will be.
        let reach = self.scene.lines.iter().enumerate().skip(self.scene.shell_lines).filter_map(|(index, line)| {
            let (beam, nearest_m) = self.beam_about(line.middle_m, line.half_m);
            let at_least_m = nearest_m.max(0.1);
            let strength = line.strength() * beam.sqrt() / at_least_m.powi(3).sqrt();
            let seen = nearest_m <= self.max_range_m && strength >= self.min_amplitude;
            seen.then(|| (strength, index, line.widened(SLACK_M, SLACK_RAD), beam.sqrt()))
        });
        let mut reach: Vec<(f64, usize, Line, f64)> = reach.collect();
        reach.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        reach.truncate(MIRRORED_LINES);
        let mut links = Vec::new();
        for (mirror, face) in self.scene.mirrors.iter().enumerate().filter(|(_, f)| f.distance_m(self.sensor_m) > 0.0) {
            let image_of_sensor = face.image(self.sensor_m);
            for (_, line, wide, beam) in &reach {
                if face.distance_m(wide.middle_m) <= 0.0 {
                    continue;
                }
                let by = wide.bistatic(self.sensor_m, image_of_sensor);
                let by = by.map_or(0.0, |echo| 2.0 * self.strength(&echo) * beam * face.reflection);
                let back = wide.echo(image_of_sensor);
                let back = back.map_or(0.0, |echo| self.strength(&echo) * face.reflection * face.reflection);
                if by.max(back) < self.min_amplitude {
                    continue;
                }
                let image_beam = self.beam_about(face.image(wide.middle_m), wide.half_m).0.sqrt();
                if image_beam * by.max(back * image_beam) >= self.min_amplitude {
                    links.push(LineLink { line: *line, mirror });
                }
            }
        }
        links
    }

    fn strength(&self, echo: &LineEcho) -> f64 {
        if echo.range_m > self.max_range_m + SLACK_M { 0.0 } else { echo.spread }
    }
}

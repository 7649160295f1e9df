//! Compares detections with the ground truth: which obstacles were found, with which error, and
//! which reports are false.
//!
//! An obstacle of the truth is *due* if the head came close enough to it to need a warning, and
//! *found* if a report is within `found_m` of one of its scatterers. A report *matches* within
//! `found_m` of any scatterer, is *near* up to `false_m`, else *at a wall* within `false_m` of a
//! wall's extent, else *false*.

use std::fmt;

use glam::DVec3;
use serde::Serialize;

use radar_mapping::{Observed, Obstacle, Scene, Wall};
use radar_sar::truth::{Truth, TruthObstacle, TruthWall};

/// Distance limits of the score.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Limits {
    /// An obstacle is due if the head came this close, metres.
    pub due_m: f64,
    /// An obstacle is found by a report this close to one of its scatterers, metres.
    pub found_m: f64,
    /// A report farther than this from everything is false, metres.
    pub false_m: f64,
    /// A wall is found if the angle between the normals is at most this, degrees.
    pub wall_angle_deg: f64,
    /// … and the distance of the planes at the true wall's centre is at most this, metres.
    pub wall_offset_m: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { due_m: 1.0, found_m: 0.10, false_m: 0.25, wall_angle_deg: 6.0, wall_offset_m: 0.05 }
    }
}

/// Classification of a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Within `found_m` of a scatterer.
    Match,
    /// Between `found_m` and `false_m` from the nearest scatterer.
    Near,
    /// Close to no obstacle, but within `false_m` of a wall.
    AtWall,
    /// The report states that its direction is unknown, and an obstacle is within 3σ of its largest
    /// uncertainty.
    DirectionUnknown,
    /// Close to nothing.
    False,
}

/// Score of one obstacle of the truth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ObstacleScore {
    /// Name in the truth.
    pub name: String,
    /// Smallest distance from the head during the recording, metres.
    pub closest_approach_m: f64,
    /// Time in the beam, seconds.
    pub in_beam_s: f64,
    /// Whether the head came close enough to need a warning.
    pub due: bool,
    /// Whether a report is close enough.
    pub found: bool,
    /// Distance from the nearest report of any kind to the nearest scatterer, metres; `None`
    /// without reports.
    pub nearest_report_m: Option<f64>,
}

/// The complete score. 17 fields: one record, serialised as it is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Score {
    /// The distance limits used.
    pub limits: Limits,
    /// Number of due obstacles.
    pub due: usize,
    /// Number of due obstacles that were found.
    pub due_found: usize,
    /// Number of obstacles of the truth.
    pub present: usize,
    /// Number of obstacles that were found.
    pub found: usize,
    /// Number of reports.
    pub reports: usize,
    /// Number of false reports.
    pub false_reports: usize,
    /// Number of reports between `found_m` and `false_m` from an obstacle.
    pub near_reports: usize,
    /// Number of reports close to no obstacle, but at a wall.
    pub wall_reports: usize,
    /// Number of reports with a stated unknown direction that covers an obstacle.
    pub direction_unknown_reports: usize,
    /// Number of further reports with the same nearest obstacle, within `false_m`.
    pub duplicates: usize,
    /// Median distance from found obstacles (due or not) to their nearest report, metres; `None` if
    /// none was found.
    pub median_error_m: Option<f64>,
    /// 90th percentile of the same distance (linear interpolation), metres.
    pub p90_error_m: Option<f64>,
    /// Number of walls of the truth.
    pub walls: usize,
    /// Number of walls that were found.
    pub walls_found: usize,
    /// Number of reported walls that match no true wall.
    pub walls_false: usize,
    /// Scores of the obstacles, in the order of the truth.
    pub obstacles: Vec<ObstacleScore>,
}

/// Compares a scene with the truth.
pub fn score(scene: &Scene, truth: &Truth, limits: &Limits) -> Score {
    let reports: Vec<DVec3> = scene.obstacles.iter().map(|obstacle| obstacle.position_m).collect();
    let obstacles: Vec<ObstacleScore> =
        truth.obstacles.iter().map(|obstacle| score_obstacle(obstacle, &reports, limits)).collect();
    let verdicts: Vec<Verdict> = scene.obstacles.iter().map(|report| verdict(report, truth, limits)).collect();
    let count = |wanted: Verdict| verdicts.iter().filter(|&&verdict| verdict == wanted).count();
    let errors = sorted_errors(&obstacles);
    let matches = |wall: &TruthWall, found: &Wall| is_same_wall(wall, found, limits);
    Score {
        limits: *limits,
        due: obstacles.iter().filter(|o| o.due).count(),
        due_found: obstacles.iter().filter(|o| o.due && o.found).count(),
        present: obstacles.len(),
        found: errors.len(),
        reports: reports.len(),
        false_reports: count(Verdict::False),
        near_reports: count(Verdict::Near),
        wall_reports: count(Verdict::AtWall),
        direction_unknown_reports: count(Verdict::DirectionUnknown),
        duplicates: duplicates(&reports, truth, limits),
        median_error_m: quantile(&errors, 0.5),
        p90_error_m: quantile(&errors, 0.9),
        walls: truth.walls.len(),
        walls_found: truth.walls.iter().filter(|wall| scene.walls.iter().any(|found| matches(wall, found))).count(),
        walls_false: scene.walls.iter().filter(|found| !truth.walls.iter().any(|wall| matches(wall, found))).count(),
        obstacles,
    }
}

/// Classifies a report. A non-finite position is false.
pub fn verdict(report: &Obstacle, truth: &Truth, limits: &Limits) -> Verdict {
    let report_m = report.position_m;
    let obstacle_m = nearest_obstacle(report_m, truth).map_or(f64::INFINITY, |(_, distance)| distance);
    let wall_m = truth.walls.iter().map(|wall| wall.extent.distance(report_m)).fold(f64::INFINITY, f64::min);
    if !report_m.is_finite() {
        Verdict::False
    } else if obstacle_m <= limits.found_m {
        Verdict::Match
    } else if obstacle_m <= limits.false_m {
        Verdict::Near
    } else if wall_m <= limits.false_m {
        Verdict::AtWall
    } else if report.observed != Observed::Position && obstacle_m <= 3.0 * widest_sigma_m(report) {
        Verdict::DirectionUnknown
    } else {
        Verdict::False
    }
}

/// Upper bound of 1σ in the worst direction: the square root of the covariance's trace.
fn widest_sigma_m(report: &Obstacle) -> f64 {
    let c = &report.covariance_m2;
    (c.x_axis.x + c.y_axis.y + c.z_axis.z).max(0.0).sqrt()
}

fn score_obstacle(obstacle: &TruthObstacle, reports: &[DVec3], limits: &Limits) -> ObstacleScore {
    let nearest = reports.iter().map(|&report| distance(obstacle, report)).fold(f64::INFINITY, f64::min);
    ObstacleScore {
        name: obstacle.name.clone(),
        closest_approach_m: obstacle.closest_approach_m,
        in_beam_s: obstacle.in_beam_s,
        due: obstacle.closest_approach_m <= limits.due_m,
        found: nearest <= limits.found_m,
        nearest_report_m: nearest.is_finite().then_some(nearest),
    }
}

/// Distance from a point to the obstacle's nearest scatterer; infinite without scatterers.
fn distance(obstacle: &TruthObstacle, position: DVec3) -> f64 {
    obstacle.points_m.iter().map(|point| point.distance(position)).fold(f64::INFINITY, f64::min)
}

fn nearest_obstacle(position: DVec3, truth: &Truth) -> Option<(usize, f64)> {
    let distances = truth.obstacles.iter().map(|obstacle| distance(obstacle, position)).enumerate();
    distances.min_by(|a, b| a.1.total_cmp(&b.1))
}

fn duplicates(reports: &[DVec3], truth: &Truth, limits: &Limits) -> usize {
    let mut of = vec![0usize; truth.obstacles.len()];
    for &report in reports {
        if let Some((index, _)) = nearest_obstacle(report, truth).filter(|nearest| nearest.1 <= limits.false_m) {
            of[index] += 1;
        }
    }
    of.into_iter().map(|count| count.saturating_sub(1)).sum()
}

fn is_same_wall(wall: &TruthWall, found: &Wall, limits: &Limits) -> bool {
    let least_cosine = limits.wall_angle_deg.to_radians().cos();
    found.plane.outward.dot(wall.plane.outward) >= least_cosine
        && found.plane.distance(wall.plane.foot(wall.extent.center())).abs() <= limits.wall_offset_m
}

fn sorted_errors(obstacles: &[ObstacleScore]) -> Vec<f64> {
    let mut errors: Vec<f64> = obstacles.iter().filter(|o| o.found).filter_map(|o| o.nearest_report_m).collect();
    errors.sort_by(f64::total_cmp);
    errors
}

/// Quantile of ascending values, linear interpolation; `None` if there are none.
fn quantile(rising: &[f64], share: f64) -> Option<f64> {
    let at = share * rising.len().checked_sub(1)? as f64;
    let (below, above) = (rising[at.floor() as usize], rising[at.ceil() as usize]);
    Some(below + (above - below) * at.fract())
}

impl fmt::Display for Score {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.obstacles.iter().map(|o| o.name.chars().count()).max().unwrap_or(0).max(8);
        writeln!(f, "{:width$}  closest  in beam  due  found  nearest report", "obstacle")?;
        for o in &self.obstacles {
            let yes = |is: bool| if is { "yes" } else { "–" };
            let nearest = o.nearest_report_m.map_or("–".into(), |m| format!("{m:.3} m"));
            let (due, found) = (yes(o.due), yes(o.found));
            let (name, closest_m, beam_s) = (&o.name, o.closest_approach_m, o.in_beam_s);
            writeln!(f, "{name:width$}  {closest_m:5.2} m  {beam_s:5.1} s  {due:>3}  {found:>5}  {nearest:>14}")?;
        }
        let centimetres = |m: Option<f64>| m.map_or("–".into(), |m| format!("{:.1} cm", 100.0 * m));
        writeln!(f, "due and found        {} of {}", self.due_found, self.due)?;
        writeln!(f, "found of all         {} of {}", self.found, self.present)?;
        writeln!(f, "false reports        {} of {}", self.false_reports, self.reports)?;
        writeln!(
            f,
            "other reports        {} near an obstacle, {} at a wall, {} of unknown direction, {} duplicates",
            self.near_reports, self.wall_reports, self.direction_unknown_reports, self.duplicates
        )?;
        let (median, p90) = (centimetres(self.median_error_m), centimetres(self.p90_error_m));
        writeln!(f, "position error       median {median}, 90 % within {p90}")?;
        write!(f, "walls found          {} of {}, false {}", self.walls_found, self.walls, self.walls_false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;
    use proptest::prelude::*;
    use radar_sar::geometry::{Aabb, Plane};

    fn report(x: f64, y: f64, z: f64) -> Obstacle {
        Obstacle {
            id: 0,
            position_m: DVec3::new(x, y, z),
            covariance_m2: DMat3::IDENTITY,
            observed: Observed::Position,
            extent_m: DVec3::ZERO,
            evidence: 1.0,
            shape: Vec::new(),
            provisional: false,
            first_seen_ns: 0,
            last_seen_ns: 0,
        }
    }

    fn object(name: &str, closest_approach_m: f64, points_m: Vec<DVec3>) -> TruthObstacle {
        TruthObstacle {
            name: name.into(),
            rcs_dbsm: vec![0.0; points_m.len()],
            points_m,
            closest_approach_m,
            in_beam_s: 1.0,
        }
    }

    /// A chair of two points at x = 0 and 0.4, a lamp at x = 2 that the head never came close to, a
    /// wall at z = −3.
    fn truth() -> Truth {
        let wall = TruthWall {
            name: "wall north".into(),
            plane: Plane { outward: DVec3::NEG_Z, offset_m: 3.0 },
            extent: Aabb { min: DVec3::new(-3.0, 0.0, -3.0), max: DVec3::new(3.0, 2.5, -3.0) },
        };
        let chair = object("chair", 0.7, vec![DVec3::ZERO, DVec3::new(0.4, 0.0, 0.0)]);
        let lamp = object("lamp", 1.6, vec![DVec3::new(2.0, 1.0, 0.0)]);
        Truth { obstacles: vec![chair, lamp], walls: vec![wall], ..Truth::default() }
    }

    fn scored(obstacles: Vec<Obstacle>) -> Score {
        score(&Scene { obstacles, ..Scene::default() }, &truth(), &Limits::default())
    }

    #[test]
    fn empty_scene_misses_everything() {
        let score = scored(Vec::new());
        assert_eq!((score.due, score.due_found, score.present, score.found), (1, 0, 2, 0));
        assert_eq!((score.median_error_m, score.obstacles[0].nearest_report_m), (None, None));
    }

    #[test]
    fn verdicts_cover_found_near_false_and_wall() {
        let score = scored(vec![
            report(0.40, 0.06, 0.0), // finds the chair
            report(0.03, 0.0, 0.0),  // the chair again, nearer
            report(2.0, 1.0, 0.20),  // near the lamp, does not find it
            report(0.0, 1.0, -2.80), // at the wall
            report(-1.5, 0.0, 1.5),  // nothing there
            report(f64::NAN, 0.0, 0.0),
        ]);
        assert_eq!((score.due, score.due_found, score.found, score.reports), (1, 1, 1, 6));
        assert_eq!((score.false_reports, score.near_reports, score.wall_reports, score.duplicates), (2, 1, 1, 1));
        assert!((score.median_error_m.unwrap() - 0.03).abs() < 1e-12);
        assert!((score.obstacles[1].nearest_report_m.unwrap() - 0.20).abs() < 1e-12);
        assert!(!score.obstacles[1].found);
    }

    #[test]
    fn unknown_direction_is_not_false() {
        let known = Obstacle { covariance_m2: DMat3::IDENTITY * 0.36, ..report(0.0, 0.0, 1.0) };
        let unknown = Obstacle { observed: Observed::RangeOnly, ..known.clone() };
        assert_eq!(verdict(&known, &truth(), &Limits::default()), Verdict::False);
        assert_eq!(verdict(&unknown, &truth(), &Limits::default()), Verdict::DirectionUnknown);
        let sure = Obstacle { covariance_m2: DMat3::IDENTITY * 1e-4, ..unknown };
        assert_eq!(verdict(&sure, &truth(), &Limits::default()), Verdict::False);
    }

    #[test]
    fn walls_match_by_direction_and_offset() {
        let found = |degrees: f64, offset_m: f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let outward = DVec3::new(sin, 0.0, -cos);
            // A plane through the true wall's centre, displaced along the normal.
            let plane = Plane { outward, offset_m: outward.dot(DVec3::new(0.0, 1.25, -3.0)) + offset_m };
            let seen_at = Aabb { min: DVec3::ZERO, max: DVec3::ZERO };
            let wall =
                Wall { id: 0, plane, evidence: 1.0, seen_at, provisional: false, first_seen_ns: 0, last_seen_ns: 0 };
            let scene = Scene { walls: vec![wall], ..Scene::default() };
            let score = score(&scene, &truth(), &Limits::default());
            (score.walls_found, score.walls_false)
        };
        assert_eq!(found(0.0, 0.0), (1, 0));
        assert_eq!(found(5.9, 0.049), (1, 0));
        assert_eq!(found(6.1, 0.0), (0, 1));
        assert_eq!(found(0.0, -0.051), (0, 1));
        assert_eq!(found(180.0, 0.0), (0, 1));
    }

    #[test]
    fn quantiles_are_linear_between_neighbours() {
        assert_eq!(quantile(&[], 0.5), None);
        assert_eq!(quantile(&[3.0], 0.9), Some(3.0));
        assert_eq!(quantile(&[1.0, 2.0], 0.5), Some(1.5));
        assert!((quantile(&[0.0, 1.0, 2.0, 3.0, 4.0], 0.9).unwrap() - 3.6).abs() < 1e-12);
    }

    #[test]
    fn score_table_lists_every_obstacle() {
        let text = scored(vec![report(0.0, 0.0, 0.02)]).to_string();
        assert!(text.contains("chair") && text.contains("lamp") && text.contains("1 of 1"), "{text}");
        assert!(text.contains("median 2.0 cm"), "{text}");
    }

    proptest! {
        #[test]
        fn every_report_has_exactly_one_verdict(positions in prop::collection::vec(prop::array::uniform3(-4.0..4.0f64), 0..12)) {
            let score = scored(positions.iter().map(|p| report(p[0], p[1], p[2])).collect());
            let matched = positions.iter()
                .filter(|p| verdict(&report(p[0], p[1], p[2]), &truth(), &Limits::default()) == Verdict::Match).count();
            prop_assert_eq!(score.reports, matched + score.near_reports + score.wall_reports + score.false_reports);
            prop_assert!(score.found <= matched);
        }
    }
}

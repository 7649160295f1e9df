//! What is reported where nothing is, each time that it comes near the body, and what may have caused it.

use std::collections::{BTreeMap, VecDeque};

use glam::DVec3;

use super::figures::{Cause, FalseReport, Figures, Rates};
use super::moving::movers_at;
use super::target::{APPROACH_END_M, FALSE_REPORT_M, Target, body_distance_m};
use radar_mapping::{Scene, Wall};
use radar_sar::geometry::Pose;
use radar_simulation::{Session, SessionWall};

/// Distance from a person's parts within which a report is of the person, metres. Choice: the parts
/// are points inside a body and its clothes.
const PERSON_RADIUS_M: f64 = 0.4;
/// Time after a moving person was at a point during which a report there is not false, seconds.
/// Choice: what was seen a moment ago was right then; an object is removed after several missed
/// sub-apertures.
const MOVED_AWAY_GRACE_S: f64 = 1.5;
/// Maximum time between a movement and a false report that it may have caused, seconds. Choice: the
/// mapper's window of 4 s and the time until it reports.
const CAUSE_WINDOW_S: f64 = 6.0;
/// Interval at which positions of hands and visitor are stored, seconds. Choice: a hand at 2 m/s
/// moves 20 cm, less than the radius of a false report.
const TRAIL_STEP_S: f64 = 0.1;
/// A false report is a mirror image of what lies this near to its position mirrored in a wall, metres. Choice: the
/// radius of a false report, and as much for the wall's own roughness.
const MIRROR_M: f64 = 0.4;

/// Key of a reported obstacle or wall.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum ReportId {
    Obstacle(u64),
    Wall(u64),
}

#[derive(Default)]
struct ReportState {
    is_false: bool,
    is_near: bool,
    cause: Option<Cause>,
}

/// Scores the reports of one session.
pub(super) struct ReportScorer<'s> {
    session: &'s Session,
    reports: BTreeMap<ReportId, ReportState>,
    hands: VecDeque<(f64, Vec<DVec3>)>,
    visitor: VecDeque<(f64, Vec<DVec3>)>,
}

impl<'s> ReportScorer<'s> {
    /// Nothing reported yet.
    pub fn new(session: &'s Session) -> Self {
        Self { session, reports: BTreeMap::new(), hands: VecDeque::new(), visitor: VecDeque::new() }
    }

    /// Scores what is reported at one time among these targets.
    pub fn step(
        &mut self,
        (time_s, step_s): (f64, f64),
        head: &Pose,
        scene: &Scene,
        targets: &[Target<'s>],
        figures: &mut Figures,
    ) {
        self.record_moving_parts(time_s);
        let mut any_near = false;
        let reported = reported_positions(scene, head.translation);
        let mut reports = std::mem::take(&mut self.reports);
        reports.retain(|key, _| reported.iter().any(|(other, _)| other == key));
        for (key, point) in reported {
            let report = reports.entry(key).or_default();
            let is_false = !self.is_real(time_s, point, targets);
            let away_m = body_distance_m(head, point);
            let is_near = is_false && away_m <= if report.is_near { APPROACH_END_M } else { Rates::NEAR_M };
            if is_false && report.cause.is_none() {
                report.cause = Some(self.cause(point));
            }
            let cause = report.cause.unwrap_or(Cause::Nothing);
            let is_wall = matches!(key, ReportId::Wall(_));
            let first_anywhere = (is_false && !report.is_false).then_some(false);
            let came_near = (is_near && !report.is_near).then_some(true);
            for is_near in first_anywhere.into_iter().chain(came_near) {
                let (position_m, behind_m, mirrors) =
                    (point.to_array(), self.behind_m(point), self.mirrors(point, targets));
                let report = FalseReport { time_s, cause, is_wall, is_near, position_m, behind_m, mirrors };
                figures.false_reports.push(report);
            }
            (report.is_false, report.is_near) = (report.is_false || is_false, is_near);
            any_near |= is_near && away_m <= Rates::NEAR_M;
        }
        self.reports = reports;
        figures.false_near_s += if any_near { step_s } else { 0.0 };
    }

    /// Whether something is, or shortly before was, at a reported position.
    fn is_real(&self, time_s: f64, point: DVec3, targets: &[Target<'s>]) -> bool {
        // A removed object counts as present here: how long it stays reported is measured
        // separately.
        let person = self.visitor.iter().filter(|(at_s, _)| time_s - at_s <= MOVED_AWAY_GRACE_S);
        targets.iter().any(|target| target.is_at(point))
            || self.session.walls().iter().any(|wall| wall.distance_m(point) <= FALSE_REPORT_M)
            || person.flat_map(|(_, parts)| parts).any(|part| part.distance(point) <= PERSON_RADIUS_M)
    }

    /// Walls, floor and ceiling that reach to where the perpendicular from a point meets them.
    fn walls_before(&self, point: DVec3) -> impl Iterator<Item = &SessionWall> {
        let reaches = move |wall: &&SessionWall| wall.distance_m(wall.plane.foot(point)) < 1e-6;
        self.session.walls().iter().filter(reaches)
    }

    /// Distance behind the nearest wall, floor or ceiling, metres; negative before all of them.
    fn behind_m(&self, point: DVec3) -> f64 {
        let behind = self.walls_before(point).map(|wall| point.dot(wall.plane.outward) - wall.plane.offset_m);
        behind.fold(f64::NEG_INFINITY, f64::max)
    }

    /// For a point outside the room: name of what lies at its mirror image in a wall, floor or ceiling; empty for
    /// nothing, and inside.
    fn mirrors(&self, point: DVec3, targets: &[Target<'s>]) -> String {
        if self.behind_m(point) <= 0.0 {
            return String::new();
        }
        let images = self.walls_before(point).map(|wall| 2.0 * wall.plane.foot(point) - point);
        let mut near = images.filter_map(|image| targets.iter().find(|t| t.distance_to_m(image) <= MIRROR_M));
        near.next().map_or_else(String::new, |target| target.kind.clone())
    }

    fn cause(&self, point: DVec3) -> Cause {
        let was_there = |trail: &VecDeque<(f64, Vec<DVec3>)>, within_m: f64| {
            trail.iter().flat_map(|(_, parts)| parts).any(|part| part.distance(point) <= within_m)
        };
        if was_there(&self.hands, FALSE_REPORT_M) {
            Cause::Hand
        } else if was_there(&self.visitor, PERSON_RADIUS_M) {
            Cause::Visitor
        } else {
            Cause::Nothing
        }
    }

    fn record_moving_parts(&mut self, time_s: f64) {
        if self.hands.back().is_some_and(|(last_s, _)| time_s - last_s < TRAIL_STEP_S) {
            return;
        }
        let hands = self.session.hands_at(time_s).map(|hands| hands.to_vec()).unwrap_or_default();
        self.hands.push_back((time_s, hands));
        self.visitor.push_back((time_s, movers_at(self.session, time_s)));
        for trail in [&mut self.hands, &mut self.visitor] {
            while trail.pop_front_if(|(at_s, _)| time_s - *at_s > CAUSE_WINDOW_S).is_some() {}
        }
    }
}

/// Reported positions: obstacles, and of each upright wall the part nearest to the head of where it
/// was seen.
fn reported_positions(scene: &Scene, head: DVec3) -> Vec<(ReportId, DVec3)> {
    let obstacles = scene.obstacles.iter().map(|obstacle| (ReportId::Obstacle(obstacle.id), obstacle.position_m));
    let upright = scene.walls.iter().filter(|wall| wall.plane.is_upright());
    let nearest = |wall: &Wall| wall.plane.foot(head.clamp(wall.seen_at.min, wall.seen_at.max));
    obstacles.chain(upright.map(|wall| (ReportId::Wall(wall.id), nearest(wall)))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiments::play::target::TargetGeometry;
    use a121::preset;
    use radar_sar::geometry::{Aabb, Plane};
    use radar_simulation::PlaySession;

    #[test]
    fn walls_report_the_seen_part_nearest_to_the_head_and_floors_are_left_out() {
        let seen_at = Aabb { min: DVec3::new(-0.5, 1.5, -2.0), max: DVec3::new(0.5, 1.7, -2.0) };
        let wall = |id: u64, outward: DVec3, offset_m: f64| Wall {
            id,
            plane: Plane { outward, offset_m },
            evidence: 20.0,
            seen_at,
            provisional: false,
            first_seen_ns: 0,
            last_seen_ns: 0,
        };
        let walls = vec![wall(1, DVec3::NEG_Y, 0.0), wall(7, DVec3::NEG_Z, 2.0)];
        let scene = Scene { walls, ..Scene::default() };
        let found = reported_positions(&scene, DVec3::new(3.0, 1.6, 0.0));
        assert_eq!(found, [(ReportId::Wall(7), DVec3::new(0.5, 1.6, -2.0))]);
    }

    #[test]
    fn an_objects_mirror_image_lies_behind_a_wall_and_names_it() {
        let play = PlaySession { duration_s: 5.0, ..PlaySession::new(preset("d16").unwrap(), 3) };
        let session = play.prepare().unwrap();
        let scorer = ReportScorer::new(&session);
        let things = session.things();
        let mut images = 0;
        for (index, thing) in things.iter().enumerate() {
            let name = &thing.thing.name;
            let target = Target::new(TargetGeometry::Object(index, &thing.thing.scatterers), name, thing.until_s);
            let targets = [target];
            let part_m = thing.thing.scatterers[0].position_m;
            assert!(scorer.behind_m(part_m) < 0.0 && scorer.mirrors(part_m, &targets).is_empty(), "{name} is inside");
            for wall in scorer.walls_before(part_m) {
                let image_m = 2.0 * wall.plane.foot(part_m) - part_m;
                assert!((scorer.behind_m(image_m) - wall.plane.distance(part_m).abs()).abs() < 1e-9);
                assert_eq!(&scorer.mirrors(image_m, &targets), name);
                assert_eq!(scorer.mirrors(image_m, &[]), "", "nothing is mirrored there");
                images += 1;
            }
        }
        assert!(images >= 4 * things.len(), "{images}");
    }
}

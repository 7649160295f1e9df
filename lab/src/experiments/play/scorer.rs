//! Scores reports and warnings of a play session against the truth, step by step.
//!
//! The body is modelled as the vertical line below the head: a point no higher than the eyes is as
//! near as its horizontal distance. An approach to an object begins when the body comes within 1 m
//! of it. It must be warned of by the deadline: when the body is within 0.4 m, or would be there
//! within 0.6 s at its speed; if neither happens, when it is nearest. An object counts as warned of
//! while a shown shape has a point within 25 cm of one of its scatterers, a wall while a panel in
//! its plane is shown.

use std::collections::{BTreeMap, VecDeque};

use glam::DVec3;

use super::figures::{Approach, BoundErrors, Cause, Detected, FalseReport, Figures, Rates, RemovalOutcome};
use super::moving::{MovingScorer, movers_at};
use a121::frame_timing;
use radar_mapping::{Model, Obstacle, Scene, ScoredCandidate, Wall};
use radar_sar::geometry::{Aabb, Plane, Pose};
use radar_sar::math;
use radar_simulation::{Scatterer, Session, SessionWall};

/// Deadline of a warning: distance and time to contact. Choice: where warnings have their full
/// brightness by default.
const DEADLINE_M: f64 = 0.4;
const DEADLINE_S: f64 = 0.6;
/// Closing speeds below this count as standing still, metres per second. Choice: swaying and
/// turning stay below.
const MIN_CLOSING_M_PER_S: f64 = 0.3;
/// Distance beyond which an approach is over, metres. Choice: 20 cm beyond its start, so that a
/// sway at 1 m does not count as many approaches.
const APPROACH_END_M: f64 = 1.2;
/// A report farther than this from everything is false, metres. Choice: the radius within which a
/// warning is where the object is; as in the study that chose the method.
const FALSE_REPORT_M: f64 = 0.25;
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
/// Power SNR of one sub-aperture from which on a scatterer counts as visible, dB, and the length of
/// a sub-aperture, seconds. Choice: noise reaches 10 dB once in 20 000 times; the mapper's length.
const MIN_VISIBLE_SNR_DB: f64 = 10.0;
const SUBAPERTURE_S: f64 = 0.09;
/// Detections this long before a deadline are listed with the approach, seconds. Choice: the mapper's window of 4 s, and
/// what was detected before it and forgotten.
const DETECTED_S: f64 = 10.0;
/// A false report is a mirror image of what lies this near to its position mirrored in a wall, metres. Choice: the
/// radius of a false report, and as much for the wall's own roughness.
const MIRROR_M: f64 = 0.4;
/// Interval at which it is computed what the sensor illuminates, seconds. Choice: an eighth of the time after which an
/// object is due.
const ILLUMINATION_STEP_S: f64 = 0.09;
/// A warning that switches on and off again within this time flickers, seconds. Choice: shorter
/// than any approach and retreat.
const FLICKER_S: f64 = 1.0;
/// A wall is warned of by a panel whose plane differs by at most this angle, degrees, and this
/// offset, metres. Choice: a little above the 5 cm and 6° to which walls were found right in the
/// study that chose the method.
const WALL_ANGLE_DEG: f64 = 8.0;
const WALL_OFFSET_M: f64 = 0.15;

/// What is shown at one time.
#[derive(Debug, Clone, Default)]
pub(super) struct ShownWarnings {
    /// Points of the shown shapes, tracking frame, metres.
    pub points_m: Vec<DVec3>,
    /// Planes of the shown walls.
    pub planes: Vec<Plane>,
}

/// Scores one session.
pub(super) struct Scorer<'s> {
    session: &'s Session,
    /// Log odds at which a detection is reported.
    confirm_log_odds: f64,
    targets: Vec<Target<'s>>,
    reports: BTreeMap<ReportId, ReportState>,
    hands: VecDeque<(f64, Vec<DVec3>)>,
    visitor: VecDeque<(f64, Vec<DVec3>)>,
    removal: RemovalTracker,
    moving: MovingScorer,
    detections: VecDeque<PastDetection>,
    last_s: f64,
    figures: Figures,
}

/// A detection of an earlier update.
struct PastDetection {
    time_s: f64,
    position_m: DVec3,
    score: f64,
    may_be_new: bool,
    log_odds: f64,
}

/// An object or wall that can be run into.
struct Target<'s> {
    geometry: TargetGeometry<'s>,
    kind: String,
    until_s: f64,
    /// What the sensor receives of it, and the time for which that was computed, seconds.
    illumination: (Illumination, f64),
    in_beam_s: f64,
    visible_s: f64,
    distance_m: f64,
    is_warned: bool,
    changed_s: f64,
    flickered: bool,
    /// Greatest distance since the current unbroken warning began, metres.
    lead_m: f64,
    approached: bool,
    approach: Option<OpenApproach>,
}

enum TargetGeometry<'s> {
    /// An object of the session, by its index, with its parts.
    Object(usize, &'s [Scatterer]),
    Wall(&'s SessionWall),
}

/// What the sensor receives of a target.
#[derive(Debug, Clone, Copy, Default)]
struct Illumination {
    /// A part is in the beam, and nothing is in between.
    in_beam: bool,
    /// Its echo is strong enough.
    visible: bool,
}

/// An approach in progress.
struct OpenApproach {
    nearest: Approach,
    is_scored: bool,
}

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

#[derive(Default)]
struct RemovalTracker {
    was_known: Option<bool>,
    in_beam_s: f64,
    removed: bool,
}

impl<'s> Scorer<'s> {
    /// Scores a session in which detections are reported from `confirm_log_odds` on.
    pub fn new(session: &'s Session, confirm_log_odds: f64) -> Self {
        let objects = session.things();
        let target = |(index, t): (usize, &radar_simulation::SessionObject<'s>)| {
            Target::new(TargetGeometry::Object(index, &t.thing.scatterers), &t.thing.name, t.until_s)
        };
        let upright = session.walls().iter().filter(|wall| wall.plane.is_upright());
        let walls = upright.map(|wall| Target::new(TargetGeometry::Wall(wall), "wall", f64::INFINITY));
        Self {
            session,
            confirm_log_odds,
            targets: objects.iter().enumerate().map(target).chain(walls).collect(),
            reports: BTreeMap::new(),
            hands: VecDeque::new(),
            visitor: VecDeque::new(),
            removal: RemovalTracker::default(),
            moving: MovingScorer::default(),
            detections: VecDeque::new(),
            last_s: 0.0,
            figures: Figures::default(),
        }
    }

    /// Remembers what an update of the map detected.
    pub fn note_detections(&mut self, time_s: f64, scored: &[ScoredCandidate]) {
        self.detections.extend(scored.iter().map(|candidate| PastDetection {
            time_s,
            position_m: candidate.position_m,
            score: math::exp(candidate.features[0]),
            may_be_new: candidate.may_be_new,
            log_odds: Model::embedded().log_odds(&candidate.features),
        }));
        // An open approach may have had its deadline some time ago.
        while self.detections.pop_front_if(|past| time_s - past.time_s > 3.0 * DETECTED_S).is_some() {}
    }

    /// Scores one step; times increase.
    pub fn step(&mut self, time_s: f64, scene: &Scene, shown: &ShownWarnings) {
        let step_s = time_s - self.last_s;
        self.last_s = time_s;
        let (head, sensor) = (self.session.head_at(time_s), self.session.sensor_at(time_s));
        self.record_moving_parts(time_s);
        for target in &mut self.targets {
            if let Some(approach) = target.step(self.session, time_s, step_s, &head, scene, shown) {
                self.figures.approaches.push(target.with_detected(approach, &self.detections, self.confirm_log_odds));
            }
            self.figures.flickers += u64::from(std::mem::take(&mut target.flickered));
        }
        self.score_reports(time_s, step_s, &head, scene);
        self.track_removal(time_s, step_s, &sensor, scene);
        self.moving.step(self.session, time_s, step_s, scene);
    }

    /// Ends the session. `reports` is the number of obstacles in the map.
    pub fn end(mut self, reports: usize) -> Figures {
        for target in &mut self.targets {
            let approach =
                target.end().map(|approach| target.with_detected(approach, &self.detections, self.confirm_log_odds));
            self.figures.approaches.extend(approach);
        }
        self.figures.approaches.sort_by(|a, b| a.deadline_s.total_cmp(&b.deadline_s));
        if let Some(was_known) = self.removal.was_known {
            let in_beam_s = self.removal.removed.then_some(self.removal.in_beam_s);
            self.figures.forgettings.push(RemovalOutcome { was_known, looked_s: in_beam_s });
        }
        self.figures.moving = self.moving.end();
        self.figures.played_s = self.last_s;
        self.figures.reports_at_end.push(reports);
        self.figures
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

    fn score_reports(&mut self, time_s: f64, step_s: f64, head: &Pose, scene: &Scene) {
        let mut any_near = false;
        let reported = reported_positions(scene, head.translation);
        let mut reports = std::mem::take(&mut self.reports);
        reports.retain(|key, _| reported.iter().any(|(other, _)| other == key));
        for (key, point) in reported {
            let report = reports.entry(key).or_default();
            let is_false = !self.is_real(time_s, point);
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
                let (position_m, behind_m, mirrors) = (point.to_array(), self.behind_m(point), self.mirrors(point));
                let report = FalseReport { time_s, cause, is_wall, is_near, position_m, behind_m, mirrors };
                self.figures.false_reports.push(report);
            }
            (report.is_false, report.is_near) = (report.is_false || is_false, is_near);
            any_near |= is_near && away_m <= Rates::NEAR_M;
        }
        self.reports = reports;
        self.figures.false_near_s += if any_near { step_s } else { 0.0 };
    }

    /// Whether something is, or shortly before was, at a reported position.
    fn is_real(&self, time_s: f64, point: DVec3) -> bool {
        // A removed object counts as present here: how long it stays reported is measured
        // separately.
        let distances = self.targets.iter().map(|target| target.distance_to_m(point));
        let person = self.visitor.iter().filter(|(at_s, _)| time_s - at_s <= MOVED_AWAY_GRACE_S);
        distances.fold(f64::INFINITY, f64::min) <= FALSE_REPORT_M
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
    fn mirrors(&self, point: DVec3) -> String {
        if self.behind_m(point) <= 0.0 {
            return String::new();
        }
        let images = self.walls_before(point).map(|wall| 2.0 * wall.plane.foot(point) - point);
        let mut near = images.filter_map(|image| self.targets.iter().find(|t| t.distance_to_m(image) <= MIRROR_M));
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

    fn track_removal(&mut self, time_s: f64, step_s: f64, sensor: &Pose, scene: &Scene) {
        let Some(gone) = self.targets.iter().find(|target| target.until_s.is_finite()) else { return };
        let TargetGeometry::Object(_, parts) = gone.geometry else { return };
        if time_s < gone.until_s || self.removal.removed {
            return;
        }
        let stays = |point: DVec3| {
            self.targets
                .iter()
                .filter(|t| t.until_s.is_infinite())
                .any(|target| target.distance_to_m(point) <= FALSE_REPORT_M)
        };
        let of_it = |point: DVec3| parts.iter().any(|part| part.position_m.distance(point) <= FALSE_REPORT_M);
        let is_known = scene.obstacles.iter().any(|o| of_it(o.position_m) && !stays(o.position_m));
        self.removal.was_known.get_or_insert(is_known);
        if parts.iter().any(|part| self.session.is_in_beam(sensor, part.position_m)) {
            self.removal.in_beam_s += step_s;
        }
        self.removal.removed = !is_known;
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

impl<'s> Target<'s> {
    fn new(geometry: TargetGeometry<'s>, name: &str, until_s: f64) -> Self {
        Self {
            geometry,
            kind: name.into(),
            until_s,
            illumination: (Illumination::default(), f64::NEG_INFINITY),
            in_beam_s: 0.0,
            visible_s: 0.0,
            distance_m: f64::INFINITY,
            is_warned: false,
            changed_s: f64::NEG_INFINITY,
            flickered: false,
            lead_m: 0.0,
            approached: false,
            approach: None,
        }
    }

    /// Distance from a point to the nearest scatterer, metres; infinite for walls.
    fn distance_to_m(&self, point: DVec3) -> f64 {
        match self.geometry {
            TargetGeometry::Object(_, parts) => {
                parts.iter().map(|s| s.position_m.distance(point)).fold(f64::INFINITY, f64::min)
            }
            TargetGeometry::Wall(_) => f64::INFINITY,
        }
    }

    /// Its approach with what was detected of it in the seconds before the deadline.
    fn with_detected(
        &self,
        approach: Approach,
        detections: &VecDeque<PastDetection>,
        confirm_log_odds: f64,
    ) -> Approach {
        if matches!(self.geometry, TargetGeometry::Wall(_)) {
            return approach;
        }
        let before_s = |past: &PastDetection| approach.deadline_s - past.time_s;
        let recent = detections.iter().filter(|past| (0.0..DETECTED_S).contains(&before_s(past)));
        let own: Vec<_> = recent.filter(|past| self.distance_to_m(past.position_m) <= FALSE_REPORT_M).collect();
        let new = || own.iter().filter(|past| past.may_be_new);
        let log_odds = new().map(|past| past.log_odds).reduce(f64::max);
        let detected = Detected {
            count: own.len(),
            may_be_new: new().count(),
            score: own.iter().map(|past| past.score).reduce(f64::max).unwrap_or(0.0),
            log_odds: log_odds.unwrap_or(0.0),
            is_likely: log_odds.is_some_and(|log_odds| log_odds >= confirm_log_odds),
        };
        Approach { detected: Some(detected), ..approach }
    }

    fn body_distance_m(&self, head: &Pose) -> f64 {
        match self.geometry {
            TargetGeometry::Object(_, parts) => {
                parts.iter().map(|s| body_distance_m(head, s.position_m)).fold(f64::INFINITY, f64::min)
            }
            TargetGeometry::Wall(wall) => wall.plane.distance(head.translation),
        }
    }

    fn is_shown(&self, shown: &ShownWarnings) -> bool {
        match self.geometry {
            TargetGeometry::Object(..) => {
                shown.points_m.iter().any(|point| self.distance_to_m(*point) <= FALSE_REPORT_M)
            }
            TargetGeometry::Wall(wall) => shown.planes.iter().any(|plane| is_same_plane(plane, &wall.plane)),
        }
    }

    fn illumination(&self, session: &Session, time_s: f64) -> Illumination {
        match self.geometry {
            TargetGeometry::Object(object, _) => {
                let in_beam = session.is_illuminated(object, time_s);
                Illumination {
                    in_beam,
                    visible: in_beam && subaperture_snr_db(session, object, time_s) >= MIN_VISIBLE_SNR_DB,
                }
            }
            TargetGeometry::Wall(wall) => {
                let sensor = session.sensor_at(time_s);
                let foot = wall.plane.foot(sensor.translation);
                let seen = wall.distance_m(foot) < 1e-6 && session.is_in_beam(&sensor, foot);
                Illumination { in_beam: seen, visible: seen }
            }
        }
    }

    fn step(
        &mut self,
        session: &Session,
        time_s: f64,
        step_s: f64,
        head: &Pose,
        scene: &Scene,
        shown: &ShownWarnings,
    ) -> Option<Approach> {
        if time_s >= self.until_s {
            self.approach = None;
            return None;
        }
        if time_s - self.illumination.1 >= ILLUMINATION_STEP_S {
            self.illumination = (self.illumination(session, time_s), time_s);
        }
        self.in_beam_s += if self.illumination.0.in_beam { step_s } else { 0.0 };
        self.visible_s += if self.illumination.0.visible { step_s } else { 0.0 };
        let distance_m = self.body_distance_m(head);
        // The closing speed of the first step is 0.
        let before_m = if self.distance_m.is_finite() { self.distance_m } else { distance_m };
        let closing_m_per_s = (before_m - distance_m) / step_s.max(1e-9);
        self.distance_m = distance_m;
        let is_warned = self.is_shown(shown);
        if is_warned != self.is_warned {
            self.flickered = time_s - self.changed_s < FLICKER_S;
            (self.is_warned, self.lead_m, self.changed_s) = (is_warned, 0.0, time_s);
        }
        if is_warned {
            self.lead_m = self.lead_m.max(distance_m);
        }
        let is_due = distance_m <= DEADLINE_M
            || (closing_m_per_s > MIN_CLOSING_M_PER_S && distance_m / closing_m_per_s <= DEADLINE_S);
        self.update_approach(time_s, is_due, head, scene)
    }

    /// Updates the approach, if there is one; returns it when it is over.
    fn update_approach(&mut self, time_s: f64, is_due: bool, head: &Pose, scene: &Scene) -> Option<Approach> {
        if self.approach.is_none() && self.distance_m < Rates::NEAR_M {
            self.approach =
                Some(OpenApproach { nearest: self.current_approach(time_s, head, scene), is_scored: false });
            self.approached = true;
        }
        let now = self.current_approach(time_s, head, scene);
        let open = self.approach.as_mut()?;
        let is_first = open.nearest.is_first;
        if !open.is_scored && (is_due || now.deadline_m <= open.nearest.deadline_m) {
            open.nearest = Approach { is_first, ..now };
            open.is_scored = is_due;
        }
        if self.distance_m > APPROACH_END_M { self.end() } else { None }
    }

    fn end(&mut self) -> Option<Approach> {
        self.approach.take().map(|open| open.nearest)
    }

    fn current_approach(&self, time_s: f64, head: &Pose, scene: &Scene) -> Approach {
        let errors_m =
            scene.obstacles.iter().map(|o| self.distance_to_m(o.position_m)).filter(|m| *m <= FALSE_REPORT_M).collect();
        Approach {
            kind: self.kind.clone(),
            deadline_s: time_s,
            deadline_m: self.distance_m,
            in_beam_s: self.in_beam_s,
            visible_s: self.visible_s,
            is_first: !self.approached,
            warned: self.is_warned,
            lead_m: if self.is_warned { self.lead_m } else { 0.0 },
            errors_m,
            bounds: self.bound_errors(head, scene),
            detected: None,
        }
    }

    /// Errors of the reported shape's bounds, taken at the outer sides of its cells, against the
    /// object's scatterers.
    fn bound_errors(&self, head: &Pose, scene: &Scene) -> Option<BoundErrors> {
        let TargetGeometry::Object(_, parts) = self.geometry else { return None };
        let of_it =
            || scene.obstacles.iter().filter(|obstacle| self.distance_to_m(obstacle.position_m) <= FALSE_REPORT_M);
        let cell_m = of_it().map(Obstacle::cell_m).fold(0.0, f64::max);
        let shown: Vec<DVec3> = of_it().flat_map(|obstacle| obstacle.shape.iter().map(|cell| cell.0)).collect();
        let there: Vec<DVec3> = parts.iter().map(|part| part.position_m).collect();
        let middle = there.iter().sum::<DVec3>() / there.len() as f64;
        let across = (middle - head.translation).with_y(0.0).try_normalize()?.cross(DVec3::Y);
        let width_m = |points: &[DVec3]| {
            let along = Aabb::around(points.iter().map(|point| DVec3::X * point.dot(across)))?;
            Some(along.size().x)
        };
        let top_m = |points: &[DVec3]| points.iter().map(|point| point.y).fold(f64::NEG_INFINITY, f64::max);
        let near_m = shown.iter().map(|point| body_distance_m(head, *point)).fold(f64::INFINITY, f64::min);
        Some(BoundErrors {
            near_m: self.distance_m - near_m + 0.5 * cell_m,
            width_m: width_m(&shown)? - width_m(&there)? + cell_m,
            top_m: top_m(&shown) - top_m(&there) + 0.5 * cell_m,
        })
    }
}

/// Distance from the body to a point, metres.
fn body_distance_m(head: &Pose, point: DVec3) -> f64 {
    let to = point - head.translation;
    if to.y > 0.0 { to.length() } else { math::hypot(to.x, to.z) }
}

fn is_same_plane(plane: &Plane, wall: &Plane) -> bool {
    plane.outward.dot(wall.outward) >= math::cos(WALL_ANGLE_DEG.to_radians())
        && (plane.offset_m - wall.offset_m).abs() <= WALL_OFFSET_M
}

/// Power SNR of an object after the sweeps of one sub-aperture are summed, dB.
fn subaperture_snr_db(session: &Session, object: usize, time_s: f64) -> f64 {
    let config = &session.play().config;
    let sweeps = SUBAPERTURE_S * f64::from(config.sweeps_per_frame) / frame_timing(config).frame_period_s;
    session.echo_snr_db(object, time_s) + 10.0 * math::log10(sweeps)
}

#[cfg(test)]
mod tests {
    use super::*;

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
}

//! An object or wall that can be run into: approaches to it, what the sensor receives of it, and whether it is warned of.
//!
//! The body is modelled as the vertical line below the head: a point no higher than the eyes is as
//! near as its horizontal distance. An approach to an object begins when the body comes within 1 m
//! of it. It must be warned of by the deadline: when the body is within 0.4 m, or would be there
//! within 0.6 s at its speed; if neither happens, when it is nearest. An object counts as warned of
//! while a shown shape has a point within 25 cm of one of its scatterers; a wall, or the side of a
//! pillar, while a panel in its plane is shown, or such a point where the body is nearest to it.

use std::collections::VecDeque;

use glam::DVec3;

use super::figures::{Approach, BoundErrors, Detected, InMap, Rates};
use super::locatable::Locatable;
use a121::frame_timing;
use radar_mapping::{Obstacle, Scene};
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
pub(super) const APPROACH_END_M: f64 = 1.2;
/// A report farther than this from everything is false, metres. Choice: the radius within which a
/// warning is where the object is; as in the study that chose the method.
pub(super) const FALSE_REPORT_M: f64 = 0.25;
/// Power SNR of one sub-aperture from which on a scatterer counts as visible, dB, and the length of
/// a sub-aperture, seconds. Choice: noise reaches 10 dB once in 20 000 times; the mapper's length.
const MIN_VISIBLE_SNR_DB: f64 = 10.0;
const SUBAPERTURE_S: f64 = 0.09;
/// Detections this long before a deadline are listed with the approach, seconds. Choice: the mapper's window of 4 s, and
/// what was detected before it and forgotten.
pub(super) const DETECTED_S: f64 = 10.0;
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

impl ShownWarnings {
    /// The same in another frame.
    pub fn moved(&self, to_from: &Pose) -> Self {
        Self {
            points_m: self.points_m.iter().map(|point| to_from.transform_point(*point)).collect(),
            planes: self.planes.iter().map(|plane| plane.moved(to_from)).collect(),
        }
    }
}

/// A detection of an earlier update.
pub(super) struct PastDetection {
    pub time_s: f64,
    pub position_m: DVec3,
    pub score: f64,
    pub may_be_new: bool,
    pub log_odds: f64,
}

/// An object or wall that can be run into.
pub(super) struct Target<'s> {
    pub geometry: TargetGeometry<'s>,
    pub kind: String,
    /// The box around an object's scatterers; `None` for walls.
    around: Option<Aabb>,
    /// Time at which it is carried away, seconds.
    pub until_s: f64,
    /// What the sensor receives of it, and the time for which that was computed, seconds.
    illumination: (Illumination, f64),
    in_beam_s: f64,
    locatable: Locatable,
    distance_m: f64,
    is_warned: bool,
    changed_s: f64,
    /// Whether its warning just flickered.
    pub flickered: bool,
    /// Greatest distance since the current unbroken warning began, metres.
    lead_m: f64,
    /// Whether the map has it; always `Never` for walls.
    in_map: InMap,
    approached: bool,
    approach: Option<OpenApproach>,
}

/// What a target is.
pub(super) enum TargetGeometry<'s> {
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

impl<'s> Target<'s> {
    /// Not approached yet; `name` is its kind.
    pub fn new(geometry: TargetGeometry<'s>, name: &str, until_s: f64) -> Self {
        let around = match &geometry {
            TargetGeometry::Object(_, parts) => Aabb::around(parts.iter().map(|part| part.position_m)),
            TargetGeometry::Wall(_) => None,
        };
        Self {
            geometry,
            kind: name.into(),
            around,
            until_s,
            illumination: (Illumination::default(), f64::NEG_INFINITY),
            in_beam_s: 0.0,
            locatable: Locatable::default(),
            distance_m: f64::INFINITY,
            is_warned: false,
            changed_s: f64::NEG_INFINITY,
            flickered: false,
            lead_m: 0.0,
            in_map: InMap::Never,
            approached: false,
            approach: None,
        }
    }

    /// Distance from a point to the nearest scatterer, metres; infinite for walls.
    pub fn distance_to_m(&self, point: DVec3) -> f64 {
        match self.geometry {
            TargetGeometry::Object(_, parts) => {
                parts.iter().map(|s| s.position_m.distance(point)).fold(f64::INFINITY, f64::min)
            }
            TargetGeometry::Wall(_) => f64::INFINITY,
        }
    }

    /// Whether a report at a point is of it; false for walls.
    pub fn is_at(&self, point: DVec3) -> bool {
        let may_be = self.around.is_some_and(|around| around.distance(point) <= FALSE_REPORT_M);
        may_be && self.distance_to_m(point) <= FALSE_REPORT_M
    }

    /// Its approach with what was detected of it in the seconds before the deadline.
    pub fn with_detected(
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
        let own: Vec<_> = recent.filter(|past| self.is_at(past.position_m)).collect();
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
            // The side of a pillar or corner that faces away cannot be run into.
            TargetGeometry::Wall(wall) if wall.plane.distance(head.translation) < 0.0 => f64::INFINITY,
            TargetGeometry::Wall(wall) => wall.distance_m(head.translation),
        }
    }

    fn is_shown(&self, head: &Pose, shown: &ShownWarnings) -> bool {
        match self.geometry {
            TargetGeometry::Object(..) => shown.points_m.iter().any(|point| self.is_at(*point)),
            TargetGeometry::Wall(wall) => {
                let reach_m = self.distance_m + FALSE_REPORT_M;
                let is_here = |point: &DVec3| {
                    wall.distance_m(*point) <= FALSE_REPORT_M && body_distance_m(head, *point) <= reach_m
                };
                shown.planes.iter().any(|plane| is_same_plane(plane, &wall.plane)) || shown.points_m.iter().any(is_here)
            }
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

    /// Takes one step; returns an approach that is over.
    pub fn step(
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
            self.locate(session, time_s);
        }
        self.in_beam_s += if self.illumination.0.in_beam { step_s } else { 0.0 };
        let distance_m = self.body_distance_m(head);
        // The closing speed of the first step is 0.
        let before_m = if self.distance_m.is_finite() { self.distance_m } else { distance_m };
        let closing_m_per_s = (before_m - distance_m) / step_s.max(1e-9);
        self.distance_m = distance_m;
        let has_part_here = |obstacle: &Obstacle| obstacle.shape.iter().any(|(center, _)| self.is_at(*center));
        self.in_map = self.in_map.after(scene.obstacles.iter().any(has_part_here));
        let is_warned = self.is_shown(head, shown);
        if is_warned != self.is_warned {
            self.flickered = time_s - self.changed_s < FLICKER_S;
            (self.is_warned, self.lead_m, self.changed_s) = (is_warned, 0.0, time_s);
        }
        if is_warned {
            self.lead_m = self.lead_m.max(distance_m);
        }
        let is_due = distance_m <= DEADLINE_M
            || (closing_m_per_s > MIN_CLOSING_M_PER_S && distance_m / closing_m_per_s <= DEADLINE_S);
        self.update_approach(session, time_s, is_due, (head, scene))
    }

    /// Takes the echo of the newest sub-aperture.
    fn locate(&mut self, session: &Session, time_s: f64) {
        let Some(around) = self.around.filter(|_| self.illumination.0.visible) else { return };
        let sensor_m = |offset_s: f64| session.sensor_at(time_s + offset_s).translation;
        let displacement_m = sensor_m(0.5 * SUBAPERTURE_S) - sensor_m(-0.5 * SUBAPERTURE_S);
        let profiles = session.play().config.subsweeps.iter().map(|subsweep| subsweep.profile);
        let range_sigma_m = 0.5 * profiles.map(|profile| profile.envelope_fwhm_m()).fold(f64::INFINITY, f64::min);
        self.locatable.push(&session.sensor_at(time_s), displacement_m, around.center(), range_sigma_m);
    }

    /// Updates the approach, if there is one; returns it when it is over.
    fn update_approach(
        &mut self,
        session: &Session,
        time_s: f64,
        is_due: bool,
        (head, scene): (&Pose, &Scene),
    ) -> Option<Approach> {
        if let Some(open) = &self.approach {
            if !open.is_scored && (is_due || self.distance_m <= open.nearest.deadline_m) {
                let is_first = open.nearest.is_first;
                let nearest = Approach { is_first, ..self.current_approach(session, time_s, head, scene) };
                self.approach = Some(OpenApproach { nearest, is_scored: is_due });
            }
        } else if self.distance_m < Rates::NEAR_M {
            let nearest = self.current_approach(session, time_s, head, scene);
            self.approach = Some(OpenApproach { nearest, is_scored: is_due });
            self.approached = true;
        }
        if self.distance_m > APPROACH_END_M { self.end() } else { None }
    }

    /// Ends the approach in progress.
    pub fn end(&mut self) -> Option<Approach> {
        self.approach.take().map(|open| open.nearest)
    }

    fn current_approach(&self, session: &Session, time_s: f64, head: &Pose, scene: &Scene) -> Approach {
        let of_it = scene.obstacles.iter().filter(|obstacle| self.is_at(obstacle.position_m));
        let error_m = |obstacle: &Obstacle| match self.geometry {
            TargetGeometry::Object(object, _) => session.distance_to_m(object, obstacle.position_m),
            TargetGeometry::Wall(_) => f64::INFINITY,
        };
        let errors_m = of_it.map(error_m).collect();
        Approach {
            kind: self.kind.clone(),
            deadline_s: time_s,
            deadline_m: self.distance_m,
            in_beam_s: self.in_beam_s,
            locatable: self.around.is_none() || self.locatable.is_reached(),
            is_first: !self.approached,
            warned: self.is_warned,
            lead_m: if self.is_warned { self.lead_m } else { 0.0 },
            errors_m,
            bounds: self.bound_errors(head, scene),
            in_map: matches!(self.geometry, TargetGeometry::Object(..)).then_some(self.in_map),
            detected: None,
        }
    }

    /// Errors of the reported shape's bounds, taken at the outer sides of its cells, against the
    /// object's scatterers.
    fn bound_errors(&self, head: &Pose, scene: &Scene) -> Option<BoundErrors> {
        let TargetGeometry::Object(_, parts) = self.geometry else { return None };
        let of_it = || scene.obstacles.iter().filter(|obstacle| self.is_at(obstacle.position_m));
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
pub(super) fn body_distance_m(head: &Pose, point: DVec3) -> f64 {
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

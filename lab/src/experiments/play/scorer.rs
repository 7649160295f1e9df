//! Scores reports and warnings of a play session against the truth, step by step.

use std::collections::VecDeque;

use glam::DVec3;

use super::figures::{Figures, RemovalOutcome};
use super::moving::MovingScorer;
use super::reports::ReportScorer;
use super::target::{DETECTED_S, FALSE_REPORT_M, PastDetection, ShownWarnings, Target, TargetGeometry};
use radar_mapping::{Scene, ScoredCandidate};
use radar_sar::geometry::Pose;
use radar_sar::math;
use radar_simulation::Session;

/// Scores one session.
pub(super) struct Scorer<'s> {
    session: &'s Session,
    /// Log odds at which a detection is reported.
    confirm_log_odds: f64,
    targets: Vec<Target<'s>>,
    reports: ReportScorer<'s>,
    removal: RemovalTracker,
    moving: MovingScorer,
    detections: VecDeque<PastDetection>,
    last_s: f64,
    figures: Figures,
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
            reports: ReportScorer::new(session),
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
            log_odds: candidate.log_odds,
        }));
        // An open approach may have had its deadline some time ago.
        while self.detections.pop_front_if(|past| time_s - past.time_s > 3.0 * DETECTED_S).is_some() {}
    }

    /// Scores one step; times increase.
    pub fn step(&mut self, time_s: f64, scene: &Scene, shown: &ShownWarnings) {
        let step_s = time_s - self.last_s;
        self.last_s = time_s;
        let (head, sensor) = (self.session.head_at(time_s), self.session.sensor_at(time_s));
        for target in &mut self.targets {
            if let Some(approach) = target.step(self.session, time_s, step_s, &head, scene, shown) {
                self.figures.approaches.push(target.with_detected(approach, &self.detections, self.confirm_log_odds));
            }
            self.figures.flickers += u64::from(std::mem::take(&mut target.flickered));
        }
        self.reports.step((time_s, step_s), &head, scene, &self.targets, &mut self.figures);
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

    fn track_removal(&mut self, time_s: f64, step_s: f64, sensor: &Pose, scene: &Scene) {
        let Some(gone) = self.targets.iter().find(|target| target.until_s.is_finite()) else { return };
        let TargetGeometry::Object(_, parts) = gone.geometry else { return };
        if time_s < gone.until_s || self.removal.removed {
            return;
        }
        let stays =
            |point: DVec3| self.targets.iter().filter(|t| t.until_s.is_infinite()).any(|target| target.is_at(point));
        let of_it = |point: DVec3| parts.iter().any(|part| part.position_m.distance(point) <= FALSE_REPORT_M);
        let is_known = scene.obstacles.iter().any(|o| of_it(o.position_m) && !stays(o.position_m));
        self.removal.was_known.get_or_insert(is_known);
        if parts.iter().any(|part| self.session.is_in_beam(sensor, part.position_m)) {
            self.removal.in_beam_s += step_s;
        }
        self.removal.removed = !is_known;
    }
}

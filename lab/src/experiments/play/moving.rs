//! Scores moving targets: a person or pet near is to be shown, and nothing is where nobody moves.

use std::collections::BTreeSet;

use glam::DVec3;
use serde::Serialize;

use radar_mapping::{MovingTarget, Scene};
use radar_simulation::Session;

/// A person of whom a part is seen within this range, metres, is to be shown. Choice: two steps away.
pub const NEAR_M: f64 = 2.5;
/// Maximum difference of range to a part of a person for a target to show that person, and minimum difference for one
/// that shows nobody, metres. Choice: a chest's depth and the pulse's half width; between right and false lies a margin.
pub const RIGHT_M: f64 = 0.35;
/// See [`RIGHT_M`].
pub const FALSE_M: f64 = 0.5;
/// Time for which former positions count for what is false, seconds. A track coasts for 1 s, a sub-aperture takes
/// 0.1 s, and the scene is up to 0.25 s old.
pub const AFTER_S: f64 = 1.4;
/// Interval of these positions, seconds, a divisor of [`AFTER_S`]. Choice: a person moves 0.15 m in between.
const STEP_S: f64 = 0.1;

/// Time near and time shown.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct ShownTime {
    /// Time in which a part was seen within 2.5 m, seconds.
    pub near_s: f64,
    /// Of it, time in which a target was shown at that range.
    pub shown_s: f64,
}

impl ShownTime {
    /// Share of the time near in which somebody was shown; NaN if nobody came near.
    pub fn share(&self) -> f64 {
        self.shown_s / self.near_s
    }

    fn add(&mut self, other: Self) {
        self.near_s += other.near_s;
        self.shown_s += other.shown_s;
    }
}

/// Figures of moving targets.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct MovingFigures {
    /// Of people.
    pub people: ShownTime,
    /// Of pets, while no person is near.
    pub pets: ShownTime,
    /// Targets at the range of the wearer's hands, where nobody else moves.
    pub hands: u64,
    /// Targets where nobody and nothing moves.
    pub nothing: u64,
}

impl MovingFigures {
    /// Adds another session's figures.
    pub fn add(&mut self, other: Self) {
        self.people.add(other.people);
        self.pets.add(other.pets);
        self.hands += other.hands;
        self.nothing += other.nothing;
    }
}

/// Scores the moving targets of one session.
#[derive(Debug, Default)]
pub(super) struct MovingScorer {
    figures: MovingFigures,
    /// Targets that were counted as false.
    counted: BTreeSet<u64>,
}

impl MovingScorer {
    /// Scores what is shown at one time.
    pub fn step(&mut self, session: &Session, time_s: f64, step_s: f64, scene: &Scene) {
        let sensor_m = session.sensor_at(time_s).translation;
        let is_near = |part: &DVec3| part.distance(sensor_m) <= NEAR_M && session.is_seen(time_s, *part);
        let of_those_near =
            [(session.visitor_at(time_s), &mut self.figures.people), (session.pet_at(time_s), &mut self.figures.pets)];
        if let Some((parts_m, time)) = of_those_near.into_iter().find(|(parts_m, _)| parts_m.iter().any(is_near)) {
            let is_shown = scene.moving.iter().any(|target| range_off_m(target, &parts_m) <= RIGHT_M);
            time.add(ShownTime { near_s: step_s, shown_s: if is_shown { step_s } else { 0.0 } });
        }
        for target in &scene.moving {
            let was_there = |parts_m: &dyn Fn(f64) -> Vec<DVec3>| {
                let times_s = (0..=(AFTER_S / STEP_S).round() as u32).map(|n| time_s - f64::from(n) * STEP_S);
                times_s.into_iter().any(|time_s| range_off_m(target, &parts_m(time_s)) <= FALSE_M)
            };
            if self.counted.contains(&target.id) || was_there(&|time_s| movers_at(session, time_s)) {
                continue;
            }
            let is_hand = was_there(&|time_s| session.hands_at(time_s).map(|h| h.to_vec()).unwrap_or_default());
            self.figures.hands += u64::from(is_hand);
            self.figures.nothing += u64::from(!is_hand);
            self.counted.insert(target.id);
        }
    }

    /// Ends the session.
    pub fn end(self) -> MovingFigures {
        self.figures
    }
}

/// Positions of the parts of all who move but the wearer.
pub fn movers_at(session: &Session, time_s: f64) -> Vec<DVec3> {
    [session.visitor_at(time_s), session.pet_at(time_s)].concat()
}

/// Difference between a target's range and that of the nearest part of somebody, metres; infinite without any.
pub fn range_off_m(target: &MovingTarget, parts_m: &[DVec3]) -> f64 {
    let ranges_m = parts_m.iter().map(|part| part.distance(target.seen_from.translation));
    ranges_m.map(|range_m| (range_m - target.range_m).abs()).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use a121::preset;
    use radar_simulation::PlaySession;

    fn target(id: u64, session: &Session, time_s: f64, range_m: f64) -> MovingTarget {
        MovingTarget {
            id,
            seen_from: session.sensor_at(time_s),
            range_m,
            range_sigma_m: 0.05,
            direction_sigma_rad: 0.4,
            speed_m_per_s: 0.5,
            evidence: 10.0,
            first_seen_ns: 0,
            last_seen_ns: 1,
        }
    }

    #[test]
    fn targets_are_right_at_a_person_and_false_elsewhere() {
        let play = PlaySession { duration_s: 60.0, ..PlaySession::new(preset("d16").unwrap(), 3) };
        let session = play.prepare().unwrap();
        let to_m = |at_s: f64| {
            let (sensor, parts) = (session.sensor_at(at_s), session.visitor_at(at_s));
            let seen = parts.into_iter().filter(|part| session.is_in_beam(&sensor, *part));
            seen.map(|part| part.distance(sensor.translation)).reduce(f64::min)
        };
        let times_s = || (0..600).map(|n| f64::from(n) * 0.1);
        let near_s = times_s().find(|at_s| to_m(*at_s).is_some_and(|m| m < NEAR_M)).expect("a person comes near");
        let alone_s = times_s().find(|at_s| (0..20).all(|n| to_m(at_s - f64::from(n) * 0.1).is_none())).unwrap();
        let figures = |at_s: f64, moving: Vec<MovingTarget>| {
            let mut scorer = MovingScorer::default();
            let scene = Scene { moving, ..Scene::default() };
            scorer.step(&session, at_s, 0.1, &scene);
            scorer.step(&session, at_s, 0.1, &scene);
            scorer.end()
        };
        let right = figures(near_s, vec![target(1, &session, near_s, to_m(near_s).unwrap() + 0.2)]);
        assert_eq!(right.people, ShownTime { near_s: 0.2, shown_s: 0.2 });
        assert_eq!((right.pets, right.hands, right.nothing), (ShownTime::default(), 0, 0));
        let missed = figures(near_s, vec![]);
        assert_eq!(missed.people, ShownTime { near_s: 0.2, shown_s: 0.0 });
        let far = session.sensor_at(alone_s);
        let hand_m = session.hands_at(alone_s).unwrap()[0].distance(far.translation);
        let others = vec![target(1, &session, alone_s, 2.9), target(2, &session, alone_s, hand_m)];
        assert_eq!(figures(alone_s, others), MovingFigures { hands: 1, nothing: 1, ..MovingFigures::default() });
    }
}

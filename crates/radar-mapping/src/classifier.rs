//! Whether what was believed is a thing or an artefact, as log odds learned from simulated play.
//!
//! Evidence alone does not tell: pieces of several things that happen to lie right, and what floor and walls scatter, score as much as a
//! weak thing does. But they differ in how they come by it: how much is left without the best moment, how even the strengths are, where in
//! the beam they lie, what else is at the range, whether an echo elsewhere explains as much, what was seen there before, how near walls,
//! floor and known things are. Boosted decision trees (Friedman 2001, Annals of Statistics 29:1189) weigh these: each asks a few questions
//! and adds to the log odds. The model is a data file, `acceptance/classifier.json`, made by
//! `examples/train_classifier.rs` from rooms that no figure is taken from.

mod model;

use glam::DVec3;

use super::clean::Detection;

use radar_sar::math;

pub use model::{HeldOutScore, Model, ModelCard, ModelError, Tree};

/// What a tree may ask for, in the table's order.
/// `ln`: natural logarithm.
pub const FEATURES: [&str; 27] = [
    "ln score",
    "ln robust score",
    "ln clutter",
    "amplitude spread",
    "miss fraction",
    "ambiguity",
    "history (log odds)",
    "position sigma (m)",
    "farthest range (m)",
    "ln sub-apertures",
    "distance to known (m)",
    "horizontal distance to known (m)",
    "distance to wall (m)",
    "height (m)",
    "range (m)",
    "beam amplitude",
    "ln reflectivity",
    "reflectivity spread",
    "ln coherence",
    "height sigma (m)",
    "time since start (s)",
    "distance to sensor (m)",
    "horizontal distance to sensor (m)",
    "ln reflectivity of the nearest known",
    "recent updates that scored it",
    "position sigma with history (m)",
    "sub-apertures of the history that observe it",
];

/// What the blocks from before the window say of a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct HistorySummary {
    /// How much likelier they make it that something is there, log odds.
    pub log_odds: f64,
    /// 1σ of the place by the window and them, all directions together, metres.
    pub sigma_m: f64,
    /// Blocks of them that tell of it.
    pub significant: usize,
}

/// What is around a place that may be a thing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Surroundings {
    /// To the nearest known thing, and the same seen from above, metres; infinite where nothing is known.
    pub nearest_track_m: f64,
    /// See `nearest_track_m`.
    pub nearest_track_horizontal_m: f64,
    /// To the nearest known wall, metres; negative beyond it.
    pub wall_m: f64,
    /// Logarithm of what the nearest known thing returns at most, 0 where nothing is known.
    pub nearest_track_ln_strength: f64,
    /// What the blocks from before the window say.
    pub history: HistorySummary,
    /// To the sensor as it is now, and the same seen from above, metres.
    pub sensor_m: f64,
    /// See `sensor_m`.
    pub sensor_horizontal_m: f64,
    /// How long blocks have been coming, seconds.
    pub age_s: f64,
    /// How many of the last looks have weighed it.
    pub recent_updates: usize,
}

/// A place that was weighed, for who learns from it.
#[derive(Debug, Clone, PartialEq)]
pub struct ScoredCandidate {
    /// Where, tracking frame, metres.
    pub position_m: DVec3,
    /// By [`FEATURES`].
    pub features: [f64; FEATURES.len()],
    /// It is no known place seen again, and all else allows it to be a thing.
    pub may_be_new: bool,
}

/// What is past counts for no more than this, log odds: things are moved into a place, too.
const MAX_HISTORY_LOG_ODDS: f64 = 10.0;

/// Of a place, by [`FEATURES`].
pub(super) fn features(detection: &Detection<DVec3>, around: &Surroundings) -> [f64; FEATURES.len()] {
    [
        math::ln(detection.score.max(0.1)),
        math::ln(detection.robust_score.max(0.5)),
        detection.ln_clutter,
        detection.amplitude_spread,
        detection.miss_fraction,
        detection.ambiguity,
        around.history.log_odds.clamp(-MAX_HISTORY_LOG_ODDS, MAX_HISTORY_LOG_ODDS),
        detection.sigma_m,
        detection.farthest_m.min(2.0),
        math::ln((detection.subapertures as f64).max(1.0)),
        around.nearest_track_m.min(1.5),
        around.nearest_track_horizontal_m.min(1.0),
        around.wall_m.min(1.0),
        detection.estimate.y,
        detection.aspect.range_m,
        detection.aspect.beam,
        detection.aspect.ln_strength,
        detection.aspect.spread,
        detection.aspect.ln_coherence,
        detection.aspect.sigma_up_m,
        around.age_s,
        around.sensor_m,
        around.sensor_horizontal_m,
        around.nearest_track_ln_strength,
        around.recent_updates as f64,
        around.history.sigma_m.min(1.0),
        around.history.significant as f64,
    ]
}

/// Log odds that it is a thing; 0 is even.
pub(super) fn log_odds(features: &[f64; FEATURES.len()]) -> f64 {
    Model::embedded().log_odds(features)
}

/// Log odds of what is beyond doubt.
const CERTAIN_LOG_ODDS: f64 = 3.0;
/// What is beyond doubt has such a score, keeps so much of it without its best moment, and is determined so well, 1σ in metres: of all
/// that was believed where nothing is, in 150 minutes of play, nothing came to that.
const CERTAIN_MIN_SCORE: f64 = 15.0;
const CERTAIN_MIN_ROBUST_SCORE: f64 = 9.0;
const CERTAIN_MAX_SIGMA_M: f64 = 0.05;

/// The log odds, but no less than [`CERTAIN_LOG_ODDS`] of what stands out so far that it is there whatever was learned: a strong thing that hangs
/// alone at the height of the head is like no furniture, and nothing is worse to run into. What is `at_surface` is left to what was learned.
pub(super) fn raise_if_certain(log_odds: f64, detection: &Detection<DVec3>, at_surface: bool) -> f64 {
    let stands_out = detection.score >= CERTAIN_MIN_SCORE && detection.robust_score >= CERTAIN_MIN_ROBUST_SCORE;
    let is_sure = stands_out && detection.sigma_m <= CERTAIN_MAX_SIGMA_M && !at_surface;
    if is_sure { log_odds.max(CERTAIN_LOG_ODDS) } else { log_odds }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clean::Aspect;

    /// Of a chair's back in a room that is known.
    fn thing() -> Detection<DVec3> {
        Detection {
            estimate: DVec3::new(0.3, 0.8, -1.2),
            score: 14.0,
            subapertures: 20,
            observable: true,
            sigma_m: 0.1,
            aspect: Aspect {
                range_m: 1.5,
                beam: 0.8,
                ln_strength: 6.0,
                spread: 0.05,
                ln_coherence: 3.0,
                sigma_up_m: 0.08,
            },
            log_odds: f64::INFINITY,
            robust_score: 12.0,
            ln_clutter: 0.3,
            farthest_m: 1.9,
            amplitude_spread: 0.25,
            miss_fraction: 0.0,
            ambiguity: 0.4,
            first_ns: 0,
            last_ns: 1,
        }
    }

    const AROUND: Surroundings = Surroundings {
        nearest_track_m: 0.8,
        nearest_track_horizontal_m: 0.6,
        wall_m: 0.9,
        nearest_track_ln_strength: 7.0,
        history: HistorySummary { log_odds: 4.0, sigma_m: 0.08, significant: 9 },
        sensor_m: 1.6,
        sensor_horizontal_m: 1.4,
        age_s: 60.0,
        recent_updates: 4,
    };

    /// The past speaks against it.
    fn against(log_odds: f64) -> Surroundings {
        Surroundings { history: HistorySummary { log_odds, sigma_m: 0.1, significant: 0 }, ..AROUND }
    }

    fn odds(thing: &Detection<DVec3>, around: &Surroundings) -> f64 {
        log_odds(&features(thing, around))
    }

    #[test]
    fn object_scores_higher_than_artefact() {
        let chair = odds(&thing(), &AROUND);
        let aspect = Aspect { beam: 0.2, ..thing().aspect };
        let lone = Detection { score: 4.0, robust_score: 1.0, amplitude_spread: 0.9, ambiguity: 0.95, ..thing() };
        let artefact = Detection { ln_clutter: 2.0, miss_fraction: 0.4, aspect, ..lone };
        let nothing_before = odds(&artefact, &against(-5.0));
        assert!(chair > 1.0 && nothing_before < -1.0, "{chair} {nothing_before}");
        for worse in [odds(&artefact, &AROUND), odds(&thing(), &against(-8.0))] {
            assert!(worse < chair, "{worse} {chair}");
        }
    }

    #[test]
    fn outstanding_detection_gets_certain_log_odds_unless_at_surface() {
        let hanging = Detection { score: 20.0, robust_score: 15.0, sigma_m: 0.03, ..thing() };
        assert_eq!(raise_if_certain(-1.0, &hanging, false), CERTAIN_LOG_ODDS);
        assert_eq!(raise_if_certain(5.0, &hanging, false), 5.0);
        assert_eq!(raise_if_certain(-1.0, &hanging, true), -1.0, "a wall's reflection is as strong");
        let less = [
            Detection { score: 14.0, ..hanging },
            Detection { robust_score: 8.0, ..hanging },
            Detection { sigma_m: 0.06, ..hanging },
        ];
        assert!(less.iter().all(|less| raise_if_certain(-1.0, less, false) == -1.0));
    }

    #[test]
    fn log_odds_are_finite_for_non_finite_features() {
        let (nearest_track_m, history) =
            (f64::INFINITY, HistorySummary { log_odds: f64::NAN, sigma_m: f64::NAN, significant: 0 });
        let nowhere = Surroundings {
            nearest_track_m,
            nearest_track_horizontal_m: nearest_track_m,
            wall_m: f64::NEG_INFINITY,
            history,
            recent_updates: 0,
            ..AROUND
        };
        assert!(odds(&Detection { score: f64::NAN, robust_score: f64::NEG_INFINITY, ..thing() }, &nowhere).is_finite());
    }
}

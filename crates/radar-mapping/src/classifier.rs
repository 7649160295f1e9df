//! Classifier: log odds that a detection is a real object and not an artefact, learned from
//! simulated play.
//!
//! The score alone does not separate the two. Parts of several objects that happen to fit, and what
//! floor and walls scatter, score as much as a weak object. They differ in other features: the
//! score without the best moment, the spread of the strengths, the position in the beam, the
//! clutter at the same range, whether an echo elsewhere explains as much, what was seen there
//! before, and the distance to walls, floor and known objects. Gradient-boosted trees combine these
//! (Friedman 2001, Annals of Statistics 29:1189). The model is a data file that is compiled in.
//! `lab/examples/train_classifier.rs` makes it, from rooms that no published figure is taken from.

mod model;

use glam::DVec3;

use super::clean::Detection;

use radar_sar::math;

pub use model::{HeldOutScore, Model, ModelCard, ModelError, Tree};

/// The features, in the table's order. `ln`: natural logarithm.
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

/// What the sub-apertures from before the window indicate about a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct HistorySummary {
    /// Log odds that they add for an object there.
    pub log_odds: f64,
    /// 1σ of the point by the window and the history together, all directions together, metres.
    pub sigma_m: f64,
    /// Number of sub-apertures of the history with a significant response.
    pub significant: usize,
}

/// Surroundings of a candidate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Surroundings {
    /// Distance to the nearest known object and its horizontal part, metres; infinite where nothing
    /// is known.
    pub nearest_track_m: f64,
    /// See `nearest_track_m`.
    pub nearest_track_horizontal_m: f64,
    /// Distance to the nearest known wall, metres; negative behind it.
    pub wall_m: f64,
    /// Logarithm of the greatest strength of the nearest known object; 0 where nothing is known.
    pub nearest_track_ln_strength: f64,
    /// Evidence from before the window.
    pub history: HistorySummary,
    /// Distance to the sensor in the newest sub-aperture and its horizontal part, metres.
    pub sensor_m: f64,
    /// See `sensor_m`.
    pub sensor_horizontal_m: f64,
    /// Time since the first sub-aperture, seconds.
    pub age_s: f64,
    /// Number of recent updates that scored this point.
    pub recent_updates: usize,
}

/// A scored candidate, for training.
#[derive(Debug, Clone, PartialEq)]
pub struct ScoredCandidate {
    /// Position in the tracking frame, metres.
    pub position_m: DVec3,
    /// Values of [`FEATURES`].
    pub features: [f64; FEATURES.len()],
    /// Log odds that it is a real object, by these features and by what was detected there before.
    pub log_odds: f64,
    /// What the earlier windows in which something was detected there add to the log odds by the features.
    pub recurrence_log_odds: f64,
    /// It is not a known object seen again, and everything else allows it to be a new one.
    pub may_be_new: bool,
}

/// Most log odds that the history may add or subtract. An object can be put where nothing was.
/// Choice: the history is evidence and no veto, because an object can be put where nothing was; 16
/// misses alone sum to −11.
const MAX_HISTORY_LOG_ODDS: f64 = 10.0;

/// The [`FEATURES`] of a detection.
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

/// Log odds that it is a real object; 0 is even.
pub(super) fn log_odds(features: &[f64; FEATURES.len()]) -> f64 {
    Model::embedded().log_odds(features)
}

/// Log odds given to a detection that stands out. Choice: that of
/// `ExistenceSettings::confirm_log_odds`, so that a track confirmed by it begins with enough
/// existence.
const CERTAIN_LOG_ODDS: f64 = 3.0;
/// A detection that stands out has such a score, such a robust score and such a 1σ, in metres.
/// Measured: in 150 minutes of play (`lab play`) nothing that was detected where nothing is reached
/// these.
const CERTAIN_MIN_SCORE: f64 = 15.0;
const CERTAIN_MIN_ROBUST_SCORE: f64 = 9.0;
const CERTAIN_MAX_SIGMA_M: f64 = 0.05;

/// The log odds, but at least [`CERTAIN_LOG_ODDS`] for a detection that stands out. A strong object
/// that hangs alone at head height is unlike the furniture of the training set, and nothing is
/// worse to run into. A detection `at_surface`, which is near a wall, is left to the classifier.
pub(super) fn raise_if_certain(log_odds: f64, detection: &Detection<DVec3>, at_surface: bool) -> f64 {
    let stands_out = detection.score >= CERTAIN_MIN_SCORE && detection.robust_score >= CERTAIN_MIN_ROBUST_SCORE;
    let is_sure = stands_out && detection.sigma_m <= CERTAIN_MAX_SIGMA_M && !at_surface;
    if is_sure { log_odds.max(CERTAIN_LOG_ODDS) } else { log_odds }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clean::Aspect;

    /// Detection of a chair's back in a known room.
    fn object() -> Detection<DVec3> {
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

    /// A history that speaks against the object.
    fn against(log_odds: f64) -> Surroundings {
        Surroundings { history: HistorySummary { log_odds, sigma_m: 0.1, significant: 0 }, ..AROUND }
    }

    fn odds(object: &Detection<DVec3>, around: &Surroundings) -> f64 {
        log_odds(&features(object, around))
    }

    #[test]
    fn object_scores_higher_than_artefact() {
        let chair = odds(&object(), &AROUND);
        let aspect = Aspect { beam: 0.2, ..object().aspect };
        let lone = Detection { score: 4.0, robust_score: 1.0, amplitude_spread: 0.9, ambiguity: 0.95, ..object() };
        let artefact = Detection { ln_clutter: 2.0, miss_fraction: 0.4, aspect, ..lone };
        let nothing_before = odds(&artefact, &against(-5.0));
        assert!(chair > 1.0 && nothing_before < -1.0, "{chair} {nothing_before}");
        for worse in [odds(&artefact, &AROUND), odds(&object(), &against(-8.0))] {
            assert!(worse < chair, "{worse} {chair}");
        }
    }

    #[test]
    fn outstanding_detection_gets_certain_log_odds_unless_at_surface() {
        let hanging = Detection { score: 20.0, robust_score: 15.0, sigma_m: 0.03, ..object() };
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
        assert!(
            odds(&Detection { score: f64::NAN, robust_score: f64::NEG_INFINITY, ..object() }, &nowhere).is_finite()
        );
    }
}

//! Whether what was believed is a thing or an artefact, as log odds learned from simulated play.
//!
//! Evidence alone does not tell: pieces of several things that happen to lie right, and what floor and walls scatter, score as much as a
//! weak thing does. But they differ in how they come by it: how much is left without the best moment, how even the strengths are, where in
//! the beam they lie, what else is at the range, whether an echo elsewhere explains as much, what was seen there before, how near walls,
//! floor and known things are. Boosted decision trees (Friedman 2001, Annals of Statistics 29:1189) weigh these: each asks a few questions
//! and adds to the log odds. The model is a data file, `acceptance/classifier.json`, made by
//! `examples/acceptance.rs` from rooms that no figure is taken from.

mod model;

use glam::DVec3;

use super::explain::Explained;

use crate::math;

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
pub(super) struct Earlier {
    /// How much likelier they make it that something is there, log odds.
    pub log_odds: f64,
    /// 1σ of the place by the window and them, all directions together, metres.
    pub sigma_m: f64,
    /// Blocks of them that tell of it.
    pub telling: usize,
}

/// What is around a place that may be a thing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Around {
    /// To the nearest known thing, and the same seen from above, metres; infinite where nothing is known.
    pub known_m: f64,
    /// See `known_m`.
    pub known_level_m: f64,
    /// To the nearest known wall, metres; negative beyond it.
    pub wall_m: f64,
    /// Logarithm of what the nearest known thing returns at most, 0 where nothing is known.
    pub known_ln_strength: f64,
    /// What the blocks from before the window say.
    pub earlier: Earlier,
    /// To the sensor as it is now, and the same seen from above, metres.
    pub sensor_m: f64,
    /// See `sensor_m`.
    pub sensor_level_m: f64,
    /// How long blocks have been coming, seconds.
    pub age_s: f64,
    /// How many of the last looks have weighed it.
    pub looks: usize,
}

/// A place that was weighed, for who learns from it.
#[derive(Debug, Clone, PartialEq)]
pub struct Weighed {
    /// Where, tracking frame, metres.
    pub place_m: DVec3,
    /// By [`FEATURES`].
    pub features: [f64; FEATURES.len()],
    /// It is no known place seen again, and all else allows it to be a thing.
    pub may_be_new: bool,
}

/// What is past counts for no more than this, log odds: things are moved into a place, too.
const MOST_OF_PAST: f64 = 10.0;

/// Of a place, by [`FEATURES`].
pub(super) fn features(believed: &Explained<DVec3>, around: &Around) -> [f64; FEATURES.len()] {
    [
        math::ln(believed.score.max(0.1)),
        math::ln(believed.lasting.max(0.5)),
        believed.drowned,
        believed.uneven,
        believed.silent,
        believed.rival,
        around.earlier.log_odds.clamp(-MOST_OF_PAST, MOST_OF_PAST),
        believed.sigma_m,
        believed.farthest_m.min(2.0),
        math::ln((believed.blocks as f64).max(1.0)),
        around.known_m.min(1.5),
        around.known_level_m.min(1.0),
        around.wall_m.min(1.0),
        believed.thing.y,
        believed.aspect.range_m,
        believed.aspect.beam,
        believed.aspect.ln_strength,
        believed.aspect.spread,
        believed.aspect.ln_coherence,
        believed.aspect.sigma_up_m,
        around.age_s,
        around.sensor_m,
        around.sensor_level_m,
        around.known_ln_strength,
        around.looks as f64,
        around.earlier.sigma_m.min(1.0),
        around.earlier.telling as f64,
    ]
}

/// Log odds that it is a thing; 0 is even.
pub(super) fn log_odds(features: &[f64; FEATURES.len()]) -> f64 {
    Model::embedded().log_odds(features)
}

/// Log odds of what is beyond doubt.
const BEYOND_DOUBT: f64 = 3.0;
/// What is beyond doubt has such a score, keeps so much of it without its best moment, and is determined so well, 1σ in metres: of all
/// that was believed where nothing is, in 150 minutes of play, nothing came to that.
const BEYOND_SCORE: f64 = 15.0;
const BEYOND_LASTING: f64 = 9.0;
const BEYOND_SIGMA_M: f64 = 0.05;

/// The log odds, but no less than [`BEYOND_DOUBT`] of what stands out so far that it is there whatever was learned: a strong thing that hangs
/// alone at the height of the head is like no furniture, and nothing is worse to run into. What is `at_surface` is left to what was learned.
pub(super) fn beyond_doubt_or(log_odds: f64, believed: &Explained<DVec3>, at_surface: bool) -> f64 {
    let stands_out = believed.score >= BEYOND_SCORE && believed.lasting >= BEYOND_LASTING;
    let is_sure = stands_out && believed.sigma_m <= BEYOND_SIGMA_M && !at_surface;
    if is_sure { log_odds.max(BEYOND_DOUBT) } else { log_odds }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::obstacles::explain::Aspect;

    /// Of a chair's back in a room that is known.
    fn thing() -> Explained<DVec3> {
        Explained {
            thing: DVec3::new(0.3, 0.8, -1.2),
            score: 14.0,
            blocks: 20,
            determined: true,
            sigma_m: 0.1,
            aspect: Aspect {
                range_m: 1.5,
                beam: 0.8,
                ln_strength: 6.0,
                spread: 0.05,
                ln_coherence: 3.0,
                sigma_up_m: 0.08,
            },
            odds: f64::INFINITY,
            lasting: 12.0,
            drowned: 0.3,
            farthest_m: 1.9,
            uneven: 0.25,
            silent: 0.0,
            rival: 0.4,
            first_ns: 0,
            last_ns: 1,
        }
    }

    const AROUND: Around = Around {
        known_m: 0.8,
        known_level_m: 0.6,
        wall_m: 0.9,
        known_ln_strength: 7.0,
        earlier: Earlier { log_odds: 4.0, sigma_m: 0.08, telling: 9 },
        sensor_m: 1.6,
        sensor_level_m: 1.4,
        age_s: 60.0,
        looks: 4,
    };

    /// The past speaks against it.
    fn against(log_odds: f64) -> Around {
        Around { earlier: Earlier { log_odds, sigma_m: 0.1, telling: 0 }, ..AROUND }
    }

    fn odds(thing: &Explained<DVec3>, around: &Around) -> f64 {
        log_odds(&features(thing, around))
    }

    #[test]
    fn a_thing_is_likely_and_an_artefact_is_not() {
        let chair = odds(&thing(), &AROUND);
        let aspect = Aspect { beam: 0.2, ..thing().aspect };
        let lone = Explained { score: 4.0, lasting: 1.0, uneven: 0.9, rival: 0.95, ..thing() };
        let artefact = Explained { drowned: 2.0, silent: 0.4, aspect, ..lone };
        let nothing_before = odds(&artefact, &against(-5.0));
        assert!(chair > 1.0 && nothing_before < -1.0, "{chair} {nothing_before}");
        for worse in [odds(&artefact, &AROUND), odds(&thing(), &against(-8.0))] {
            assert!(worse < chair, "{worse} {chair}");
        }
    }

    #[test]
    fn what_is_beyond_doubt_is_there_though_it_is_like_no_furniture() {
        let hanging = Explained { score: 20.0, lasting: 15.0, sigma_m: 0.03, ..thing() };
        assert_eq!(beyond_doubt_or(-1.0, &hanging, false), BEYOND_DOUBT);
        assert_eq!(beyond_doubt_or(5.0, &hanging, false), 5.0);
        assert_eq!(beyond_doubt_or(-1.0, &hanging, true), -1.0, "a wall's reflection is as strong");
        let less = [
            Explained { score: 14.0, ..hanging },
            Explained { lasting: 8.0, ..hanging },
            Explained { sigma_m: 0.06, ..hanging },
        ];
        assert!(less.iter().all(|less| beyond_doubt_or(-1.0, less, false) == -1.0));
    }

    #[test]
    fn no_number_breaks_it() {
        let (known_m, earlier) = (f64::INFINITY, Earlier { log_odds: f64::NAN, sigma_m: f64::NAN, telling: 0 });
        let nowhere =
            Around { known_m, known_level_m: known_m, wall_m: f64::NEG_INFINITY, earlier, looks: 0, ..AROUND };
        assert!(odds(&Explained { score: f64::NAN, lasting: f64::NEG_INFINITY, ..thing() }, &nowhere).is_finite());
    }
}

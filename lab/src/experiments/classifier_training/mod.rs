//! Trains and scores the classifier that separates objects from artefacts, on simulated play
//! sessions with known truth.
//!
//! Sessions are played once; their examples are kept as a table (CSV), from which models are trained and scored with
//! and without single features. A detection within 25 cm of an object's scatterer is a positive example. One where nothing is
//! present is a negative example. One on the floor or the ceiling is a negative example of low weight: it misleads
//! nobody, but there is no need to warn of it. One on a wall is no example: it may be run into, and a model that learns
//! to reject walls also rejects objects near them. Detections of the same place in many updates share one place's
//! weight: n of them count √n. What recurrence adds to the log odds is added in training too, so that it is not learned again.

mod gradient_boosting;

use glam::DVec3;
use rayon::prelude::*;

use super::play::{PlayError, PlayTrial, for_each_update};
use gradient_boosting::{BoostSettings, FittedTree, LabelledFeatures, Split, boost};
use radar_mapping::{FEATURES, HeldOutScore, Model, ModelCard, ScoredCandidate, Tree};
use radar_sar::math;
use radar_simulation::{PlaySession, Session, SessionWall};

/// A detection nearer than this to a scatterer belongs to its object, metres. Choice: the play
/// scorer uses the same limit.
const OBJECT_RADIUS_M: f64 = 0.25;
/// Detections within this of each other are one object, metres. Choice: wider than detections
/// of one part scatter, which must not count as independent.
const MERGE_RADIUS_M: f64 = 0.25;
/// Weight of a detection on the floor or the ceiling relative to one where nothing is. Choice: at 0.3 more
/// objects are taken for artefacts; without these examples the model cannot separate objects from the floor.
const FLOOR_WEIGHT: f64 = 0.1;
/// Hyperparameters. The number of trees is the largest that still improved rooms held out of the
/// training.
const SETTINGS: BoostSettings =
    BoostSettings { trees: 250, leaves: 24, learning_rate: 0.05, min_rows: 60, l2_regularisation: 5.0 };

/// Labelled features of detections in simulated sessions.
#[derive(Debug, Clone, Default)]
pub struct TrainingSet {
    /// The commands that played the sessions.
    commands: Vec<String>,
    rows: Vec<LabelledFeatures<{ FEATURES.len() }>>,
}

impl TrainingSet {
    /// Plays one session per seed and labels its detections; `command` is what the user ran. The result does not depend on the
    /// number of threads.
    ///
    /// # Errors
    /// A session that cannot be simulated.
    pub fn of(trial: &PlayTrial, seeds: &[u64], command: &str) -> Result<Self, PlayError> {
        let of_seed = |&seed: &u64| -> Result<_, PlayError> {
            let session = PlaySession { seed, ..trial.session.clone() }.prepare()?;
            let mut candidates = Vec::new();
            for_each_update(&session, trial, |time_s, weighed| {
                let new = weighed.iter().filter(|weighed| weighed.may_be_new);
                let of_class = |weighed: &ScoredCandidate| {
                    true_class(&session, time_s, weighed.position_m).map(|class| (weighed.clone(), class))
                };
                candidates.extend(new.filter_map(of_class));
            });
            Ok(rows(&candidates))
        };
        let of_seeds: Vec<_> = seeds.par_iter().map(of_seed).collect::<Result<_, _>>()?;
        Ok(Self { commands: vec![command.into()], rows: of_seeds.concat() })
    }

    /// Both sets together.
    #[must_use]
    pub fn merged(mut self, others: Self) -> Self {
        self.rows.extend(others.rows);
        self.commands.extend(others.commands);
        self.commands.dedup();
        self
    }

    /// The sets together, each with the same weight in all, however many examples it has.
    #[must_use]
    pub fn weighed_alike(mut sets: Vec<Self>) -> Self {
        let weight = |set: &Self| set.rows.iter().map(|row| row.weight).sum::<f64>();
        let mean = sets.iter().map(weight).sum::<f64>() / sets.len().max(1) as f64;
        for set in &mut sets {
            let factor = mean / weight(set).max(1e-300);
            set.rows.iter_mut().for_each(|row| row.weight *= factor);
        }
        sets.into_iter().fold(Self::default(), Self::merged)
    }

    /// The same with these features the same in every example, so that nothing is learned from them.
    #[must_use]
    pub fn without(mut self, features: &[usize]) -> Self {
        for row in &mut self.rows {
            features.iter().for_each(|&feature| row.features[feature] = 0.0);
        }
        self
    }

    /// As CSV: the commands in comments (#), a heading with the features' names, then one example a line. Read back
    /// exactly.
    pub fn to_csv(&self) -> String {
        let line = |row: &LabelledFeatures<{ FEATURES.len() }>| {
            let features: String = row.features.iter().map(|value| format!("{value},")).collect();
            format!("{features}{},{},{}\n", row.added_log_odds, u8::from(row.is_object), row.weight)
        };
        let commands = self.commands.iter().map(|command| format!("# {command}\n"));
        commands.chain([csv_heading()]).chain(self.rows.iter().map(line)).collect()
    }

    /// Reads [`Self::to_csv`].
    ///
    /// # Errors
    /// Examples of other features, or a line that is not of numbers.
    pub fn from_csv(text: &str) -> Result<Self, CsvError> {
        let commands: Vec<String> = text.lines().map_while(|line| line.strip_prefix("# ")).map(String::from).collect();
        let mut lines = text.lines().enumerate().skip(commands.len());
        if lines.next().is_none_or(|(_, heading)| heading != csv_heading().trim_end()) {
            return Err(CsvError::Heading);
        }
        let row = |(n, line): (usize, &str)| from_csv_line(line).ok_or(CsvError::Line(n + 1));
        Ok(Self { commands, rows: lines.map(row).collect::<Result<_, _>>()? })
    }

    /// Number of positive examples (objects) and of negative examples.
    pub fn counts(&self) -> (usize, usize) {
        let things = self.rows.iter().filter(|row| row.is_object).count();
        (things, self.rows.len() - things)
    }

    /// Trains a model on this set; `command` is what the user ran. It goes into the model card, with the commands that
    /// played the sessions.
    pub fn train(&self, command: String) -> Model {
        let worlds = format!("simulated play sessions: {}", self.commands.join("; "));
        let (prior, trees) = boost(&self.rows, &SETTINGS);
        let (things, artefacts) = self.counts();
        let card = ModelCard { command, commit: String::new(), worlds, things, artefacts, held_out: None };
        let tree = |tree: FittedTree| {
            let split = |Split { feature, threshold, children: [not_above, above] }: &Split| {
                (*feature as u8, rounded(*threshold), *not_above as i16, *above as i16)
            };
            Tree {
                splits: tree.splits.iter().map(split).collect(),
                leaves: tree.leaves.iter().map(|odds| rounded(*odds)).collect(),
            }
        };
        Model::new((prior * 1e4).round() / 1e4, trees.into_iter().map(tree).collect(), card)
    }

    /// Scores a model on this set with the training weights; `command` is what the user ran.
    pub fn score(&self, model: &Model, command: String) -> HeldOutScore {
        let mut scored: Vec<(f64, &LabelledFeatures<{ FEATURES.len() }>)> =
            self.rows.iter().map(|row| (model.log_odds(&row.features) + row.added_log_odds, row)).collect();
        scored.sort_by(|a, b| a.0.total_cmp(&b.0));
        let of = |is_object: bool| -> f64 {
            self.rows.iter().filter(|row| row.is_object == is_object).map(|row| row.weight).sum()
        };
        let loss = |(odds, row): &(f64, &LabelledFeatures<_>)| {
            let against = if row.is_object { -odds } else { *odds };
            row.weight * math::ln_1p(math::exp(against))
        };
        // Area under the ROC curve: share of pairs of an object and an artefact in which the object
        // has the higher odds. Equal odds count half.
        let (mut artefacts_below, mut ordered) = (0.0, 0.0);
        for equal in scored.chunk_by(|a, b| a.0 == b.0) {
            let sum = |is_object| equal.iter().filter(|s| s.1.is_object == is_object).map(|s| s.1.weight).sum::<f64>();
            let (objects, artefacts) = (sum(true), sum(false));
            ordered += objects * (artefacts_below + 0.5 * artefacts);
            artefacts_below += artefacts;
        }
        let (things, artefacts) = self.counts();
        let to_4_places = |value: f64| (value * 1e4).round() / 1e4;
        HeldOutScore {
            command,
            things,
            artefacts,
            log_loss: to_4_places(scored.iter().map(loss).sum::<f64>() / (of(true) + of(false))),
            area_under_curve: to_4_places(ordered / (of(true) * of(false))),
        }
    }
}

/// Why a table of examples is refused.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum CsvError {
    /// Other columns.
    #[error("the examples are of other features than this program computes: play the sessions again")]
    Heading,
    /// Not numbers, or too many or too few.
    #[error("line {0} of the examples is broken")]
    Line(usize),
}

fn csv_heading() -> String {
    format!("{},recurrence (log odds),is object,weight\n", FEATURES.join(","))
}

fn from_csv_line(line: &str) -> Option<LabelledFeatures<{ FEATURES.len() }>> {
    let numbers: Vec<f64> = line.split(',').map(|number| number.parse().ok()).collect::<Option<_>>()?;
    let (&features, &[added_log_odds, is_object, weight]) = numbers.split_first_chunk()? else { return None };
    let is_sound = !features.iter().any(|value| value.is_nan())
        && added_log_odds.is_finite()
        && weight.is_finite()
        && weight > 0.0;
    is_sound.then_some(LabelledFeatures { features, is_object: is_object != 0.0, added_log_odds, weight })
}

/// Rounds to four decimals, as the model file stores them.
fn rounded(value: f64) -> f32 {
    ((value * 1e4).round() / 1e4) as f32
}

/// What is truly at a detection's position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TrueClass {
    Object,
    FloorOrCeiling,
    Nothing,
}

/// `None`: a wall, which is no example.
fn true_class(session: &Session, time_s: f64, position_m: DVec3) -> Option<TrueClass> {
    let things = session.things();
    let there = (0..things.len()).filter(|&n| time_s < things[n].until_s);
    let is_at = |n: usize| session.distance_to_m(n, position_m) <= OBJECT_RADIUS_M;
    if there.into_iter().any(is_at) {
        return Some(TrueClass::Object);
    }
    let is_near = |wall: &&SessionWall| wall.distance_m(position_m) <= OBJECT_RADIUS_M;
    let near: Vec<&SessionWall> = session.walls().iter().filter(is_near).collect();
    match near.is_empty() {
        true => Some(TrueClass::Nothing),
        false if near.iter().any(|wall| wall.plane.is_upright()) => None,
        false => Some(TrueClass::FloorOrCeiling),
    }
}

/// Rows of one session: an object detected n times counts √n times.
fn rows(candidates: &[(ScoredCandidate, TrueClass)]) -> Vec<LabelledFeatures<{ FEATURES.len() }>> {
    let mut middles: Vec<(DVec3, TrueClass, usize)> = Vec::new();
    let mut middle_of = |position: DVec3, what: TrueClass| {
        let is_same = |(middle, other, _): &(DVec3, TrueClass, usize)| {
            *other == what && middle.distance(position) < MERGE_RADIUS_M
        };
        let at = middles.iter().position(is_same).unwrap_or_else(|| {
            middles.push((position, what, 0));
            middles.len() - 1
        });
        middles[at].2 += 1;
        at
    };
    let of_middle: Vec<usize> = candidates.iter().map(|(weighed, what)| middle_of(weighed.position_m, *what)).collect();
    let row = |((weighed, what), at): (&(ScoredCandidate, TrueClass), &usize)| LabelledFeatures {
        features: weighed.features,
        is_object: *what == TrueClass::Object,
        added_log_odds: weighed.recurrence_log_odds,
        weight: if *what == TrueClass::FloorOrCeiling { FLOOR_WEIGHT } else { 1.0 } / (middles[*at].2 as f64).sqrt(),
    };
    candidates.iter().zip(&of_middle).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(strength: f64, is_object: bool) -> LabelledFeatures<{ FEATURES.len() }> {
        let mut features = [0.0; FEATURES.len()];
        features[16] = strength;
        LabelledFeatures { features, is_object, added_log_odds: 0.0, weight: 1.0 }
    }

    #[test]
    fn examples_are_written_and_read_exactly_and_others_refused() {
        let rows = vec![row(0.1, true), row(-1.0 / 3.0, false)];
        let set = TrainingSet { commands: vec!["play a".into(), "play b".into()], rows };
        let text = set.to_csv();
        let read = TrainingSet::from_csv(&text).unwrap();
        assert_eq!((&read.rows, &read.commands), (&set.rows, &set.commands));
        let refused = |text: &str| TrainingSet::from_csv(text).unwrap_err();
        assert_eq!(refused(&text.replace("ln score", "score")), CsvError::Heading);
        for broken in [text.replace("0.1", "NaN"), text.replace("0.1,", ""), text.replace("0.1", "x")] {
            assert_eq!(refused(&broken), CsvError::Line(4));
        }
        assert!(set.without(&[16]).rows.iter().all(|row| row.features[16] == 0.0));
    }

    #[test]
    fn positions_have_the_class_of_what_is_there() {
        let config = a121::preset("d16").unwrap();
        let session = PlaySession { duration_s: 20.0, ..PlaySession::new(config, 3) }.prepare().unwrap();
        let things = session.things();
        let is_free = |point: DVec3| (0..things.len()).all(|n| session.distance_to_m(n, point) > 0.3);
        let away_m = |point: DVec3| {
            let upright = session.walls().iter().filter(|wall| wall.plane.is_upright());
            upright.map(|wall| wall.distance_m(point)).fold(f64::INFINITY, f64::min)
        };
        let gone = things.iter().position(|object| object.until_s.is_finite()).unwrap();
        let there = things[gone].thing.scatterers[0].position_m;
        assert_eq!(true_class(&session, 0.0, there), Some(TrueClass::Object));
        assert_ne!(true_class(&session, 20.0, there), Some(TrueClass::Object), "it was carried away");
        // A lattice over the room finds each kind of place.
        let lattice = (0..20 * 20 * 30).map(|n| {
            DVec3::new(f64::from(n % 20), 0.0, f64::from(n / 20 % 20)) * 0.3
                + DVec3::new(-3.0, 0.1 * f64::from(n / 400), -3.0)
        });
        let mut found = [0; 3];
        for point in lattice.filter(|point| is_free(*point)) {
            let near_plane = session.walls().iter().any(|wall| wall.distance_m(point) <= OBJECT_RADIUS_M);
            let (class, expected) = match (away_m(point) <= OBJECT_RADIUS_M, near_plane) {
                (true, _) => (0, None),
                (false, true) => (1, Some(TrueClass::FloorOrCeiling)),
                (false, false) => (2, Some(TrueClass::Nothing)),
            };
            assert_eq!(true_class(&session, 0.0, point), expected, "{point}");
            found[class] += 1;
        }
        assert!(found.iter().all(|count| *count > 0), "{found:?}");
    }

    #[test]
    fn a_small_set_weighs_as_much_as_a_large_one() {
        let set = |count: usize, is_object: bool| TrainingSet {
            commands: vec![format!("play {count}")],
            rows: vec![row(1.0, is_object); count],
        };
        let both = TrainingSet::weighed_alike(vec![set(300, true), set(100, false)]);
        let weight = |is_object: bool| -> f64 {
            both.rows.iter().filter(|row| row.is_object == is_object).map(|row| row.weight).sum()
        };
        assert!((weight(true) - 200.0).abs() < 1e-9 && (weight(false) - 200.0).abs() < 1e-9);
        assert_eq!((both.counts(), both.commands.len()), ((300, 100), 2));
        assert_eq!(TrainingSet::weighed_alike(Vec::new()).counts(), (0, 0));
    }

    #[test]
    fn a_trained_model_is_scored_by_order_and_by_loss() {
        let rows = (0..400).map(|n| row(f64::from(n % 20), n % 20 >= 10)).collect();
        let set = TrainingSet { commands: Vec::new(), rows };
        let model = set.train("test".into());
        assert_eq!(Model::from_json(&model.to_json()).unwrap(), model);
        let right = set.score(&model, "test".into());
        assert!(right.area_under_curve == 1.0 && right.log_loss < 0.01, "{right:?}");
        assert_eq!((right.things, right.artefacts), (200, 200));
        // With the labels of half of the rows inverted, the order is random and the loss that of
        // confident errors.
        let mut mixed = set.clone();
        mixed.rows.iter_mut().step_by(2).for_each(|row| row.is_object = !row.is_object);
        let half = mixed.score(&model, "test".into());
        assert!((half.area_under_curve - 0.5).abs() < 0.01 && half.log_loss > 2.0, "{half:?}");
    }
}

//! Learns to tell things from artefacts: what the search weighs in simulated play, held against the truth, and the table that comes of it.
//!
//! A place that was believed and is a thing's teaches one class, one where nothing is the other, and so does, less, what lies at a wall, the
//! floor or the ceiling: it misleads nobody, but these are told as planes. Places that are looked at again and again count once and a
//! little more.

mod boost;

use std::fmt::Write;

use glam::DVec3;
use rayon::prelude::*;

use super::play::{PlayError, PlayTrial, each_look};
use crate::obstacles::{FEATURES, Weighed};
use crate::simulation::{PlaySession, Session};
use boost::{BoostSettings, Question, Row, boost};

/// Nearer than this to a scatterer it is the thing's, metres.
const THING_M: f64 = 0.25;
/// What is weighed within this of another is the same place, metres.
const SAME_M: f64 = 0.25;
/// What lies on a surface counts so much of what lies where nothing is.
const SURFACE_SHARE: f64 = 0.3;
/// As many trees as still bettered rooms that were left out of the learning.
const SETTINGS: BoostSettings = BoostSettings { trees: 250, leaves: 24, share: 0.05, least_rows: 60, damping: 5.0 };

/// Places that were weighed, and whether something is there.
#[derive(Debug, Clone, Default)]
pub struct Lessons {
    rows: Vec<Row<{ FEATURES.len() }>>,
}

impl Lessons {
    /// Of each seed's session. The same on any number of threads.
    ///
    /// # Errors
    /// A session that cannot be simulated.
    pub fn of(trial: &PlayTrial, seeds: &[u64]) -> Result<Self, PlayError> {
        let of_seed = |&seed: &u64| -> Result<_, PlayError> {
            let session = PlaySession { seed, ..trial.session.clone() }.stage()?;
            let mut places = Vec::new();
            each_look(&session, trial, |time_s, weighed| {
                let new = weighed.iter().filter(|weighed| weighed.may_be_new);
                places.extend(new.map(|weighed| (weighed.clone(), what_is_at(&session, time_s, weighed))));
            });
            Ok(rows(&places))
        };
        let of_seeds: Vec<_> = seeds.par_iter().map(of_seed).collect::<Result<_, _>>()?;
        Ok(Self { rows: of_seeds.concat() })
    }

    /// These and others.
    #[must_use]
    pub fn and(mut self, others: Self) -> Self {
        self.rows.extend(others.rows);
        self
    }

    /// Number of places of things and of nothing.
    pub fn counts(&self) -> (usize, usize) {
        let things = self.rows.iter().filter(|row| row.is_thing).count();
        (things, self.rows.len() - things)
    }

    /// What is learned, as the source text of the table.
    pub fn table(&self) -> String {
        let (prior, trees) = boost(&self.rows, &SETTINGS);
        let (things, nothing) = self.counts();
        let mut text = format!(
            "//! Made by `examples/acceptance.rs` from {things} places of things and {nothing} where nothing is; not to be changed by hand.\n\n\
             use super::Tree;\n\n/// Log odds before any question.\npub(super) const PRIOR: f64 = {prior:.4};\n\n\
             #[rustfmt::skip]\n#[allow(clippy::approx_constant)] // Bounds come near to all kinds of constants.\n\
             pub(super) const TREES: &[Tree] = &[\n"
        );
        for tree in trees {
            let questions = tree.questions.iter().map(|Question { feature, bound, then: [not_above, above] }| {
                format!("({feature}, {:?}, {not_above}, {above})", rounded(*bound))
            });
            let questions: Vec<String> = questions.collect();
            let leaves: Vec<String> = tree.leaves.iter().map(|odds| format!("{:?}", rounded(*odds))).collect();
            let (questions, leaves) = (questions.join(", "), leaves.join(", "));
            // Writing to a string does not fail.
            let _ = writeln!(text, "    Tree {{ questions: &[{questions}], leaves: &[{leaves}] }},");
        }
        text + "];\n"
    }
}

/// To four places after the point, as the table has it.
fn rounded(value: f64) -> f32 {
    ((value * 1e4).round() / 1e4) as f32
}

/// What is at a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum There {
    Thing,
    /// A wall, the floor or the ceiling.
    Surface,
    Nothing,
}

fn what_is_at(session: &Session, time_s: f64, weighed: &Weighed) -> There {
    let there = session.things().into_iter().filter(|thing| time_s < thing.until_s);
    let parts = there.flat_map(|thing| &thing.thing.scatterers);
    let to_thing_m = parts.map(|part| part.position_m.distance(weighed.place_m)).fold(f64::INFINITY, f64::min);
    if to_thing_m <= THING_M {
        There::Thing
    } else if session.walls().iter().any(|wall| wall.distance_m(weighed.place_m) <= THING_M) {
        There::Surface
    } else {
        There::Nothing
    }
}

/// Rows of one session: a place that was weighed n times counts √n times.
fn rows(places: &[(Weighed, There)]) -> Vec<Row<{ FEATURES.len() }>> {
    let mut middles: Vec<(DVec3, There, usize)> = Vec::new();
    let mut middle_of = |place: DVec3, what: There| {
        let is_same = |(middle, other, _): &(DVec3, There, usize)| *other == what && middle.distance(place) < SAME_M;
        let at = middles.iter().position(is_same).unwrap_or_else(|| {
            middles.push((place, what, 0));
            middles.len() - 1
        });
        middles[at].2 += 1;
        at
    };
    let of_middle: Vec<usize> = places.iter().map(|(weighed, what)| middle_of(weighed.place_m, *what)).collect();
    let row = |((weighed, what), at): (&(Weighed, There), &usize)| Row {
        features: weighed.features,
        is_thing: *what == There::Thing,
        weight: if *what == There::Surface { SURFACE_SHARE } else { 1.0 } / (middles[*at].2 as f64).sqrt(),
    };
    places.iter().zip(&of_middle).map(row).collect()
}

//! Learns to tell things from artefacts: what the search weighs in simulated play, held against the truth, and the table that comes of it.
//!
//! A place that was believed and is a thing's teaches one class, one where nothing is the other; of what lies at a wall, the floor or the
//! ceiling nothing is learned, since it is wrong of nobody. Places that are looked at again and again count once and a little more.

mod boost;

use std::fmt::Write;

use glam::DVec3;
use rayon::prelude::*;

use super::play::{PlayError, PlayTrial, each_look};
use crate::obstacles::{FEATURES, Weighed};
use crate::simulation::{PlaySession, Session};
use boost::{BoostSettings, Row, boost};

/// Nearer than this to a scatterer it is the thing's, metres.
const THING_M: f64 = 0.25;
/// What is weighed within this of another is the same place, metres.
const SAME_M: f64 = 0.25;
/// As many trees as still bettered rooms that were left out of the learning.
const SETTINGS: BoostSettings = BoostSettings { trees: 150, share: 0.08, least_rows: 30 };

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
                places.extend(new.filter_map(|weighed| Some((weighed.clone(), is_thing(&session, time_s, weighed)?))));
            });
            Ok(rows(&places))
        };
        let of_seeds: Vec<_> = seeds.par_iter().map(of_seed).collect::<Result<_, _>>()?;
        Ok(Self { rows: of_seeds.concat() })
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
             #[rustfmt::skip]\npub(super) const TREES: &[Tree] = &[\n"
        );
        for tree in trees {
            let question = |(feature, bound): (usize, f64)| format!("({feature}, {bound:.4})");
            let [a, b, c, d] = tree.odds;
            let [by, below, above] = [tree.by, tree.then[0], tree.then[1]].map(question);
            // Writing to a string does not fail.
            let _ = writeln!(
                text,
                "    Tree {{ by: {by}, then: [{below}, {above}], odds: [{a:.4}, {b:.4}, {c:.4}, {d:.4}] }},"
            );
        }
        text + "];\n"
    }
}

/// Whether a thing is at a place; `None` where only a wall, the floor or the ceiling is.
fn is_thing(session: &Session, time_s: f64, weighed: &Weighed) -> Option<bool> {
    let there = session.things().into_iter().filter(|thing| time_s < thing.until_s);
    let to_thing = |place: DVec3| {
        there
            .flat_map(|thing| &thing.thing.scatterers)
            .map(move |s| s.position_m.distance(place))
            .fold(f64::INFINITY, f64::min)
    };
    if to_thing(weighed.place_m) <= THING_M {
        return Some(true);
    }
    let at_surface = session.walls().iter().any(|wall| wall.extent.distance(weighed.place_m) <= THING_M);
    (!at_surface).then_some(false)
}

/// Rows of one session: a place that was weighed n times counts √n times.
fn rows(places: &[(Weighed, bool)]) -> Vec<Row<{ FEATURES.len() }>> {
    let mut middles: Vec<(DVec3, usize)> = Vec::new();
    let mut middle_of = |place: DVec3| {
        let known = middles.iter().position(|(middle, _)| middle.distance(place) < SAME_M);
        let at = known.unwrap_or_else(|| {
            middles.push((place, 0));
            middles.len() - 1
        });
        middles[at].1 += 1;
        at
    };
    let of_middle: Vec<usize> = places.iter().map(|(weighed, _)| middle_of(weighed.place_m)).collect();
    let row = |((weighed, is_thing), at): (&(Weighed, bool), &usize)| Row {
        features: weighed.features,
        is_thing: *is_thing,
        weight: 1.0 / (middles[*at].1 as f64).sqrt(),
    };
    places.iter().zip(&of_middle).map(row).collect()
}

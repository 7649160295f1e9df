//! Trains the classifier that separates objects from artefacts, and scores it on other rooms:
//!
//!     cargo run --release -p lab --example train_classifier -- train 20..50 > new.json
//!     cargo run --release -p lab --example train_classifier -- score 2000..2006 > scored.json
//!
//! The output replaces the model file of `radar_mapping::Model`. `score` prints the program's own
//! model with the score in its card.
//!
//! Each room is played for four minutes; from another seed for one minute, since little is known at
//! a session's start; from a third for three minutes with the slower preset c16; and from a fourth
//! for two minutes with walls that return 20 dB more, as metal does. Rooms that figures are taken
//! from must not be trained on. The examples depend slightly on the model in use: after a large
//! change of the mapper, train twice.

use std::ops::Range;

use a121::preset;
use lab::experiments::{PlayTrial, TrainingSet};
use radar_chaperone::settings::Settings;
use radar_mapping::Model;
use radar_simulation::PlaySession;

/// Preset, minutes, extra reflection of the walls in dB, and offset of these sessions' seeds.
const SESSIONS: [(&str, f64, f64, u64); 4] =
    [("d16", 4.0, 0.0, 0), ("d16", 1.0, 0.0, 100_000), ("c16", 3.0, 0.0, 200_000), ("d16", 2.0, 20.0, 300_000)];
const USAGE: &str = "usage: train_classifier train|score FIRST..END (seeds)";

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [what, seeds] = &arguments[..] else { panic!("{USAGE}") };
    let (first, end) = seeds.split_once("..").expect(USAGE);
    let seeds = first.parse().expect(USAGE)..end.parse().expect(USAGE);
    let command = format!("cargo run --release -p lab --example train_classifier -- {}", arguments.join(" "));
    let sessions = training_set(&seeds);
    let model = match what.as_str() {
        "train" => {
            let rooms = seeds.count();
            let worlds = format!(
                "simulated play sessions in {rooms} furnished rooms, each 4 min and 1 min of d16, 3 min of c16, 2 min of d16 \
                 with walls 20 dB stronger"
            );
            sessions.train(command, worlds)
        }
        "score" => Model::embedded().clone().with_held_out(sessions.score(Model::embedded(), command)),
        _ => panic!("{USAGE}"),
    };
    print!("{}", model.to_json());
}

fn training_set(seeds: &Range<u64>) -> TrainingSet {
    let each = SESSIONS.map(|(name, minutes, walls_db, from)| {
        preset_training_set(name, minutes, walls_db, seeds.clone().map(|seed| seed + from))
    });
    each.into_iter().fold(TrainingSet::default(), TrainingSet::merged)
}

fn preset_training_set(name: &str, minutes: f64, walls_db: f64, seeds: impl Iterator<Item = u64>) -> TrainingSet {
    let config = preset(name).unwrap_or_else(|| panic!("there is no preset {name}"));
    // The visitor is a person, not an object.
    let session = PlaySession { duration_s: 60.0 * minutes, visitor: false, walls_db, ..PlaySession::new(config, 0) };
    let trial = PlayTrial { session, settings: Settings::default(), controllers: false };
    TrainingSet::of(&trial, &seeds.collect::<Vec<u64>>()).unwrap_or_else(|error| panic!("{error}"))
}

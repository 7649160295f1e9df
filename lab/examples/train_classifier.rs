//! Trains the classifier that separates objects from artefacts, and scores it on rooms of another kind:
//!
//!     cargo run --release -p lab --example train_classifier -- play office 20..44 > office.csv
//!     cargo run --release -p lab --example train_classifier -- play points 20..32 > points.csv
//!     cargo run --release -p lab --example train_classifier -- play dining 20..26 > dining.csv
//!     cargo run --release -p lab --example train_classifier -- train office.csv points.csv > new.json
//!     cargo run --release -p lab --example train_classifier -- score dining.csv > scored.json
//!
//! The output of `train` replaces the model file of `radar_mapping::Model`. `score` prints the program's own model with
//! the score in its card. Each file weighs the same, however many examples it has. `--without "height (m)"` trains without a feature, and may be repeated.
//!
//! Each seed is another room, and the rooms take turns in what they are played with ([`SESSIONS`]). Rooms that figures
//! are taken from must not be trained on. The examples depend slightly on the model in use: after a large change of the
//! mapper, train twice.

use std::ops::Range;

use a121::preset;
use anyhow::{Context, Result, bail};
use lab::experiments::{PlayTrial, PlayerSetup, TrainingSet};
use radar_chaperone::settings::Settings;
use radar_mapping::{FEATURES, Model};
use radar_simulation::{Headset, PlaySession, PlayWorld, SensorEffects};

/// Preset, minutes, headset, and minimum log odds of a confirmed detection. What is confirmed is no longer an example,
/// so where the model in use confirms, its table lacks what it recognises: in half of the rooms it confirms nothing.
const SESSIONS: [(&str, f64, Headset, f64); 4] = [
    ("d16", 3.0, Headset::Lighthouse, 1.7),
    ("d16", 2.0, Headset::InsideOut, NEVER),
    ("c16", 2.0, Headset::Lighthouse, 3.0),
    ("d16", 2.0, Headset::Lighthouse, NEVER),
];
/// Log odds that no detection reaches.
const NEVER: f64 = 50.0;
const USAGE: &str = "usage: train_classifier play WORLD FIRST..END | train FILE.. [--without FEATURE].. | score FILE..";

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let command = format!("cargo run --release -p lab --example train_classifier -- {}", arguments.join(" "));
    let (what, of) = arguments.split_first().context(USAGE)?;
    match (what.as_str(), of) {
        ("play", [world, seeds]) => {
            let (first, end) = seeds.split_once("..").context(USAGE)?;
            print!("{}", played(PlayWorld::from_name(world)?, first.parse()?..end.parse()?, &command)?.to_csv());
        }
        ("train", of) => {
            let (files, without) = files_and_features(of)?;
            let examples = TrainingSet::weighed_alike(read(&files)?);
            print!("{}", examples.without(&without).train(command).to_json());
        }
        ("score", files) => {
            let score = TrainingSet::weighed_alike(read(files)?).score(Model::embedded(), command);
            print!("{}", Model::embedded().clone().with_held_out(score).to_json());
        }
        _ => bail!(USAGE),
    }
    Ok(())
}

fn played(world: PlayWorld, seeds: Range<u64>, command: &str) -> Result<TrainingSet> {
    let mut examples = TrainingSet::default();
    for (n, (name, minutes, headset, confirm_log_odds)) in SESSIONS.into_iter().enumerate() {
        let config = preset(name).with_context(|| format!("there is no preset {name}"))?;
        // The visitor is a person, not an object.
        let session = PlaySession {
            duration_s: 60.0 * minutes,
            visitor: false,
            world,
            effects: SensorEffects::MEASURED,
            errors: headset.errors(),
            ..PlaySession::new(config, 0)
        };
        let mut settings = Settings::default();
        settings.rooms.tracks.confirm_log_odds = confirm_log_odds;
        let players = vec![PlayerSetup { settings, tracking: session.errors }];
        let trial = PlayTrial { session, players, controllers: false };
        let seeds: Vec<u64> = seeds.clone().skip(n).step_by(SESSIONS.len()).collect();
        examples = examples.merged(TrainingSet::of(&trial, &seeds, command)?);
    }
    Ok(examples)
}

/// What to read, and the features to train without.
fn files_and_features(arguments: &[String]) -> Result<(Vec<String>, Vec<usize>)> {
    let (mut files, mut without) = (Vec::new(), Vec::new());
    let mut left = arguments.iter();
    while let Some(argument) = left.next() {
        if argument == "--without" {
            let name = left.next().context(USAGE)?;
            let feature = FEATURES.iter().position(|feature| feature == name);
            without.push(feature.with_context(|| format!("no feature \"{name}\": use one of {FEATURES:?}"))?);
        } else {
            files.push(argument.clone());
        }
    }
    Ok((files, without))
}

/// The examples of each file.
fn read(files: &[String]) -> Result<Vec<TrainingSet>> {
    let one = |file: &String| {
        let text = std::fs::read_to_string(file).with_context(|| format!("cannot read {file}"))?;
        TrainingSet::from_csv(&text).with_context(|| file.clone())
    };
    files.iter().map(one).collect()
}

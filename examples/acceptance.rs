//! Learns anew to tell things from artefacts and writes the table, src/obstacles/acceptance/trees.rs:
//!
//!     cargo run --release --example acceptance -- [FIRST..END] > trees.rs
//!
//! Each room is played for four minutes and, from another seed, for one: little is known in a session's first minute; from a third for
//! three with the slower c16; and from a fourth for two with walls that return 20 dB more, as metal does. The rooms must be others than those
//! that figures are taken from. What is weighed depends a little on what was accepted before: run it twice when the search has changed much.

use radar_chaperone::engine::Settings;
use radar_chaperone::experiments::{Lessons, PlayTrial};
use radar_chaperone::radar::preset;
use radar_chaperone::simulation::PlaySession;

/// Preset, minutes, what the walls return more, dB, and how far these sessions' seeds lie behind the first ones'.
const SESSIONS: [(&str, f64, f64, u64); 4] =
    [("d16", 4.0, 0.0, 0), ("d16", 1.0, 0.0, 100_000), ("c16", 3.0, 0.0, 200_000), ("d16", 2.0, 20.0, 300_000)];

fn main() {
    let mut seeds = 20..50;
    for argument in std::env::args().skip(1) {
        match argument.split_once("..") {
            Some((first, end)) => seeds = first.parse().expect("a seed")..end.parse().expect("a seed"),
            None => panic!("FIRST..END, not {argument}"),
        }
    }
    let each = SESSIONS
        .map(|(name, minutes, walls_db, from)| lessons(name, minutes, walls_db, seeds.clone().map(|seed| seed + from)));
    let lessons = each.into_iter().fold(Lessons::default(), Lessons::and);
    print!("{}", lessons.table());
}

fn lessons(name: &str, minutes: f64, walls_db: f64, seeds: impl Iterator<Item = u64>) -> Lessons {
    let config = preset(name).unwrap_or_else(|| panic!("there is no preset {name}"));
    // The visitor is somebody, and no thing.
    let session = PlaySession { duration_s: 60.0 * minutes, visitor: false, walls_db, ..PlaySession::new(config, 0) };
    let trial = PlayTrial { session, settings: Settings::default(), controllers: false };
    Lessons::of(&trial, &seeds.collect::<Vec<u64>>()).unwrap_or_else(|error| panic!("{error}"))
}

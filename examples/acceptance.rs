//! Learns anew to tell things from artefacts and writes the table, src/obstacles/acceptance/trees.rs:
//!
//!     cargo run --release --example acceptance -- [FIRST..END] [--minutes=4] > trees.rs
//!
//! The rooms must be others than those that figures are taken from. What is weighed depends a little on what was accepted before: run it
//! twice when the search has changed much.

use radar_chaperone::engine::Settings;
use radar_chaperone::experiments::{Lessons, PlayTrial};
use radar_chaperone::radar::preset;
use radar_chaperone::simulation::PlaySession;

fn main() {
    let (mut seeds, mut minutes) = (20..50, 4.0);
    for argument in std::env::args().skip(1) {
        match (argument.strip_prefix("--minutes="), argument.split_once("..")) {
            (Some(value), _) => minutes = value.parse().expect("minutes"),
            (None, Some((first, end))) => seeds = first.parse().expect("a seed")..end.parse().expect("a seed"),
            _ => panic!("FIRST..END or --minutes=N, not {argument}"),
        }
    }
    let config = preset("d16").expect("d16 exists");
    // The visitor is somebody, and no thing.
    let session = PlaySession { duration_s: 60.0 * minutes, visitor: false, ..PlaySession::new(config, 0) };
    let trial = PlayTrial { session, settings: Settings::default(), controllers: false };
    let lessons = Lessons::of(&trial, &seeds.collect::<Vec<u64>>()).unwrap_or_else(|error| panic!("{error}"));
    print!("{}", lessons.table());
}

//! Detection of furniture and false reports in simulated rooms, with any settings. The documented
//! table is `lab results rooms`.
//!
//!     cargo run --release -p lab --example rooms -- [FIRST..END] [SCENE] [--each] \
//!         [--poses-hz=250] [rooms.clean.min_score=3 …]
//!
//! Settings are named as in `--set`; `--each` prints every score in full.

use lab::experiments::accuracy::{RoomTrial, room_table};
use radar_chaperone::settings::Settings;

fn main() {
    let (mut seeds, mut scene, mut each, mut changes) = (0..4, "furnished-room".to_string(), false, Vec::new());
    let mut poses_hz = None;
    for argument in std::env::args().skip(1) {
        match argument.split_once("..") {
            Some((first, end)) => seeds = first.parse().expect("a seed")..end.parse().expect("a seed"),
            None if argument.starts_with("--poses-hz=") => poses_hz = argument[11..].parse().ok(),
            None if argument.contains('=') => changes.push(argument),
            None if argument == "--each" => each = true,
            None => scene = argument,
        }
    }
    let settings = Settings::from_toml("", &changes).unwrap_or_else(|error| panic!("{error}"));
    let trial = RoomTrial { scene, poses_hz, settings };
    let scores = trial.scores(&seeds).unwrap_or_else(|error| panic!("{error}"));
    for (seed, score) in seeds.zip(&scores).filter(|_| each) {
        println!("seed {seed}\n{score}\n");
    }
    let table = room_table(&scores);
    println!("{}\n{}", table.aligned(), table.caption);
}

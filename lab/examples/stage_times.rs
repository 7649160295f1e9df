//! Cost of each stage of room imaging with preset d16, as a share of one core, for any recording and
//! settings. The documented table is `lab results speed`.
//!
//!     cargo run --release -p lab --example stage_times -- [SECONDS] [SEED] [SCENE …] [whole] \
//!         [rooms.subapertures.decay_s=2 …]
//!
//! Defaults: 10 s, seed 500, a furnished and an empty room. With `whole` only the mapper is timed.

use lab::experiments::PipelineCost;
use radar_chaperone::settings::Settings;

fn main() {
    let (mut numbers, mut changes) = (Vec::new(), Vec::new());
    let (mut scenes, mut whole_alone) = (Vec::new(), false);
    for argument in std::env::args().skip(1) {
        match argument.parse::<f64>() {
            Ok(number) => numbers.push(number),
            Err(_) if argument.contains('=') => changes.push(argument),
            Err(_) if argument == "whole" => whole_alone = true,
            Err(_) => scenes.push(argument),
        }
    }
    if scenes.is_empty() {
        scenes = ["furnished-room", "empty-room"].map(String::from).to_vec();
    }
    let settings = Settings::from_toml("", &changes).unwrap_or_else(|error| panic!("{error}"));
    let duration_s = numbers.first().copied().unwrap_or(10.0);
    let seed = numbers.get(1).map_or(500, |n| *n as u64);
    for scene in scenes {
        let cost = PipelineCost { seed, settings: settings.clone(), ..PipelineCost::of_play(&scene, duration_s) };
        let table = cost.table(whole_alone).unwrap_or_else(|error| panic!("{error}"));
        println!("{}\n{}", table.caption, table.aligned());
    }
}

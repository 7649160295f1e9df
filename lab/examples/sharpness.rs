//! How sharp sub-apertures are with tracked poses, against the same sweeps with true poses.
//!
//!     cargo run --release -p lab --example sharpness -- [FIRST..END]
//!
//! Seeds 0..4 by default: play of half a minute each in a room of point scatterers.

use a121::preset;
use lab::experiments::accuracy::sharpness_table;
use lab::results::wandering;
use radar_simulation::{PlaySession, SensorEffects};

fn main() {
    let seeds = std::env::args().nth(1).map_or(0..4, |argument| {
        let (first, end) = argument.split_once("..").expect("FIRST..END");
        first.parse().expect("a seed")..end.parse().expect("a seed")
    });
    let config = preset("d16").expect("d16 exists");
    let session = PlaySession {
        duration_s: 30.0,
        effects: SensorEffects::MEASURED,
        hands: false,
        visitor: false,
        ..PlaySession::new(config, 0)
    };
    let table = sharpness_table(&session, &wandering(), &seeds);
    println!("{}\n{}", table.aligned(), table.caption);
}

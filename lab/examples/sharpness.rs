//! How sharp sub-apertures are with tracked poses, against the same sweeps with true poses.
//!
//!     cargo run --release -p lab --example sharpness -- [FIRST..END]
//!
//! Seeds 0..4 by default: play of half a minute each in a room of point scatterers.

use a121::preset;
use lab::experiments::accuracy::sharpness_table;
use radar_simulation::{Headset, PlaySession, SensorEffects, TrackingErrors};

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
    let wander = TrackingErrors { wander_m: 3e-3, ..TrackingErrors::default() };
    let stamps = TrackingErrors { stamp_s: 1e-3, ..TrackingErrors::default() };
    let kinds = [
        ("none", TrackingErrors::none()),
        ("nominal", TrackingErrors::default()),
        ("wander 3 mm", wander),
        ("stamps 1 ms", stamps),
        (
            "wander 3 mm, jumps 5 mm, stamps 1 ms",
            TrackingErrors { jumps_per_minute: 7.5, jump_m: 5e-3, stamp_s: 1e-3, ..wander },
        ),
        ("lighthouse", Headset::Lighthouse.errors()),
        ("inside-out", Headset::InsideOut.errors()),
        ("poor", Headset::Poor.errors()),
    ];
    let table = sharpness_table(&session, &kinds, &seeds);
    println!("{}\n{}", table.aligned(), table.caption);
}

//! How well jumps of the tracking frame are followed.
//!
//!     cargo run --release -p lab --example jumps -- [FIRST..END]
//!
//! Seeds 0..10 by default: play of a minute each.

use a121::preset;
use lab::experiments::accuracy::jumps_table;
use radar_simulation::{Headset, PlaySession, TrackingErrors};

fn main() {
    let seeds = std::env::args().nth(1).map_or(0..10, |argument| {
        let (first, end) = argument.split_once("..").expect("FIRST..END");
        first.parse().expect("a seed")..end.parse().expect("a seed")
    });
    let session = PlaySession { duration_s: 60.0, ..PlaySession::new(preset("d16").expect("d16 exists"), 0) };
    let jumping = |jump_m: f64, jump_deg: f64| TrackingErrors {
        jumps_per_minute: 7.5,
        jump_m,
        jump_deg,
        ..TrackingErrors::default()
    };
    let stamps = TrackingErrors { stamp_s: 1e-3, ..jumping(20e-3, 0.5) };
    let kinds = [
        ("5 mm", jumping(5e-3, 0.0)),
        ("20 mm, 0.5°", jumping(20e-3, 0.5)),
        ("100 mm, 5°", jumping(0.1, 5.0)),
        ("20 mm, 0.5°, 90 Hz", TrackingErrors { rate_hz: 90.0, ..jumping(20e-3, 0.5) }),
        ("20 mm, 0.5°, stamps 1 ms", stamps),
        ("no jumps", TrackingErrors::default()),
        ("no jumps, stamps 1 ms", TrackingErrors { stamp_s: 1e-3, ..TrackingErrors::default() }),
        ("lighthouse", Headset::Lighthouse.errors()),
        ("inside-out", Headset::InsideOut.errors()),
        ("poor", Headset::Poor.errors()),
    ];
    let table = jumps_table(&session, &kinds, &seeds);
    println!("{}\n{}", table.aligned(), table.caption);
}

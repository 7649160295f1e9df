//! How well jumps of the tracking frame are followed.
//!
//!     cargo run --release -p lab --example jumps -- [FIRST..END]
//!
//! Seeds 0..10 by default: play of a minute each.

use a121::preset;
use lab::experiments::accuracy::jumps_table;
use lab::results::jumping;
use radar_simulation::PlaySession;

fn main() {
    let seeds = std::env::args().nth(1).map_or(0..10, |argument| {
        let (first, end) = argument.split_once("..").expect("FIRST..END");
        first.parse().expect("a seed")..end.parse().expect("a seed")
    });
    let session = PlaySession { duration_s: 60.0, ..PlaySession::new(preset("d16").expect("d16 exists"), 0) };
    let table = jumps_table(&session, &jumping(), &seeds);
    println!("{}\n{}", table.aligned(), table.caption);
}

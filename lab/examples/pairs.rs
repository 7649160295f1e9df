//! Two reflectors 20 cm apart across range, and a single one that must not be split.
//!
//!     cargo run --release -p lab --example pairs -- calibrate|verify|split [seeds=FIRST..END]
//!
//! `calibrate` (seeds 0..20): gains of a second reflector, from which the threshold in `radar-sar`'s
//! `refine/pair.rs` was chosen. `split` (seeds 100..300): how often one reflector is reported as
//! more than one. `verify` (seeds 100..140): the pair through the whole search.

use std::ops::Range;

use lab::experiments::accuracy::{pair_calibration, pair_table, split_table};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let seeds = |first: u64, end: u64| -> Range<u64> {
        let given = arguments.iter().find_map(|a| a.strip_prefix("seeds=")?.split_once(".."));
        given.map_or(first..end, |(a, b)| a.parse().expect("a seed")..b.parse().expect("a seed"))
    };
    let table = match arguments.first().map(String::as_str) {
        Some("calibrate") => pair_calibration(&seeds(0, 20)),
        Some("split") => split_table(&seeds(100, 300)),
        Some("verify") => pair_table(&seeds(100, 140)),
        _ => panic!("calibrate, split or verify: see the head of this file"),
    };
    println!("{}\n{}", table.aligned(), table.caption);
}

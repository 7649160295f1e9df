//! Accuracy of the estimated time offset between the pose stream and the sweep stream, for chosen
//! seeds, scenes and motions. The documented table is `lab results reflectors`.
//!
//!     cargo run --release -p lab --example time_offset -- \
//!         [FIRST..END] [SCENE or MOTION …] [rooms]
//!
//! Seeds 100..120 by default. With `rooms`, also furnished rooms of 30 s (takes minutes).

use lab::experiments::accuracy::{correction_in_rooms, correction_table, time_offset_table};

fn main() {
    let (mut seeds, mut rooms, mut names) = (100..120, false, Vec::new());
    for argument in std::env::args().skip(1) {
        match argument.split_once("..") {
            Some((first, end)) => seeds = first.parse().expect("a seed")..end.parse().expect("a seed"),
            None if argument == "rooms" => rooms = true,
            None => names.push(argument),
        }
    }
    let table = time_offset_table(&seeds, &names);
    println!("{}\n{}\n", table.aligned(), table.caption);
    if names.is_empty() {
        println!("{}", correction_table(&seeds).aligned());
    }
    if rooms {
        println!("{}", correction_in_rooms(&seeds).aligned());
    }
}

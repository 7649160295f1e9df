//! False-alarm rates of the room mapper on receiver noise alone. The documented tables are in
//! `lab results rooms`.
//!
//!     cargo run --release -p lab --example room_false_alarms -- \
//!         [FIRST..END] [--minutes=M] [PRESET …]
//!
//! Defaults: 40 minutes, seeds 1..17, every preset.

use a121::PRESETS;
use lab::experiments::NoiseAlarms;

fn main() {
    let (mut seeds, mut minutes, mut names) = (1..17, 40.0, Vec::new());
    for argument in std::env::args().skip(1) {
        match (argument.split_once(".."), argument.strip_prefix("--minutes=")) {
            (Some((first, end)), _) => seeds = first.parse().expect("a seed")..end.parse().expect("a seed"),
            (None, Some(number)) => minutes = number.parse().expect("a number of minutes"),
            (None, None) => names.push(argument),
        }
    }
    if names.is_empty() {
        names = PRESETS.map(String::from).to_vec();
    }
    let alarms = NoiseAlarms::of(&names, &seeds, minutes).unwrap_or_else(|error| panic!("{error}"));
    for table in [alarms.measured(), alarms.rates_from_tail(), alarms.stated_against_measured()] {
        println!("{}\n{}\n", table.aligned(), table.caption);
    }
    if !alarms.without_subapertures().is_empty() {
        println!("Without sub-apertures: {}", alarms.without_subapertures().join(", "));
    }
}

//! Accuracy of the sensor's position on the head, estimated from play together with the time offset.
//!
//!     cargo run --release -p lab --example mount -- [FIRST..END] [--world=NAME …] [--headset=NAME …] [--preset=d16] \
//!         [--effects=none] [--no-hands] [--no-visitor] [--gross]
//!
//! Seeds 0..10, world points, headsets nominal, lighthouse, inside-out and poor by default. Each seed is another room
//! and another mount, assumed wrong by up to 8 cm and 20°; with `--gross`, by 90 or 180°, a wrong
//! origin, or wrong poses. The sensor has its measured imperfections.

use a121::preset;
use lab::experiments::accuracy::{gross_table, mount_table};
use radar_simulation::{Headset, PlaySession, PlayWorld, SensorEffects};

fn main() {
    let (mut seeds, mut worlds, mut headsets, mut gross) = (0..10, Vec::new(), Vec::new(), false);
    let config = preset("d16").expect("d16 exists");
    let mut session = PlaySession { effects: SensorEffects::MEASURED, ..PlaySession::new(config, 0) };
    for argument in std::env::args().skip(1) {
        match argument.split_once('=') {
            Some(("--preset", value)) => session.config = preset(value).expect("a preset"),
            Some(("--world", value)) => worlds.push(PlayWorld::from_name(value).expect("a world")),
            Some(("--headset", value)) => headsets.push(Headset::from_name(value).expect("a headset")),
            Some(("--effects", value)) => session.effects = value.parse().expect("effects"),
            Some(_) => panic!("unknown argument {argument}"),
            None if argument == "--no-hands" => session.hands = false,
            None if argument == "--no-visitor" => session.visitor = false,
            None if argument == "--gross" => gross = true,
            None => {
                let (first, end) = argument.split_once("..").expect("FIRST..END");
                seeds = first.parse().expect("a seed")..end.parse().expect("a seed");
            }
        }
    }
    if worlds.is_empty() {
        worlds = vec![PlayWorld::Points];
    }
    if headsets.is_empty() {
        headsets = vec![Headset::Nominal, Headset::Lighthouse, Headset::InsideOut, Headset::Poor];
    }
    let table = if gross { gross_table } else { mount_table }(&session, &worlds, &headsets, &seeds);
    println!("{}\n{}", table.aligned(), table.caption);
}

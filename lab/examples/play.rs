//! Play sessions with any settings, for tuning: the tables of `lab play`, and every false report.
//!
//!     cargo run --release -p lab --example play -- [FIRST..END] [--minutes=10] [--preset=d16] \
//!         [--controllers] [--walls-db=20] [--no-hands] [--silent-hands] \
//!         [--no-visitor] [--square] [--each] [rooms.tracks.confirm_score=6 …]

use std::time::Instant;

use a121::preset;
use lab::experiments::{Figures, PlayTrial, by_kind, play, totals};
use radar_chaperone::settings::Settings;
use radar_simulation::PlaySession;

fn main() {
    let (mut seeds, mut minutes, mut changes, mut each, mut controllers) = (0..2, 2.0, Vec::new(), false, false);
    let (mut config, mut walls_db) = (preset("d16").expect("d16 exists"), 0.0);
    let (mut hands, mut silent_hands, mut visitor, mut square) = (true, false, true, false);
    for argument in std::env::args().skip(1) {
        match argument.split_once('=') {
            Some(("--minutes", value)) => minutes = value.parse().expect("minutes"),
            Some(("--preset", value)) => config = preset(value).expect("a preset"),
            Some(("--walls-db", value)) => walls_db = value.parse().expect("dB"),
            Some(_) => changes.push(argument),
            None if argument == "--each" => each = true,
            None if argument == "--controllers" => controllers = true,
            None if argument == "--no-hands" => hands = false,
            None if argument == "--silent-hands" => silent_hands = true,
            None if argument == "--no-visitor" => visitor = false,
            None if argument == "--square" => square = true,
            None => {
                let (first, end) = argument.split_once("..").expect("FIRST..END");
                seeds = first.parse().expect("a seed")..end.parse().expect("a seed");
            }
        }
    }
    let settings = Settings::from_toml("", &changes).unwrap_or_else(|error| panic!("{error}"));
    let session = PlaySession {
        duration_s: 60.0 * minutes,
        walls_db,
        hands,
        hands_without_echo: silent_hands,
        visitor,
        axis_aligned: square,
        ..PlaySession::new(config, 0)
    };
    let trial = PlayTrial { session, settings, controllers };
    let (start, seeds) = (Instant::now(), seeds.collect::<Vec<u64>>());
    let figures = play(&trial, &seeds, |seed, figures| {
        let rates = figures.without_walls().rates();
        eprintln!(
            "seed {seed}: {} of {} in time, {:.2} false reports near the body per minute",
            rates.warned, rates.due, rates.false_near_per_min
        );
    });
    let figures = figures.unwrap_or_else(|error| panic!("{error}"));
    let mut all = Figures::default();
    for (seed, one) in seeds.iter().zip(figures) {
        if each {
            for approach in one.approaches.iter().filter(|a| a.in_beam_s >= 0.75 && !a.warned) {
                println!("seed {seed} missed {approach:?}");
            }
            for report in &one.false_reports {
                println!("seed {seed} {report:?}");
            }
            for forgetting in &one.forgettings {
                println!("seed {seed} {forgetting:?}");
            }
        }
        all.add(one);
    }
    println!("{}\n{}", by_kind(&all).aligned(), totals(&all).aligned());
    println!("{:.1} s", start.elapsed().as_secs_f64());
}

//! False-alarm rates of the room mapper on receiver noise alone, for every preset, and scores that
//! keep stated rates.
//!
//!     cargo run --release -p lab --example room_false_alarms -- \
//!         [FIRST..END] [--minutes=M] [PRESET …]
//!
//! Simulates natural head motion in empty space for M minutes per preset (default 40), divided
//! among the seeds (default 1..17), through the whole mapper. An alarm is a score above a
//! threshold; scores within 30 cm and one second of it belong to it.
//!
//! First table: measured alarms. `candidates`: maxima of the score field; `detections`: those that
//! remain after CLEAN; each per hour, with the count in brackets. `sub-aperture`: mean and standard
//! deviation of what one sub-aperture adds to a score, and the same by the model of noise.
//! `confirmed`: obstacles and walls, and the upper bound of their rate at 95 % confidence.
//!
//! Second table: from the tail of a score on noise and the number of independent cells per hour,
//! how often noise reaches the default thresholds, and which scores keep a rate.
//!
//! Third table: thresholds for stated rates from the first half of the seeds, and the rates
//! measured in the second half, with 95 % bounds. (Alarms come in bursts: a head that hardly turns
//! sees the same noise all along its path.)

use std::ops::Range;

use a121::{PRESETS, SensorConfig, preset};
use lab::experiments::{RoomNoise, rate_upper_bound_per_h};
use radar_mapping::{CleanSettings, MapSettings};

/// Thresholds at which alarms are counted.
const SCORES: [f64; 4] = [1.75, 2.0, 2.25, 2.5];
/// Rates for which scores are given, per hour.
const RATES: [(f64, &str); 3] = [(60.0, "one a minute"), (1.0, "one an hour"), (1.0 / 1000.0, "one in 1000 h")];
/// Rates that are stated and compared with other noise, per hour.
const STATED: [f64; 2] = [600.0, 60.0];
/// Duration that shows whether a preset makes sub-apertures at all, seconds.
const TRIAL_S: f64 = 1.0;

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
    let session_s = minutes * 60.0 / seeds.clone().count().max(1) as f64;
    let half = seeds.start + (seeds.end - seeds.start) / 2;
    let mut played = Vec::new();
    for name in &names {
        let config = preset(name).unwrap_or_else(|| panic!("no preset {name}: use {}", PRESETS.join(", ")));
        if noise(&config, seeds.start..seeds.start + 1, TRIAL_S, &SCORES).blocks == 0 {
            println!(
                "{name}: too few sweeps for a sub-aperture of the default settings; the preset uses the \
                reflector search"
            );
            continue;
        }
        let first = noise(&config, seeds.start..half, session_s, &SCORES);
        let scores: Vec<f64> = STATED.into_iter().map(|rate| score_for(&first, rate)).collect();
        let all_scores = [&SCORES[..], &scores].concat();
        let second = noise(&config, half..seeds.end, session_s, &all_scores);
        played.push((name.as_str(), first.merged(&second), scores, second));
    }
    measured(&played);
    rates_from_tail(&played);
    stated_rates_against_measured(&played);
}

/// Preset, all sessions, thresholds from the first half, sessions of the second half.
type Played<'a> = (&'a str, RoomNoise, Vec<f64>, RoomNoise);

/// One session per seed, each of this duration.
fn noise(config: &SensorConfig, seeds: Range<u64>, session_s: f64, scores: &[f64]) -> RoomNoise {
    let session = |seed| RoomNoise::of(config, seed, session_s, scores).unwrap_or_else(|error| panic!("{error}"));
    seeds.map(session).reduce(|all, session| all.merged(&session)).unwrap_or_default()
}

/// The score that noise exceeds at a rate per hour.
fn score_for(noise: &RoomNoise, rate: f64) -> f64 {
    noise.tail().score((noise.independent_cells_per_h() / rate).max(1.0).ln())
}

fn measured(played: &[Played]) {
    println!(
        "\n| preset | minutes | sweeps | voxels | sub-aperture (model) | score | candidates/h | detections/h | \
         greatest | confirmed |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for (name, all, ..) in played {
        let ([mean, sigma], [stated, stated_sigma]) = (all.of_subaperture(), all.tail().of_subaperture());
        let rate = |events: u64| format!("{:.1} ({events})", events as f64 / all.hours());
        for (n, score) in SCORES.iter().enumerate() {
            let (candidates, places) = (rate(all.candidates[n]), rate(all.places[n]));
            if n > 0 {
                println!("| | | | | | {score} | {candidates} | {places} | | |");
                continue;
            }
            let [peak, place, plane] = all.greatest;
            let confirmed = all.confirmed.iter().sum::<usize>();
            println!(
                "| {name} | {:.0} | {:.0} | {:.0} | {mean:.4} ± {sigma:.3} ({stated:.4} ± {stated_sigma:.3}) | \
                 {score} | {candidates} | {places} | {peak:.2}, detection {place:.2}, plane {plane:.2} | {confirmed}: \
                 < {:.1}/h |",
                all.played_s / 60.0,
                all.sweeps_per_subaperture(),
                all.voxels(),
                rate_upper_bound_per_h(confirmed as u64, all.hours())
            );
        }
    }
}

fn rates_from_tail(played: &[Played]) {
    let (explain, map) = (CleanSettings::default(), MapSettings::default());
    let defaults = [explain.min_candidate_score, map.confirm_score];
    println!(
        "\n| preset | independent cells/h | candidates of {}/h | of {}/h | {} |",
        defaults[0],
        defaults[1],
        RATES.map(|r| r.1).join(" | ")
    );
    println!("|---|---|---|---|---|---|---|");
    for (name, all, ..) in played {
        let places = all.independent_cells_per_h();
        let [candidates, confirmed] = defaults.map(|score| (places.ln() - all.tail().surprisal(score)).exp());
        let scores = RATES.map(|(rate, _)| format!("{:.2}", score_for(all, rate)));
        println!("| {name} | {places:.1e} | {candidates:.1} | {confirmed:.0e} | {} |", scores.join(" | "));
    }
}

fn stated_rates_against_measured(played: &[Played]) {
    println!("\n| preset | stated/h | score | measured/h | upper bound |");
    println!("|---|---|---|---|---|");
    for (name, _, scores, second) in played {
        for ((stated, score), alarms) in STATED.iter().zip(scores).zip(&second.candidates[SCORES.len()..]) {
            let (rate, most) = (*alarms as f64 / second.hours(), rate_upper_bound_per_h(*alarms, second.hours()));
            println!("| {name} | {stated} | {score:.2} | {rate:.0} ({alarms}) | {most:.0} |");
        }
    }
}

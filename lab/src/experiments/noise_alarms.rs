//! False-alarm rates of the room mapper on receiver noise alone, and scores that keep stated rates.
//!
//! Simulates natural head motion in empty space for some minutes per preset, divided among the
//! seeds, through the whole mapper. An alarm is a score above a threshold; scores within 30 cm and
//! one second of it belong to it. Alarms come in bursts: a head that hardly turns sees the same
//! noise all along its path.

use std::ops::Range;

use a121::{SensorConfig, preset};
use rayon::prelude::*;

use super::{RoomNoise, rate_upper_bound_per_h};
use radar_chaperone::report::Table;
use radar_mapping::{CleanSettings, TrackSettings};
use radar_sar::math;
use radar_simulation::ScenarioError;

/// Thresholds at which alarms are counted. Choice: around the mapper's thresholds, from alarms by
/// the hundred to hardly any.
const SCORES: [f64; 4] = [1.75, 2.0, 2.25, 2.5];
/// Rates for which scores are given, per hour.
const RATES: [(f64, &str); 3] = [(60.0, "one a minute"), (1.0, "one an hour"), (1.0 / 1000.0, "one in 1000 h")];
/// Rates that are stated and compared with other noise, per hour. Choice: frequent enough to be
/// counted within minutes.
const STATED: [f64; 2] = [600.0, 60.0];
/// Duration that shows whether a preset makes sub-apertures at all, seconds. Choice: ten
/// sub-apertures.
const TRIAL_S: f64 = 1.0;

/// The noise of some presets.
pub struct NoiseAlarms {
    played: Vec<Played>,
    /// Presets with too few sweeps for a sub-aperture: they use the reflector search.
    without_subapertures: Vec<String>,
}

/// One preset's noise.
struct Played {
    preset: String,
    all: RoomNoise,
    /// Thresholds for [`STATED`] rates, from the first half of the seeds.
    scores: Vec<f64>,
    /// The second half of the seeds.
    second: RoomNoise,
}

impl NoiseAlarms {
    /// Simulates `minutes` of noise for each of these presets, divided among the seeds.
    ///
    /// # Errors
    /// A preset's configuration cannot be simulated.
    ///
    /// # Panics
    /// There is no such preset.
    pub fn of(presets: &[String], seeds: &Range<u64>, minutes: f64) -> Result<Self, ScenarioError> {
        let session_s = minutes * 60.0 / seeds.clone().count().max(1) as f64;
        let half = seeds.start + (seeds.end - seeds.start) / 2;
        let mut alarms = Self { played: Vec::new(), without_subapertures: Vec::new() };
        for name in presets {
            let config = preset(name).unwrap_or_else(|| panic!("there is no preset {name}"));
            if noise(&config, seeds.start..seeds.start + 1, TRIAL_S, &SCORES)?.blocks == 0 {
                alarms.without_subapertures.push(name.clone());
                continue;
            }
            let first = noise(&config, seeds.start..half, session_s, &SCORES)?;
            let scores: Vec<f64> = STATED.into_iter().map(|rate| score_for(&first, rate)).collect();
            let second = noise(&config, half..seeds.end, session_s, &[&SCORES[..], &scores].concat())?;
            alarms.played.push(Played { preset: name.clone(), all: first.merged(&second), scores, second });
        }
        Ok(alarms)
    }

    /// The presets that have no sub-apertures.
    pub fn without_subapertures(&self) -> &[String] {
        &self.without_subapertures
    }

    /// Measured alarms.
    pub fn measured(&self) -> Table {
        let head = [
            "preset",
            "minutes",
            "sweeps",
            "voxels",
            "sub-aperture (model)",
            "score",
            "candidates/h",
            "detections/h",
            "greatest",
            "confirmed",
        ];
        let caption = "candidates: maxima of the score field; detections: those that remain after CLEAN; each per \
            hour, with the count in brackets. sub-aperture: mean and standard deviation of what one sub-aperture adds \
            to a score, and the same by the model of noise. confirmed: obstacles and walls, and the upper bound of \
            their rate at 95 % confidence.";
        Table {
            head: head.map(str::to_owned).to_vec(),
            rows: self.played.iter().flat_map(measured_rows).collect(),
            caption: caption.into(),
        }
    }

    /// From the tail of a score on noise and the number of independent cells per hour: how often
    /// noise reaches the default thresholds, and which scores keep a rate.
    pub fn rates_from_tail(&self) -> Table {
        let defaults = [CleanSettings::default().min_candidate_score, TrackSettings::default().confirm_score];
        let row = |played: &Played| {
            let cells = played.all.independent_cells_per_h();
            let [candidates, confirmed] =
                defaults.map(|score| math::exp(math::ln(cells) - played.all.tail().surprisal(score)));
            let scores = RATES.map(|(rate, _)| format!("{:.2}", score_for(&played.all, rate)));
            let mut row = vec![
                played.preset.clone(),
                format!("{cells:.1e}"),
                format!("{candidates:.1}"),
                format!("{confirmed:.0e}"),
            ];
            row.extend(scores);
            row
        };
        let mut head = vec![
            "preset".to_owned(),
            "independent cells/h".into(),
            format!("above {}/h", defaults[0]),
            format!("above {}/h", defaults[1]),
        ];
        head.extend(RATES.map(|(_, name)| format!("score for {name}")));
        Table { head, rows: self.played.iter().map(row).collect(), caption: String::new() }
    }

    /// Thresholds for stated rates from the first half of the seeds, and the rates measured in the
    /// second half, with 95 % bounds.
    pub fn stated_against_measured(&self) -> Table {
        let rows = self.played.iter().flat_map(|played| {
            let counts = &played.second.candidates[SCORES.len()..];
            STATED.iter().zip(&played.scores).zip(counts).map(|((stated, score), alarms)| {
                let hours = played.second.hours();
                vec![
                    played.preset.clone(),
                    stated.to_string(),
                    format!("{score:.2}"),
                    format!("{:.0} ({alarms})", *alarms as f64 / hours),
                    format!("{:.0}", rate_upper_bound_per_h(*alarms, hours)),
                ]
            })
        });
        let head = ["preset", "stated/h", "score", "measured/h", "upper bound/h"];
        Table { head: head.map(str::to_owned).to_vec(), rows: rows.collect(), caption: String::new() }
    }
}

/// One session per seed, each of this duration.
fn noise(config: &SensorConfig, seeds: Range<u64>, session_s: f64, scores: &[f64]) -> Result<RoomNoise, ScenarioError> {
    let seeds: Vec<u64> = seeds.collect();
    let each: Vec<RoomNoise> =
        seeds.par_iter().map(|seed| RoomNoise::of(config, *seed, session_s, scores)).collect::<Result<_, _>>()?;
    Ok(each.into_iter().reduce(|all, session| all.merged(&session)).unwrap_or_default())
}

/// The score that noise exceeds at a rate per hour.
fn score_for(noise: &RoomNoise, rate: f64) -> f64 {
    noise.tail().score(math::ln((noise.independent_cells_per_h() / rate).max(1.0)))
}

/// One row per threshold; what does not depend on it stands in the first.
fn measured_rows(played: &Played) -> Vec<Vec<String>> {
    let all = &played.all;
    let ([mean, sigma], [stated, stated_sigma]) = (all.of_subaperture(), all.tail().of_subaperture());
    let [peak, detection, plane] = all.greatest;
    let confirmed = all.confirmed.iter().sum::<usize>();
    let rate = |events: u64| format!("{:.1} ({events})", events as f64 / all.hours());
    let row = |(n, score): (usize, &f64)| {
        let first = |text: String| if n == 0 { text } else { String::new() };
        vec![
            first(played.preset.clone()),
            first(format!("{:.0}", all.played_s / 60.0)),
            first(format!("{:.0}", all.sweeps_per_subaperture())),
            first(format!("{:.0}", all.voxels())),
            first(format!("{mean:.4} ± {sigma:.3} ({stated:.4} ± {stated_sigma:.3})")),
            score.to_string(),
            rate(all.candidates[n]),
            rate(all.places[n]),
            first(format!("{peak:.2}, detection {detection:.2}, plane {plane:.2}")),
            first(format!("{confirmed}: < {:.1}/h", rate_upper_bound_per_h(confirmed as u64, all.hours()))),
        ]
    };
    SCORES.iter().enumerate().map(row).collect()
}

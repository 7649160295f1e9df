//! `lab play`: simulated players in furnished rooms, and how well the warnings serve them.

use std::path::PathBuf;

use anyhow::{Context, Result, anyhow};
use clap::Args;
use serde_json::json;

use super::check_targets;
use a121::{PRESETS, preset};
use lab::experiments::{Figures, PlayTrial, by_kind, curve, play, totals};
use radar_chaperone::app::progress;
use radar_chaperone::outln;
use radar_chaperone::report::{Chart, Series, Table, write_atomically};
use radar_chaperone::settings::Settings;
use radar_simulation::PlaySession;

/// Simulates play sessions in furnished rooms and scores the warnings
#[derive(Debug, Args)]
pub struct PlaySessions {
    /// Writes the figures as a JSON list
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Folder for play.md and, with --odds, play.png
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Two rooms of a minute
    #[arg(long)]
    quick: bool,
    /// Rooms [default: 10, with --quick 2]
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=1000))]
    rooms: Option<u64>,
    /// Minutes in each [default: 10, with --quick 1]
    #[arg(long)]
    minutes: Option<f64>,
    /// Seed of the first room; the others follow
    #[arg(long, default_value_t = 1000)]
    seed: u64,
    /// Sensor presets; one after the other
    #[arg(long, value_delimiter = ',', default_value = "d16",
          value_parser = clap::builder::PossibleValuesParser::new(PRESETS))]
    presets: Vec<String>,
    /// The controllers are tracked
    #[arg(long)]
    controllers: bool,
    /// Added to the reflection of the walls, dB
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    walls_db: f64,
    /// Plays the same at each of these values of rooms.map.confirm_odds: the curve of detections
    /// against false reports
    #[arg(long, value_name = "ODDS", value_delimiter = ',', allow_hyphen_values = true)]
    odds: Vec<f64>,
    /// Settings file
    #[arg(long, value_name = "FILE")]
    settings: Option<std::path::PathBuf>,
    /// A setting; may be repeated
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<String>,
}

/// Result of the sessions with one setting.
struct PlayResult {
    name: String,
    preset: String,
    odds: Option<f64>,
    figures: Figures,
}

impl PlaySessions {
    /// Plays, prints the figures and writes them.
    ///
    /// # Errors
    /// Settings or files that cannot be read or written.
    pub fn run(&self) -> Result<()> {
        check_targets(self.json.as_deref(), self.out.as_deref(), &["play.png", "play.md"])?;
        // Invalid settings fail before minutes of work.
        let text = match &self.settings {
            Some(path) => std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?,
            None => String::new(),
        };
        let odds: Vec<Option<f64>> =
            if self.odds.is_empty() { vec![None] } else { self.odds.iter().copied().map(Some).collect() };
        let settings: Vec<Settings> = odds.iter().map(|odds| self.settings(&text, *odds)).collect::<Result<_>>()?;
        let mut played = Vec::new();
        for preset in &self.presets {
            for (odds, settings) in odds.iter().zip(&settings) {
                played.push(self.play(preset, *odds, settings.clone())?);
            }
        }
        if played.len() > 1 {
            outln!("{}", all_of(&played).aligned())?;
        }
        self.write(&played)
    }

    /// Plays every room with one setting.
    fn play(&self, name: &str, odds: Option<f64>, settings: Settings) -> Result<PlayResult> {
        let rooms = self.rooms.unwrap_or(if self.quick { 2 } else { 10 });
        let minutes = self.minutes.unwrap_or(if self.quick { 1.0 } else { 10.0 });
        let config = preset(name).ok_or_else(|| anyhow!("there is no preset {name:?}"))?;
        let session =
            PlaySession { duration_s: 60.0 * minutes, walls_db: self.walls_db, ..PlaySession::new(config, self.seed) };
        let trial = PlayTrial { session, settings, controllers: self.controllers };
        let seeds: Vec<u64> = (0..rooms).map(|n| self.seed.wrapping_add(n)).collect();
        let (preset, name) = (name.to_owned(), odds.map_or(name.into(), |odds| format!("{name}, odds {odds}")));
        let bar = progress::bar(rooms, &format!("playing with {name}"));
        let each = play(&trial, &seeds, |_, _| bar.inc(1))?;
        bar.finish_and_clear();
        let mut figures = Figures::default();
        each.into_iter().for_each(|one| figures.add(one));
        outln!("{name}: {rooms} rooms of {minutes} min from seed {} on", self.seed)?;
        outln!("{}\n{}", by_kind(&figures).aligned(), totals(&figures).aligned())?;
        Ok(PlayResult { name, preset, odds, figures })
    }

    fn settings(&self, text: &str, odds: Option<f64>) -> Result<Settings> {
        let odds = odds.map(|odds| format!("rooms.map.confirm_odds={odds:?}"));
        let changes: Vec<String> = self.set.iter().cloned().chain(odds).collect();
        Ok(Settings::from_toml(text, &changes)?)
    }

    fn write(&self, played: &[PlayResult]) -> Result<()> {
        if let Some(folder) = &self.out {
            let path = folder.join("play.md");
            write_atomically(&path, self.markdown(played).as_bytes())?;
            if !self.odds.is_empty() {
                chart(played).draw().write(&folder.join("play.png"))?;
            }
            outln!("Written to {}", path.display())?;
        }
        if let Some(path) = &self.json {
            let rows = played.iter().map(|PlayResult { preset, odds, figures, .. }| {
                json!({"preset": preset, "confirm_odds": odds, "controllers": self.controllers, "walls_db": self.walls_db,
                    "seed": self.seed, "rates": figures.rates(), "rates_without_walls": figures.without_walls().rates(),
                    "figures": figures})
            });
            let text = serde_json::to_string_pretty(&rows.collect::<Vec<_>>())?;
            write_atomically(path, (text + "\n").as_bytes())?;
            outln!("Written to {}", path.display())?;
        }
        Ok(())
    }

    fn markdown(&self, played: &[PlayResult]) -> String {
        let mut text = String::from("# Play sessions\n\nMade by `cargo run --release -p lab -- play --out DIR`.\n");
        if played.len() > 1 || !self.odds.is_empty() {
            let all = all_of(played);
            text += &format!("\n## All\n\n{}\n{}\n", all.markdown(), all.caption);
        }
        if !self.odds.is_empty() {
            return text + "\n![Warned in time against reported where nothing is](play.png)\n";
        }
        for PlayResult { name, figures, .. } in played {
            let table = by_kind(figures);
            text +=
                &format!("\n## {name}\n\n{}\n{}\n\n{}", table.markdown(), table.caption, totals(figures).markdown());
        }
        text
    }
}

fn all_of(played: &[PlayResult]) -> Table {
    curve(played.iter().map(|played| (played.name.as_str(), &played.figures)))
}

/// A curve for each preset.
fn chart(played: &[PlayResult]) -> Chart {
    let of_preset = |of: &[PlayResult]| Series {
        name: of[0].preset.clone(),
        points: of.iter().map(|played| point(&played.figures)).collect(),
        joined: true,
    };
    Chart {
        title: "Play: warned in time against reported where nothing is".into(),
        x_label: "reported where nothing is, within 1 m of the body (a minute)".into(),
        y_label: "warned in time (%)".into(),
        series: played.chunk_by(|a, b| a.preset == b.preset).map(of_preset).collect(),
        ..Chart::default()
    }
}

fn point(figures: &Figures) -> [f64; 2] {
    let things = figures.without_walls().rates();
    [figures.rates().false_near_per_min, 100.0 * things.warned as f64 / things.due as f64]
}

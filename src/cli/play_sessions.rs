//! `radar-chaperone benchmark --play`: simulated players in furnished rooms, and what the warnings are worth to them.

use std::path::Path;

use anyhow::{Context, Result, anyhow};
use clap::Args;
use serde_json::json;

use super::progress;
use crate::engine::Settings;
use crate::experiments::{Figures, PlayTrial, by_kind, curve, play, totals};
use crate::radar::{PRESETS, preset};
use crate::report::write_atomically;
use crate::simulation::PlaySession;

/// What is played.
#[derive(Debug, Args)]
pub(super) struct PlaySessions {
    /// Play sessions instead: rooms with chairs, tables, sofas, a hanger, hard and soft things, the player's own hands, a visitor
    #[arg(long)]
    play: bool,
    /// Rooms, with --play [default: 10, with --quick 2]
    #[arg(long, requires = "play", value_parser = clap::value_parser!(u64).range(1..=1000))]
    rooms: Option<u64>,
    /// Minutes in each, with --play [default: 10, with --quick 1]
    #[arg(long, requires = "play")]
    minutes: Option<f64>,
    /// The first room's seed, with --play; the others follow
    #[arg(long, requires = "play", default_value_t = 1000)]
    seed: u64,
    /// Sensor presets, with --play; one after the other
    #[arg(long, requires = "play", value_delimiter = ',', default_value = "d16",
          value_parser = clap::builder::PossibleValuesParser::new(PRESETS))]
    presets: Vec<String>,
    /// The controllers are tracked, with --play
    #[arg(long, requires = "play")]
    controllers: bool,
    /// Added to the reflection of the walls, dB, with --play
    #[arg(long, requires = "play", default_value_t = 0.0, allow_hyphen_values = true)]
    walls_db: f64,
    /// Settings file, with --play
    #[arg(long, requires = "play", value_name = "FILE")]
    settings: Option<std::path::PathBuf>,
    /// A setting, with --play; may be given again and again
    #[arg(long, requires = "play", value_name = "NAME=VALUE")]
    set: Vec<String>,
}

impl PlaySessions {
    pub fn is_asked(&self) -> bool {
        self.play
    }

    pub fn run(&self, quick: bool, json: Option<&Path>, out: Option<&Path>) -> Result<()> {
        let rooms = self.rooms.unwrap_or(if quick { 2 } else { 10 });
        let minutes = self.minutes.unwrap_or(if quick { 1.0 } else { 10.0 });
        let settings = self.settings()?;
        let mut played = Vec::new();
        for name in &self.presets {
            let config = preset(name).ok_or_else(|| anyhow!("there is no preset {name:?}"))?;
            let session = PlaySession {
                duration_s: 60.0 * minutes,
                walls_db: self.walls_db,
                ..PlaySession::new(config, self.seed)
            };
            let trial = PlayTrial { session, settings: settings.clone(), controllers: self.controllers };
            let seeds: Vec<u64> = (0..rooms).map(|n| self.seed.wrapping_add(n)).collect();
            let bar = progress::bar(rooms, &format!("playing with {name}"));
            let each = play(&trial, &seeds, |_, _| bar.inc(1))?;
            bar.finish_and_clear();
            let mut all = Figures::default();
            each.into_iter().for_each(|figures| all.add(figures));
            say!("{name}: {rooms} rooms of {minutes} min from seed {} on", self.seed)?;
            say!("{}\n{}", by_kind(&all).aligned(), totals(&all).aligned())?;
            played.push((name.clone(), all));
        }
        if played.len() > 1 {
            say!("{}", curve(&played).aligned())?;
        }
        self.write(&played, json, out)
    }

    fn settings(&self) -> Result<Settings> {
        let text = match &self.settings {
            Some(path) => std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?,
            None => String::new(),
        };
        Ok(Settings::from_toml(&text, &self.set)?)
    }

    fn write(&self, played: &[(String, Figures)], json: Option<&Path>, out: Option<&Path>) -> Result<()> {
        if let Some(folder) = out {
            let path = folder.join("play.md");
            write_atomically(&path, self.markdown(played).as_bytes())?;
            say!("Written to {}", path.display())?;
        }
        if let Some(path) = json {
            let rows = played.iter().map(|(name, figures)| {
                json!({"preset": name, "controllers": self.controllers, "walls_db": self.walls_db, "seed": self.seed,
                    "rates": figures.rates(), "rates_without_walls": figures.without_walls().rates(), "figures": figures})
            });
            let text = serde_json::to_string_pretty(&rows.collect::<Vec<_>>())?;
            write_atomically(path, (text + "\n").as_bytes())?;
            say!("Written to {}", path.display())?;
        }
        Ok(())
    }

    fn markdown(&self, played: &[(String, Figures)]) -> String {
        let mut text = String::from("# Play sessions\n\nMade by `radar-chaperone benchmark --play --out DIR`.\n");
        for (name, figures) in played {
            let table = by_kind(figures);
            text +=
                &format!("\n## {name}\n\n{}\n{}\n\n{}", table.markdown(), table.caption, totals(figures).markdown());
        }
        if played.len() > 1 {
            text += &format!("\n## All\n\n{}", curve(played).markdown());
        }
        text
    }
}

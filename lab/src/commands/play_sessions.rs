//! `lab play`: simulated players in furnished rooms, and how well the warnings serve them.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use clap::Args;
use serde_json::json;

use super::{check_targets, recorded_sensor};
use a121::PRESETS;
use lab::experiments::{Figures, PlayTrial, PlayerSetup, Rates, by_kind, false_reports, missed, totals};
use lab::results::{Page, PlayOutcome, Provenance, curve_chart, curve_page_body, curve_table, played};
use radar_chaperone::app::progress;
use radar_chaperone::outln;
use radar_chaperone::report::{Table, write_atomically};
use radar_chaperone::settings::Settings;
use radar_simulation::{DiffuseEchoes, Headset, PlayWorld, SensorEffects, TrackingErrors};

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
    /// Leaves out: hands, their echoes alone, or whoever else moves
    #[arg(long, value_name = "WHAT", value_delimiter = ',',
          value_parser = clap::builder::PossibleValuesParser::new(["hands", "hand-echoes", "visitor"]))]
    without: Vec<String>,
    /// Prints each missed approach and each false report
    #[arg(long)]
    each: bool,
    /// Added to the reflection of the walls, dB
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    walls_db: f64,
    /// How far the sensor is from where the program assumes it, in a random direction, mm
    #[arg(long, default_value_t = 2.0)]
    mount_mm: f64,
    /// Kind of room: points (scatterers and smooth walls), or with surfaces, multipath and shadows:
    /// office, dining, living; corner: a bare room
    #[arg(long, default_value = "points", value_parser = clap::builder::PossibleValuesParser::new(PlayWorld::NAMES))]
    world: String,
    /// How well the headset is tracked; several play the same sessions
    #[arg(long, value_delimiter = ',', default_value = "nominal",
          value_parser = clap::builder::PossibleValuesParser::new(Headset::NAMES))]
    headset: Vec<String>,
    /// Also plays the same with the last --headset and these errors of its tracking instead, NAME=VALUE separated by spaces;
    /// may be repeated: rate_hz, jitter_m, wander_m, rotation_deg, dropouts_per_minute, distortion_m, jumps_per_minute,
    /// jump_m, jump_deg, stamp_s
    #[arg(long, value_name = "ERRORS")]
    tracking: Vec<String>,
    /// Imperfections of the sensor: none, measured, or a list of jitter, leakage, ringing,
    /// range_bias, warm_up, interference, profile_noise, each with =STRENGTH if it is not 1
    #[arg(long, default_value = "measured")]
    effects: SensorEffects,
    /// Jitter and noise of these recordings of the sensor at rest (.h5 of the vendor) instead of the
    /// measured model's
    #[arg(long, value_name = "FILE", value_delimiter = ',')]
    sensor_recording: Vec<PathBuf>,
    /// Factor of the spacing of the points that stand for rough surfaces; not in points
    #[arg(long, default_value_t = 1.0)]
    spacing: f64,
    /// Added to the diffuse echoes of surfaces, dB; not in points
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    diffuse_db: f64,
    /// Plays the same at each of these values of rooms.tracks.confirm_log_odds: the curve of detections
    /// against false reports
    #[arg(long, value_name = "ODDS", value_delimiter = ',', allow_hyphen_values = true)]
    odds: Vec<f64>,
    /// Also plays the same with these settings, NAME=VALUE separated by spaces; may be repeated
    #[arg(long, value_name = "SETTINGS", conflicts_with = "odds")]
    variant: Vec<String>,
    /// Settings file
    #[arg(long, value_name = "FILE")]
    settings: Option<std::path::PathBuf>,
    /// A setting; may be repeated
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<String>,
}

/// A setting that is played beside others, with the same sessions.
#[derive(Debug, Clone, Default)]
struct Variant {
    /// What the outcome's name has after the preset's.
    name: String,
    headset: Headset,
    tracking: TrackingErrors,
    odds: Option<f64>,
    changes: Vec<String>,
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
        let variants = self.with_headsets(&self.variants())?;
        let player = |variant: &Variant| {
            Ok(PlayerSetup { settings: self.settings(&text, variant)?, tracking: variant.tracking })
        };
        let players = variants.iter().map(player).collect::<Result<Vec<_>>>()?;
        let start = Instant::now();
        let mut outcomes = Vec::new();
        for preset in &self.presets {
            outcomes.extend(self.play(preset, &variants, &players)?);
        }
        if outcomes.len() > 1 {
            outln!("{}", curve_table(&outcomes).aligned())?;
        }
        self.write(&outcomes, start.elapsed())
    }

    /// What is played of each session: one setting, several odds, or the setting and its variants.
    fn variants(&self) -> Vec<Variant> {
        let with_odds = |odds: &f64| Variant {
            name: format!(", odds {odds}"),
            odds: Some(*odds),
            changes: vec![format!("rooms.tracks.confirm_log_odds={odds:?}")],
            ..Variant::default()
        };
        if !self.odds.is_empty() {
            return self.odds.iter().map(with_odds).collect();
        }
        let others = self.variant.iter().map(|text| Variant {
            name: format!(", {text}"),
            changes: text.split_whitespace().map(str::to_owned).collect(),
            ..Variant::default()
        });
        std::iter::once(Variant::default()).chain(others).collect()
    }

    /// Each variant with each headset.
    fn with_headsets(&self, variants: &[Variant]) -> Result<Vec<Variant>> {
        let mut all = Vec::new();
        let mut headsets = Vec::new();
        for name in &self.headset {
            let headset = Headset::from_name(name)?;
            headsets.push((name.clone(), headset, headset.errors()));
        }
        let Some((_, headset, base)) = headsets.last().cloned() else { return Ok(all) };
        for errors in &self.tracking {
            headsets.push((errors.clone(), headset, with_errors(base, errors)?));
        }
        for (name, headset, tracking) in &headsets {
            let named = |variant: &Variant| match headsets.len() {
                1 => variant.name.clone(),
                _ => format!(", {name}{}", variant.name),
            };
            let (headset, tracking) = (*headset, *tracking);
            all.extend(variants.iter().map(|variant| Variant {
                name: named(variant),
                headset,
                tracking,
                ..variant.clone()
            }));
        }
        Ok(all)
    }

    /// Plays every room with every variant.
    fn play(&self, preset: &str, variants: &[Variant], players: &[PlayerSetup]) -> Result<Vec<PlayOutcome>> {
        let rooms = self.rooms.unwrap_or(if self.quick { 2 } else { 10 });
        let minutes = self.minutes.unwrap_or(if self.quick { 1.0 } else { 10.0 });
        let seeds: Vec<u64> = (0..rooms).map(|n| self.seed.wrapping_add(n)).collect();
        let bar = progress::bar(rooms, &format!("playing with {preset}"));
        let world = PlayWorld::from_name(&self.world)?;
        if self.walls_db != 0.0 && world != PlayWorld::Points {
            bail!("--walls-db is for rooms of points: the walls of {} are of their material", self.world);
        }
        let diffuse = DiffuseEchoes { spacing: self.spacing, level_db: self.diffuse_db };
        if diffuse != DiffuseEchoes::default() && world == PlayWorld::Points {
            bail!("--spacing and --diffuse-db are for rooms of surfaces: give --world");
        }
        let recorded = recorded_sensor(&self.sensor_recording)?;
        let adapt = |trial: &mut PlayTrial| {
            trial.session.diffuse = diffuse;
            trial.session.recorded.clone_from(&recorded);
            trial.session.effects = self.effects;
            trial.session.world = world;
            trial.session.walls_db = self.walls_db;
            trial.session.errors.mount_m = self.mount_mm * 1e-3;
            trial.session.hands = !self.lacks("hands");
            trial.session.hands_without_echo = self.lacks("hand-echoes");
            trial.session.visitor = !self.lacks("visitor");
            trial.controllers = self.controllers;
        };
        let played = played(preset, players.to_vec(), &seeds, minutes, adapt, || bar.inc(1))?;
        bar.finish_and_clear();
        let mut outcomes = Vec::new();
        for (Variant { name, headset, odds, .. }, figures) in variants.iter().zip(played) {
            let name = format!("{preset}{name}");
            outln!("{name}: {rooms} rooms of {minutes} min from seed {} on", self.seed)?;
            for table in tables(&figures) {
                outln!("{}", table.aligned())?;
            }
            if self.each {
                print_each(&figures)?;
            }
            outcomes.push(PlayOutcome { name, preset: preset.into(), headset: *headset, odds: *odds, figures });
        }
        Ok(outcomes)
    }

    fn lacks(&self, what: &str) -> bool {
        self.without.iter().any(|without| without == what)
    }

    fn settings(&self, text: &str, variant: &Variant) -> Result<Settings> {
        let changes: Vec<String> = self.set.iter().chain(&variant.changes).cloned().collect();
        Ok(Settings::from_toml(text, &changes)?)
    }

    fn write(&self, played: &[PlayOutcome], took: Duration) -> Result<()> {
        if let Some(folder) = &self.out {
            self.page(played)?.write(folder, "play", &Provenance::here(), took)?;
            outln!("Written to {}", folder.join("play.md").display())?;
        }
        if let Some(path) = &self.json {
            let rows = played.iter().map(|PlayOutcome { name, preset, headset, odds, figures }| {
                json!({"name": name, "preset": preset, "confirm_log_odds": odds, "controllers": self.controllers, "without": self.without, "walls_db": self.walls_db, "mount_mm": self.mount_mm,
                    "headset": headset, "effects": self.effects, "world": self.world,
                    "spacing": self.spacing, "diffuse_db": self.diffuse_db, "sensor_recording": self.sensor_recording,
                    "seed": self.seed, "rates": figures.rates(), "rates_without_walls": figures.without_walls().rates(),
                    "figures": figures})
            });
            let text = serde_json::to_string_pretty(&rows.collect::<Vec<_>>())?;
            write_atomically(path, (text + "\n").as_bytes())?;
            outln!("Written to {}", path.display())?;
        }
        Ok(())
    }

    fn page(&self, played: &[PlayOutcome]) -> Result<Page> {
        let arguments: Vec<String> = std::env::args().skip(2).collect();
        let mut page = Page::new("Play sessions", &format!("play {}", arguments.join(" ")));
        if played.len() > 1 || !self.odds.is_empty() {
            page = page.heading("All").markdown(&curve_page_body(played));
        }
        if !self.odds.is_empty() {
            let alt = "Warned in time against reported where nothing is";
            return page.picture("play", alt, &curve_chart(played).draw());
        }
        for PlayOutcome { name, figures, .. } in played {
            page = tables(figures).iter().fold(page.heading(name), Page::table);
        }
        Ok(page)
    }
}

/// The tables of one setting; without misses or false reports, theirs are left out.
fn tables(figures: &Figures) -> Vec<Table> {
    let all = [by_kind(figures), totals(figures), missed(figures), false_reports(figures)];
    all.into_iter().filter(|table| !table.rows.is_empty()).collect()
}

/// Prints each approach that was due and not warned of, each false report, and each removed chair.
fn print_each(figures: &Figures) -> Result<()> {
    for approach in figures.approaches.iter().filter(|a| a.in_beam_s >= Rates::SEEN_S && !a.warned) {
        outln!("missed {approach:?}")?;
    }
    for report in &figures.false_reports {
        outln!("{report:?}")?;
    }
    for removed in &figures.forgettings {
        outln!("{removed:?}")?;
    }
    Ok(())
}

/// Errors of a tracking, some of them replaced.
fn with_errors(errors: TrackingErrors, changes: &str) -> Result<TrackingErrors> {
    let mut all = serde_json::to_value(errors)?;
    for change in changes.split_whitespace() {
        let (name, value) = change.split_once('=').with_context(|| format!("\"{change}\" is not NAME=VALUE"))?;
        let value: f64 = value.parse().with_context(|| format!("{name}: \"{value}\" is not a number"))?;
        all[name] = json!(value);
    }
    serde_json::from_value(all).with_context(|| format!("tracking errors \"{changes}\""))
}

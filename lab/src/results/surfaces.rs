//! Pages of play in rooms of surfaces, with everything that the simulator knows of: how the program does in rooms that
//! nothing was made with, and what each part of the simulation costs it.

use std::sync::Arc;

use anyhow::Result;

use super::play::played;
use super::{Extent, Page};
use crate::experiments::{Figures, PlayTrial, PlayerSetup, by_headset, by_kind, curve, false_reports, missed};
use radar_chaperone::settings::Settings;
use radar_simulation::{DiffuseEchoes, Headset, PlayWorld, RecordedSensor, SensorEffects};

/// First of the seeds of each page. Choice: nothing was tuned or trained on these.
const LIVING_SEED: u64 = 7000;
const REALISM_SEED: u64 = 7100;
/// Headsets, as columns name them.
const HEADSETS: [(&str, Headset); 3] =
    [("Lighthouse", Headset::Lighthouse), ("inside-out", Headset::InsideOut), ("poor tracker", Headset::Poor)];

fn player(headset: Headset) -> PlayerSetup {
    PlayerSetup { settings: Settings::default(), tracking: headset.errors() }
}

/// A trial of living rooms with tracked controllers.
fn in_living_rooms(trial: &mut PlayTrial) {
    trial.session.world = PlayWorld::Living;
    trial.controllers = true;
}

/// Play in living rooms, by headset and preset.
pub(super) fn living(extent: Extent) -> Result<Page> {
    let seeds: Vec<u64> = (0..extent.choose(10, 1)).map(|n| LIVING_SEED + n).collect();
    let minutes = extent.choose(10.0, 0.25);
    let by_preset = |preset: &str| -> Result<Vec<Figures>> {
        let players = HEADSETS.map(|(_, headset)| player(headset)).to_vec();
        played(preset, players, &seeds, minutes, in_living_rooms, || ())
    };
    let columns = |figures: &[Figures]| {
        let named: Vec<_> = HEADSETS.iter().map(|(name, _)| *name).zip(figures).collect();
        by_headset(&named)
    };
    let (d16, c16) = (by_preset("d16")?, by_preset("c16")?);
    Ok(Page::new("Play in living rooms", "")
        .text(&format!(
            "Simulation. {} rooms of {minutes} minutes from seed {LIVING_SEED} on, of a family that nothing was tuned or \
             trained on: L-shaped, with a pillar or a sloping ceiling; sofas, armchairs, wire and cantilever chairs, glass \
             tables, shelves, plants, cables. Surfaces echo from their specular points, edges and roughness, walls and \
             panels mirror, objects and bodies shadow. The sensor has its measured imperfections, the wearer a body and \
             hands with tracked controllers; a person and a cat cross the room, a chair is carried away halfway. The \
             three headsets play the same sessions.",
            seeds.len()
        ))
        .heading("Preset d16")
        .table(&columns(&d16))
        .heading("Preset c16")
        .table(&columns(&c16))
        .heading("By object: d16, Lighthouse")
        .table(&by_kind(&d16[0]))
        .table(&missed(&d16[0]))
        .table(&false_reports(&d16[0])))
}

/// A row of the page of assumptions: its name, and what is different from everything on.
type Assumption = (&'static str, fn(&mut PlayTrial));

/// The effect of this name alone.
fn only(name: &str) -> SensorEffects {
    let mut effects = SensorEffects::NONE;
    *effects.strength_mut(name).expect("a sensor effect") = 1.0;
    effects
}

fn diffuse(level_db: f64, spacing: f64) -> DiffuseEchoes {
    DiffuseEchoes { spacing, level_db }
}

/// What differs from everything on, in the order of the table.
const ASSUMPTIONS: [Assumption; 16] = [
    ("everything on", |_| ()),
    ("sensor: noise alone", |t| t.session.effects = SensorEffects::NONE),
    ("   jitter alone", |t| t.session.effects = only("jitter")),
    ("   leakage alone", |t| t.session.effects = only("leakage")),
    ("   ringing alone", |t| t.session.effects = only("ringing")),
    ("   range bias alone", |t| t.session.effects = only("range_bias")),
    ("   warming up alone", |t| t.session.effects = only("warm_up")),
    ("   interference alone", |t| t.session.effects = only("interference")),
    ("   profile's noise alone", |t| t.session.effects = only("profile_noise")),
    ("perfect poses", |t| t.players = vec![player(Headset::Perfect)]),
    ("hands without echoes", |t| t.session.hands_without_echo = true),
    ("nobody else moves", |t| t.session.visitor = false),
    ("points of surfaces half as far apart", |t| t.session.diffuse = diffuse(0.0, 0.5)),
    ("rough surfaces 6 dB weaker", |t| t.session.diffuse = diffuse(-6.0, 1.0)),
    ("rough surfaces 6 dB stronger", |t| t.session.diffuse = diffuse(6.0, 1.0)),
    ("the world of before: points, smooth walls", |t| t.session.world = PlayWorld::Points),
];

/// What each part of the simulation costs.
pub(super) fn realism(extent: Extent, recorded: Option<&Arc<RecordedSensor>>) -> Result<Page> {
    let rooms = extent.choose(6, 1);
    let minutes = extent.choose(3.0, 0.25);
    let rows = &ASSUMPTIONS[..extent.choose(ASSUMPTIONS.len(), 2)];
    let play = |first_seed: u64, change: &dyn Fn(&mut PlayTrial)| -> Result<Figures> {
        let adapt = |trial: &mut PlayTrial| {
            in_living_rooms(trial);
            change(trial);
        };
        let seeds: Vec<u64> = (first_seed..first_seed + rooms).collect();
        Ok(played("d16", vec![player(Headset::Lighthouse)], &seeds, minutes, adapt, || ())?.swap_remove(0))
    };
    let mut figures: Vec<(&str, Figures)> = Vec::new();
    let mut row = |name: &'static str, first_seed: u64, change: &dyn Fn(&mut PlayTrial)| -> Result<()> {
        let of_row = play(first_seed, change)?;
        // The whole page takes an hour; what is done is not lost with it.
        log::info!("{}", curve([(name, &of_row)].into_iter()).markdown().lines().last().unwrap_or_default());
        figures.push((name, of_row));
        Ok(())
    };
    row("other rooms, everything on", REALISM_SEED + rooms, &|_| ())?;
    for (name, change) in rows {
        row(name, REALISM_SEED, change)?;
    }
    if let Some(recorded) = recorded {
        row("a recorded sensor's jitter and noise", REALISM_SEED, &|trial| {
            trial.session.recorded = Some(recorded.clone());
        })?;
    }
    Ok(Page::new("What the simulation assumes, and what each assumption costs", "")
        .text(&format!(
            "Living rooms, {rooms} of {minutes} minutes from seed {REALISM_SEED} on, d16, Lighthouse, tracked controllers: \
             each row differs from \"everything on\" in what it names. In the first minutes the map is still incomplete, so \
             fewer approaches are warned of than in ten. The first row shows how much the rooms alone make."
        ))
        .table(&curve(figures.iter().map(|(name, figures)| (*name, figures)))))
}

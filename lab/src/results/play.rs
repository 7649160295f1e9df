//! The page of play sessions: warnings of simulated players in furnished rooms.

use anyhow::{Result, anyhow};

use super::{Extent, Page};
use crate::experiments::{Figures, PlayTrial, PlayerSetup, by_kind, curve, play, totals};
use a121::preset;
use radar_chaperone::report::{Chart, Series, Table};
use radar_chaperone::settings::Settings;
use radar_simulation::{Headset, PlaySession, SensorEffects};

/// First of the seeds. Choice: nothing was tuned or trained on these.
const FIRST_SEED: u64 = 1000;
/// The setting that trades detections against false reports.
const ODDS: &str = "rooms.tracks.confirm_log_odds";

/// Result of the sessions with one setting.
#[derive(Debug, Clone)]
pub struct PlayOutcome {
    /// Preset and what differs from the defaults.
    pub name: String,
    /// The sensor's preset.
    pub preset: String,
    /// How the headset is tracked.
    pub headset: Headset,
    /// The minimum log odds, if it was set.
    pub odds: Option<f64>,
    /// All sessions together.
    pub figures: Figures,
}

/// Plays `seeds` with a preset and each of the players; `adapt` changes the trial. `done` is called when
/// each session is over. Returns the figures of each player.
///
/// # Errors
/// A preset that does not exist, sessions that cannot be simulated.
pub fn played(
    preset_name: &str,
    players: Vec<PlayerSetup>,
    seeds: &[u64],
    minutes: f64,
    adapt: impl Fn(&mut PlayTrial),
    done: impl Fn() + Sync,
) -> Result<Vec<Figures>> {
    let config = preset(preset_name).ok_or_else(|| anyhow!("there is no preset {preset_name:?}"))?;
    let effects = SensorEffects::MEASURED;
    let session = PlaySession { duration_s: 60.0 * minutes, effects, ..PlaySession::new(config, 0) };
    let mut trial = PlayTrial { session, players, controllers: false };
    adapt(&mut trial);
    let mut sums = vec![Figures::default(); trial.players.len()];
    for of_seed in play(&trial, seeds, |_| done())? {
        sums.iter_mut().zip(of_seed).for_each(|(sum, one)| sum.add(one));
    }
    Ok(sums)
}

/// Players with the nominal headset, one for each of the settings.
fn with_nominal_headset(settings: impl IntoIterator<Item = Settings>) -> Vec<PlayerSetup> {
    let tracking = Headset::Nominal.errors();
    settings.into_iter().map(|settings| PlayerSetup { settings, tracking }).collect()
}

pub(super) fn page(extent: Extent) -> Result<Page> {
    let seeds: Vec<u64> = (0..extent.choose(10, 1)).map(|n| FIRST_SEED + n).collect();
    let minutes = extent.choose(10.0, 0.5);
    let of = |adapt: fn(&mut PlayTrial)| {
        let player = with_nominal_headset([Settings::default()]);
        Ok::<_, anyhow::Error>(played("d16", player, &seeds, minutes, adapt, || ())?.swap_remove(0))
    };
    let usual = of(|_| ())?;
    let controllers = of(|trial| trial.controllers = true)?;
    let bright_walls = of(|trial| trial.session.walls_db = 20.0)?;
    let page = Page::new("Play sessions", "")
        .text(&format!(
            "Rooms with nine pieces of furniture, hard and soft (−33 to +10 dBsm), at any angle to the tracking frame. \
             The wearer turns, steps, reaches, crouches and comes near them with hands in the beam; there is a visitor, \
             and a chair is carried away halfway. {} rooms of {minutes} minutes from seed {FIRST_SEED} on, preset d16; \
             nothing was tuned or trained on them. The sensor has its measured imperfections; objects are point \
             scatterers and walls smooth planes, without multipath. A warning is in time when it shows before the body is within 0.4 m, \
             or would be there within 0.6 s at its speed. Nothing is at a report that is more than 25 cm from every \
             object.",
            seeds.len()
        ))
        .heading("Preset d16")
        .table(&by_kind(&usual))
        .table(&totals(&usual))
        .heading("With tracked controllers")
        .table(&totals(&controllers))
        .heading("With walls that return 20 dB more")
        .table(&by_kind(&bright_walls))
        .table(&totals(&bright_walls));
    let curve = curves(extent)?;
    page.heading("Detections against false reports")
        .text(&format!(
            "The same rooms, {} minutes each, over `{ODDS}`, the minimum log odds of a confirmed detection; its default \
             is {}. In the first minute the map is still incomplete, so fewer approaches are warned of than in ten \
             minutes. Preset thesis with `processing.mode = \"rooms\"`.",
            extent.choose(3.0, 0.5),
            Settings::default().rooms.tracks.confirm_log_odds
        ))
        .picture("play", "Warned in time against reported where nothing is", &curve_chart(&curve).draw())
        .map(|page| page.markdown(&curve_page_body(&curve)))
}

/// Every preset at every value of [`ODDS`].
fn curves(extent: Extent) -> Result<Vec<PlayOutcome>> {
    let seeds: Vec<u64> = (0..extent.choose(10, 1)).map(|n| FIRST_SEED + n).collect();
    let mut outcomes = Vec::new();
    for preset in extent.choose(vec!["d16", "c16", "thesis"], vec!["d16"]) {
        let all_odds = extent.choose(vec![0.7, 1.2, 1.7, 2.3], vec![1.7]);
        let with_odds = |odds: &f64| {
            let mut changes = vec![format!("{ODDS}={odds:?}")];
            if preset == "thesis" {
                changes.push("processing.mode=\"rooms\"".into());
            }
            Settings::from_toml("", &changes)
        };
        let settings = all_odds.iter().map(with_odds).collect::<Result<Vec<_>, _>>()?;
        let played = played(preset, with_nominal_headset(settings), &seeds, extent.choose(3.0, 0.5), |_| (), || ())?;
        for (odds, figures) in all_odds.into_iter().zip(played) {
            let name = format!("{preset}, odds {odds}");
            let (preset, headset) = (preset.to_owned(), Headset::Nominal);
            outcomes.push(PlayOutcome { name, preset, headset, odds: Some(odds), figures });
        }
    }
    Ok(outcomes)
}

/// The table of detections against false reports.
pub fn curve_table(outcomes: &[PlayOutcome]) -> Table {
    curve(outcomes.iter().map(|outcome| (outcome.name.as_str(), &outcome.figures)))
}

/// The table of detections against false reports, as Markdown.
pub fn curve_page_body(outcomes: &[PlayOutcome]) -> String {
    let table = curve_table(outcomes);
    format!("\n{}\n{}\n", table.markdown(), table.caption)
}

/// A curve for each preset.
pub fn curve_chart(outcomes: &[PlayOutcome]) -> Chart {
    let point = |figures: &Figures| {
        let objects = figures.without_walls().rates();
        [figures.rates().false_near_per_min, 100.0 * objects.warned as f64 / objects.due as f64]
    };
    let of_preset = |of: &[PlayOutcome]| Series {
        name: of[0].preset.clone(),
        points: of.iter().map(|outcome| point(&outcome.figures)).collect(),
        joined: true,
    };
    Chart {
        title: "Simulated play: warned in time against reported where nothing is".into(),
        x_label: "reported where nothing is, within 1 m of the body (a minute)".into(),
        y_label: "warned in time (%)".into(),
        series: outcomes.chunk_by(|a, b| a.preset == b.preset).map(of_preset).collect(),
        ..Chart::default()
    }
}

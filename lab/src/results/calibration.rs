//! The page of calibration without a ruler: the mount and the time offset from play, mistakes, jumps, drift, sharpness, and
//! what a wrong mount and worse tracking cost.

use std::ops::Range;

use anyhow::Result;

use super::play::played;
use super::{Extent, Page};
use crate::experiments::accuracy::{
    REFLECTOR_TRIALS, ReflectorOptions, gross_table, jumps_table, mount_table, reflector_table, sharpness_table,
};
use crate::experiments::{Figures, PlayTrial, PlayerSetup, curve};
use a121::preset;
use radar_chaperone::report::Table;
use radar_chaperone::settings::Settings;
use radar_simulation::{Headset, PlaySession, PlayWorld, SensorEffects, TrackingErrors};

/// First of the seeds of each part. Choice: nothing was tuned or trained on these.
const MOUNT_SEED: u64 = 7900;
const GROSS_SEED: u64 = 7920;
const JUMP_SEED: u64 = 7930;
const REFLECTOR_SEED: u64 = 7940;
const PLAY_SEED: u64 = 7960;
const TRACKING_SEED: u64 = 7970;
const HEADSETS: [Headset; 4] = [Headset::Nominal, Headset::Lighthouse, Headset::InsideOut, Headset::Poor];
const WORLDS: [PlayWorld; 3] = [PlayWorld::Points, PlayWorld::Office, PlayWorld::Dining];
/// How far the sensor of the part about wrong mounts is from where it is assumed, metres.
const MOUNTS_M: [f64; 3] = [0.0, 0.05, 0.08];
/// Slow errors of the tracking that the settings do not know of, metres.
const UNKNOWN_WANDERS_M: [f64; 2] = [3e-3, 5e-3];

/// All parts.
pub(super) fn calibration(extent: Extent) -> Result<Page> {
    let session = session();
    let worlds = &WORLDS[..extent.choose(3, 1)];
    let headsets = &HEADSETS[..extent.choose(4, 1)];
    let seeds = |first: u64, full: u64| first..first + extent.choose(full, 1);
    let short = |duration_s: f64| PlaySession { duration_s, ..session.clone() };
    let bare = PlaySession { visitor: false, ..session.clone() };
    let mut page = Page::new("Calibration without a ruler", "")
        .text("Simulation: play of the preset d16, with the sensor's measured imperfections, the wearer's hands and a visitor.")
        .heading("Where the sensor is on the head, from play")
        .text(
            "Each room has another mount, assumed wrong by up to 8 cm and 20°. Only echoes and path are used; nothing is \
             mapped. Corner: a bare room, in a corner of which the wearer looks about; of those, walls, floor and ceiling alone.",
        )
        .table(&mount_table(&session, worlds, headsets, &seeds(MOUNT_SEED, 10)))
        .table(&mount_table(&bare, &[PlayWorld::Corner], headsets, &seeds(MOUNT_SEED, 10)))
        .heading("Mistakes")
        .table(&gross_table(&session, worlds, &[Headset::InsideOut], &seeds(GROSS_SEED, 6)))
        .heading("Jumps of the tracking frame")
        .table(&jumps_table(&short(extent.choose(60.0, 10.0)), &jumping(), &seeds(JUMP_SEED, 10)))
        .heading("Sharpness with tracked poses")
        .table(&sharpness_table(&alone(extent), &wandering(), &seeds(JUMP_SEED, 6)));
    for wander_m in UNKNOWN_WANDERS_M {
        page = page
            .heading(&format!("One reflector, {:.0} mm of drift that the settings do not know of", wander_m * 1e3))
            .table(&reflector(wander_m, seeds(REFLECTOR_SEED, 10)));
    }
    wrong_mounts(worse_tracking(page, extent)?, extent)
}

fn session() -> PlaySession {
    let config = preset("d16").expect("d16 exists");
    PlaySession { effects: SensorEffects::MEASURED, ..PlaySession::new(config, 0) }
}

/// Without hands and visitor, whose echoes pass over those of the scatterers.
fn alone(extent: Extent) -> PlaySession {
    PlaySession { duration_s: extent.choose(30.0, 5.0), hands: false, visitor: false, ..session() }
}

/// Kinds of tracking that jumps.
pub fn jumping() -> [(&'static str, TrackingErrors); 10] {
    let jumping =
        |jump_m, jump_deg| TrackingErrors { jumps_per_minute: 7.5, jump_m, jump_deg, ..TrackingErrors::default() };
    let usual = jumping(20e-3, 0.5);
    [
        ("5 mm", jumping(5e-3, 0.0)),
        ("20 mm, 0.5°", usual),
        ("100 mm, 5°", jumping(0.1, 5.0)),
        ("20 mm, 0.5°, 90 Hz", TrackingErrors { rate_hz: 90.0, ..usual }),
        ("20 mm, 0.5°, stamps 1 ms", TrackingErrors { stamp_s: 1e-3, ..usual }),
        ("no jumps", TrackingErrors::default()),
        ("no jumps, stamps 1 ms", TrackingErrors { stamp_s: 1e-3, ..TrackingErrors::default() }),
        ("lighthouse", Headset::Lighthouse.errors()),
        ("inside-out", Headset::InsideOut.errors()),
        ("poor", Headset::Poor.errors()),
    ]
}

/// Kinds of tracking whose path is not quite the sensor's.
pub fn wandering() -> [(&'static str, TrackingErrors); 8] {
    let wander = TrackingErrors { wander_m: 3e-3, ..TrackingErrors::default() };
    [
        ("none", TrackingErrors::none()),
        ("nominal", TrackingErrors::default()),
        ("wander 3 mm", wander),
        ("stamps 1 ms", TrackingErrors { stamp_s: 1e-3, ..TrackingErrors::default() }),
        ("wander 3 mm, jumps 5 mm, stamps 1 ms", wandering_and_jumping()),
        ("lighthouse", Headset::Lighthouse.errors()),
        ("inside-out", Headset::InsideOut.errors()),
        ("poor", Headset::Poor.errors()),
    ]
}

fn wandering_and_jumping() -> TrackingErrors {
    TrackingErrors { wander_m: 3e-3, jumps_per_minute: 7.5, jump_m: 5e-3, stamp_s: 1e-3, ..TrackingErrors::default() }
}

/// Of the trials, those on a sphere of 50 cm at 20 dB.
fn reflector(wander_m: f64, seeds: Range<u64>) -> Table {
    let options =
        ReflectorOptions { seeds, without: None, near: false, by_axis: false, unknown_wander_m: Some(wander_m) };
    let trials = REFLECTOR_TRIALS.into_iter().filter(|trial| trial.motion == "sphere-50cm" && trial.snr_db == 20.0);
    reflector_table(&trials.collect::<Vec<_>>(), &options)
}

/// Play with tracking that is worse than the settings assume.
fn worse_tracking(page: Page, extent: Extent) -> Result<Page> {
    let (rooms, minutes) = (extent.choose(6, 1), extent.choose(2.5, 0.25));
    let seeds: Vec<u64> = (TRACKING_SEED..TRACKING_SEED + rooms).collect();
    let nominal = TrackingErrors::default();
    let lost = TrackingErrors { dropouts_per_minute: 4.0, ..nominal };
    let kinds = [
        ("nominal", nominal),
        ("slow error 3 mm, jumps 5 mm, stamps 1 ms", wandering_and_jumping()),
        ("stamps 1 ms", TrackingErrors { stamp_s: 1e-3, ..nominal }),
        ("lost 4 times a minute", lost),
        ("… and 20 mm, 0.5° elsewhere then", TrackingErrors { jump_m: 20e-3, jump_deg: 0.5, ..lost }),
        ("… and 100 mm, 5° elsewhere then", TrackingErrors { jump_m: 0.1, jump_deg: 5.0, ..lost }),
    ];
    let players = || kinds.map(|(_, tracking)| PlayerSetup { settings: Settings::default(), tracking }).to_vec();
    let mut rows = Vec::new();
    for world in [PlayWorld::Points, PlayWorld::Dining].into_iter().take(extent.choose(2, 1)) {
        let adapt = |trial: &mut PlayTrial| (trial.session.world, trial.controllers) = (world, true);
        let figures = played("d16", players(), &seeds, minutes, adapt, || ())?;
        let name = format!("{world:?}").to_lowercase();
        rows.extend(kinds.iter().zip(figures).map(|((kind, _), figures)| (format!("{name}, {kind}"), figures)));
    }
    Ok(page
        .heading("Play with worse tracking")
        .text(&format!(
            "{rooms} rooms of {minutes} minutes from seed {TRACKING_SEED} on, the same sweeps and motion for every kind of tracking."
        ))
        .table(&curve(rows.iter().map(|(name, figures)| (name.as_str(), figures)))))
}

/// Play with the sensor elsewhere than assumed.
fn wrong_mounts(page: Page, extent: Extent) -> Result<Page> {
    let (rooms, minutes) = (extent.choose(4, 1), extent.choose(2.5, 0.25));
    let mut rows = Vec::new();
    for headset in [Headset::Lighthouse, Headset::InsideOut].into_iter().take(extent.choose(2, 1)) {
        for mount_m in MOUNTS_M {
            for (name, figures) in ["estimated", "as assumed"].iter().zip(with_mount(headset, mount_m, rooms, minutes)?)
            {
                rows.push((format!("{headset:?}, {:.0} cm off, {name}", mount_m * 100.0), figures));
            }
        }
    }
    Ok(page
        .heading("Play with a wrong mount")
        .text(&format!(
            "{rooms} rooms of points, {minutes} minutes each from seed {PLAY_SEED} on, the map empty at the beginning, so that \
             the time until the mount is found counts too. \"As assumed\": `tracking.estimate_mount = false`."
        ))
        .table(&curve(rows.iter().map(|(name, figures)| (name.as_str(), figures)))))
}

/// Play with the sensor this far from where it is assumed: with and without estimating it.
fn with_mount(headset: Headset, mount_m: f64, rooms: u64, minutes: f64) -> Result<Vec<Figures>> {
    let player = |estimate: bool| -> Result<PlayerSetup> {
        let settings = Settings::from_toml("", &[format!("tracking.estimate_mount={estimate}")])?;
        Ok(PlayerSetup { settings, tracking: headset.errors() })
    };
    let seeds: Vec<u64> = (PLAY_SEED..PLAY_SEED + rooms).collect();
    let adapt = |trial: &mut PlayTrial| {
        trial.session.errors.mount_m = mount_m;
        trial.controllers = true;
    };
    played("d16", vec![player(true)?, player(false)?], &seeds, minutes, adapt, || ())
}

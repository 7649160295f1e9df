//! The page of calibration without a ruler: the mount and the time offset from play, and what a wrong mount costs.

use anyhow::Result;

use super::play::played;
use super::{Extent, Page};
use crate::experiments::accuracy::mount_table;
use crate::experiments::{Figures, PlayTrial, PlayerSetup, curve};
use a121::preset;
use radar_chaperone::settings::Settings;
use radar_simulation::{Headset, PlaySession, PlayWorld, SensorEffects};

/// First of the seeds of both parts. Choice: nothing was tuned or trained on these.
const MOUNT_SEED: u64 = 7200;
const PLAY_SEED: u64 = 7300;
const HEADSETS: [Headset; 4] = [Headset::Nominal, Headset::Lighthouse, Headset::InsideOut, Headset::Poor];
/// How far the sensor of the second part is from where it is assumed, metres.
const MOUNTS_M: [f64; 3] = [0.0, 0.05, 0.08];

/// Mount and time offset from play, and play with a wrong mount.
pub(super) fn calibration(extent: Extent) -> Result<Page> {
    let config = preset("d16").expect("d16 exists");
    let session = PlaySession { effects: SensorEffects::MEASURED, ..PlaySession::new(config, 0) };
    let worlds = [PlayWorld::Points, PlayWorld::Office, PlayWorld::Dining];
    let worlds = &worlds[..extent.choose(3, 1)];
    let headsets = &HEADSETS[..extent.choose(4, 1)];
    let seeds = MOUNT_SEED..MOUNT_SEED + extent.choose(10, 1);
    let rooms = extent.choose(4, 1);
    let minutes = extent.choose(2.5, 0.25);
    let mut rows = Vec::new();
    for headset in [Headset::Lighthouse, Headset::InsideOut].into_iter().take(extent.choose(2, 1)) {
        for mount_m in MOUNTS_M {
            for (name, figures) in ["estimated", "as assumed"].iter().zip(with_mount(headset, mount_m, rooms, minutes)?)
            {
                rows.push((format!("{headset:?}, {:.0} cm off, {name}", mount_m * 100.0), figures));
            }
        }
    }
    Ok(Page::new("Calibration without a ruler", "")
        .text("Simulation: play of the preset d16, with the sensor's measured imperfections, the wearer's hands and a visitor.")
        .heading("Where the sensor is on the head, from play")
        .text(
            "Each room has another mount, assumed wrong by up to 8 cm and 20°. Only echoes and path are used; nothing is mapped.",
        )
        .table(&mount_table(&session, worlds, headsets, &seeds))
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

//! `radar-chaperone run`: runs with SteamVR and shows warnings in the headset. The manifest starts
//! this command.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Result;
use clap::Args;
use glam::DVec3;
use radar_sar::geometry::Pose;

use super::files::SettingsArguments;
use super::outputs::{CommandFiles, always, never};
use super::sensor::SensorArguments;
use crate::app::{SessionOptions, is_session_report};

/// Runs with SteamVR and warns of obstacles in the headset
///
/// Reads the headset's poses and the sensor's sweeps, maps the room and draws warnings where
/// obstacles are. Ends with SteamVR, or by Ctrl-C. A missing sensor is waited for. `radar-chaperone
/// install` has SteamVR start it.
#[derive(Debug, Args)]
pub(super) struct Run {
    /// Waits for SteamVR if it does not run yet, and again after it has ended
    #[arg(long)]
    wait: bool,
    /// Also records frames and poses; must not exist yet
    #[arg(long, value_name = "FILE.mcap")]
    record: Option<PathBuf>,
    /// Writes counters and costs when it ends
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Removes the saved maps of the rooms in which it runs; with --wait once for each room
    #[arg(long)]
    forget: bool,
    /// Opens a window on the desktop that shows the map, as `replay --view` does; closing it ends
    /// nothing else
    #[arg(long)]
    view: bool,
    #[command(flatten)]
    sensor: SensorArguments,
    #[command(flatten)]
    settings: SettingsArguments,
}

/// Where a sensor is assumed until its echoes show where it is: `head_from_sensor`, in the middle of the headset's front.
/// Choice: fronts are 7 to 10 cm ahead of the eyes; the search is 5 cm wide (1σ).
fn front_of_headset() -> Pose {
    Pose::from_translation(DVec3::new(0.0, 0.02, -0.08))
}

impl Run {
    pub fn run(&self) -> Result<()> {
        let files = CommandFiles::default().reads(&self.sensor.config).reads(self.settings.live_file());
        let files = files.records(&self.record, never).writes(&self.report, is_session_report);
        files.writes(&self.sensor.calibration, always).check_new()?;
        self.check()?;
        let sensor = self.sensor.clone();
        let options = SessionOptions {
            wait: self.wait,
            record: self.record.clone(),
            report: self.report.clone(),
            forget: self.forget,
            view: self.view,
            settings_file: self.settings.live_file(),
            overrides: self.overrides()?,
            choose_sensor: Arc::new(move || {
                let mut chosen = sensor.choose()?;
                if sensor.given_mount()?.is_none() {
                    chosen.mount = front_of_headset();
                }
                Ok(chosen)
            }),
        };
        options.run()
    }

    /// Checks mount and settings.
    pub(super) fn check(&self) -> Result<()> {
        self.settings.check_live(&self.overrides()?)
    }

    /// Settings of the command line, which override the file: also the mount, where given.
    fn overrides(&self) -> Result<Vec<String>> {
        let mount = self.sensor.given_mount()?.map(|mount| {
            let [translation, rotation] = [mount.translation.to_array().to_vec(), mount.rotation.to_array().to_vec()];
            format!("tracking.mount={{ translation = {translation:?}, rotation = {rotation:?} }}")
        });
        Ok(mount.into_iter().chain(self.settings.changes().iter().cloned()).collect())
    }
}

//! Shared by `record` and `run`: the sensor's arguments.

use std::path::{Path, PathBuf};

use a121::find::Candidate;
use a121::{Calibration, PRESETS, SensorConfig, Setup, preset};
use anyhow::{Context, Result, anyhow};
use clap::Args;
use radar_recording::read_small_text;
use radar_sar::geometry::Pose;

use super::board::BoardArguments;
use super::import::parse_mount;
use super::simulate::read_config;
use crate::app::ChosenSensor;

/// Command-line arguments of the sensor.
#[derive(Debug, Clone, Args)]
pub(super) struct SensorArguments {
    #[command(flatten)]
    board: BoardArguments,
    /// Sensor preset; default: d16 on XC120 and Raspberry Pi, c16 on XE125, slow-link on boards
    /// with a CH340
    #[arg(long, value_parser = clap::builder::PossibleValuesParser::new(PRESETS))]
    preset: Option<String>,
    /// Sensor configuration (JSON, named as in the vendor's protocol) instead of a preset
    #[arg(long, value_name = "FILE.json", conflicts_with = "preset")]
    pub config: Option<PathBuf>,
    /// Pose of the sensor on the tracked object: x,y,z in metres, or x,y,z,qx,qy,qz,qw
    #[arg(long, value_name = "x,y,z[,qx,qy,qz,qw]", allow_hyphen_values = true)]
    mount: Option<String>,
    /// Calibration to reuse; rewritten when the sensor was calibrated
    #[arg(long, value_name = "FILE.json")]
    pub calibration: Option<PathBuf>,
}

impl SensorArguments {
    /// `head_from_sensor`.
    pub fn mount(&self) -> Result<Pose> {
        Ok(self.given_mount()?.unwrap_or(Pose::IDENTITY))
    }

    /// The same, if given.
    pub fn given_mount(&self) -> Result<Option<Pose>> {
        self.mount.as_deref().map(parse_mount).transpose()
    }

    /// The given board, or the most likely one, with the given configuration, or the board's
    /// default.
    pub fn choose(&self) -> Result<ChosenSensor> {
        let mount = self.mount()?;
        let place = self.board.choose()?;
        let (name, config) = self.config_for(&place)?;
        let mut setup = Setup::single(self.board.sensor, config);
        setup.calibrations = self.calibration.as_deref().map_or(Ok(Vec::new()), read_calibrations)?;
        let calibration = self.calibration.clone();
        Ok(ChosenSensor { place, name, setup, mount, baud: self.board.baud, calibration })
    }

    /// The given configuration, or the board's default, with its name.
    fn config_for(&self, candidate: &Candidate) -> Result<(String, SensorConfig)> {
        if let Some(path) = &self.config {
            return Ok((path.display().to_string(), read_config(path)?));
        }
        let name = self.preset.as_deref().unwrap_or(candidate.board.default_preset());
        let config = preset(name).ok_or_else(|| anyhow!("preset \"{name}\" is not known"))?;
        Ok((name.to_owned(), config))
    }
}

/// Calibrations of an earlier recording; empty where the file does not exist yet.
fn read_calibrations(path: &Path) -> Result<Vec<Calibration>> {
    let about = || format!("cannot read calibration {}", path.display());
    let text = match read_small_text(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        text => text.with_context(about)?,
    };
    serde_json::from_str(&text).with_context(|| format!("{} is no calibration", path.display()))
}

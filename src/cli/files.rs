//! File handling shared by several commands: settings over a recording, streams read to the end.

use crate::app::user_folder;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;

use crate::settings::Settings;
use a121::Frame;
use radar_mapping::{Event, ObserverCounters, ObserverSettings, observe_each};
use radar_recording::{Recording, read_small_text};
use radar_sar::{Observation, PoseSample};

/// Command-line arguments of the settings.
#[derive(Debug, Default, Args)]
pub(super) struct SettingsArguments {
    /// Settings file (TOML); default: the recording's own settings, or the user's file where there
    /// is no recording
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
    /// Changes one setting, for example --set tracking.time_offset_s=0.02; may be repeated
    #[arg(long = "set", value_name = "NAME=VALUE")]
    changes: Vec<String>,
}

impl SettingsArguments {
    /// The given file.
    pub fn file(&self) -> &Option<PathBuf> {
        &self.settings
    }

    /// Settings from the file, or from the recording, with the changes applied.
    pub fn over_recorded(&self, recorded: &str) -> Result<Settings> {
        let text = match &self.settings {
            Some(path) => read_small_text(path).with_context(|| format!("cannot read settings {}", path.display()))?,
            None => recorded.to_owned(),
        };
        Ok(Settings::from_toml(&text, &self.changes)?)
    }

    /// The file that is followed while the program runs: the given one, or the user's own, which
    /// may be missing.
    pub fn live_file(&self) -> Option<PathBuf> {
        self.settings.clone().or_else(user_settings)
    }

    /// The changes on the command line.
    pub fn changes(&self) -> &[String] {
        &self.changes
    }

    /// Checks the settings of a long-running command. A given file must be valid; the user's own
    /// may be invalid, because nobody may be there to fix it.
    pub fn check_live(&self, over: &[String]) -> Result<()> {
        match &self.settings {
            Some(_) => self.live(toml::Table::new()).map(drop),
            None => Ok(Settings::from_toml("", over).map(drop)?),
        }
    }

    /// Settings from the given file, or from the user's own if it exists, with the changes applied;
    /// `below` supplies values that neither sets.
    pub fn live(&self, below: toml::Table) -> Result<Settings> {
        let path = self.settings.clone().or_else(|| user_settings().filter(|path| path.is_file()));
        let text = match &path {
            Some(path) => read_small_text(path).with_context(|| format!("cannot read settings {}", path.display()))?,
            None => String::new(),
        };
        let read = Settings::from_layers(below, &text, &self.changes);
        match path {
            Some(path) => read.with_context(|| path.display().to_string()),
            None => Ok(read?),
        }
    }
}

/// Path of the user's own settings.
pub(super) fn user_settings() -> Option<PathBuf> {
    user_folder("XDG_CONFIG_HOME", ".config").map(|folder| folder.join("settings.toml"))
}

/// Most frames and poses read into memory, bytes. Choice: 190 s at the fastest that the serial line
/// carries, 187 kB/s. `calibrate` then takes less than 300 MB. Measured: `lab results memory`.
const MAX_STREAM_BYTES: usize = 34 << 20;
/// A pose counts as much as this many. Choice: itself, and steps of the path over 15 ms to the next.
const PATH_PER_POSE: usize = 4;

/// Frames and poses of a recording, each in file order, as far as they fit; damage is logged once.
pub(super) fn read_streams(path: &Path) -> Result<(Recording, Vec<Frame>, Vec<PoseSample>)> {
    let mut recording = Recording::open(path)?;
    let (mut frames, mut poses) = (Vec::new(), Vec::new());
    let mut bytes = 0;
    for event in &mut recording {
        match event {
            Event::Frame(frame) => {
                bytes += size_of::<Frame>() + size_of_val(&frame.samples[..]);
                frames.push(frame);
            }
            Event::Pose(pose) => {
                bytes += PATH_PER_POSE * size_of::<PoseSample>();
                poses.push(pose);
            }
            Event::Hands(_) => {}
        }
        if bytes > MAX_STREAM_BYTES {
            let (frames, poses) = (frames.len(), poses.len());
            log::warn!("{} is long: only its first {frames} frames and {poses} poses are used.", path.display());
            break;
        }
    }
    warn_of_damage(&recording);
    Ok((recording, frames, poses))
}

/// The sweeps of a recording that have a pose, one at a time, as often as needed: it may be larger
/// than memory.
#[derive(Debug)]
pub(super) struct SweepSource<'a> {
    /// The recording.
    pub path: &'a Path,
    /// How sweeps get their poses.
    pub observer: ObserverSettings,
}

impl SweepSource<'_> {
    /// Every sweep in order of time; then the counters, and the recording read to its end.
    pub fn each(&self, with: impl FnMut(Observation)) -> Result<(ObserverCounters, Recording)> {
        let (mut frames, poses) = (Recording::open(self.path)?, Recording::open(self.path)?);
        let config = frames.header().config.clone();
        let frame = |event| if let Event::Frame(frame) = event { Some(frame) } else { None };
        let pose = |event| if let Event::Pose(pose) = event { Some(pose) } else { None };
        let (only_frames, only_poses) = (frames.by_ref().filter_map(frame), poses.filter_map(pose));
        let counters = observe_each(&config, self.observer, only_frames, only_poses, with);
        Ok((counters, frames))
    }
}

/// Logs what could not be read.
pub(super) fn warn_of_damage(recording: &Recording) {
    if !recording.damage().is_none() {
        log::warn!("{} is damaged: {}. Everything readable was used.", recording.path().display(), recording.damage());
    }
}

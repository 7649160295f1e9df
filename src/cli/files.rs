//! What several commands do with files: settings over a recording, streams read to the end.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;

use crate::settings::Settings;
use a121::Frame;
use radar_recording::{Event, Recording};
use radar_sar::PoseSample;

/// Settings on the command line.
#[derive(Debug, Default, Args)]
pub(super) struct SettingsArguments {
    /// Settings file (TOML); without it the recording's own settings, or the user's file where there is no recording
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
    /// Changes one setting, for example --set tracking.time_offset_s=0.02; may be repeated
    #[arg(long = "set", value_name = "NAME=VALUE")]
    changes: Vec<String>,
}

impl SettingsArguments {
    /// The settings file's, else the recording's, with the changes laid over.
    pub fn over_recorded(&self, recorded: &str) -> Result<Settings> {
        let text = match &self.settings {
            Some(path) => {
                std::fs::read_to_string(path).with_context(|| format!("cannot read settings {}", path.display()))?
            }
            None => recorded.to_owned(),
        };
        Ok(Settings::from_toml(&text, &self.changes)?)
    }

    /// The file that is followed while the program runs: the one named, else the user's own, which need not be there.
    pub fn live_file(&self) -> Option<PathBuf> {
        self.settings.clone().or_else(user_settings)
    }

    /// The changes on the command line.
    pub fn changes(&self) -> &[String] {
        &self.changes
    }

    /// What a program that goes on for long begins with: a file that was named must be good; the user's own may be wrong, since whoever
    /// could mend it may not be there.
    pub fn check_live(&self, over: &[String]) -> Result<()> {
        match &self.settings {
            Some(_) => self.live(toml::Table::new()).map(drop),
            None => Ok(Settings::from_toml("", over).map(drop)?),
        }
    }

    /// The settings file's, else the user's own file's where there is one, with the changes laid over; `below` serves where
    /// none names its own.
    pub fn live(&self, below: toml::Table) -> Result<Settings> {
        let path = self.settings.clone().or_else(|| user_settings().filter(|path| path.is_file()));
        let text = match &path {
            Some(path) => {
                std::fs::read_to_string(path).with_context(|| format!("cannot read settings {}", path.display()))?
            }
            None => String::new(),
        };
        let read = Settings::from_layers(below, &text, &self.changes);
        match path {
            Some(path) => read.with_context(|| path.display().to_string()),
            None => Ok(read?),
        }
    }
}

/// Where the user's own settings are looked for.
pub(super) fn user_settings() -> Option<PathBuf> {
    user_folder("XDG_CONFIG_HOME", ".config").map(|folder| folder.join("settings.toml"))
}

/// This program's folder among the user's, by the desktop's rules.
pub(super) fn user_folder(variable: &str, below_home: &str) -> Option<PathBuf> {
    let named = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let folder = if cfg!(windows) {
        named("LOCALAPPDATA")
    } else {
        named(variable).or_else(|| named("HOME").map(|home| home.join(below_home)))
    };
    folder.map(|folder| folder.join("radar-chaperone"))
}

/// Frames and poses of a recording, each in the order of the file; damage is told once.
pub(super) fn read_streams(path: &Path) -> Result<(Recording, Vec<Frame>, Vec<PoseSample>)> {
    let mut recording = Recording::open(path)?;
    let (mut frames, mut poses) = (Vec::new(), Vec::new());
    for event in &mut recording {
        match event {
            Event::Frame(frame) => frames.push(frame),
            Event::Pose(pose) => poses.push(pose),
            Event::Hands(_) => {}
        }
    }
    warn_of_damage(&recording);
    Ok((recording, frames, poses))
}

/// Refuses to write over a file that is read, by whatever name.
pub(super) fn refuse_overwriting(out: &Path, inputs: &[&Path]) -> Result<()> {
    let same = |input: &&&Path| matches!((out.canonicalize(), input.canonicalize()), (Ok(a), Ok(b)) if a == b);
    match inputs.iter().find(same) {
        Some(input) => {
            bail!("{} is {} itself: choose another name for what is written", out.display(), input.display())
        }
        None => Ok(()),
    }
}

/// Says what could not be read.
pub(super) fn warn_of_damage(recording: &Recording) {
    if !recording.damage().is_none() {
        log::warn!("{} is damaged: {}. Everything readable was used.", recording.path().display(), recording.damage());
    }
}

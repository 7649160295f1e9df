//! `radar-chaperone recover FILE --out NEW`: saves what is readable of a damaged recording.

use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;

use super::outputs::{CommandFiles, ReplaceArgument, never};
use radar_recording::{Header, Recording, RecordingWriter};

/// Copies everything readable of a damaged recording into a new, valid one
#[derive(Debug, Args)]
pub(super) struct Recover {
    /// Damaged recording (.mcap)
    file: PathBuf,
    /// New recording
    #[arg(long, value_name = "FILE.mcap")]
    out: PathBuf,
    /// Recording of the same sensor with the same settings, where the header of the damaged one is lost
    #[arg(long, value_name = "OTHER.mcap")]
    header_of: Option<PathBuf>,
    #[command(flatten)]
    replace: ReplaceArgument,
}

impl Recover {
    pub fn run(&self) -> Result<()> {
        let other = self.header_of.as_deref();
        let inputs = other.into_iter().chain([self.file.as_path()]);
        let outputs = CommandFiles::default().reads(inputs).records([&self.out], never).check(self.replace)?;
        let mut recording = match other {
            None => Recording::open(&self.file)?,
            Some(other) => {
                let header = Recording::open(other)?.header().clone();
                Recording::open_with_header(&self.file, Header { truth: None, ..header })?
            }
        };
        let mut writer = RecordingWriter::create(&self.out, recording.header(), outputs.existing(&self.out))?;
        let mut is_empty = true;
        for event in &mut recording {
            writer.write(&event)?;
            is_empty = false;
        }
        if is_empty && !recording.damage().is_none() {
            bail!("nothing could be saved of {}: {}", self.file.display(), recording.damage());
        }
        let saved = writer.finish()?;
        match recording.damage().is_none() {
            true => outln!("{} was not damaged.", self.file.display())?,
            false => outln!("Damage: {}", recording.damage())?,
        }
        let frames = match recording.stated_frames() {
            Some(stated) if stated >= saved.frames.count => {
                let share = 100.0 * saved.frames.count as f64 / (stated as f64).max(1.0);
                format!("{} of {stated} frames ({share:.1} %)", saved.frames.count)
            }
            _ => format!("{} frames", saved.frames.count),
        };
        outln!("Saved {frames} and {} poses to {}", saved.poses.count, self.out.display())?;
        Ok(())
    }
}

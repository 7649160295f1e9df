//! `radar-chaperone recover FILE --out NEW`: saves what is readable of a damaged recording.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;

use super::files::refuse_overwriting;
use radar_recording::{Recording, RecordingWriter};

/// Copies everything readable of a damaged recording into a new, valid one
#[derive(Debug, Args)]
pub(super) struct Recover {
    /// Damaged recording (.mcap)
    file: PathBuf,
    /// New recording
    #[arg(long, value_name = "FILE.mcap")]
    out: PathBuf,
}

impl Recover {
    pub fn run(&self) -> Result<()> {
        refuse_overwriting(&self.out, &[&self.file])?;
        let mut recording = Recording::open(&self.file)?;
        let mut writer = RecordingWriter::create(&self.out, recording.header())?;
        for event in &mut recording {
            writer.write(&event)?;
        }
        let saved = writer.finish()?;
        match recording.damage().is_none() {
            true => outln!("{} was not damaged.", self.file.display())?,
            false => outln!("Damage: {}", recording.damage())?,
        }
        outln!("Saved {} frames and {} poses to {}", saved.frames.count, saved.poses.count, self.out.display())?;
        Ok(())
    }
}

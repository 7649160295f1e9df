//! `radar-chaperone info FILE`: shows what a recording contains.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;

use radar_recording::RecordingSummary;

/// Shows what a recording contains: source, sensor, streams, mount, truth, damage
#[derive(Debug, Args)]
pub(super) struct Info {
    /// Recording (.mcap)
    file: PathBuf,
}

impl Info {
    pub fn run(&self) -> Result<()> {
        outln!("{}", RecordingSummary::read(&self.file)?)?;
        Ok(())
    }
}

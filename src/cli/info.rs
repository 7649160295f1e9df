//! `radar-chaperone info FILE`: what a recording holds.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;

use radar_recording::RecordingSummary;

/// Tells what a recording holds: source, sensor, streams, mount, truth, damage
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

//! `simulate … --serve` on systems without pseudo-terminals and `poll`: fails with an explanation.

use anyhow::{Result, bail};
use clap::Args;

use radar_simulation::Scenario;

/// Arguments for serving instead of recording.
#[derive(Debug, Args)]
pub(super) struct Serve {
    /// Serves the sensor live instead of writing a recording: only on Linux and macOS
    #[arg(long, value_name = "PLACE", conflicts_with_all = ["out", "preset", "config"])]
    serve: Option<String>,
}

impl Serve {
    pub fn is_requested(&self) -> bool {
        self.serve.is_some()
    }

    pub fn require_serve(&self) -> Result<()> {
        Ok(())
    }

    pub fn run(&self, _scenario: Scenario, _duration_s: Option<f64>) -> Result<()> {
        bail!("a simulated sensor is served on Linux and macOS alone: record a simulation with --out instead")
    }
}

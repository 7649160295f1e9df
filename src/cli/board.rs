//! Shared by `record`, `run` and `doctor`: the board's arguments.

use anyhow::Result;
use clap::Args;

use a121::PortError;
use a121::find::{Candidate, boards_without_port, choose, list_ports};

/// Command-line arguments of the board.
#[derive(Debug, Clone, Args)]
pub(super) struct BoardArguments {
    /// Port of the board, or tcp:HOST[:PORT] for a Raspberry Pi; default: the most likely one
    #[arg(long, value_name = "PORT")]
    port: Option<String>,
    /// Speed of a serial port, bits per second; default: the fastest that the board supports
    #[arg(long, value_parser = clap::value_parser!(u32).range(115_200..=20_000_000))]
    pub baud: Option<u32>,
    /// Sensor on the board, from 1
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=5))]
    pub sensor: u32,
}

impl BoardArguments {
    /// Whether a port was given.
    pub fn names_port(&self) -> bool {
        self.port.is_some()
    }

    /// The given board, or the most likely one.
    pub fn choose(&self) -> Result<Candidate> {
        Ok(choose(self.port.as_deref(), &list_ports()).map_err(|error| match error {
            PortError::NoBoard { .. } => boards_without_port().into_iter().next().unwrap_or(error),
            other => other,
        })?)
    }
}

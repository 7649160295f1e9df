//! The result pages in docs/results: measured by one command, with the commit and the machine that
//! measured them.

mod calibration;
mod gpu;
mod memory;
mod page;
mod pages;
mod peers;
mod play;
mod provenance;
mod scale;
mod speed;
mod surfaces;

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Result, bail};
use radar_simulation::RecordedSensor;

pub use calibration::{jumping, wandering};
pub use page::Page;
pub use pages::benchmark_page;
pub use peers::{DenseJob, peers_table};
pub use play::{PlayOutcome, curve_chart, curve_page_body, curve_table, played};
pub use provenance::Provenance;
pub use speed::whole_pipeline_share;

/// How much is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extent {
    /// What the documented figures need.
    Full,
    /// A few seeds and seconds: shows that a page can be made, not a figure.
    Quick,
}

impl Extent {
    /// One value or the other.
    pub(crate) fn choose<T>(self, full: T, quick: T) -> T {
        match self {
            Self::Full => full,
            Self::Quick => quick,
        }
    }
}

/// The program, which is built beside this one.
///
/// # Errors
/// It is missing.
fn program() -> Result<PathBuf> {
    let program =
        std::env::current_exe()?.with_file_name("radar-chaperone").with_extension(std::env::consts::EXE_EXTENSION);
    if !program.is_file() {
        bail!("{} is missing: build it with cargo build --release", program.display());
    }
    Ok(program)
}

/// A result page that the lab can make.
#[derive(Debug, Clone, Copy)]
pub struct ResultsPage {
    /// Name of the page's file without `.md`.
    pub name: &'static str,
    /// What it measures.
    pub about: &'static str,
    /// Whether it measures times, so that nothing else may run beside it.
    pub is_timed: bool,
    make: fn(&Measuring) -> Result<Page>,
}

/// How a page is measured.
#[derive(Debug, Clone)]
pub struct Measuring {
    /// How much.
    pub extent: Extent,
    /// Jitter and noise of a recorded sensor, for the page that compares it with the model's.
    pub recorded: Option<Arc<RecordedSensor>>,
}

impl ResultsPage {
    /// Measures and returns the page.
    ///
    /// # Errors
    /// Simulations that fail, pictures that cannot be encoded.
    pub fn make(&self, measuring: &Measuring) -> Result<Page> {
        let mut page = (self.make)(measuring)?;
        let quick = measuring.extent.choose("", " --quick");
        page.command = format!("results {}{quick}", self.name);
        Ok(page)
    }
}

/// Every page.
pub const PAGES: [ResultsPage; 12] = [
    ResultsPage {
        name: "reflectors",
        about: "position of a reflector, pairs, time offset",
        is_timed: false,
        make: |measuring| pages::reflectors(measuring.extent),
    },
    ResultsPage {
        name: "rooms",
        about: "furnished rooms of 30 s, false alarms on noise",
        is_timed: false,
        make: |measuring| pages::rooms(measuring.extent),
    },
    ResultsPage {
        name: "play",
        about: "warnings in play sessions",
        is_timed: false,
        make: |measuring| play::page(measuring.extent),
    },
    ResultsPage {
        name: "living",
        about: "warnings in living rooms of surfaces, by headset",
        is_timed: false,
        make: |measuring| surfaces::living(measuring.extent),
    },
    ResultsPage {
        name: "realism",
        about: "what each assumption of the simulation costs",
        is_timed: false,
        make: |measuring| surfaces::realism(measuring.extent, measuring.recorded.as_ref()),
    },
    ResultsPage {
        name: "calibration",
        about: "mount, time offset, mistakes, jumps and drift from play, and what they cost",
        is_timed: false,
        make: |measuring| calibration::calibration(measuring.extent),
    },
    ResultsPage {
        name: "experiments",
        about: "the thesis' experiments repeated",
        is_timed: true,
        make: |measuring| pages::experiments(measuring.extent),
    },
    ResultsPage {
        name: "benchmark",
        about: "run time against error",
        is_timed: true,
        make: |measuring| pages::benchmark(measuring.extent),
    },
    ResultsPage {
        name: "speed",
        about: "backprojection beside plain C, processor time of the pipeline, latency beside a frame loop",
        is_timed: true,
        make: |measuring| speed::page(measuring.extent),
    },
    ResultsPage {
        name: "gpu",
        about: "dense volumes on the graphics card beside the processor",
        is_timed: true,
        make: |measuring| gpu::page(measuring.extent),
    },
    ResultsPage {
        name: "memory",
        about: "peak memory of the commands over recordings made to swell",
        is_timed: false,
        make: |measuring| memory::page(measuring.extent),
    },
    ResultsPage {
        name: "scale",
        about: "growth of time and memory: a house, hours, voxels, sweeps, range",
        is_timed: true,
        make: |measuring| scale::page(measuring.extent),
    },
];

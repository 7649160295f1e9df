//! The result pages in docs/results: measured by one command, with the commit and the machine that
//! measured them.

mod gpu;
mod page;
mod pages;
mod play;
mod provenance;
mod speed;

use anyhow::Result;

pub use page::Page;
pub use pages::benchmark_page;
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

/// A result page that the lab can make.
#[derive(Debug, Clone, Copy)]
pub struct ResultsPage {
    /// Name of the page's file without `.md`.
    pub name: &'static str,
    /// What it measures.
    pub about: &'static str,
    /// Whether it measures times, so that nothing else may run beside it.
    pub is_timed: bool,
    make: fn(Extent) -> Result<Page>,
}

impl ResultsPage {
    /// Measures and returns the page.
    ///
    /// # Errors
    /// Simulations that fail, pictures that cannot be encoded.
    pub fn make(&self, extent: Extent) -> Result<Page> {
        let mut page = (self.make)(extent)?;
        let quick = extent.choose("", " --quick");
        page.command = format!("results {}{quick}", self.name);
        Ok(page)
    }
}

/// Every page.
pub const PAGES: [ResultsPage; 7] = [
    ResultsPage {
        name: "reflectors",
        about: "position of a reflector, pairs, time offset",
        is_timed: false,
        make: pages::reflectors,
    },
    ResultsPage {
        name: "rooms",
        about: "furnished rooms of 30 s, false alarms on noise",
        is_timed: false,
        make: pages::rooms,
    },
    ResultsPage { name: "play", about: "warnings in play sessions", is_timed: false, make: play::page },
    ResultsPage {
        name: "experiments",
        about: "the thesis' experiments repeated",
        is_timed: true,
        make: pages::experiments,
    },
    ResultsPage { name: "benchmark", about: "run time against error", is_timed: true, make: pages::benchmark },
    ResultsPage {
        name: "speed",
        about: "processor time of the pipeline, latency beside a frame loop",
        is_timed: true,
        make: speed::page,
    },
    ResultsPage {
        name: "gpu",
        about: "dense volumes on the graphics card beside the processor",
        is_timed: true,
        make: gpu::page,
    },
];

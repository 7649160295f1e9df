//! `lab results`: measures the documented figures and writes docs/results.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail};
use clap::Args;

use super::{check_targets, recorded_sensor};
use lab::results::{Extent, Measuring, PAGES, Provenance, ResultsPage, whole_pipeline_share};
use radar_chaperone::outln;

/// Measures the documented figures and writes the pages of docs/results
///
/// Each page names the commit, the machine and the command that made it. All pages take about an
/// hour on two cores. Pages with times need a machine on which nothing else runs.
#[derive(Debug, Args)]
pub struct ResultsCommand {
    /// Names of pages, or `all`; without names, lists them
    names: Vec<String>,
    /// Folder to write into
    #[arg(long, value_name = "DIR", default_value = "docs/results")]
    out: PathBuf,
    /// A few seeds and seconds: shows that pages can be made, not their figures
    #[arg(long)]
    quick: bool,
    /// Recordings of the sensor at rest (.h5 of the vendor), whose jitter and noise the page
    /// realism also plays with
    #[arg(long, value_name = "FILE", value_delimiter = ',')]
    sensor_recording: Vec<PathBuf>,
    /// Prints the whole pipeline's share of a core for one scene, percent, and ends
    #[arg(long, value_name = "SCENE", hide = true, conflicts_with = "names")]
    whole_pipeline: Option<String>,
    /// Length of that recording, seconds
    #[arg(long, default_value_t = 30.0, hide = true)]
    seconds: f64,
}

impl ResultsCommand {
    /// Measures and writes.
    ///
    /// # Errors
    /// Names that do not exist, simulations that fail, files that cannot be written.
    pub fn run(&self) -> Result<()> {
        if let Some(scene) = &self.whole_pipeline {
            return outln!("{}", whole_pipeline_share(scene, self.seconds)?);
        }
        let wanted = self.wanted()?;
        if wanted.is_empty() {
            return PAGES.iter().try_for_each(|page| {
                let timed = if page.is_timed { " (measures times)" } else { "" };
                outln!("{:<14}{}{timed}", page.name, page.about)
            });
        }
        check_targets(None, Some(&self.out), &[])?;
        let provenance = Provenance::here();
        let extent = if self.quick { Extent::Quick } else { Extent::Full };
        let measuring = Measuring { extent, recorded: recorded_sensor(&self.sensor_recording)? };
        for page in wanted {
            let start = Instant::now();
            let made = page.make(&measuring)?;
            made.write(&self.out, page.name, &provenance, start.elapsed())?;
            let path = self.out.join(format!("{}.md", page.name));
            outln!("Written to {} in {:.0} s", path.display(), start.elapsed().as_secs_f64())?;
        }
        Ok(())
    }

    fn wanted(&self) -> Result<Vec<&'static ResultsPage>> {
        if self.names.iter().any(|name| name == "all") {
            return Ok(PAGES.iter().collect());
        }
        let known = |name: &String| match PAGES.iter().find(|page| page.name == *name) {
            Some(page) => Ok(page),
            None => {
                let names: Vec<&str> = PAGES.iter().map(|page| page.name).collect();
                bail!("there is no page \"{name}\": use {} or all", names.join(", "))
            }
        };
        self.names.iter().map(known).collect()
    }
}

//! `lab experiment`: repeats the thesis' experiments, with figures.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use clap::Args;

use lab::experiments::{EXPERIMENTS, Experiment, Outcome, experiments_markdown, experiments_report};
use lab::results::{Page, Provenance};
use radar_chaperone::app::progress;
use radar_chaperone::outln;
use radar_chaperone::report::write_atomically;

/// Repeats the thesis' experiments and states which of its findings hold
///
/// Everything is simulated, so the truth is known. Writes report.html, one file with everything in
/// it, report.md, its findings and tables, and for each experiment a folder of pictures (PNG),
/// tables (CSV) and, for other tools, volumes (.npy, each with a .json) and point clouds (.ply).
#[derive(Debug, Args)]
pub struct ExperimentCommand {
    /// Names of experiments, or `all`; without names, lists them
    names: Vec<String>,
    /// Folder to write into
    #[arg(long, value_name = "DIR", default_value = "experiments")]
    out: PathBuf,
    /// Recordings of each kind over which medians are taken
    #[arg(long, default_value_t = 6, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: u64,
}

/// Steps of the progress bar per experiment. Choice: per cent.
const STEPS: u64 = 100;

impl ExperimentCommand {
    /// Runs the experiments and writes their report.
    ///
    /// # Errors
    /// Names that do not exist, trials that fail, files that cannot be written.
    pub fn run(&self) -> Result<()> {
        let wanted = self.wanted()?;
        if wanted.is_empty() {
            return EXPERIMENTS.iter().try_for_each(|one| outln!("{:<16}{} ({})", one.name, one.title, one.section));
        }
        let mut done: Vec<(&Experiment, Outcome)> = Vec::new();
        let start = Instant::now();
        let bar = progress::bar(wanted.len() as u64 * STEPS, "");
        for (n, experiment) in wanted.iter().enumerate() {
            bar.set_message(format!("{} of {}: {}", n + 1, wanted.len(), experiment.name));
            let began = Instant::now();
            let report = |share: f64| bar.set_position(n as u64 * STEPS + (share * STEPS as f64) as u64);
            report(0.0);
            let outcome = experiment.run(self.seeds, &report)?;
            bar.suspend(|| print_outcome(experiment, &outcome, began.elapsed().as_secs_f64()))?;
            write(&self.out.join(experiment.name), &outcome)?;
            done.push((experiment, outcome));
        }
        bar.finish_and_clear();
        Page::new("The thesis' experiments repeated", &self.command()).markdown(&experiments_markdown(&done)).write(
            &self.out,
            "report",
            &Provenance::here(),
            start.elapsed(),
        )?;
        let path = self.out.join("report.html");
        experiments_report(&done)?.write(&path)?;
        outln!("Written to {}", path.display())
    }

    /// What makes the same report.
    fn command(&self) -> String {
        format!("experiment {} --seeds {}", self.names.join(" "), self.seeds)
    }

    fn wanted(&self) -> Result<Vec<&'static Experiment>> {
        if self.names.iter().any(|name| name == "all") {
            return Ok(EXPERIMENTS.iter().collect());
        }
        let known = |name: &String| match EXPERIMENTS.iter().find(|experiment| experiment.name == *name) {
            Some(experiment) => Ok(experiment),
            None => {
                let names: Vec<&str> = EXPERIMENTS.iter().map(|experiment| experiment.name).collect();
                bail!("there is no experiment \"{name}\": use {} or all", names.join(", "))
            }
        };
        self.names.iter().map(known).collect()
    }
}

fn print_outcome(experiment: &Experiment, outcome: &Outcome, took_s: f64) -> Result<()> {
    outln!("{} (section {}), {took_s:.1} s", experiment.title, experiment.section)?;
    for finding in &outcome.findings {
        outln!("  {:<15} {}", format!("{}:", finding.verdict()), finding.thesis)?;
        outln!("                  {}", finding.ours)?;
    }
    Ok(())
}

fn write(folder: &Path, outcome: &Outcome) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    for drawn in &outcome.pictures {
        drawn.picture.write(&folder.join(format!("{}.png", drawn.name)))?;
    }
    for file in &outcome.files {
        write_atomically(&folder.join(&file.name), &file.bytes)?;
    }
    write_atomically(&folder.join("findings.csv"), outcome.findings_table().csv().as_bytes())?;
    for (n, table) in outcome.tables.iter().enumerate() {
        write_atomically(&folder.join(format!("table-{}.csv", n + 1)), table.csv().as_bytes())?;
    }
    Ok(())
}

//! `radar-chaperone benchmark [--json FILE] [--out DIR] [--quick]`: run time against error, as a table and a plot.
//! `… --play`: play sessions.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;

use super::play_sessions::PlaySessions;
use super::progress;
use crate::experiments::{Benchmark, Plan, Row, present};
use crate::imaging::backprojection::instruction_set;
use crate::report::write_atomically;

/// Measures run time against error: every statistic, voxel size, number and choice of sweeps, dense and adaptive, fresh and
/// rolling
///
/// Images simulated recordings of a corner reflector 1 m away and compares the place found with the truth. The time is that
/// of one image on all cores: from raw sweeps over tables and search to the place, refinement included where it is done;
/// choosing the sweeps is not in it. Time and error are medians over the seeds. Rows with a * are on the front: no other is
/// both faster and nearer the truth. Takes one to two minutes. With --play: simulated players in furnished rooms instead, and what
/// the warnings are worth to them.
#[derive(Debug, Args)]
pub(super) struct BenchmarkCommand {
    /// Writes the rows as a JSON list
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Folder for benchmark.png and benchmark.md; with --play for play.md and, with --odds, play.png
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// A few cases and seeds: seconds
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    play: PlaySessions,
}

impl BenchmarkCommand {
    pub fn run(&self) -> Result<()> {
        self.check_targets()?;
        if self.play.is_asked() {
            return self.play.run(self.quick, self.json.as_deref(), self.out.as_deref());
        }
        let benchmark = Benchmark::new(if self.quick { Plan::quick() } else { Plan::full() })?;
        let bar = progress::bar(benchmark.cases() as u64, "measuring");
        let rows = benchmark.run(|row| {
            log::info!("{}: {:.3} ms, {:.1} mm", row.case.name(), row.median_s * 1e3, row.error_m * 1e3);
            bar.inc(1);
        })?;
        bar.finish_and_clear();
        let (threads, instructions) = (rayon::current_num_threads(), instruction_set());
        let machine = format!("{threads} threads, {instructions}");
        say!("{}", present::table(&rows).aligned())?;
        say!("On {machine}. *: no other row of these recordings is both faster and nearer the truth.")?;
        if let Some(folder) = &self.out {
            present::plot(&rows, &machine).draw().write(&folder.join("benchmark.png"))?;
            write_atomically(&folder.join("benchmark.md"), markdown(&rows, &machine).as_bytes())?;
            say!("Written to {}", folder.display())?;
        }
        if let Some(path) = &self.json {
            let text = serde_json::to_string_pretty(&present::json(&rows, threads, instructions))?;
            write_atomically(path, (text + "\n").as_bytes())?;
            say!("Written to {}", path.display())?;
        }
        Ok(())
    }

    /// What cannot be written is refused before minutes of work.
    fn check_targets(&self) -> Result<()> {
        if let Some(folder) = &self.out {
            make_folder(folder)?;
        }
        let Some(json) = &self.json else { return Ok(()) };
        if json.is_dir() || json.file_name().is_none() {
            bail!("--json {}: give the name of a file", json.display());
        }
        let ours = |folder: &PathBuf| {
            ["benchmark.png", "benchmark.md", "play.png", "play.md"].iter().any(|name| folder.join(name) == *json)
        };
        if self.out.as_ref().is_some_and(ours) {
            bail!("--json {}: a file of --out has this name: choose another", json.display());
        }
        match json.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            Some(folder) => make_folder(folder),
            None => Ok(()),
        }
    }
}

fn make_folder(folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make folder {}", folder.display()))
}

fn markdown(rows: &[Row], machine: &str) -> String {
    let front: Vec<Row> = rows.iter().filter(|row| row.on_front).cloned().collect();
    format!(
        "# Run time against error\n\nMade by `radar-chaperone benchmark --out DIR` on {machine}. Time: one image, from raw \
         sweeps to the place. Error: distance from the truth, median and 95th percentile over seeds. `adaptive`: the voxels of \
         at least half of the peak; `peak`: the greatest alone; `window`, `rolling`: the newest sweeps, after every sweep, \
         fresh or from the image before.\n\n![Run time against error](benchmark.png)\n\n## The front\n\n{}\n## All\n\n{}",
        present::table(&front).markdown(),
        present::table(rows).markdown()
    )
}

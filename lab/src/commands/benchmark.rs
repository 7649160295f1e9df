//! `lab benchmark [--json FILE] [--out DIR] [--quick]`: run time against error, as a table and a
//! plot; with `--peers`, dense backprojection beside plain C.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Result;
use clap::Args;

use super::check_targets;
use lab::experiments::{Benchmark, Plan, present};
use lab::results::{DenseJob, Extent, Provenance, benchmark_page, peers_table};
use radar_chaperone::app::progress;
use radar_chaperone::outln;
use radar_chaperone::report::write_atomically;
use radar_sar::{InstructionSet, Statistic};

/// Measures run time against error: every statistic, voxel size, number and choice of sweeps, dense
/// and adaptive, fresh and rolling
///
/// Images simulated recordings of a corner reflector 1 m away and compares the estimated position
/// with the truth. The time is that of one image on all cores, from raw sweeps over tables and
/// search to the position, including refinement where it is done; choosing the sweeps is not
/// included. Time and error are medians over the seeds. Rows with a * are on the Pareto front: no
/// other row is both faster and more accurate. Takes one to two minutes.
#[derive(Debug, Args)]
pub struct BenchmarkCommand {
    /// Writes the rows as a JSON list
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Folder for benchmark.png and benchmark.md
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Only a few cases and seeds: seconds
    #[arg(long)]
    quick: bool,
    /// Measures dense backprojection beside plain C instead, with each instruction set of this processor
    #[arg(long, conflicts_with_all = ["json", "out"])]
    peers: bool,
    /// Prints the seconds of one dense volume of this statistic and ends
    #[arg(long, value_name = "STATISTIC", hide = true)]
    dense: Option<Statistic>,
    #[arg(long, default_value_t = 128, hide = true)]
    voxels: u32,
    #[arg(long, default_value_t = 100, hide = true)]
    sweeps: usize,
    #[arg(long, default_value_t = 321, hide = true)]
    points: usize,
    #[arg(long, hide = true)]
    from_raw_sweeps: bool,
}

impl BenchmarkCommand {
    /// Measures, prints the table and writes it.
    ///
    /// # Errors
    /// Trials that fail, files that cannot be written.
    pub fn run(&self) -> Result<()> {
        let extent = if self.quick { Extent::Quick } else { Extent::Full };
        if let Some(statistic) = self.dense {
            let &Self { voxels, sweeps, points, from_raw_sweeps, .. } = self;
            return outln!("{:.9}", DenseJob { statistic, voxels, sweeps, points, from_raw_sweeps }.seconds());
        }
        if self.peers {
            let table = peers_table(extent)?;
            return outln!("{}\n{}", table.aligned(), table.caption);
        }
        check_targets(self.json.as_deref(), self.out.as_deref(), &["benchmark.png", "benchmark.md"])?;
        let start = Instant::now();
        let benchmark = Benchmark::new(if self.quick { Plan::quick() } else { Plan::full() })?;
        let bar = progress::bar(benchmark.cases() as u64, "measuring");
        let rows = benchmark.run(|row| {
            log::info!("{}: {:.3} ms, {:.1} mm", row.case.name(), row.median_s * 1e3, row.error_m * 1e3);
            bar.inc(1);
        })?;
        bar.finish_and_clear();
        let (threads, instructions) = (rayon::current_num_threads(), InstructionSet::in_use());
        let machine = format!("{threads} threads, {instructions}");
        outln!("{}", present::table(&rows).aligned())?;
        outln!("On {machine}. *: no other row of these recordings is both faster and nearer the truth.")?;
        if let Some(folder) = &self.out {
            let command = if self.quick { "benchmark --quick --out DIR" } else { "benchmark --out DIR" };
            benchmark_page(&rows, command)?.write(folder, "benchmark", &Provenance::here(), start.elapsed())?;
            outln!("Written to {}", folder.display())?;
        }
        if let Some(path) = &self.json {
            let text = serde_json::to_string_pretty(&present::json(&rows, threads, &instructions.to_string()))?;
            write_atomically(path, (text + "\n").as_bytes())?;
            outln!("Written to {}", path.display())?;
        }
        Ok(())
    }
}

//! Pages about accuracy, and those that present the experiments and the benchmark.

use anyhow::Result;

use super::{Extent, Page};
use crate::experiments::accuracy::{
    REFLECTOR_TRIALS, ReflectorOptions, RoomTrial, correction_table, pair_table, reflector_table, room_table,
    split_table, time_offset_table,
};
use crate::experiments::{Benchmark, EXPERIMENTS, NoiseAlarms, Plan, Row, experiments_markdown, present};
use a121::PRESETS;
use radar_chaperone::settings::Settings;
use radar_sar::InstructionSet;

const SIMULATED: &str = "All from simulation: 20 dB SNR at 1 m unless a row says otherwise, default tracking errors (0.3 mm \
    jitter, 1 mm drift in each axis, 2 mm mount, 0.1° rotation).";

/// Position of a reflector, pairs, time offset.
pub(super) fn reflectors(extent: Extent) -> Result<Page> {
    let trials = &REFLECTOR_TRIALS[..extent.choose(REFLECTOR_TRIALS.len(), 1)];
    let options = ReflectorOptions {
        seeds: 2000..extent.choose(2200, 2003),
        without: None,
        near: true,
        by_axis: false,
        unknown_wander_m: None,
    };
    let page = Page::new("Position of a reflector", "")
        .text(SIMULATED)
        .heading("One corner reflector")
        .text("Seeds that nothing was tuned on. The preset is `fine`; a sphere is the space in which the head moves.")
        .table(&reflector_table(trials, &options))
        .text(
            "Ratios to the bound of ranges below 1 are possible: phase is used as well. On a straight line (x-50cm, \
             approach-1.0) one direction is not observed, and the error along it is as wide as the beam. The filter \
             assumes no drift faster than about half a hertz (`tracking.errors.wander_s`), as in the simulator: \
             faster drift makes covariances too small.",
        )
        .heading("Two equal reflectors 20 cm apart across range")
        .table(&pair_table(&(100..extent.choose(140, 102))))
        .heading("One reflector reported as more than one")
        .table(&split_table(&(100..extent.choose(140, 101))));
    let names: Vec<String> = extent.choose(Vec::new(), vec!["stationary".into()]);
    Ok(page
        .heading("Time offset between poses and sweeps")
        .table(&time_offset_table(&(200..extent.choose(220, 201)), &names))
        .heading("Position with the offset corrected")
        .text("A corner reflector, 50 cm sphere, 10 s.")
        .table(&correction_table(&(200..extent.choose(220, 201)))))
}

/// Furnished rooms, and noise alone.
pub(super) fn rooms(extent: Extent) -> Result<Page> {
    let settings = Settings::from_toml("", &[])?;
    let trial = RoomTrial { scene: "furnished-room".into(), poses_hz: None, settings };
    let scores = trial.scores(&(600..extent.choose(624, 601)))?;
    let presets: Vec<String> = extent.choose(PRESETS.to_vec(), vec!["d16"]).into_iter().map(str::to_owned).collect();
    let alarms = NoiseAlarms::of(&presets, &extent.choose(1..17, 1..3), extent.choose(40.0, 0.2))?;
    let page = Page::new("Rooms", "")
        .text(SIMULATED)
        .heading("Furnished rooms")
        .text("Natural play of 30 s, preset d16, seeds 600 to 623, on which nothing was tuned or trained.")
        .table(&room_table(&scores))
        .heading("Receiver noise alone")
        .text(
            "Natural head motion in empty space, through the whole mapper. An alarm is a score above a threshold; \
             scores within 30 cm and one second of it belong to it.",
        )
        .table(&alarms.measured())
        .heading("Scores that keep a rate of false candidates")
        .text("From the tail of a score on noise and the number of independent cells per hour.")
        .table(&alarms.rates_from_tail())
        .heading("Stated rates against measured ones")
        .text("Thresholds from the first half of the seeds, alarms counted in the second half; bounds at 95 %.")
        .table(&alarms.stated_against_measured());
    Ok(match alarms.without_subapertures() {
        [] => page,
        names => page.text(&format!(
            "Not in these tables: {}. They give too few sweeps for a sub-aperture and use the reflector search.",
            names.join(", ")
        )),
    })
}

/// The thesis' experiments.
pub(super) fn experiments(extent: Extent) -> Result<Page> {
    let seeds = extent.choose(6, 1);
    let wanted = &EXPERIMENTS[..extent.choose(EXPERIMENTS.len(), 1)];
    let done = wanted
        .iter()
        .map(|experiment| Ok((experiment, experiment.run(seeds, &|_| ())?)))
        .collect::<Result<Vec<_>>>()?;
    Ok(Page::new("The thesis' experiments repeated", "")
        .text("`lab experiment all` also draws the pictures and writes the volumes.")
        .markdown(&experiments_markdown(&done)))
}

/// Run time against error.
pub(super) fn benchmark(extent: Extent) -> Result<Page> {
    let rows = Benchmark::new(extent.choose(Plan::full(), Plan::quick()))?.run(|_| ())?;
    benchmark_page(&rows, "")
}

/// The page of a benchmark's rows.
///
/// # Errors
/// The plot cannot be encoded.
pub fn benchmark_page(rows: &[Row], command: &str) -> Result<Page> {
    let machine = format!("{} threads, {}", rayon::current_num_threads(), InstructionSet::in_use());
    let front: Vec<Row> = rows.iter().filter(|row| row.on_front).cloned().collect();
    Ok(Page::new("Run time against error", command)
        .text(
            "Simulated recordings of one reflector, imaged in many ways. Time: one image, from raw sweeps to the \
             position, without choosing the sweeps. Error: distance from the truth, median and 95th percentile over \
             seeds. `adaptive`: the voxels of at least half of the peak; `peak`: the greatest alone; `window`, \
             `rolling`: the newest sweeps, after every sweep, fresh or from the image before. Rows on the front: no \
             other row is both faster and more accurate.",
        )
        .picture("benchmark", "Run time against error", &present::plot(rows, &machine).draw())?
        .heading("The front")
        .table(&present::table(&front))
        .heading("All")
        .table(&present::table(rows)))
}
